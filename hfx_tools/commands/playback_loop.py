# SPDX-License-Identifier: GPL-3.0-or-later
"""Playback of a track, a clip or a game on devices in real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final, Protocol

from hfx_blender.devices.host.clock import shorten_slices
from hfx_blender.devices.live.client import DeviceState, LiveClient
from hfx_blender.devices.workers.render_process import SCENE_S
from hfx_blender.errors import DeviceError
from hfx_blender.processes.process_end import check

from ..command_process.signal_watch import at_signals

# Bounds of the time between two frames, seconds; each frame is a sign of life.
_STEPS_S: Final = (0.01, 0.05)

# Longest wait without a look for a signal, seconds: devices are silent within 50 ms of Ctrl-C.
_LOOK_S: Final = 0.005

# Time for the last ramp of a device, seconds.
_FADE_S: Final = 0.1

# Time after the end of a source at which it is silent, seconds.
_SILENT_S: Final = 1.0

# Time limit for the closing of the ports, seconds; an output needs 3 s at most.
_CLOSE_S: Final = 4.0


class ValueSource(Protocol):
    """Interface of a source of values over time: a track, a clip, or a game."""

    is_rendered: bool  # True: samples, which the output process renders; False: values
    start_s: float
    end_s: float
    sample_s: float

    def begin(self, client: LiveClient) -> None: ...

    def show(self, client: LiveClient, time_s: float) -> None:
        """Send the values or samples of a time; silence, past scripts, from the end on."""


def play(
    source: ValueSource,
    client: LiveClient,
    *,
    from_s: float | None = None,
    offset_s: float = 0.0,
    clock: Callable[[], float | None] | None = None,
    progress: Callable[[float], None] = lambda share: None,
    connected: Callable[[], None] = lambda: None,
    printed: Callable[[str], None] = lambda line: None,
) -> list[DeviceState]:
    """Play a source once on the connected devices of a client; return the failed devices.

    Devices are stopped at the end, also after an exception, and ports are closed. A signal stops
    them at once, also during a long frame.

    ``from_s``: start time on the source's clock; None: the source's start.
    ``offset_s``: longest delay of a device, also of the end.
    ``clock``: time of another program on the source's clock, followed until an exception; devices
    are silent at once while the clock gives None, and before the source's start and after its end.
    ``progress``: takes the played share, 0..1.
    ``connected``: called once, when the devices are ready.
    ``printed``: takes each line that a device's script prints, with the name of the device.

    Raises DeviceError: all devices have failed.
    Raises InputError: the file is damaged.
    """
    shorten_slices()
    with ExitStack() as stack:
        stack.callback(client.stop_all, "the end was reached")
        stack.enter_context(at_signals(client.stop_all))
        source.begin(client)
        # Wait for the opening of all devices, which may take seconds, and for the rendering of the
        # scene. After 60 s the playback begins on the devices that are armed.
        is_prepared = not source.is_rendered
        deadline = time.monotonic() + SCENE_S
        while time.monotonic() < deadline:
            check()
            client.heartbeat()
            is_prepared |= "prepared" in _take_events(client, printed)
            states = client.devices.values()
            if is_prepared and not any(x.state in ("connecting", "connected") for x in states):
                break
            time.sleep(_STEPS_S[0])
        _require_playing(client)
        connected()
        begin_s = source.start_s if from_s is None else from_s
        length_s = max(source.end_s - begin_s, 1e-9)
        # The upper bound keeps signs of life more frequent than the host's 250 ms.
        step_s = min(max(source.sample_s, _STEPS_S[0]), _STEPS_S[1])
        is_silent = False
        while clock is not None:
            time_s = clock()
            if time_s is None or not source.start_s <= time_s < source.end_s:
                if not is_silent:
                    client.pause()  # past all messages; drops values that wait for an offset
                is_silent, time_s = True, source.end_s + _SILENT_S
            else:
                is_silent = False
            source.show(client, time_s)
            _wait_alive(client, step_s, printed)
        begun = time.monotonic()
        while (now_s := begin_s + time.monotonic() - begun) < source.end_s:
            source.show(client, now_s)
            _wait_alive(client, step_s, printed)
            progress((now_s - begin_s) / length_s)
        progress(1.0)
        ended = time.monotonic()
        while time.monotonic() - ended < offset_s + _FADE_S:
            source.show(client, source.end_s + source.sample_s)  # silence after the last sample
            _wait_alive(client, _STEPS_S[0], printed)
        failed = [state for state in client.devices.values() if not state.is_armed]
    check()  # a signal near the end has stopped the devices: no fault of theirs
    return failed + _unstopped(client, [x for x in client.devices.values() if x not in failed])


def _take_events(client: LiveClient, printed: Callable[[str], None]) -> set[str]:
    """Process the events since the last call, and return their names; ``printed`` as of
    :func:`play`."""
    events = client.events()
    for event in events:
        if event.event == "log":
            names = [x.name for x in client.devices.values() if x.number == event.device]
            printed(": ".join([*names, event.text]))
    return {event.event for event in events}


def _wait_alive(client: LiveClient, step_s: float, printed: Callable[[str], None]) -> None:
    """Send a heartbeat, process events and sleep ``step_s``; DeviceError if no device plays,
    TerminatedError within 5 ms of a signal."""
    check()
    client.heartbeat()
    _take_events(client, printed)
    _require_playing(client)
    end_s = time.monotonic() + step_s
    while (left_s := end_s - time.monotonic()) > 0.0:
        time.sleep(min(left_s, _LOOK_S))
        check()


def _require_playing(client: LiveClient) -> None:
    """Raise ``DeviceError`` with all reasons if no device plays; TerminatedError after a signal,
    which stops the devices."""
    if not any(state.is_armed for state in client.devices.values()):
        check()
        raise DeviceError(" ".join(fault_of(state) for state in client.devices.values()))


def _unstopped(client: LiveClient, states: list[DeviceState]) -> list[DeviceState]:
    """Close the ports of devices within 4 s; return those whose state is not "closed": an
    unconfirmed stop. A port still open then becomes "lost"."""
    for state in states:
        client.close_port(state.name)
    deadline = time.monotonic() + _CLOSE_S
    while open_states := [x for x in states if x.state not in ("closed", "lost")]:
        if time.monotonic() > deadline:
            for state in open_states:
                state.state, state.text = "lost", "its output did not close in time"
            break
        client.heartbeat()
        client.events()
        time.sleep(_STEPS_S[0])
    return [state for state in states if state.state != "closed"]


def fault_of(state: DeviceState) -> str:
    """Sentence about a device that does not play: the last text of the device, else its state; for
    a frozen device, that this command did not run in time."""
    text = state.text or f"it is {state.state}"
    if state.state == "frozen":  # the text of the output process is about Blender
        text = "this command did not run for 250 ms, so the device stopped"
    return f"Device '{state.name}': {text.removesuffix('.')}."
