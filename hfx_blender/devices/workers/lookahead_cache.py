# SPDX-License-Identifier: GPL-3.0-or-later
"""Latency compensation: evaluates samples ahead of the playhead.

A keyed scene is evaluated ahead of the playhead, in a thread beside whoever renders. Of other
scenes it is remembered what was felt at each frame: from the second time on that playback comes
by, it is known too.
"""

from __future__ import annotations

import logging
import threading
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import ceil
from typing import Final

from ...engine.evaluate import Engine
from ...engine.keyed_scene import KeyedBlock, KeyedScene
from ...engine.samples import SampleRun
from ...engine.serialization import decode_object
from ..live.playhead import Playhead
from .live_frame import LiveFrame

_log = logging.getLogger(__name__)

_MOST_KNOWN: Final = 4000
"""Frames; then it begins anew."""

_PLAYING_S: Final = 0.5
_STANDING_S: Final = 0.1
"""Time ahead that is evaluated while nothing plays, seconds: Play may be pressed at any time."""

_NEAR: Final = 0.5
"""Largest distance, frames, at which known samples stand for those of a frame."""

_PARTS: Final = 1000  # distinguished within a frame

Runs = Sequence[SampleRun]


class LookaheadCache:
    """Lookahead cache and scheduler: samples at other frames of one scene.

    Parameters
    ----------
    latencies_ms : iterable of float
        That are to be compensated.
    """

    def __init__(self, latencies_ms: Sequence[float]) -> None:
        self._latencies_ms = tuple(sorted(latencies_ms))
        self._wake = threading.Condition()
        self._bodies: deque[bytes] = deque()
        self._edition = -1
        self._scene: KeyedScene | None = None
        self._engine: Engine | None = None
        self._blocks: dict[int, tuple[KeyedBlock, int]] = {}  # by part of a frame, its row
        self._known: dict[int, Runs] = {}
        self._order: list[int] = []  # known parts, ascending
        self._playhead: Playhead | None = None
        self._is_answering = False
        self._is_closed = False
        self._thread: threading.Thread | None = None

    def take(self, body: bytes) -> None:
        """Take a :class:`KeyedScene` or a :class:`KeyedBlock`; the thread will process it."""
        if not self._latencies_ms:
            return
        with self._wake:
            self._bodies.append(body)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="lookahead", daemon=True)
                self._thread.start()
            self._wake.notify()

    def close(self) -> None:
        """End the thread; another scene has its own."""
        with self._wake:
            self._is_closed = True
            self._wake.notify()

    @contextmanager
    def answering(self, moment: LiveFrame) -> Iterator[Mapping[float, Runs]]:
        """Context with the known later samples, by latency; the thread begins nothing else
        meanwhile.
        """
        with self._wake:
            self._is_answering = True
        try:
            yield self._later(moment)
        finally:
            with self._wake:
                self._is_answering = False
                self._wake.notify()

    def _later(self, moment: LiveFrame) -> dict[float, Runs]:
        playhead = moment.playhead
        if playhead is None or not self._latencies_ms:
            return {}
        with self._wake:
            if moment.edition > self._edition:
                self._begin(moment.edition)
            if moment.edition == self._edition and playhead.is_playing:
                self._remember(_part(playhead.frame), moment.runs)
            self._playhead = playhead
            if not playhead.is_playing:
                return {}
            found = {ms: self._nearest(playhead.after(ms), ms) for ms in self._latencies_ms}
        return {ms: runs for ms, runs in found.items() if runs is not None}

    def _begin(self, edition: int) -> None:
        """Start anew after an edit: nothing of before is valid."""
        self._edition, self._scene, self._engine = edition, None, None
        self._blocks.clear()
        self._known.clear()
        self._order.clear()

    def _remember(self, part: int, runs: Runs) -> None:
        if part not in self._known:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
                self._order.clear()
            insort(self._order, part)
        self._known[part] = runs

    def _nearest(self, frame: float, latency_ms: float) -> Runs | None:
        """Samples at a frame, or at a known one that is nearer to it than the present frame."""
        part = _part(frame)
        if part in self._known:
            return self._known[part]
        place = bisect_left(self._order, part)
        near = self._order[max(place - 1, 0) : place + 1]
        best = min(near, key=lambda each: abs(each - part), default=None)
        if best is None or abs(best - part) > _NEAR * _PARTS:
            return None
        return self._known[best]

    # In the thread of its own.

    def _run(self) -> None:
        while True:
            with self._wake:
                while not (self._is_closed or self._bodies or self._wanted() is not None):
                    self._wake.wait()
                if self._is_closed:
                    return
                body = self._bodies.popleft() if self._bodies else None
                part = None if body is not None else self._wanted()
                edition, scene, engine = self._edition, self._scene, self._engine
            if body is not None:
                self._read(body)
            elif part is not None and scene is not None and engine is not None:
                block, row = self._blocks[part]
                runs: Runs | None = None
                try:
                    runs = engine.evaluate(block.at(row, scene))
                except Exception:  # without it, devices get the present samples
                    _log.exception("looking ahead")
                with self._wake:
                    if edition != self._edition:
                        continue
                    if runs is None:
                        self._blocks.pop(part, None)
                    else:
                        self._remember(part, runs)

    def _read(self, body: bytes) -> None:
        try:
            found = decode_object(body)
        except Exception as error:  # without it, devices get the present samples
            _log.warning("looking ahead: %s", error)
            return
        if isinstance(found, KeyedScene):
            engine = Engine(found.description, record=found.record, tolerance=found.tolerance)
            with self._wake:
                if found.edition >= self._edition:
                    if found.edition > self._edition:
                        self._begin(found.edition)
                    self._scene, self._engine = found, engine
                    self._blocks.clear()
        elif isinstance(found, KeyedBlock):
            with self._wake:
                if self._scene is not None and found.edition == self._edition:
                    for row, frame in enumerate(found.frames.tolist()):
                        self._blocks[_part(frame)] = found, row

    def _wanted(self) -> int | None:
        """Next part of a frame to evaluate."""
        playhead = self._playhead
        if playhead is None or self._is_answering or not self._blocks:
            return None
        ahead_s = _PLAYING_S if playhead.is_playing else _STANDING_S
        for k in range(ceil(ahead_s * playhead.fps)):
            then = playhead.next(k)
            for ms in self._latencies_ms:
                part = _part(then.after(ms))
                if part not in self._known and part in self._blocks:
                    return part
        return None


def _part(frame: float) -> int:
    return round(frame * _PARTS)
