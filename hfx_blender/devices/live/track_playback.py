# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays a track or clip on devices in real time, without Blender; it always ends in silence."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final, Protocol

from ...errors import DeviceError
from ..host.device_state import DeviceState
from ..workers.render_process import SCENE_S
from .client import LiveClient

_STEPS_S: Final = (0.01, 0.05)
"""Shortest and longest time between two frames, seconds; each is a sign of life."""

_FADE_S: Final = 0.1
"""Time for the last ramp of a device, seconds."""

_CLOSE_S: Final = 4.0
"""Time limit for the confirmation of the last stop, seconds; an output has 3 s at most."""


class ValueSource(Protocol):
    """Interface of a file that is played: a track, or a clip."""

    is_rendered: bool  # by the output process
    start_s: float
    end_s: float
    sample_s: float

    def begin(self, client: LiveClient) -> None: ...

    def show(self, client: LiveClient, time_s: float) -> None: ...


def play(
    source: ValueSource,
    client: LiveClient,
    *,
    from_s: float | None = None,
    offset_s: float = 0.0,
    progress: Callable[[float], None] = lambda share: None,
    connected: Callable[[], None] = lambda: None,
) -> list[DeviceState]:
    """Play a file once on the connected devices of a client; returns those that failed meanwhile.

    Parameters
    ----------
    from_s : float, optional
        Begin there, on the source's clock.
    offset_s : float
        The longest delay of a device: the end waits for it.
    progress : callable
        Takes the share that has been played.
    connected : callable
        Called once, when the devices are ready.

    Raises
    ------
    DeviceError
        No device plays, or none does any more.
    InputError
        The file is damaged.
    """
    try:
        source.begin(client)
        _await_devices(client, is_prepared=not source.is_rendered)
        connected()
        begin_s = source.start_s if from_s is None else from_s
        length_s = max(source.end_s - begin_s, 1e-9)
        step_s = min(max(source.sample_s, _STEPS_S[0]), _STEPS_S[1])
        begun = time.monotonic()
        while (now_s := begin_s + time.monotonic() - begun) < source.end_s:
            source.show(client, now_s)
            _live_on(client, step_s)
            progress((now_s - begin_s) / length_s)
        progress(1.0)
        ended = time.monotonic()
        while time.monotonic() - ended < offset_s + _FADE_S:
            source.show(client, source.end_s + source.sample_s)  # of which nothing is felt
            _live_on(client, _STEPS_S[0])
        failed = _failed(client)
    finally:
        client.stop_all("the end was reached")
    return failed + _unstopped(client, [x for x in client.devices.values() if x not in failed])


def _await_devices(client: LiveClient, *, is_prepared: bool) -> None:
    """Wait until what is to be rendered is prepared and each device plays, or has failed."""
    deadline = time.monotonic() + SCENE_S
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


def _unstopped(client: LiveClient, states: list[DeviceState]) -> list[DeviceState]:
    """Give devices back; returns those that did not confirm the stop."""
    for state in states:
        client.give_back(state.name)
    deadline = time.monotonic() + _CLOSE_S
    while any(each.state not in ("closed", "lost") for each in states):
        if time.monotonic() > deadline:
            for each in states:
                if each.state not in ("closed", "lost"):
                    each.state, each.text = "lost", "its output did not close in time"
            break
        client.heartbeat()
        client.events()
        time.sleep(_STEPS_S[0])
    return [each for each in states if each.state != "closed"]


def fault_of(state: DeviceState) -> str:
    """Sentence about a device that does not play."""
    text = state.text or f"it is {state.state}"
    if state.state == "frozen":  # the output process speaks of Blender
        text = "this command did not run for 250 ms, so the device stopped"
    return f"Device '{state.name}': {text.removesuffix('.')}."
