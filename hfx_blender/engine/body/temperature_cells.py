# SPDX-License-Identifier: GPL-3.0-or-later
"""Skin cells of the temperature model: the patch of skin represented by each vertex.

Temperature thresholds (150 mm) exceed the girth of limbs, so cells are geodesic patches, sampled
by the vertices of the pressure model.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import I32, NPZ_DAMAGE
from . import model_library
from .model import PerceptualModel

CELLS_FILE: Final = "cells.npz"


def cell_of_skin(model: PerceptualModel) -> tuple[str, I32]:
    """Pressure model to sample a temperature model's skin, and the geodesic cell of each vertex.

    ``model`` is canonical, fitted to an avatar, or of other thresholds.

    Returns
    -------
    fine : str
        Id of the pressure model, of the same variant as ``model``.
    owner : (V,) int32, read-only
        For each vertex of the pressure model, the vertex of ``model`` with the cell around it; same
        body part. Every cell has at least one vertex; cells of limbs have dozens.

    Raises
    ------
    InputError
        No cells are stored for the model, or the cells are of another edition.
    """
    origin = model_library.owner_of_ids(model.id, model.provenance)
    path = origin.folder / CELLS_FILE
    owner_model, fine, owner = _read(path) if path.is_file() else (("", ""), "", None)
    if owner is None or owner_model[0] != origin.id:
        raise InputError(
            f"Body model '{model.id}' has no skin cells; only temperature models have."
        )
    if owner_model[1] != origin.content_hash:
        raise InputError(
            f"{path}: the cells are of another '{origin.id}' ({owner_model[1][:12]}...). Build the "
            "body models again."
        )
    return fine + model.id.removeprefix(origin.id), owner


@lru_cache(maxsize=4)
def _read(path: Path) -> tuple[tuple[str, str], str, I32]:
    """Read ((model id, content hash), pressure model id, owners (V,) read-only); cached. Raises
    InputError: unreadable."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            owner = stored["owner"].astype(np.int32)
            identity, content_hash = (str(value) for value in stored["model"])
            fine = str(stored["fine"][0])
    except NPZ_DAMAGE as error:
        raise InputError(f"{path}: not readable as skin cells ({error}).") from error
    owner.flags.writeable = False
    return (identity, content_hash), fine, owner
