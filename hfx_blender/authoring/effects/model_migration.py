# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfers areas painted on earlier editions of the body models to the present ones.

An area is a list of vertices of one edition. Of each edition that files may still have, a data
file keeps where its vertices were.
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


FILE: Final = "earlier-editions.npz"
STEP_M: Final = 1e-4


@dataclass(frozen=True, eq=False)
class EarlierModel:
    """Earlier edition of a model: enough to carry an area over from it."""

    vertices: F64  # (V, 3) metres, canonical rest space
    part: npt.NDArray[np.int64]  # (V,)
    areas_m2: F64  # (V,) all alike


def load(model_id: str, content_hash: str) -> EarlierModel | None:
    """Load an earlier edition of a model; None if it is unknown."""
    import numpy as np

    key = f"{model_id}.{content_hash}"
    if key not in known():
        return None
    with np.load(resources.body_models() / FILE) as data:
        places, part = data[f"{key}.places"], data[f"{key}.part"]
    return EarlierModel(
        places.astype(np.float64) * STEP_M, part.astype(np.int64), np.ones(len(places))
    )


@lru_cache(maxsize=1)
def known() -> frozenset[str]:
    """Editions that are stored, as ``MODEL_ID.HASH``."""
    path = resources.body_models() / FILE
    if not path.is_file():
        return frozenset()
    with zipfile.ZipFile(path) as archive:
        return frozenset(Path(name).stem.rpartition(".")[0] for name in archive.namelist())


def carried_over(
    model_id: str, content_hash: str, vertices: list[int], weights: list[float]
) -> F64 | None:
    """Transfer an area from an earlier edition: weights (V,) on the present one; None if unknown.

    Raises
    ------
    InputError
        The area is not one of that edition.
    """
    import numpy as np

    from ...engine.body import areas
    from ...engine.body.model import load_model

    earlier = load(model_id, content_hash)
    if earlier is None:
        return None
    ids, values = effects.checked_area("?", vertices, weights, len(earlier.vertices))
    painted = np.zeros(len(earlier.vertices))
    painted[ids] = values
    return areas.transferred(earlier, painted, load_model(model_id))


def reason_not_carried(model_id: str, content_hash: str) -> str:
    """State why an area on an earlier edition was not carried over, as the end of a sentence."""
    if f"{model_id}.{content_hash}" not in known() or find_spec("scipy") is not None:
        return ""
    return "; carrying it over needs the Python package scipy, which this Blender lacks"


def update_all() -> list[str]:
    """Carry over the areas of all effects that were painted on earlier editions; their names."""
    found = []
    for effect in bpy.data.objects:
        hfx = effect.hfx
        if hfx.role != "EFFECT" or f"{hfx.model_id}.{hfx.model_hash}" not in known():
            continue
        try:
            weights = carried_over(hfx.model_id, hfx.model_hash, *effects.area(effect))
        except (HfxError, ModuleNotFoundError, TypeError):  # an export reports the fault
            continue
        if weights is not None and effects.model_id_for(hfx.modality) == hfx.model_id:
            effects.store_weights(effect, weights)
            found.append(effect.name)
    return found
