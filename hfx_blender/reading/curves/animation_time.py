# SPDX-License-Identifier: GPL-3.0-or-later
"""Time remapping: the frame of the animation that Blender evaluates at a frame that is played.

Played frames are what the timeline shows and what is exported: one second is the frame rate's
number of them. Keyframes, clips and caches have the frames of the animation.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.arrays import F64


def _length(scene: bpy.types.Scene) -> np.float32:
    """Frames of the animation in a played frame."""
    render = scene.render
    return np.float32(render.frame_map_old) / np.float32(render.frame_map_new)


def animation_frames(scene: bpy.types.Scene, frames: F64) -> F64:
    """Played frames, (n,) -> frames of the animation, in 32 bits as Blender computes them."""
    mapped: F64 = (frames.astype(np.float32) * _length(scene)).astype(np.float64)
    return mapped


def played_frame(scene: bpy.types.Scene, frame: float) -> float:
    """Played frame for one of the animation's own frames."""
    return frame / float(_length(scene))
