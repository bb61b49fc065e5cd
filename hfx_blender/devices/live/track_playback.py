# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of a track at moments, for live devices."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...engine.rendering.moment import of_one_moment
from ...engine.rendering.room import SETTING, PlaySpace
from ...engine.track import TrackReader
from ...errors import InputError
from ..workers.live_frame import LiveFrame


class PlayedTrack:
    """Open track as a source of values for live devices.

    The attributes ``header`` and ``body_id``, of the first body, are for
    :meth:`.client.LiveClient.describe`. ``start_s`` and ``end_s`` are the time of the first sample
    and the end of the last, on the clock of the recorded scene.

    Raises InputError: the ``.hfxtrack`` file cannot be read, or has no body.
    """

    def __init__(self, path: Path) -> None:
        # The file stays open: a track may be larger than memory, so each moment is read by itself.
        self._reader = TrackReader(path)
        try:
            self.header = of_one_moment(self._reader.header)
            if not self.header.bodies:
                raise InputError(f"{path}: The track has no body.")
            self.body_id = self.header.bodies[0].id
            settings = self._reader.header.settings
            self._play_space = PlaySpace.of_settings(settings) if SETTING in settings else None
        except BaseException:
            self.close()
            raise
        self.time = self._reader.header.time
        self.start_s, last_s = self.time.times_s(np.array([0, self.time.sample_count - 1])).tolist()
        self.end_s: float = last_s + 1.0 / float(self.time.rate_hz)

    def close(self) -> None:
        """Close the file; may be called again."""
        self._reader.close()

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
        # Devices in a room need the wearer's place; a track without such devices has no play space.
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
