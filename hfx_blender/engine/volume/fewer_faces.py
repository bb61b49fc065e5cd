# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of the mesh that is felt: fewer faces, where a tolerance allows what that changes."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I32, I64
from .mesh import MeshVolume
from .shape import Shape

SHARE: Final = 1.0 / 8.0
"""Share of the accepted error of a contact's edge that the mesh may take."""

_STEPS: Final = 2.0  # of bounds in an octave, so that a turning volume keeps its mesh


def of_fewer_faces(
    shapes: tuple[Shape, ...], which: I64, matrices: F64, bounds_m: F64
) -> tuple[tuple[Shape, ...], I32]:
    """Shapes whose surfaces are within a bound of the given ones, row by row.

    A row's choice depends on nothing but the row, so that parts of a scene give what it gives.

    Parameters
    ----------
    shapes : tuple of Shape
    which : (n,) int64
        The shape of each row.
    matrices : (n, 4, 4) float64
        From shape space to the world.
    bounds_m : (n,) float64
        World space; 0 where the shape itself is wanted.

    Returns
    -------
    shapes : tuple of Shape
        Those that occur.
    which : (n,) int32
    """
    linear = matrices[:, :3, :3]
    is_asked = np.isfinite(linear).all(axis=(1, 2)) & (bounds_m > 0.0)
    is_asked &= np.array([isinstance(s, MeshVolume) and s.is_fine for s in shapes])[which]
    stretches = np.ones(len(which))
    stretches[is_asked] = np.linalg.norm(linear[is_asked], 2, axis=(1, 2))
    is_asked &= stretches > 0.0
    steps = np.zeros(len(which), np.int64)
    allowed = bounds_m[is_asked] / stretches[is_asked]
    steps[is_asked] = np.floor(_STEPS * np.log2(allowed)).astype(np.int64)
    keys = np.stack([which, is_asked, steps], axis=1)
    found: list[Shape] = []
    index = np.zeros(len(which), np.int32)
    for number, asked, step in np.unique(keys, axis=0).tolist():
        shape = shapes[number]
        if asked and isinstance(shape, MeshVolume):
            shape = shape.within(2.0 ** (step / _STEPS))
        if shape not in found:  # meshes are the same only where they are one
            found.append(shape)
        index[(keys == (number, asked, step)).all(axis=1)] = found.index(shape)
    return tuple(found), index
