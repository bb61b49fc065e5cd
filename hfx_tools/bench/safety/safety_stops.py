# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of stopping: simulators log values and times before and after a failure."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.devices.live import approval
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.workers.haptics import encode_haptics
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.processes import start

from ... import processes

DEVICE: Final = "forearm_band_left"
RATE_HZ: Final = 60.0

PATIENCE_S: Final = 10.0
"""Longest wait for an event, seconds."""

_LINGER_S: Final = 0.02
"""Seconds of watching a stopped device; a perceptible value in this time voids the stop."""

_RAISES: Final = """
import time
def render(haptics):
    if haptics.time_s > 0.0:
        open({mark!r}, "w").write(repr(time.monotonic()))
        raise ValueError("on purpose")
    return haptics.values
"""
_HANGS: Final = _RAISES.replace('raise ValueError("on purpose")', "while True: pass")
_FLOODS: Final = """
def render(haptics):
    while True:
        print("x" * 400)
"""

_MEMORY_GIB: Final = 2
"""Memory of a large scene: the system frees memory before closing a killed process's pipes."""

_MEMORY_EVERY: Final = 10
"""Rounds per round with this memory: filling takes longer than the rest of a round."""

_SENDER: Final = """
import mmap, sys, time
memory = mmap.mmap(-1, max(int(sys.argv[2]) << 30, 1))
for place in range(0, len(memory), mmap.PAGESIZE):
    memory[place] = 1
from hfx_blender.devices.live.client import LiveClient
client = LiveClient()
client.connect("band", {device!r}, {{"kind": "simulator", "path": sys.argv[1]}})
while True:
    client.events()
    if "did not answer" in client.devices["band"].text:
        client.arm()
    client.send("band", {values!r})
    client.heartbeat()
    time.sleep(1.0 / 60.0)
"""


class NotPlayedError(Exception):
    """The device was not playing at the fault, so the round is void."""


class NotSilentError(Exception):
    """The device played on after the fault."""


@dataclass(eq=False)
class Trials:
    """Results of the rounds of one kind: seconds from fault to silence, and counts of failures."""

    times_s: list[float] = field(default_factory=list)
    never_silent: int = 0
    not_played: int = 0

    @property
    def count(self) -> int:
        return len(self.times_s) + self.never_silent


def run(
    name: str,
    make: Callable[[Path], Rounds],
    at_a_time: int,
    folder: Path,
    rounds: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Trials:
    """Run all rounds of one kind, in ``at_a_time`` threads; most of their time is waiting.

    Parameters
    ----------
    make : callable
        Builds :class:`Rounds` in a new folder.
    at_a_time : int
        Number of threads; 1: this thread.

    Raises
    ------
    InputError
        Devices hardly ever play on this computer.
    """
    results: list[Trials] = []
    errors: list[BaseException] = []

    def work(number: int) -> None:
        own = folder / str(number)
        tell = progress if number == 0 else lambda share: None
        try:
            own.mkdir()
            results.append(rounds_of(name, partial(make, own), -(-rounds // at_a_time), tell))
        except BaseException as error:
            errors.append(error)

    if at_a_time == 1:
        work(0)  # in this thread: Blender may be used in the main thread only
    else:
        threads = [threading.Thread(target=work, args=(k,)) for k in range(at_a_time)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if errors:
        raise errors[0]
    return Trials(
        [time_s for trials in results for time_s in trials.times_s],
        sum(trials.never_silent for trials in results),
        sum(trials.not_played for trials in results),
    )


def rounds_of(
    name: str,
    make: Callable[[], Rounds],
    rounds: int,
    progress: Callable[[float], None],
) -> Trials:
    """Repeat rounds up to ``rounds`` valid results.

    Raises
    ------
    InputError
        Devices hardly ever play on this computer.
    """
    trials = Trials()
    kind = make()
    try:
        while trials.count < rounds:
            try:
                trials.times_s += kind.several()
            except NotSilentError:
                trials.never_silent += 1
                kind.recover()
            except NotPlayedError as error:
                trials.not_played += 1
                if trials.not_played > rounds + 10:
                    raise InputError(f"{name}: the device does not play ({error}).") from None
                kind.recover()
            progress(min(1.0, trials.count / rounds))
    finally:
        kind.close()
    return trials


def playing() -> list[float]:
    """Perceptible values for every motor of the device."""
    return [10.0, 100.0] * 8


class Log:
    """Growing log of a simulator, read incrementally."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset_bytes = 0
        self.rows: list[dict[str, Any]] = []

    def read(self) -> list[dict[str, Any]]:
        """Read new complete lines; returns all rows since :meth:`forget`."""
        if self._path.exists():
            with open(self._path, "rb") as file:
                file.seek(self._offset_bytes)
                content = file.read()
            whole = content[: content.rfind(b"\n") + 1]
            self._offset_bytes += len(whole)
            self.rows += [json.loads(line) for line in whole.splitlines()]
        return self.rows

    def forget(self) -> None:
        """Discard all rows so far."""
        self.read()
        self.rows.clear()

    def is_loud(self) -> bool:
        """Test the last row for perceptible values; False without rows."""
        rows = self.read()
        return bool(rows) and is_loud_row(rows[-1])

    def silence_after(self, fault_s: float, *, by_values: bool = False) -> float | None:
        """Seconds from a fault to the stop without perceptible values after it; None without one.

        ``by_values``: imperceptible values count like a stop.

        Raises
        ------
        NotPlayedError
            The device was silent before the fault.
        """
        before = [row for row in self.read() if row["time_s"] < fault_s]
        if not before or not is_loud_row(before[-1]):
            raise NotPlayedError("it was silent before the fault")
        silence_s = None
        for row in self.rows[len(before) :]:
            if is_loud_row(row):
                silence_s = None
            elif ("stop" in row or by_values) and silence_s is None:
                silence_s = row["time_s"] - fault_s
        return silence_s


def is_loud_row(row: dict[str, Any]) -> bool:
    """Test a row of a simulator's log for perceptible strengths; False for a stop."""
    return any(row.get("values", ())[::2])


class Rounds:
    """Base class of rounds of one kind, with their shared state."""

    def round(self) -> float:
        """Run one round; returns seconds from fault to silence.

        Raises
        ------
        NotPlayedError, NotSilentError
        """
        raise NotImplementedError

    def several(self) -> list[float]:
        """Run one round; returns seconds from fault to silence of each device."""
        return [self.round()]

    def recover(self) -> None:
        """Restart after a failed round."""

    def close(self) -> None:
        """Clean up after all rounds."""

    @staticmethod
    def until_played(
        happened: Callable[[], object],
        feed: Callable[[], None] = lambda: None,
        is_over: Callable[[], bool] = lambda: False,
    ) -> None:
        """Call ``feed`` until an event of a playing device.

        Raises
        ------
        NotPlayedError
            ``is_over``, or no event within :data:`PATIENCE_S`.
        """
        end = time.monotonic() + PATIENCE_S
        while not happened():
            feed()
            if (is_over() or time.monotonic() > end) and not happened():
                raise NotPlayedError("it did not begin")
            time.sleep(0.002)

    @staticmethod
    def silence(log: Log, fault_s: float, feed: Callable[[], None] = lambda: None) -> float:
        """Wait for lasting silence; returns seconds from the fault.

        Raises
        ------
        NotSilentError
            No silence within :data:`PATIENCE_S`.
        """
        end = time.monotonic() + PATIENCE_S
        while log.silence_after(fault_s) is None:
            feed()
            if time.monotonic() > end:
                raise NotSilentError
            time.sleep(0.002)
        watched = time.monotonic() + _LINGER_S
        while time.monotonic() < watched:
            feed()
            time.sleep(0.002)
        silence_s = log.silence_after(fault_s)
        if silence_s is None:
            return Rounds.silence(log, fault_s, feed)
        return silence_s


class WithClient(Rounds):
    """Rounds with this process in Blender's part, alive after the fault."""

    name = "band"

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._client = LiveClient()

    def recover(self) -> None:
        self._client.close()

    def close(self) -> None:
        self._client.close()

    def patiently(self, feed: Callable[[], None]) -> None:
        """Call ``feed``; arm devices again after a late heartbeat of this process."""
        feed()
        for name, state in self._client.devices.items():
            if state.state == "frozen":
                self._client.arm(name)

    def is_stopped(self) -> bool:
        state = self._client.devices.get(self.name)
        return state is None or state.state in ("stopped", "frozen", "fault", "lost", "closed")


class BandRounds(WithClient):
    """Rounds of one device, playing at the start of each round."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.log = Log(folder / "log")
        self._count = 0

    def feed(self) -> None:
        """Send the values and heartbeat of one frame."""
        self._client.events()
        self._client.send("band", playing())
        self._client.heartbeat()

    def play(self) -> None:
        """Connect the device if needed, and wait for playback."""
        if not self._client.pipe.is_running:
            self._count += 1
            path = self._folder / f"log{self._count}"
            self.log = Log(path)
            self._client.connect("band", DEVICE, {"kind": "simulator", "path": str(path)})
        self.log.forget()
        self._client.arm()
        self.until_played(self.log.is_loud, partial(self.patiently, self.feed))


class _OperatorStops(BandRounds):
    def round(self) -> float:
        self.play()
        fault_s = time.monotonic()
        self._client.stop_all()
        return self.silence(self.log, fault_s)


class _ScriptFails(WithClient):
    """Seconds from a script's failure (time written by the script) to silence."""

    name = "scripted"

    def __init__(self, folder: Path, source: str) -> None:
        super().__init__(folder)
        self._mark = folder / "mark"
        self._request = scripted(folder, self.name, source.format(mark=str(self._mark)))
        self._count = 0

    def _feed(self, time_s: float) -> None:
        self._client.events()
        self._client.send_haptics(self.name, encode_haptics(time_s, [], np.array(playing())))
        self._client.heartbeat()

    def round(self) -> float:
        self._mark.unlink(missing_ok=True)
        self._count += 1
        path = self._folder / f"log{self._count}"
        log = Log(path)
        # A new connection each time: after three faults the script would stay off.
        self._client.disconnect(self.name)
        connect_scripted(self._client, self._folder, self.name, path, self._request)
        self.until_played(log.is_loud, partial(self.patiently, partial(self._feed, 0.0)))
        fails = partial(self._feed, 1.0)
        self.until_played(self._has_failed, fails, self.is_stopped)
        silence_s = self.silence(log, float(self._mark.read_text()), fails)
        path.unlink()
        return silence_s

    def _has_failed(self) -> bool:
        return self._mark.exists() and bool(self._mark.read_text())


class _BlenderFails(Rounds):
    def __init__(self, folder: Path, how: signal.Signals) -> None:
        self._folder, self._how, self._count = folder, how, 0
        self._source = _SENDER.format(device=DEVICE, values=playing())

    def round(self) -> float:
        self._count += 1
        path = self._folder / f"log{self._count}"
        log = Log(path)
        gib = _MEMORY_GIB if self._count % _MEMORY_EVERY == 1 else 0
        process = start.start(processes.program(self._source, path, str(gib)))
        try:
            self.until_played(log.is_loud, is_over=lambda: process.poll() is not None)
            fault_s = time.monotonic()
            os.kill(process.pid, self._how)
            return self.silence(log, fault_s)
        finally:
            process.kill()
            process.wait()
            path.unlink(missing_ok=True)


def gaps(folder: Path, seconds: float) -> Trials:
    """Measure seconds between values of a healthy device, next to three hostile scripts.

    A stop after a late heartbeat of this process is no gap: the stop is counted, and the device
    is armed again.
    """
    hostile = {
        "raises": "def render(haptics):\n    raise ValueError\n",
        "hangs": "def render(haptics):\n    while True: pass\n",
        "floods": _FLOODS,
    }
    requests = {name: scripted(folder, name, source) for name, source in hostile.items()}
    client = LiveClient()
    path = folder / "log"
    log = Log(path)

    def feed() -> None:
        client.events()
        client.send("band", playing())
        for name, request in requests.items():
            state = client.devices.get(name)
            if state is None or state.state in ("fault", "frozen", "stopped"):
                client.disconnect(name)
                connect_scripted(client, folder, name, folder / f"log {name}", request)
            client.send_haptics(name, encode_haptics(1.0, [], np.array(playing())))
        if "did not answer" in client.devices["band"].text:
            client.arm("band")
        client.heartbeat()

    try:
        client.connect("band", DEVICE, {"kind": "simulator", "path": str(path)})
        try:
            Rounds.until_played(log.is_loud, feed)
        except NotPlayedError as error:
            raise InputError(f"gap beside hostile scripts: {error}.") from None
        end = time.monotonic() + seconds
        due = time.monotonic()
        while time.monotonic() < end:
            feed()
            due = max(due + 1.0 / RATE_HZ, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
    finally:
        client.close()
    return gaps_of([row for row in log.read() if row["time_s"] < end])


def gaps_of(rows: list[dict[str, Any]]) -> Trials:
    """Seconds between successive rows of values; pairs with a stop in between are left out."""
    trials = Trials()
    last: float | None = None  # None: not playing before
    for row in rows:
        if "values" not in row:
            trials.not_played += last is not None
            last = None
            continue
        if last is not None:
            trials.times_s.append(row["time_s"] - last)
        last = row["time_s"]
    return trials


def scripted(folder: Path, name: str, source: str) -> dict[str, str]:
    """Write a device with an approved script into ``folder``; returns the script's request."""
    text = (resources.device_configs() / "forearm_band.json").read_text(encoding="utf-8")
    configuration = folder / f"{name}.json"
    configuration.write_text(text.replace('"id": "forearm_band"', f'"id": "{name}"'))
    configuration.with_suffix(".py").write_text(source)
    script = approval.script_of(f"{name}_left", folder)
    assert script is not None
    approval.approve(script)
    return script.as_request()


def connect_scripted(
    client: LiveClient, folder: Path, name: str, log: Path, request: dict[str, str]
) -> None:
    output = {"kind": "simulator", "path": str(log)}
    client.connect(name, f"{name}_left", output, folder=folder, script=request)


KINDS: Final[dict[str, tuple[Callable[[Path], Rounds], int]]] = {
    "operator stops": (_OperatorStops, 1),
    "script raises": (partial(_ScriptFails, source=_RAISES), 1),
    "script hangs": (partial(_ScriptFails, source=_HANGS), 2),
    "Blender killed": (partial(_BlenderFails, how=signal.SIGKILL), 1),
    "Blender frozen": (partial(_BlenderFails, how=getattr(signal, "SIGSTOP", signal.SIGTERM)), 2),
}
"""Class of rounds, and number of parallel runs, by kind."""
