# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads samples ahead of the playhead for actuators with latency: in slices, between frames.

Whoever renders evaluates it. Not while scrubbing or dragging: nobody knows what comes then.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from math import ceil
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...blender.scene_units import fps_of
from ...devices.live.playhead import Playhead, parts_between
from ...devices.workers.messages import MessageError
from ...engine.serialization import encode_object
from ...errors import HfxError

if TYPE_CHECKING:
    from ...reading.curves.keyframe_reader import Key, KeyframeReader
    from ...reading.live.live_scene import LiveScene

SETTLE_S = 0.3
"""Delay from the last edit to reading ahead anew, seconds."""

SLICE_S = 0.004
"""About the most that one slice may take."""

MOST_BYTES = 64_000_000
"""Memory limit of what is read ahead, bytes; a larger scene is read a stretch at a time."""

_STRETCH_S = 10.0
_COUNTS = (2, 128)  # frames of a slice

Tell = Callable[[bytes, bool], None]
"""Callback that takes bytes for the renderer, and a flag for a new scene."""


class LookaheadScheduler:
    """Lookahead in the open scene, as far as it has been read.

    Attributes
    ----------
    edition : int
        Rises with every edit.
    latencies_ms : tuple of float
        Latencies to compensate, ascending.
    reason : str
        Why what comes cannot be read; then it is known from the second time on that playback
        comes by. Empty: it can.
    """

    def __init__(self) -> None:
        self.edition = 0
        self.reason = ""
        self.latencies_ms: tuple[float, ...] = ()
        self._reader: KeyframeReader | None = None
        self._before: KeyframeReader | None = None
        self._due_s = 0.0
        self._stretch: tuple[object, ...] = ()
        self._is_read = np.zeros(0, np.bool_)
        self._bytes = self._points = 0
        self._count = 16
        self.has_more = False  # to be read soon
        self._direction = PlaybackDirection()

    @property
    def is_read(self) -> bool:
        """Test that the whole range has been read, for a scene that is not read in stretches."""
        return bool(len(self._is_read)) and bool(self._is_read.all())

    def set_latencies(self, latencies_ms: Iterable[float]) -> None:
        """Set the latencies to compensate."""
        found = tuple(sorted(set(latencies_ms)))
        if found != self.latencies_ms:
            self.latencies_ms = found
            self.forget()

    def forget(self) -> None:
        """Drop everything: the scene may have become another one."""
        self.edition += 1
        self._reader = self._before = None
        self._stretch, self._is_read = (), np.zeros(0, np.bool_)
        self.reason, self._due_s = "", 0.0

    def edited(self, changed: Iterable[Key]) -> None:
        """Invalidate what was read, after a change of anything but the time."""
        if not self.latencies_ms:
            return
        self.edition += 1
        known = self._reader or self._before
        if known is not None and not known.posing.isdisjoint(changed):
            known = None
        self._before, self._reader = known, None
        self._stretch, self._is_read = (), np.zeros(0, np.bool_)
        self._due_s = time.monotonic() + SETTLE_S

    def playhead(self, scene: bpy.types.Scene, is_playing: bool) -> Playhead:
        """Position and direction of playback."""
        first, last = scene.frame_start, scene.frame_end
        if scene.use_preview_range:
            first, last = scene.frame_preview_start, scene.frame_preview_end
        frame = scene.frame_current_final
        step = self._direction.at(frame, last + 1 - first, is_playing)
        fps = fps_of(scene)
        return Playhead(frame, first, last, fps, is_playing, step)

    def work(self, playhead: Playhead, live: LiveScene, tell: Tell) -> None:
        """Read one slice more, if there is any; never from within an update.

        Raises
        ------
        ReferenceError
            Something of the scene was deleted.
        """
        self.has_more = False
        if not self.latencies_ms or time.monotonic() < self._due_s:
            return
        try:
            if self._reader is None:
                self._begin(live, tell)
            elif not self._reader.reason:
                self._read(playhead, self._reader, tell)
        except (HfxError, MessageError) as error:
            self.reason = str(error)
            if self._reader is not None:
                self._reader.reason = self.reason

    def _begin(self, live: LiveScene, tell: Tell) -> None:
        from ...reading.curves.keyframe_reader import KeyframeReader

        self._reader = KeyframeReader(live, self._before)
        self._before = None
        self.reason, self.has_more = self._reader.reason, not self._reader.reason
        if not self.reason:
            tell(encode_object(self._reader.scene(self.edition)), True)

    def _read(self, playhead: Playhead, reader: KeyframeReader, tell: Tell) -> None:
        parts = parts_between(self.latencies_ms, playhead.fps, playhead.step)
        stretch = playhead.first, playhead.last, parts
        if stretch != self._stretch:
            self._stretch = stretch
            self._is_read = np.zeros(playhead.last + 1 - playhead.first, np.bool_)
            self._bytes = self._points = 0
        elif self._bytes > MOST_BYTES:  # the frames read so far are in the past
            tell(encode_object(reader.scene(self.edition)), True)
            self._is_read[:] = False
            self._bytes = self._points = 0
        numbers = self._next(playhead, len(parts))
        self.has_more = len(numbers) > 0
        if not self.has_more:
            return
        begun = time.perf_counter()
        frames = (playhead.first + numbers[:, None] + np.array(parts)).ravel()
        body = encode_object(reader.block(self.edition, frames))
        tell(body, False)
        self._is_read[numbers] = True
        self._bytes += len(body)
        self._points += len(frames)
        spent_s = max(time.perf_counter() - begun, 1e-6)
        self._count = int(np.clip(len(numbers) * SLICE_S / spent_s, *_COUNTS))

    def _next(self, playhead: Playhead, parts: int) -> np.ndarray:
        """Next frames to read, counted from the first one that is played."""
        total = len(self._is_read)
        begin = int(playhead.after(self.latencies_ms[0]) // 1) - playhead.first
        numbers = (begin + playhead.step * np.arange(total)) % total
        per_point = self._bytes / self._points if self._points else 0.0
        if total * parts * per_point > MOST_BYTES:
            numbers = numbers[: ceil((self.latencies_ms[-1] / 1000.0 + _STRETCH_S) * playhead.fps)]
        return numbers[~self._is_read[numbers]][: self._count]


class PlaybackDirection:
    """Direction of playback, inferred from successive frames, as Blender does not tell it."""

    def __init__(self) -> None:
        self._frame: float | None = None
        self._step = 1
        self._doubt = False

    def at(self, frame: float, count: int, is_playing: bool) -> int:
        """Infer the direction: 1, or -1 in reverse; ``count`` frames are played over and over.

        One frame that goes the other way is a jump, two are another direction.
        """
        before, self._frame = self._frame, frame
        if not is_playing or before is None:
            if not is_playing:
                self._step, self._doubt = 1, False
            return self._step
        moved = frame - before
        if abs(moved) > count / 2:  # it began again at the other end
            moved = -moved
        if moved * self._step > 0:
            self._doubt = False
        elif moved * self._step < 0:
            if self._doubt:
                self._step = -self._step
            self._doubt = not self._doubt
        return self._step


def changed_by(depsgraph: bpy.types.Depsgraph) -> Sequence[Key]:
    """Datablocks that an update changed; without the scene, as selections and our own settings
    change it.
    """
    found = ((type(each.id).__name__, each.id.name) for each in depsgraph.updates)
    return [key for key in found if key[0] != "Scene"]
