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
_IDLE_S: Final = 0.01
_REPEAT_S: Final = 0.05


@dataclass(frozen=True)
class Playback:
    """Times of a played stimulus, seconds of the monotonic clock.

    ``onset_s`` is the time at which the output process had handed the first values to the port,
    ``latency_s`` after they were sent. Silent stimuli have no such report: ``latency_s`` is None,
    and the last known latency counts.
    """

    onset_s: float
    end_s: float
    latency_s: float | None


class StandstillError(Exception):
    """Silence of devices after this process did not run for 250 ms; :meth:`DevicePlayer.arm` lets
    the devices play again."""


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
        self._typical_s = 0.0  # latency of the last stimulus with a report
        self._at_port_s: float | None = None  # first report of levels since the last onset

    def wait_ready(self) -> None:
        """Wait until all devices are armed, a minute at most."""
        until_s = time.monotonic() + _READY_S
        while not all(state.is_armed for state in self._client.devices.values()):
            check()
            self._client.heartbeat()
            self._client.events()
            opening = ("connecting", "connected", "armed", "frozen")
            failed = [s for s in self._client.devices.values() if s.state not in opening]
            if failed or time.monotonic() > until_s:
                check()  # a signal stops the devices
                states = failed or list(self._client.devices.values())
                raise DeviceError(" ".join(map(fault_of, states)))
            time.sleep(_IDLE_S)

    def arm(self) -> None:
        """Arm the devices again after a StandstillError, and wait until all are armed."""
        self._client.arm()
        self.wait_ready()

    def idle(self, seconds: float = _IDLE_S) -> None:
        """Wait with silent devices."""
        self._wait_until(time.monotonic() + seconds)

    def play(self, stimulus: Stimulus) -> Playback:
        """Play a stimulus from silence to silence; an exception of ``interrupted`` silences at
        once. Raises StandstillError if devices are, or become, silent after a standstill."""
        name, neutral = stimulus.device, self._devices[stimulus.device].neutral
        self._raise_faults(plays=True)
        self._at_port_s = None
        previous = stimulus.values[0]
        sent_s = begun_s = time.monotonic()
        self._client.send(name, previous)
        try:
            for k, row in enumerate(stimulus.values):
                self._wait_until(begun_s + k * stimulus.step_s, plays=True)
                # Equal rows need no message; a repetition proves that the session goes on.
                now_s = time.monotonic()
                if not np.array_equal(row, previous) or now_s - sent_s > _REPEAT_S:
                    self._client.send(name, row)
                    sent_s, previous = now_s, row
            self._wait_until(begun_s + stimulus.duration_s, plays=True)
        except BaseException:
            self._client.pause()
            raise
        self._client.send(name, neutral)
        end_s = time.monotonic()
        latency_s = None
        if self._at_port_s is not None:
            latency_s = self._typical_s = max(self._at_port_s - begun_s, 0.0)
        return Playback(begun_s + self._typical_s, end_s + self._typical_s, latency_s)

    def silence(self) -> None:
        """Silence all devices until the next stimulus."""
        self._client.pause()

    def stop(self, reason: str) -> None:
        """Stop all devices now; they play no more in this session."""
        self._client.stop_all(reason)

    def _wait_until(self, due_s: float, plays: bool = False) -> None:
        """Wait with signs of life, and note the first report of levels."""
        while True:
            check()
            self._client.heartbeat()
            self._raise_faults(plays)
            self.interrupted()
            left_s = due_s - time.monotonic()
            if left_s <= 0.0:
                return
            time.sleep(min(left_s, _IDLE_S))

    def _raise_faults(self, plays: bool) -> None:
        """Take the reports of the devices; raise for a failed device, or for a device that a
        standstill has silenced if a stimulus ``plays``."""
        for event in self._client.events():
            is_onset = event.event == "levels" and any(event.levels)
            if is_onset and self._at_port_s is None:
                self._at_port_s = event.at_s
        silent = [state for state in self._client.devices.values() if not state.is_armed]
        failed = [state for state in silent if state.state != "frozen"]
        if failed:
            check()  # a signal stops the devices
            raise DeviceError(" ".join(map(fault_of, failed)))
        if silent and plays:
            raise StandstillError
