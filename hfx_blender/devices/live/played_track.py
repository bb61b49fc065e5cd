# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of a recorded track as live frames for devices, without the scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np

from ...engine.rendering.moment import of_one_moment
from ...engine.rendering.room import SETTING, PlaySpace
from ...engine.track import TrackReader
from ...errors import InputError
from ..workers.live_frame import LiveFrame

if TYPE_CHECKING:
    from .client import LiveClient


class PlayedTrack:
    """Open track as a :class:`.track_playback.ValueSource`; a context manager.

    Parameters
    ----------
    path : Path
        A ``.hfxtrack``.
    body : str, optional
        Name or id of the body with the devices; by default the first body.

    Attributes
    ----------
    header : TrackHeader
        For :meth:`~hfx_blender.devices.live.client.LiveClient.describe`.
    body_id : str
    start_s, end_s : float
        Time of the first sample and end of the last, on the clock of the recorded scene.
    sample_s : float
        Interval of samples.
    latencies_ms : iterable of float
        Actuator latencies that :meth:`show` compensates; empty at first.

    Raises InputError: the file cannot be read, or has no such body.
    """

    is_rendered = True

    def __init__(self, path: Path, body: str | None = None) -> None:
        self.path = path
        self.latencies_ms: Iterable[float] = ()
        self._reader = TrackReader(path)
        try:
            self.header = of_one_moment(self._reader.header)
            self.body_id = self._body_id(body)
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
        """Time on the track's clock of a frame of a scene with a frame rate."""
        return (frame - self.time.scene_start) / fps

    def frame(
        self,
        time_s: float,
        *,
        later_s: Mapping[float, float] | None = None,
        gains: Mapping[int, float] | None = None,
    ) -> LiveFrame:
        """Samples at a time; no effects before the first sample and after the last.

        Parameters
        ----------
        time_s : float
        later_s : mapping, optional
            Time of the samples for actuators with a latency, by latency in ms.
        gains : mapping, optional
            As of :class:`LiveFrame`.

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

    def _body_id(self, body: str | None) -> str:
        bodies = self.header.bodies
        ids = [x.id for x in bodies if body in (None, x.id, x.name)]
        if not ids:
            names = ", ".join(f"'{x.name}'" for x in bodies[:5]) or "none"
            missing = "" if body is None else f" '{body[:100]}'"
            raise InputError(f"{self.path}: it has no body{missing}; there are: {names}.")
        return ids[0]
