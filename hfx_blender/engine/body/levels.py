# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail of a perceptual model: fewer of the same vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from ...errors import InputError
from ..arrays import I32, NPZ_DAMAGE
from . import model_library
from .mesh_edges import expand
from .model import PerceptualModel, SkinWeights

LEVELS_FILE: Final = "{modality}-levels.npz"


@dataclass(frozen=True, eq=False)
class Level:
    """Vertices kept of a model, and the kept vertex that stands for each of its vertices."""

    vertices: I32  # (C,) ascending ids of the model
    triangles: I32  # (F, 3) of the level's own ids
    coarse_of: I32  # (V,) the level's id that stands for each vertex of the model


def at_level(model: PerceptualModel, level: int) -> tuple[PerceptualModel, I32]:
    """Copy of a model with fewer vertices, and the mapping from the model's ids to its ids.

    Nothing may refer to the ids of a level: effects, tracks and devices speak the model's own.

    Parameters
    ----------
    level : int
        0 is the model itself; see :func:`level_count`.

    Returns
    -------
    model : PerceptualModel
        Its id is ``<id>/level-<level>``; a vertex's area is that of all it stands for.
    coarse_of : (V,) int32
        For each vertex of the model the level's vertex that stands for it.

    Raises
    ------
    InputError
        The model has no such level.
    """
    chosen = level_of(model, level)
    kept = chosen.vertices
    if level == 0:
        return model, kept
    areas = np.bincount(chosen.coarse_of, model.areas_m2, minlength=len(kept))
    coarse = replace(
        model,
        id=f"{model.id}/level-{level}",
        vertices=model.vertices[kept],
        triangles=chosen.triangles,
        normals=model.normals[kept],
        areas_m2=areas.astype(np.float32),
        part=model.part[kept],
        side=model.side[kept],
        mirror=np.searchsorted(kept, model.mirror[kept]).astype(np.int32),
        weights=_rows(model.weights, kept),
        avatar_vertices=model.avatar_vertices[kept],
        avatar_weights=model.avatar_weights[kept],
        avatar_offset_m=model.avatar_offset_m[kept],
    )
    return coarse, chosen.coarse_of


def level_of(model: PerceptualModel, level: int) -> Level:
    """Vertices of a level of a given model; at level 0 all.

    Raises
    ------
    InputError
        The model has no such level.
    """
    if level == 0:
        every = np.arange(len(model), dtype=np.int32)
        return Level(every, model.triangles, every)
    levels = _levels_of(model)
    if not 1 <= level <= len(levels):
        raise InputError(f"Body model '{model.id}' has levels 0 to {len(levels)}, not {level}.")
    return levels[level - 1]


def level_count(model: PerceptualModel) -> int:
    """Number of coarser levels of a model; 0 if it is coarse enough by itself."""
    return len(_levels_of(model))


def _rows(weights: SkinWeights, kept: I32) -> SkinWeights:
    place, owner = expand(weights.offsets.astype(np.int64), kept.astype(np.int64))
    count = np.bincount(owner, minlength=len(kept))
    offsets = np.concatenate(([0], np.cumsum(count))).astype(np.int32)
    return SkinWeights(offsets, weights.bones[place], weights.values[place])


def _levels_of(model: PerceptualModel) -> tuple[Level, ...]:
    origin = model_library.owner_of_ids(model.id, model.provenance)
    path = origin.folder / LEVELS_FILE.format(modality=model.modality)
    if not path.is_file():
        return ()
    stored, levels = read_levels(path)
    if stored != (origin.id, origin.content_hash):
        raise InputError(
            f"{path}: the levels are of another '{stored[0]}' ({stored[1][:12]}...); make them "
            "anew with 'hfx body build --levels'."
        )
    return levels


@lru_cache(maxsize=8)
def read_levels(path: Path) -> tuple[tuple[str, str], tuple[Level, ...]]:
    """Id and hash of the model, and its levels, from a file.

    Raises
    ------
    InputError
        It cannot be read.
    """
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
