# SPDX-License-Identifier: GPL-3.0-or-later
"""Bones that follow their channels and their parents, by ``source/kinematics.c``."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from ..arrays import F64, I64
from .library import DOUBLES, INTEGER, LONGS, f64, library


@cache
def _calls() -> ctypes.CDLL | None:
    """The library, with the arguments of these functions."""
    found = library()
    if found is not None:
        found.hfx_from_quaternions.argtypes = [INTEGER, DOUBLES, DOUBLES]
        found.hfx_rig_pose.argtypes = [INTEGER, INTEGER, LONGS, LONGS] + [DOUBLES] * 6
        found.hfx_from_quaternions.restype = found.hfx_rig_pose.restype = None
    return found


def from_quaternions(quaternions: F64) -> F64 | None:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4); None where there is no library.

    Those of :func:`~hfx_blender.engine.kinematics.bone_hierarchy.from_quaternions`.
    """
    found = _calls()
    if found is None:
        return None
    quaternions = f64(quaternions)
    turned = np.zeros((*quaternions.shape[:-1], 3, 3))
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
    found = _calls()
    if found is None:
        return None
    locations, turned, scales = f64(locations), f64(turned), f64(scales)
    skinning = np.zeros((*locations.shape[:2], 3, 4))
    arrays = (order, parents, rest, inverse, locations, turned, scales, skinning)
    found.hfx_rig_pose(len(locations), len(order), *arrays)
    return skinning
