# SPDX-License-Identifier: GPL-3.0-or-later
"""Play space: the object defining the room of tracked devices."""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import F64
from ...engine.scene import TimeBase
from ...errors import InputError
from ..curves.animation_curves import NotModelledError
from ..curves.animation_time import animation_frames
from ..curves.fcurve_kinematics import PlainObject
from .scene_description import sample_frames


def poses(scene: bpy.types.Scene, time: TimeBase, unit_m: float) -> F64 | None:
    """Play space to world at all samples, (T, 4, 4) in metres; None if the room is the world.
    Raises InputError with constraints, drivers or physics, and for a matrix without an inverse."""
    space = scene.hfx.play_space
    if space is None:
        return None
    try:
        plain = PlainObject(space)
    except NotModelledError as error:
        raise InputError(
            f"Play space '{space.name}': {error}; it is moved by keyframes, clips or parents only."
        ) from None
    frames = animation_frames(scene, sample_frames(time, np.arange(time.sample_count)))
    world = plain.world(frames, plain.values.sample(frames))
    world[:, :3, 3] *= unit_m
    if not np.isfinite(world).all() or (np.abs(np.linalg.det(world)) < 1e-12).any():
        raise InputError(f"Play space '{space.name}': its scale is 0, or its place no number.")
    return world


def pose_now(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, unit_m: float) -> F64:
    """Play space to world at the present frame, (4, 4) in metres, with the scale; identity without
    a play space."""
    space = scene.hfx.play_space
    if space is None:
        return np.eye(4)
    matrix = np.array(space.evaluated_get(layer.depsgraph).matrix_world, np.float64)
    matrix[:3, 3] *= unit_m
    return matrix
