# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfer of areas painted on earlier editions of the perceptual models to the present editions.

Areas refer to vertices of one edition. A data file stores the vertices of earlier editions.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

import bpy

from ...errors import HfxError
from ...files import resources
from . import effects

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ...engine.arrays import F64
    from ...engine.body.model import PerceptualModel


FILE: Final = "earlier-editions.npz"
STEP_M: Final = 1e-4  # unit of stored coordinates


@dataclass(frozen=True, eq=False)
class EarlierModel:
    """Geometry of an earlier edition of a model."""

    vertices: F64  # (V, 3) metres, canonical rest space
    part: npt.NDArray[np.int64]  # (V,)
    areas_m2: F64  # (V,) equal values


def load(model_id: str, content_hash: str) -> EarlierModel | None:
    """Earlier edition of a model from the data file, with all areas 1; None if not stored there."""
    import numpy as np

    key = f"{model_id}.{content_hash}"
    if key not in known_editions():
        return None
    # Coordinates are stored as whole tenths of a millimetre; areas are not stored.
    with np.load(resources.body_models() / FILE) as data:
        places, part = data[f"{key}.places"], data[f"{key}.part"]
    return EarlierModel(
        places.astype(np.float64) * STEP_M, part.astype(np.int64), np.ones(len(places))
    )


@lru_cache(maxsize=1)
def known_editions() -> frozenset[str]:
    """Stored editions, as ``MODEL_ID.HASH``; empty without the data file."""
    path = resources.body_models() / FILE
    if not path.is_file():
        return frozenset()
    with zipfile.ZipFile(path) as archive:
        return frozenset(Path(name).stem.rpartition(".")[0] for name in archive.namelist())


def transferred_area(
    model_id: str,
    content_hash: str,
    vertices: list[int],
    weights: list[float],
    target: PerceptualModel,
) -> F64 | None:
    """Weights (V,) on ``target`` of an area of an earlier edition, or of an installed model; None
    for an unknown edition. Raises InputError: the area does not fit that edition."""
    import numpy as np

    from ...engine.body import areas, model_library
    from ...engine.body.model import load_model

    earlier: EarlierModel | PerceptualModel | None = load(model_id, content_hash)
    installed = (*model_library.shipped(), *model_library.installed()[0])
    if earlier is None and (model_id, content_hash) in ((m.id, m.content_hash) for m in installed):
        earlier = load_model(model_id)
    if earlier is None:
        return None
    ids, values = effects.checked_area("?", vertices, weights, len(earlier.vertices))
    painted = np.zeros(len(earlier.vertices))
    painted[ids] = values
    return areas.transferred(earlier, painted, target)


def missing_scipy_reason(model_id: str, content_hash: str) -> str:
    """End of a message if only scipy is missing for the transfer of an area; else ""."""
    if f"{model_id}.{content_hash}" not in known_editions() or find_spec("scipy") is not None:
        return ""
    return "; carrying it over needs the Python package scipy, which this Blender lacks"


def update_all() -> list[str]:
    """Transfer the areas of all effects from earlier editions; return the effects' names. Areas
    with faults are skipped, and reported by exports."""
    names = []
    for effect in bpy.data.objects:
        hfx = effect.hfx
        if hfx.role != "EFFECT" or f"{hfx.model_id}.{hfx.model_hash}" not in known_editions():
            continue
        try:
            # An area on another model than the effect's is left unchanged.
            model = effects.model_of(effect)
            if model.id != hfx.model_id:
                continue
            stored = effects.area(effect)
            weights = transferred_area(hfx.model_id, hfx.model_hash, *stored, model)
        except (HfxError, ModuleNotFoundError, TypeError):  # an export reports the fault
            continue
        if weights is not None:
            effects.store_weights(effect, weights)
            names.append(effect.name)
    return names
