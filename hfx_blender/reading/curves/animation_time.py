# SPDX-License-Identifier: GPL-3.0-or-later
"""Times of a scene: its samples, and the frames of the animation that Blender evaluates there.

Played frames are what the timeline shows and what is exported: one second is the frame rate's
number of them. Keyframes, clips and caches have the frames of the animation.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import bpy
import numpy as np

from ...blender import stored_values
from ...engine.arrays import F64
from ...engine.scene import TimeBase
from ...errors import InputError

_FRAME_RATES = (0.001, 10_000.0)

MOST_SAMPLES = 2**24
"""Limit on samples: 46 hours at 100 samples a second; the data of each has to fit into memory."""


def time_base(
    scene: bpy.types.Scene, frames: tuple[int, int] | None = None, rate_hz: Fraction | None = None
) -> TimeBase:
    """Time base of a scene's samples.

    Without ``frames`` (first and last, both included) or ``rate_hz``, the scene's own are taken.

    Raises
    ------
    InputError
        The frame range holds no frames.
    """
    first, last = frames or (scene.frame_start, scene.frame_end)
    if last < first:
        raise InputError(
            f"Scene '{scene.name}': the frame range {first} to {last} holds no frames."
        )
    fps = _frame_rate(scene)
    time = TimeBase(fps, rate_hz or _sample_rate(scene), scene.frame_start, first, last)
    if time.sample_count > MOST_SAMPLES:
        raise InputError(
            f"Scene '{scene.name}': frames {first} to {last} at {float(fps):g} frames and "
            f"{float(time.rate_hz):g} samples a second are {time.sample_count} samples, at most "
            f"{MOST_SAMPLES} are allowed; export fewer frames or a lower rate."
        )
    return time


def _frame_rate(scene: bpy.types.Scene) -> Fraction:
    """Frames a second, exactly."""
    fps, base = scene.render.fps, scene.render.fps_base
    rate = fps / base if base else np.inf
    if not _FRAME_RATES[0] <= rate <= _FRAME_RATES[1]:
        raise InputError(
            f"Scene '{scene.name}': its Frame Rate, {fps} with the base {base:g}, is {rate:g} "
            f"frames a second, allowed is {_FRAME_RATES[0]:g} to {_FRAME_RATES[1]:g}."
        )
    return Fraction(fps) / Fraction(base).limit_denominator(10_000)


def _sample_rate(scene: bpy.types.Scene) -> Fraction:
    """Sampling rate that a scene asks for, Hz."""
    for bad in stored_values.bad_values(scene):
        if bad.path == "rate":
            raise InputError(f"Scene '{scene.name}': {bad}.")
    return Fraction(scene.hfx.rate).limit_denominator(1000)


def _length(scene: bpy.types.Scene) -> np.float32:
    """Frames of the animation in a played frame."""
    render = scene.render
    return np.float32(render.frame_map_old) / np.float32(render.frame_map_new)


def animation_frames(scene: bpy.types.Scene, frames: F64) -> F64:
    """Played frames, (n,) -> frames of the animation, in 32 bits as Blender computes them."""
    mapped: F64 = (frames.astype(np.float32) * _length(scene)).astype(np.float64)
    return mapped


@dataclass(frozen=True)
class ExactFrames:
    """Frames of the animation between samples, in 64 bits; reads nothing from Blender.

    In Blender's 32 bits speeds over short times would be wrong.
    """

    first: float  # frame of sample 0
    step: float  # frames from one sample to the next

    @classmethod
    def of(cls, scene: bpy.types.Scene, time: TimeBase) -> ExactFrames:
        """Frames of a scene at the samples of a time base."""
        length = float(_length(scene))
        return cls(time.frame_first * length, float(time.fps / time.rate_hz) * length)

    def at(self, indices: F64) -> F64:
        """Frames (n,) at sample indices with fractions."""
        return self.first + indices * self.step

    def indices(self, frames: F64) -> F64:
        """Sample indices (n,), with fractions, at frames."""
        return (frames - self.first) / self.step


def played_frame(scene: bpy.types.Scene, frame: float) -> float:
    """Played frame for one of the animation's own frames."""
    return frame / float(_length(scene))
