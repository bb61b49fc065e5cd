# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of a track at moments, for live devices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Self

import numpy as np

from ...engine.rendering.moment import of_one_moment
from ...engine.rendering.room import SETTING, PlaySpace
from ...engine.track import TrackReader
from ...errors import InputError
from ..workers.live_frame import LiveFrame
from .client import LiveClient


class PlayedTrack:
    """Open track as a source of values for live devices; a context manager.

    ``path``: a ``.hfxtrack`` file.
    ``body``: name or id of the body with the devices; by default the first body.

    The attributes ``header`` and ``body_id`` are for :meth:`.client.LiveClient.describe`.
    ``start_s`` and ``end_s`` are the time of the first sample and the end of the last, on the clock
    of the recorded scene; ``sample_s`` is the interval of samples. :meth:`show` compensates the
    actuator latencies ``latencies_ms``, empty at first.

    Raises InputError: the file cannot be read, or has no such body.
    """

    is_rendered = True

    def __init__(self, path: Path, body: str | None = None) -> None:
        self.path = path
        self.latencies_ms: Iterable[float] = ()
        self._reader = TrackReader(path)
        try:
            self.header = of_one_moment(self._reader.header)
            bodies = self.header.bodies
            ids = [x.id for x in bodies if body in (None, x.id, x.name)]
            if not ids:
                names = ", ".join(f"'{x.name}'" for x in bodies[:5]) or "none"
                missing = "" if body is None else f" '{body[:100]}'"
                raise InputError(f"{path}: it has no body{missing}; there are: {names}.")
            self.body_id = ids[0]
            settings = self._reader.header.settings
            self._play_space = PlaySpace.of_settings(settings) if SETTING in settings else None
        except BaseException:
            self.close()
            raise
        self.time = self._reader.header.time
        self.sample_s = 1.0 / float(self.time.rate_hz)
        self.start_s, last_s = self.time.times_s(np.array([0, self.time.sample_count - 1])).tolist()
        self.end_s: float = last_s + self.sample_s

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; may be called again."""
        self._reader.close()

    def begin(self, client: LiveClient) -> None:
        """Describe the recorded scene to the connected devices."""
        client.describe(self.header, self.body_id)

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the samples of a time to the devices, with later samples for late actuators."""
        later_s = {ms: time_s + ms / 1000.0 for ms in self.latencies_ms}
        client.show(self.frame(time_s, later_s=later_s))

    def time_s(self, frame: float, fps: float) -> float:
        """Seconds since the scene start of the track at ``frame``; ``fps`` frames a second."""
        return (frame - self.time.scene_start) / fps

    def frame(
        self,
        time_s: float,
        *,
        later_s: Mapping[float, float] | None = None,
        gains: Mapping[int, float] | None = None,
    ) -> LiveFrame:
        """Samples at a time; no effects before the first sample and after the last.

        ``later_s``: time of the samples for actuators with a latency, by latency in ms.
        ``gains``: as of :class:`LiveFrame`.

        Raises InputError: the file is damaged.
        """
        play_space = None
        if self._play_space is not None:
            play_space = self._play_space.pose(self._reader.index_at(time_s))
        read = self._reader.runs_at
        return LiveFrame(
            time_s,
            read(time_s),
            gains or {},
            play_space,
            later={ms: read(then) for ms, then in (later_s or {}).items()},
        )
