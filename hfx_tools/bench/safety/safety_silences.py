# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of silence without a stop: pauses, offsets, stale values; and after a sleep.

Several devices or output processes run at a time: most of their time is waiting.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.devices.host.device_thread import FREEZE_S
from hfx_blender.devices.workers.haptics import encode_haptics
from hfx_blender.devices.workers.live_frame import LiveFrame

from .safety_stops import (
    DEVICE,
    RATE_HZ,
    BandRounds,
    Log,
    NotPlayedError,
    NotSilentError,
    Rounds,
    WithClient,
    connect_scripted,
    is_loud_row,
    playing,
    scripted,
)

_SLOW: Final = """
import time
def render(haptics):
    time.sleep(haptics.time_s)
    return [10.0, 100.0] * 8
"""
_SLOWEST_S: Final = 0.06  # below the watchdog's 100 ms
_LATE_S: Final = 0.2
"""Seconds after a pause, long enough for any late answer."""

_RATES_HZ: Final = (24.0, 30.0, 50.0, 60.0, 72.0, 90.0, 120.0, 144.0, 240.0)
_DEVICES: Final = 8
_ASLEEP_S: Final = 0.45
_AT_A_TIME: Final = 4

_QUIET: Final = [0.0, 100.0] * 8


class _Pauses(WithClient):
    """Trial of a pause during a script's slow answer."""

    name = "slow"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._request = scripted(folder, self.name, _SLOW)
        self._log, self._count = Log(folder / "log"), 0
        self._rng = np.random.default_rng(1)

    def _feed(self, answers_after_s: float) -> None:
        self._client.events()
        haptics = encode_haptics(answers_after_s, [], np.array(playing()))
        self._client.send_haptics(self.name, haptics)
        self._client.heartbeat()

    def round(self) -> float:
        if self._client.devices.get(self.name) is None or self.is_stopped():
            self._count += 1
            path = self._folder / f"log{self._count}"
            self._log = Log(path)
            self._client.disconnect(self.name)
            connect_scripted(self._client, self._folder, self.name, path, self._request)
        self._log.forget()
        feed = partial(self._feed, float(self._rng.uniform(0.003, _SLOWEST_S)))
        self.until_played(self._log.is_loud, feed, self.is_stopped)
        end = time.monotonic() + float(self._rng.uniform(0.05, 0.15))
        while time.monotonic() < end:
            feed()
            time.sleep(1.0 / RATE_HZ)
        fault_s = time.monotonic()
        self._client.pause()
        time.sleep(_LATE_S)
        silence_s = self._log.silence_after(fault_s, by_values=True)
        if silence_s is None:
            raise NotSilentError
        self._client.heartbeat()
        return silence_s


class _Several(WithClient):
    """Trial with several playing devices."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._logs: dict[str, Log] = {}
        self._rng = np.random.default_rng(1)

    def recover(self) -> None:
        super().recover()
        for path in self._folder.iterdir():
            path.unlink()
        self._logs.clear()

    def _send(self, values: list[float]) -> None:
        self._client.events()
        for name in self._logs:
            self._client.send(name, values)
        self._client.heartbeat()

    def _play(self) -> None:
        if not self._client.pipe.is_running:
            for k in range(_DEVICES):
                path = self._folder / f"log{k}"
                self._logs[str(k)] = Log(path)
                self._client.connect(str(k), DEVICE, {"kind": "simulator", "path": str(path)})
        for log in self._logs.values():
            log.forget()
        self._client.arm()
        feed = partial(self.patiently, partial(self._send, playing()))
        self.until_played(self._all_are_loud, feed)

    def _all_are_loud(self) -> bool:
        return all([log.is_loud() for log in self._logs.values()])

    def _send_paced(self, rate_hz: float, seconds: float, values: list[float]) -> None:
        end = following = time.monotonic()
        end += seconds
        while time.monotonic() < end:
            self._send(values)
            following += 1.0 / rate_hz
            time.sleep(max(0.0, following - time.monotonic()))

    def _silences(self, since_s: dict[str, float]) -> list[float]:
        silences_s = []
        for name, log in self._logs.items():
            if self._client.devices[name].state in ("stopped", "frozen"):
                raise NotPlayedError("this process did not come to its heartbeat")
            silent_s = log.silence_after(since_s[name], by_values=True)
            if silent_s is None:
                raise NotSilentError
            silences_s.append(silent_s)
        return silences_s


class _Offsets(_Several):
    """Seconds from silent input plus the device's offset to silence at the port.

    The offset is changed during playback.
    """

    _round = 0

    def several(self) -> list[float]:
        for name in self._logs:
            self._client.set_offset(name, 0.0)
        self._play()
        rate_hz = _RATES_HZ[self._round % len(_RATES_HZ)]
        self._round += 1
        offsets_s = dict(zip(self._logs, self._rng.uniform(0.0, 1.0, len(self._logs)), strict=True))
        for name, offset_s in offsets_s.items():
            self._client.set_offset(name, 1000.0 * offset_s)
        self._send_paced(rate_hz, 0.15, playing())
        last_input_s = time.monotonic()
        longest_s = max(offsets_s.values())
        self._send_paced(rate_hz, longest_s + 0.15, _QUIET)
        if any(log.is_loud() for log in self._logs.values()):
            raise NotSilentError
        ends = {name: last_input_s + offset_s for name, offset_s in offsets_s.items()}
        return [_end_of_loud(log, last_input_s) - ends[name] for name, log in self._logs.items()]


def _end_of_loud(log: Log, since_s: float) -> float:
    """Time of the first imperceptible values after all perceptible ones, at least ``since_s``."""
    rows = log.read()
    loud = [k for k, row in enumerate(rows) if is_loud_row(row)]
    if not loud or "stop" in rows[min(loud[-1] + 1, len(rows) - 1)]:
        raise NotPlayedError("the device was stopped")
    return max(float(rows[loud[-1] + 1]["time_s"]), since_s)


class _NothingNew(_Several):
    """Trial of heartbeats without new values: the last values count as stale after a while."""

    def several(self) -> list[float]:
        self._play()
        self._send_paced(RATE_HZ, 0.05, playing())
        last_input_s = time.monotonic()
        self._send(playing())
        time.sleep(0.01)
        self._client.show(LiveFrame(0.0, []))  # without a described scene there is no answer
        end = last_input_s + FREEZE_S + 0.3
        while time.monotonic() < end:
            self._client.events()
            self._client.heartbeat()
            time.sleep(0.02)
        return self._silences(dict.fromkeys(self._logs, last_input_s + 0.005))


class _Sleeps(BandRounds):
    """Trial of a sleeping computer: the output process is frozen, with old values in its pipe."""

    def round(self) -> float:
        self.play()
        pid = self._client.pipe.pid
        assert pid is not None
        self.feed()
        os.kill(pid, signal.SIGSTOP)
        try:
            for _ in range(3):
                self.feed()
                time.sleep(0.01)
            time.sleep(_ASLEEP_S)
            fault_s = time.monotonic()
        finally:
            os.kill(pid, signal.SIGCONT)
        silence_s = self.silence(self.log, fault_s)
        if any(is_loud_row(row) and row["time_s"] > fault_s for row in self.log.rows):
            raise NotSilentError
        return silence_s


KINDS: Final[dict[str, tuple[Callable[[Path], Rounds], int]]] = {
    "pause, a script is late": (_Pauses, _AT_A_TIME),
    "offset is over": (_Offsets, 1),
    "nothing new": (_NothingNew, 1),
    "computer slept": (_Sleeps, _AT_A_TIME),
}
"""Class of rounds, and number of parallel runs, by kind."""
