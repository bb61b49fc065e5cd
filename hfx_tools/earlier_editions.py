# SPDX-License-Identifier: GPL-3.0-or-later
"""Earlier editions of body models, stored for areas painted on them."""

from __future__ import annotations

import numpy as np

from hfx_blender.authoring.effects import model_migration
from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.files import resources


def keep(model: PerceptualModel) -> None:
    """Store an edition of a shipped model before its replacement."""
    path = resources.body_models() / model_migration.FILE
    data = dict(np.load(path)) if path.is_file() else {}
    key = f"{model.id}.{model.content_hash}"
    data[f"{key}.places"] = np.round(model.vertices / model_migration.STEP_M).astype(np.int16)
    data[f"{key}.part"] = model.part.astype(np.uint8)
    np.savez_compressed(path, **data)
    model_migration.known_editions.cache_clear()
