# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone matrices from channels, boxes and rotations of placements.

Bindings of ``kinematics.c`` and ``placement.c``.
"""

from __future__ import annotations

import numpy as np

from ..arrays import F64, I64, Bool
from .library import library, loaded


def from_quaternions(quaternions: F64) -> F64 | None:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4), w first; None without a library.

    Quaternions are normalised; length 0 is half a turn about X, as in Blender.
    """
    native = library()
    if native is None:
        return None
    rotations = np.empty((*quaternions.shape[:-1], 3, 3))
    native.hfx_from_quaternions(rotations.size // 9, quaternions, rotations)
    return rotations


def rig_pose(
    order: I64, parents: I64, rest: F64, inverse: F64, locations: F64, turned: F64, scales: F64
) -> F64 | None:
    """Skinning matrices (T, B, 3, 4), rest to armature space; None without a library.

    Parameters
    ----------
    order : (B,) int64
        Bones, parents before children.
    parents : (B,) int64
        Parent of each bone; -1 for a root.
    rest, inverse : (B, 3, 4) float64
        Bone to armature space in the rest pose, and its inverse.
    locations, scales : (T, B, 3) float64
    turned : (T, B, 3, 3) float64
        Rotations of the bones' channels.
    """
    native = library()
    if native is None:
        return None
    skinning = np.empty((*locations.shape[:2], 3, 4))
    arrays = (order, parents, rest, inverse, locations, turned, scales, skinning)
    native.hfx_rig_pose(len(locations), len(order), *arrays)
    return skinning


def volume_boxes(matrices: F64, levels: F64, bounds: F64) -> tuple[F64, F64, Bool]:
    """World boxes of E volumes over all rows: lowest and highest corner (E, 3), m, and a mask (E,).

    ``matrices`` (E, T, 4, 4) are shape space to world; a volume is left out at rows with a level of
    0 or less in ``levels`` (E, T); ``bounds`` (E, 2, 3) are lowest and highest corner in shape
    space. The mask is False where a placement is not usable, and the box undefined.
    """
    count, rows = levels.shape
    boxes, is_sure = np.empty((count, 2, 3)), np.empty(count, np.bool_)
    loaded().hfx_volume_boxes(count, rows, matrices, levels, bounds, boxes, is_sure)
    return boxes[:, 0], boxes[:, 1], is_sure


def turns(before: F64, after: F64) -> F64:
    """Angles of rotation between placements (n, 4, 4), radians (n,); exactly 0 for no rotation."""
    assert before.shape == after.shape == (len(before), 4, 4)
    angles = np.empty(len(before))
    loaded().hfx_turns(len(angles), before, after, angles)
    return angles
