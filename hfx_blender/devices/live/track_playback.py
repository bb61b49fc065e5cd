# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays a track on devices in real time, without Blender; it ends in silence, whatever ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Final

from ...errors import DeviceError
from .client import LiveClient
from .device_state import DeviceState
from .live_frame import LiveFrame
from .played_track import PlayedTrack
from .render_process import SCENE_S

_STEPS_S: Final = (0.01, 0.05)
"""Shortest and longest time between two frames, seconds; each is a sign of life."""

_FADE_S: Final = 0.1
"""Time for the last ramp of a device, seconds."""


def play(
    track: PlayedTrack,
    client: LiveClient,
    *,
    latencies_ms: Iterable[float] = (),
    from_s: float | None = None,
    offset_s: float = 0.0,
    progress: Callable[[float], None] = lambda share: None,
) -> list[DeviceState]:
    """Play a track once on the connected devices of a client; returns those that failed meanwhile.

    Parameters
    ----------
    latencies_ms : iterable of float
        Latencies of actuators that are compensated.
    from_s : float, optional
        Begin there, on the track's clock.
    offset_s : float
        The longest delay of a device: the end waits for it.
    progress : callable
        Takes the share that has been played.

    Raises
    ------
    DeviceError
        No device plays, or none does any more.
    InputError
        The file is damaged.
    """
    latencies_ms = tuple(latencies_ms)
    try:
        client.describe(track.header, track.body_id)
        _await_devices(client)
        begin_s = track.start_s if from_s is None else from_s
        length_s = max(track.end_s - begin_s, 1e-9)
        step_s = min(max(track.sample_s, _STEPS_S[0]), _STEPS_S[1])
        begun = time.monotonic()
        while (now_s := begin_s + time.monotonic() - begun) < track.end_s:
            client.show(
                track.frame(now_s, later_s={ms: now_s + ms / 1000.0 for ms in latencies_ms})
            )
            _live_on(client, step_s)
            progress((now_s - begin_s) / length_s)
        progress(1.0)
        ended = time.monotonic()
        while time.monotonic() - ended < offset_s + _FADE_S:
            client.show(LiveFrame(track.end_s, ()))
            _live_on(client, _STEPS_S[0])
        return _failed(client)
    finally:
        client.stop_all("the track has ended")


def _await_devices(client: LiveClient) -> None:
    """Wait until the scene can be rendered and each device plays, or has failed."""
    deadline, is_prepared = time.monotonic() + SCENE_S, False
    while time.monotonic() < deadline:
        client.heartbeat()
        is_prepared |= any(each.event == "prepared" for each in client.events())
        states = client.devices.values()
        if is_prepared and not any(each.state in ("connecting", "connected") for each in states):
            break
        time.sleep(_STEPS_S[0])
    _refuse_silence(client)


def _live_on(client: LiveClient, step_s: float) -> None:
    client.heartbeat()
    client.events()
    _refuse_silence(client)
    time.sleep(step_s)


def _refuse_silence(client: LiveClient) -> None:
    if not any(each.is_armed for each in client.devices.values()):
        raise DeviceError(" ".join(fault_of(each) for each in client.devices.values()))


def _failed(client: LiveClient) -> list[DeviceState]:
    return [each for each in client.devices.values() if not each.is_armed]


def fault_of(state: DeviceState) -> str:
    """Sentence about a device that does not play."""
    text = state.text or f"it is {state.state}"
    return f"Device '{state.name}': {text.removesuffix('.')}."
