# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample times of a scene, and the animation frames evaluated by Blender.

Played frames are frames of the timeline, at the scene's frame rate. Keyframes, clips and caches use
animation frames, which time remapping scales.
"""

from dataclasses import dataclass
from fractions import Fraction

import bpy
import numpy as np

from ...blender import stored_values
from ...engine.arrays import F64, I64
from ...engine.scene import TimeBase
from ...errors import InputError

_FRAME_RATES = (0.001, 10_000.0)
MOST_SAMPLES = 2**24  # largest number of samples: 46 hours at 100 Hz; a memory limit


def time_base(
    scene: bpy.types.Scene, frames: tuple[int, int] | None = None, rate_hz: Fraction | None = None
) -> TimeBase:
    """Time base of a scene's samples; ``frames`` (first and last, both included) and ``rate_hz``
    default to the scene's settings. Frames per second are FPS / Base. Raises InputError for an
    empty range, a frame rate outside 0.001 to 10,000, a damaged sample rate, or too many samples.
    """
    first, last = frames or (scene.frame_start, scene.frame_end)
    if last < first:
        raise InputError(
            f"Scene '{scene.name}': the frame range {first} to {last} holds no frames."
        )
    base = scene.render.fps_base
    rate = scene.render.fps / base if base else np.inf
    if not _FRAME_RATES[0] <= rate <= _FRAME_RATES[1]:
        raise InputError(
            f"Scene '{scene.name}': its Frame Rate, {scene.render.fps} with the base {base:g}, is "
            f"{rate:g} frames a second, allowed is {_FRAME_RATES[0]:g} to {_FRAME_RATES[1]:g}."
        )
    # Blender stores base and sample rate as float32. The nearby fraction is meant: 1.001, not
    # 1.00100004673.
    fps = Fraction(scene.render.fps) / Fraction(base).limit_denominator(10_000)
    if rate_hz is None:
        for bad in stored_values.bad_values(scene):
            if bad.path == "rate":
                raise InputError(f"Scene '{scene.name}': {bad}.")
        rate_hz = Fraction(scene.hfx.rate).limit_denominator(1000)
    # Exact fractions, so that the times of late samples do not drift.
    time = TimeBase(fps, rate_hz, scene.frame_start, first, last)
    if time.sample_count > MOST_SAMPLES:
        raise InputError(
            f"Scene '{scene.name}': frames {first} to {last} at {float(fps):g} frames and "
            f"{float(time.rate_hz):g} samples a second are {time.sample_count} samples, at most "
            f"{MOST_SAMPLES} are allowed; export fewer frames or a lower rate."
        )
    return time


def _length(scene: bpy.types.Scene) -> np.float32:
    """Animation frames per played frame (Time Remapping old / new), in Blender's float32."""
    render = scene.render
    return np.float32(render.frame_map_old) / np.float32(render.frame_map_new)


def sample_frames(time: TimeBase, indices: I64) -> F64:
    """Played frames (n,) of sample indices (n,), also negative."""
    # An exact product, rounded once: repeated rounding could place a sample before a clip with the
    # same start.
    step = time.fps / time.rate_hz
    return time.frame_first + indices * step.numerator / step.denominator


def animation_frames(scene: bpy.types.Scene, frames: F64) -> F64:
    """Animation frames (n,) float64 of played frames (n,): times old / new of Time Remapping,
    computed in float32 like Blender."""
    mapped: F64 = (frames.astype(np.float32) * _length(scene)).astype(np.float64)
    return mapped


@dataclass(frozen=True)
class ExactFrames:
    """Conversion of fractional sample indices to animation frames in float64. In Blender's float32
    speeds over short times would be wrong. Reads nothing from Blender, so any thread may use it."""

    first: float  # animation frame of sample 0
    step: float  # animation frames per sample

    @classmethod
    def of(cls, scene: bpy.types.Scene, time: TimeBase) -> "ExactFrames":
        """Conversion between samples of ``time`` and animation frames of ``scene``."""
        length = float(_length(scene))
        return cls(time.frame_first * length, float(time.fps / time.rate_hz) * length)

    def at(self, indices: F64) -> F64:
        """Animation frames (n,) at fractional sample indices."""
        return self.first + indices * self.step

    def indices(self, frames: F64) -> F64:
        """Fractional sample indices (n,) at animation frames, also outside the range."""
        return (frames - self.first) / self.step


def played_frame(scene: bpy.types.Scene, frame: float) -> float:
    """Played frame of an animation frame: times new / old of Time Remapping."""
    return frame / float(_length(scene))
