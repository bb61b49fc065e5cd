# SPDX-License-Identifier: GPL-3.0-or-later
"""A track's samples as live frames: devices play what was recorded, without any scene."""

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
    """Track that live devices play; a context manager.

    Parameters
    ----------
    path : Path
        A ``.hfxtrack``.
    body : str, optional
        Name or id of who wears the devices; by default the first body.

    Attributes
    ----------
    header : TrackHeader
        For :meth:`~hfx_blender.devices.live.client.LiveClient.describe`.
    body_id : str
    start_s, end_s : float
        Times of the first sample, and after the last one, on the clock of the recorded scene.
    sample_s : float
        Time from one sample to the next.
    latencies_ms : iterable of float
        Latencies of actuators that :meth:`show` compensates; none at first.

    Raises
    ------
    InputError
        It cannot be read, or has no such body.
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
        """Describe the recorded scene to the devices that are connected."""
        client.describe(self.header, self.body_id)

    def show(self, client: LiveClient, time_s: float) -> None:
        """Let the devices play what is felt at a time."""
        later_s = {ms: time_s + ms / 1000.0 for ms in self.latencies_ms}
        client.show(self.frame(time_s, later_s=later_s))

    def time_s(self, frame: float, fps: float) -> float:
        """Time of a frame of a scene that plays ``fps`` frames a second."""
        return (frame - self.time.scene_start) / fps

    def frame(
        self,
        time_s: float,
        *,
        later_s: Mapping[float, float] | None = None,
        gains: Mapping[int, float] | None = None,
    ) -> LiveFrame:
        """Samples at a time; nothing is felt before the first and after the last.

        Parameters
        ----------
        time_s : float
        later_s : mapping, optional
            Latencies of actuators, ms, to the times of what they are to begin now.
        gains : mapping, optional
            As of :class:`LiveFrame`.

        Raises
        ------
        InputError
            The file is damaged.
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
        found = [each.id for each in bodies if body in (None, each.id, each.name)]
        if not found:
            there = ", ".join(f"'{each.name}'" for each in bodies[:5]) or "none"
            wanted = "" if body is None else f" '{body[:100]}'"
            raise InputError(f"{self.path}: it has no body{wanted}; there are: {there}.")
        return found[0]
