# SPDX-License-Identifier: GPL-3.0-or-later
"""Device thread on a simulated clock: repeatable tests without waiting."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.device_thread import DeviceThread

BAND = load_device("forearm_band_left")  # eight motors: amplitude and frequency in turn


class FakeClock:
    """Clock advanced by the test only."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def now(self) -> float:
        return self.now_s

    def wait(self, condition: threading.Condition, seconds: float) -> None:
        raise AssertionError("nobody waits on this clock")


def frame(amplitude: float = 10.0) -> np.ndarray:
    """Return values of the band with every motor playing."""
    return np.tile([amplitude, 100.0], len(BAND.actuators))


class Port:
    """Output recording values and times."""

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock
        self.given: list[tuple[float, np.ndarray | str]] = []

    def send(self, values: np.ndarray) -> None:
        self.given.append((self._clock.now_s, values.copy()))

    def stop(self) -> None:
        self.given.append((self._clock.now_s, "stop"))

    def close(self) -> None: ...

    def strengths(self) -> list[tuple[float, float]]:
        """Return (time, strength of the strongest motor) for each output."""
        return [(t, 0.0 if isinstance(v, str) else float(v[::2].max())) for t, v in self.given]

    def is_loud(self) -> bool:
        return bool(self.given) and self.strengths()[-1][1] > 0.0

    def last_loud_s(self, since_s: float = 0.0) -> float:
        """Return the end of the last perceptible output, or -1 without such output."""
        actual = [*self.strengths(), (self._clock.now_s, 0.0)]
        ends = [after for (t, v), (after, _) in pairwise(actual) if v > 0.0]
        return max((item for item in ends if item > since_s), default=-1.0)


class Played:
    """Armed device thread with a recording port and a list of reports."""

    def __init__(self, clock: FakeClock | None = None, device: Any = BAND, **more: Any) -> None:
        self.clock = clock or FakeClock()
        self.port = Port(self.clock)
        self.reports: list[tuple[str, str]] = []
        self.thread = DeviceThread(
            1, device, lambda: self.port, self._report, clock=self.clock, **more
        )
        self.thread.output, self.thread.is_open = self.port, True  # without threads
        self.thread.silence = self.port.stop  # type: ignore[method-assign]
        self.thread.arm()

    def _report(self, event: str, _device: int, text: str = "", **_: Any) -> None:
        self.reports.append((event, text))

    def events(self) -> list[str]:
        return [event for event, _ in self.reports if event != "levels"]

    def run(self, seconds: float) -> None:
        """Advance the clock in steps, running the device thread."""
        run([self], seconds)


def run(played: Iterable[Played], seconds: float) -> None:
    """Advance the shared clock of several device threads."""
    threads = [block.thread for block in played]
    clock = next(iter(played)).clock
    end = clock.now_s + seconds
    while True:
        for thread in threads:
            for _ in range(100):
                if thread.due_in_s() > 0.0:
                    break
                thread.turn()
            else:
                raise AssertionError("it never waits")
        due = min(thread.due_in_s() for thread in threads)
        if clock.now_s + due > end:
            clock.now_s = end
            return
        clock.now_s += due + 1e-6  # a clock is never asked exactly in time
