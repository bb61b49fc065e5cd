# SPDX-License-Identifier: GPL-3.0-or-later
"""Canonical models on the avatars of installed body variants; exact, without a fit."""

from __future__ import annotations

import numpy as np

from ..body import model_library
from ..body.model import AVATAR_ID, Avatar, load_model
from ..scene import FittedModel, SurfaceAnchors


def people() -> list[model_library.Entry]:
    """Avatar entries of the variants installed by the user, sorted by folder."""
    return [entry for entry in model_library.installed()[0] if entry.kind == "avatar"]


def fitted_to(avatar: Avatar) -> list[FittedModel]:
    """Every shipped model on the skin of a variant, in the order of the manifest, with canonical
    ids. Raises InputError: a model of the variant is missing or of another edition."""
    suffix = avatar.id.removeprefix(AVATAR_ID)
    fitted = []
    for entry in model_library.shipped():
        if entry.kind != "model":
            continue
        model = load_model(entry.id + suffix)
        owner = model_library.owner_of_ids(model.id, model.provenance)
        fitted.append(
            FittedModel(
                model_id=owner.id,
                model_hash=owner.content_hash,
                vertices=model.vertices,
                bone_names=model.bone_names,
                weights=model.weights,
                anchors=SurfaceAnchors(
                    model.avatar_vertices,
                    model.avatar_weights.astype(np.float64),
                    model.avatar_offset_m.astype(np.float64),
                ),
            )
        )
    return fitted
