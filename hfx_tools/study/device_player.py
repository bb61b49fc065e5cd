# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays stimuli on devices through the output process, with the times of their onsets."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from hfx_blender.devices.live.client import LiveClient
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.errors import DeviceError
from hfx_blender.processes.process_end import check

from ..commands.playback_loop import fault_of
from .stimuli import Stimulus

_READY_S: Final = 60.0
_POLL_S: Final = 0.001
_IDLE_S: Final = 0.01
_REPEAT_S: Final = 0.05
_ECHO_S: Final = 0.05


@dataclass(frozen=True)
class Playback:
    """Times of a played stimulus, seconds of the monotonic clock.

    ``onset_s`` is the middle between sending the first values and the output process's report that
    the values were handed to the port, ``echo_s`` later; without a report ``echo_s`` is None, and
    the last known delay counts.
    """

    onset_s: float
    end_s: float
    echo_s: float | None


class DevicePlayer:
    """Devices of a session, connected at a client.

    ``interrupted`` is called often during all waiting, and may raise to end a stimulus. Every
    method raises DeviceError if a device has failed, and TerminatedError after a signal.
    """

    def __init__(
        self,
        client: LiveClient,
        devices: Mapping[str, DeviceConfig],
        interrupted: Callable[[], None] = lambda: None,
    ) -> None:
        self._client, self._devices = client, devices
        self.interrupted = interrupted
        self._typical_echo_s = 0.0
        self._echoed = False  # a report of levels above 0 has come since it was cleared

    def wait_ready(self) -> None:
        """Wait until all devices are armed, a minute at most."""
        until_s = time.monotonic() + _READY_S
        while not all(state.is_armed for state in self._client.devices.values()):
            check()
            self._client.heartbeat()
            self._client.events()
            opening = ("connecting", "connected", "armed")
            failed = [s for s in self._client.devices.values() if s.state not in opening]
            if failed or time.monotonic() > until_s:
                states = failed or list(self._client.devices.values())
                raise DeviceError(" ".join(map(fault_of, states)))
            time.sleep(_IDLE_S)

    def idle(self, seconds: float = _IDLE_S) -> None:
        """Wait with silent devices."""
        self._wait_until(time.monotonic() + seconds)

    def play(self, stimulus: Stimulus) -> Playback:
        """Play a stimulus from silence to silence; an exception of ``interrupted`` silences at
        once."""
        name, neutral = stimulus.device, self._devices[stimulus.device].neutral
        self._client.events()
        self._echoed, echo_s = False, None
        previous = stimulus.values[0]
        sent_s = begun_s = time.monotonic()
        self._client.send(name, previous)
        try:
            for k, row in enumerate(stimulus.values):
                due_s = begun_s + k * stimulus.step_s
                echo_s = self._wait_until(due_s, begun_s if echo_s is None else None) or echo_s
                # Equal rows need no message; a repetition proves that the session goes on.
                now_s = time.monotonic()
                if not np.array_equal(row, previous) or now_s - sent_s > _REPEAT_S:
                    self._client.send(name, row)
                    sent_s, previous = now_s, row
            end_s = begun_s + stimulus.duration_s
            echo_s = self._wait_until(end_s, begun_s if echo_s is None else None) or echo_s
        except BaseException:
            self._client.pause()
            raise
        self._client.send(name, neutral)
        end_s = time.monotonic()
        if echo_s is not None:
            self._typical_echo_s = echo_s
        delay_s = 0.5 * self._typical_echo_s
        return Playback(begun_s + delay_s, end_s + delay_s, echo_s)

    def silence(self) -> None:
        """Silence all devices until the next stimulus."""
        self._client.pause()

    def stop(self, reason: str) -> None:
        """Stop all devices now; they play no more in this session."""
        self._client.stop_all(reason)

    def _wait_until(self, due_s: float, begun_s: float | None = None) -> float | None:
        """Wait with signs of life; returns the time from ``begun_s`` to the report of levels, or
        None."""
        echo_s = None
        while True:
            check()
            self._client.heartbeat()
            for event in self._client.events():
                if event.event == "levels" and any(event.levels):
                    self._echoed = True
            failed = [state for state in self._client.devices.values() if not state.is_armed]
            if failed:
                raise DeviceError(" ".join(map(fault_of, failed)))
            self.interrupted()
            now_s = time.monotonic()
            if begun_s is not None and echo_s is None and self._echoed:
                echo_s = now_s - begun_s
            left_s = due_s - now_s
            if left_s <= 0.0:
                return echo_s
            # Often in the first moments, for the time of the report.
            awaits_echo = begun_s is not None and echo_s is None and now_s - begun_s < _ECHO_S
            time.sleep(min(left_s, _POLL_S if awaits_echo else _IDLE_S))
