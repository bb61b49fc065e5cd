# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones that follow their channels and parents, and the boxes and rotations of what moves;
``kinematics.c``, ``placement.c``.
"""

from __future__ import annotations

import numpy as np

from ..arrays import F64, I64, Bool
from .library import library, loaded


def from_quaternions(quaternions: F64) -> F64 | None:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4); None where there is no library.

    Those of :func:`~hfx_blender.engine.kinematics.bone_hierarchy.from_quaternions`.
    """
    found = library()
    if found is None:
        return None
    turned = np.empty((*quaternions.shape[:-1], 3, 3))
    found.hfx_from_quaternions(turned.size // 9, quaternions, turned)
    return turned


def rig_pose(
    order: I64, parents: I64, rest: F64, inverse: F64, locations: F64, turned: F64, scales: F64
) -> F64 | None:
    """Skinning matrices (T, B, 3, 4); None where there is no library.

    Parameters
    ----------
    order : (B,) int64
        Of the bones, parents first.
    parents : (B,) int64
        -1 for a root.
    rest, inverse : (B, 3, 4) float64
        Bone to armature space in the rest pose, and back.
    locations, scales : (T, B, 3) float64
    turned : (T, B, 3, 3) float64
    """
    found = library()
    if found is None:
        return None
    skinning = np.empty((*locations.shape[:2], 3, 4))
    arrays = (order, parents, rest, inverse, locations, turned, scales, skinning)
    found.hfx_rig_pose(len(locations), len(order), *arrays)
    return skinning


def volume_boxes(matrices: F64, levels: F64, bounds: F64) -> tuple[F64, F64, Bool]:
    """World boxes of volumes over some rows.

    Parameters
    ----------
    matrices : (E, T, 4, 4) float64
        Shape space to world, of each volume.
    levels : (E, T) float64
        Where one is not above 0, its volume is off.
    bounds : (E, 2, 3) float64
        Lowest and highest corner in shape space.

    Returns
    -------
    low, high : (E, 3) float64
    is_sure : (E,) bool
        Else the volume may be anywhere.
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
