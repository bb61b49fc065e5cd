# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail and skin cells of perceptual models, stored beside the models.

A level is a subset of a model's vertices. A cell is the patch of skin represented by a vertex of
the temperature model: thresholds of temperature (150 mm) exceed the girth of limbs, so cells are
geodesic patches, sampled by the vertices of the pressure model.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import I32, NPZ_DAMAGE
from . import model_library
from .model import PerceptualModel

LEVELS_FILE: Final = "{modality}-levels.npz"
CELLS_FILE: Final = "cells.npz"


@dataclass(frozen=True, eq=False)
class Level:
    """Vertex subset of a model with a mesh and a mapping from the model's vertices."""

    vertices: I32  # (C,) ascending vertex ids of the model
    triangles: I32  # (F, 3) indices into vertices
    coarse_of: I32  # (V,) index into vertices of the representative of each model vertex


def level_of(model: PerceptualModel, level: int) -> Level:
    """Level of detail of a model; level 0 has all vertices. InputError for a missing level."""
    if level == 0:
        all_ids = np.arange(len(model), dtype=np.int32)
        return Level(all_ids, model.triangles, all_ids)
    levels = _levels_of(model)
    if not 1 <= level <= len(levels):
        raise InputError(f"Body model '{model.id}' has levels 0 to {len(levels)}, not {level}.")
    return levels[level - 1]


def level_count(model: PerceptualModel) -> int:
    """Number of coarser levels of a model, level 0 not counted; 0 without a levels file. Raises
    InputError: the levels were made for another edition."""
    return len(_levels_of(model))


def _levels_of(model: PerceptualModel) -> tuple[Level, ...]:
    """Coarser levels of a model, finest first; empty without a levels file beside the model (for a
    variant, its canonical model). Raises InputError: the levels were made for another edition."""
    origin = model_library.owner_of_ids(model.id, model.provenance)
    path = origin.folder / LEVELS_FILE.format(modality=model.modality)
    if not path.is_file():
        return ()
    owner, levels = read_levels(path)
    if owner != (origin.id, origin.content_hash):
        raise InputError(
            f"{path}: the levels are of another '{owner[0]}' ({owner[1][:12]}...). Make new "
            "levels with 'hfx body build --levels'."
        )
    return levels


@lru_cache(maxsize=8)
def read_levels(path: Path) -> tuple[tuple[str, str], tuple[Level, ...]]:
    """Read a levels file: (model id, content hash) and levels, finest first; cached. Raises
    InputError: the file is unreadable."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        identity, content_hash = (str(value) for value in arrays.pop("model"))
        levels = []
        for number in range(1, len(arrays) // 3 + 1):
            names = (f"{number}.{name}" for name in ("vertices", "triangles", "coarse_of"))
            levels.append(Level(*(arrays[name].astype(np.int32) for name in names)))
    except NPZ_DAMAGE as error:
        raise InputError(f"{path}: not readable as levels of a model ({error}).") from error
    return (identity, content_hash), tuple(levels)


def cell_of_skin(model: PerceptualModel) -> tuple[str, I32]:
    """Pressure model to sample a temperature model's skin, and the geodesic cell of each vertex.

    ``model`` is canonical, fitted to an avatar, or of other thresholds. Returns the id of the
    pressure model, of the same variant, and for each of its vertices the vertex of ``model`` with
    the cell around it, (V,) int32, read-only: of the same body part; every cell has at least one
    vertex, cells of limbs have dozens. Raises InputError: no cells are stored for the model, or the
    cells are of another edition.
    """
    origin = model_library.owner_of_ids(model.id, model.provenance)
    path = origin.folder / CELLS_FILE
    owner_model, fine, owner = _read_cells(path) if path.is_file() else (("", ""), "", None)
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
def _read_cells(path: Path) -> tuple[tuple[str, str], str, I32]:
    """Read ((model id, content hash), pressure model id, owners (V,) read-only); cached. Raises
    InputError: unreadable."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            owner = stored["owner"].astype(np.int32)
            identity, content_hash = (str(value) for value in stored["model"])
            fine = str(stored["fine"][0])
    except NPZ_DAMAGE as error:
        raise InputError(f"{path}: not readable as skin cells ({error}).") from error
    # Cached and shared by all callers.
    owner.flags.writeable = False
    return (identity, content_hash), fine, owner
