# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays a track on live devices, which the output process renders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Self

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.live.track_playback import PlayedTrack
from hfx_blender.engine.arrays import F64
from hfx_blender.errors import InputError


class PlayedTrackSource(PlayedTrack):
    """Track as a value source of :func:`.playback_loop.play`; a context manager.

    ``body``: name or id of the body with the devices; by default the first body. ``sample_s`` is
    the interval of samples. :meth:`show` compensates the actuator latencies ``latencies_ms``, empty
    at first. ``silences``: neutral values (columns,) of devices by name, also empty at first.

    Raises InputError: the file cannot be read, or has no such body.
    """

    is_rendered = True

    def __init__(self, path: Path, body: str | None = None) -> None:
        super().__init__(path)
        self.latencies_ms: Iterable[float] = ()
        self.silences: Mapping[str, F64] = {}
        self.sample_s = 1.0 / float(self.time.rate_hz)
        bodies = self.header.bodies
        ids = [x.id for x in bodies if body in (None, x.id, x.name)]
        if not ids:
            self.close()
            names = ", ".join(f"'{x.name}'" for x in bodies[:5])
            raise InputError(f"{path}: it has no body '{str(body)[:100]}'; there are: {names}.")
        self.body_id = ids[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def begin(self, client: LiveClient) -> None:
        """Describe the recorded scene to the connected devices."""
        client.describe(self.header, self.body_id)

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the samples of a time to the devices, with later samples for late actuators; from
        the end on neutral values, which no script gets."""
        if time_s >= self.end_s:
            for name, values in self.silences.items():
                client.send(name, values)
            return
        later_s = {ms: time_s + ms / 1000.0 for ms in self.latencies_ms}
        client.show(self.frame(time_s, later_s=later_s))
