# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones that follow their channels and their parents, by ``source/kinematics.c``."""

from __future__ import annotations

import numpy as np

from ..arrays import F64, I64
from .library import library


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
