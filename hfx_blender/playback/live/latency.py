# SPDX-License-Identifier: GPL-3.0-or-later
"""Latency compensation: slow actuators get the samples of the frame in which they answer.

These samples come from the record of values over the timeline, or from the played track. Without
playback all actuators get the samples of the current frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import TYPE_CHECKING

import bpy

from ...blender.scene_info import fps_of
from ..timeline.timeline_recorder import recorder

if TYPE_CHECKING:
    from ...engine.samples import SampleRun, Stream


class Playback:
    """Direction of playback in the open scene, and the frames shown after a delay."""

    def __init__(self) -> None:
        self._frame: float | None = None
        self._step = 1  # frames of a step; -1 in reverse
        self._is_doubtful = False

    def frames_after(
        self, scene: bpy.types.Scene, delays_ms: Iterable[float], *, is_playing: bool
    ) -> dict[float, float]:
        """Map delays in milliseconds to the frames (fractional) shown after them.

        Empty without playback. Call this at each frame, also without playback: the direction is
        inferred from successive frames. Frames wrap at the ends of the played range.
        """
        first, last = played_range(scene)
        frame, length = scene.frame_current_final, last + 1 - first
        self._infer_direction(frame, length, is_playing)
        frames = {}
        for ms in delays_ms if is_playing else ():
            then = frame + self._step * ms / 1000.0 * fps_of(scene)
            # Frame `last` lasts until `last + 1`. Only playback within the range wraps: beyond an
            # end, Blender plays on in its direction.
            if self._step > 0 and then >= last + 1 and frame <= last:
                then = first + (then - last - 1) % length
            elif self._step < 0 and then < first <= frame:
                then = last - (first - 1 - then) % length
            frames[ms] = then
        return frames

    def _infer_direction(self, frame: float, length: int, is_playing: bool) -> None:
        """Update the direction ``_step`` from the current frame and the last one.

        One step against the direction is a jump, two in succession are a reversal; a step of more
        than half of ``length``, the played range in frames, counts as a step of the other sign. A
        repeated frame changes nothing. Forwards at the first frame, and without playback.
        """
        before, self._frame = self._frame, frame
        if not is_playing or before is None:
            self._step, self._is_doubtful = 1, False
            return
        # Blender gives no direction of playback. At a wrap, the frame jumps by almost the whole
        # range against the direction; dropped frames rarely exceed half of the range.
        moved = frame - before
        if abs(moved) > length / 2:  # playback wrapped around
            moved = -moved
        # A single contrary step may be a click in the timeline: a wrong direction would give slow
        # actuators samples from the past, so wait for a second one.
        is_contrary = moved * self._step < 0
        if is_contrary and self._is_doubtful:
            self._step = -self._step
        if moved:
            self._is_doubtful = is_contrary and not self._is_doubtful


def played_range(scene: bpy.types.Scene) -> tuple[int, int]:
    """First and last played frame, both inclusive: the preview range if enabled."""
    if scene.use_preview_range:
        return scene.frame_preview_start, scene.frame_preview_end
    return scene.frame_start, scene.frame_end


def recorded_runs(
    frames: Mapping[float, float], streams: Sequence[Stream]
) -> dict[float, list[SampleRun]]:
    """Recorded samples at ``frames`` of the scene, by the same keys; an empty list for silence.

    Empty without a valid record. Keys of frames that are not recorded or not cached are missing.
    ``streams`` are those of the live scene; recorded instances are renumbered to these.
    """
    record = recorder.valid
    if record is None:
        return {}
    indices = {ms: record.index(frame) for ms, frame in frames.items()}
    cached = {ms: record.runs(index) for ms, index in indices.items() if index is not None}
    return {ms: _in_slots(runs, streams) for ms, runs in cached.items() if runs is not None}


def _in_slots(runs: list[SampleRun], streams: Sequence[Stream]) -> list[SampleRun]:
    """Rename instances missing in ``streams`` to ``EFFECT:~0``, ``EFFECT:~1``, ... per body.

    Runs whose new name is missing as well are dropped.
    """
    # Names of instances are names of emitting particles or objects, which differ between frames.
    # The live scene has numbered slots instead: which instance gets which slot does not matter,
    # as all instances of an effect have the same settings.
    known = set(streams)
    if all(run.stream in known for run in runs):
        return runs
    numbers: dict[tuple[str, str], count[int]] = {}
    moved = []
    for run in runs:
        stream = run.stream
        if stream not in known:
            source = stream.effect_id.partition(":")[0]
            number = next(numbers.setdefault((source, stream.body_id), count()))
            stream = replace(stream, effect_id=f"{source}:~{number}")
        if stream in known:
            moved.append(replace(run, stream=stream))
    return moved


def uncompensated(scene: bpy.types.Scene) -> str:
    """Sentences for the panel: frames without latency compensation, or the reason for a missing
    record, and the cure. Empty if all played frames are compensated."""
    if recorder.must_step:
        return f"Latency is not compensated. {recorder.fault} Press Update Values."
    record = recorder.valid
    if record is None:
        return "Latency is not compensated" + (
            f": {recorder.fault}"
            if recorder.fault
            else " yet: values over time are recorded while nothing is edited or played."
        )
    (first, last), (begin, end) = played_range(scene), record.kept_range
    ends = (first, min(last, begin - 1)), (max(first, end + 1), last)
    gaps = [f"{low} to {high}" for low, high in ends if low <= high]
    if not gaps:
        return ""
    cure = "Extend the scene's frame range."
    if record.is_cut:
        cure = "The record of values over time is full: lower the rate, or shorten the scene."
    return f"Latency is not compensated in frames {' and '.join(gaps)}. {cure}"
