# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of skin: the patch that each vertex of the temperature model represents.

150 mm do not fit around a limb, so there a temperature vertex stands for a piece of skin that
is measured along the surface. The skin is sampled by the vertices of the pressure model.
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
    """Geodesic cell that contains each place of the skin.

    Parameters
    ----------
    model : PerceptualModel
        A temperature model: the canonical one, as it was fitted to an avatar, a variant, or one
        of other thresholds.

    Returns
    -------
    fine : str
        Id of the pressure model whose vertices sample the skin; a variant's is its own.
    owner : (V,) int32, read-only
        For each vertex of the fine model the vertex of ``model`` whose cell it lies in, of the
        same body part. Every cell has at least one. The cells on hands, head and torso are
        small: only those of the limbs are sampled by dozens of vertices.

    Raises
    ------
    InputError
        No cells are stored for this model, or they are of another edition of it.
    """
    origin = model_library.owner_of_ids(model.id, model.provenance)
    path = origin.folder / CELLS_FILE
    stored, fine, owner = _read(path) if path.is_file() else (("", ""), "", None)
    if owner is None or stored[0] != origin.id:
        raise InputError(f"Body model '{model.id}' has no cells of skin: temperature has them.")
    if stored[1] != origin.content_hash:
        raise InputError(
            f"{path}: the cells are of another '{origin.id}' ({stored[1][:12]}...); build the "
            "body models anew."
        )
    return fine + model.id.removeprefix(origin.id), owner


@lru_cache(maxsize=4)
def _read(path: Path) -> tuple[tuple[str, str], str, I32]:
    """Read the id and hash of the model, the id of the finer one, and the owners."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            owner = stored["owner"].astype(np.int32)
            identity, content_hash = (str(value) for value in stored["model"])
            fine = str(stored["fine"][0])
    except NPZ_DAMAGE as error:
        raise InputError(f"{path}: not readable as cells of skin ({error}).") from error
    owner.flags.writeable = False
    return (identity, content_hash), fine, owner
