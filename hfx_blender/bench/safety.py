# SPDX-License-Identifier: GPL-3.0-or-later
"""Safety: how long it takes until a device is silent, whoever fails.

Every trial connects simulators, which write what they are given and when, and measures from
the fault to the stop bytes; maxima count. POSIX only: Windows has no signal that freezes.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from .. import resources
from ..devices.live import approval
from ..devices.live.client import LiveClient
from ..devices.live.haptics import packed
from ..errors import InputError

DEVICE: Final = "forearm_band_left"
_RATE_HZ: Final = 60.0
_PATIENCE_S: Final = 10.0
_GAP_SECONDS: Final = 20.0

LIMITS_MS: Final = {
    "operator stops": 50.0,
    "script raises": 1000.0 / _RATE_HZ + 20.0,
    "script hangs": 150.0,
    "Blender killed": 50.0,
    "Blender frozen": 300.0,
    "gap beside hostile scripts": 50.0,
}

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

_SENDER: Final = """
import sys, time
from {package}.devices.live.client import LiveClient
client = LiveClient()
client.connect("band", {device!r}, {{"kind": "simulator", "path": sys.argv[1]}})
while True:
    client.send("band", {values!r})
    client.heartbeat()
    time.sleep(1.0 / 60.0)
"""


def measure(
    *,
    short: bool = False,
    rounds: int = 1000,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Any]:
    """Milliseconds from fault to silence, over ``rounds`` trials of each kind; plain data.

    Raises
    ------
    InputError
        This system has no signals to freeze a process with.
    """
    if not hasattr(signal, "SIGSTOP"):
        raise InputError("'hfx bench safety' needs POSIX signals.")
    rounds = min(rounds, 10) if short else rounds
    trials: dict[str, Callable[[Path, int], list[float]]] = {
        "operator stops": _operator_stops,
        "script raises": lambda folder, n: _script_fails(folder, n, _RAISES),
        "script hangs": lambda folder, n: _script_fails(folder, n, _HANGS),
        "Blender killed": lambda folder, n: _blender_fails(folder, n, signal.SIGKILL),
        "Blender frozen": lambda folder, n: _blender_fails(folder, n, signal.SIGSTOP),
        "gap beside hostile scripts": lambda folder, n: _gaps(
            folder, 2.0 if short else max(_GAP_SECONDS, n / _RATE_HZ)
        ),
    }
    found = {}
    for k, (name, trial) in enumerate(trials.items()):
        with tempfile.TemporaryDirectory() as folder:
            try:
                times = 1000.0 * np.array(trial(Path(folder), rounds))
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
        found[name] = {
            "trials": len(times),
            "median_ms": round(float(np.median(times)), 3),
            "p99_ms": round(float(np.percentile(times, 99)), 3),
            "max_ms": round(float(times.max()), 3),
            "limit_ms": round(LIMITS_MS[name], 1),
        }
        progress((k + 1) / len(trials))
    return found


def as_text(result: dict[str, Any]) -> str:
    """A table for people."""
    lines = [f"{'silence after':<28}{'trials':>8}{'median':>10}{'p99':>10}{'max':>10}{'limit':>10}"]
    for name, row in result.items():
        figures = "".join(f"{row[key]:>7.1f} ms" for key in ("median_ms", "p99_ms", "max_ms"))
        over = "" if row["max_ms"] <= row["limit_ms"] else "  over"
        lines.append(f"{name:<28}{row['trials']:>8}{figures}{row['limit_ms']:>7.0f} ms{over}")
    return "\n".join(lines)


def _playing() -> list[float]:
    return [10.0, 100.0] * 8


class _Log:
    """What a simulator writes, read as it grows."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._place = 0
        self.rows: list[dict[str, Any]] = []

    def read(self) -> list[dict[str, Any]]:
        """Lines since the last call."""
        if not self._path.exists():
            return []
        with open(self._path, "rb") as file:
            file.seek(self._place)
            content = file.read()
        whole = content[: content.rfind(b"\n") + 1]
        self._place += len(whole)
        fresh = [json.loads(line) for line in whole.splitlines()]
        self.rows += fresh
        return fresh

    def is_loud(self) -> bool:
        self.read()
        last = self.rows[-1] if self.rows else {}
        return any(last.get("values", ())[::2])

    def silence_after(self, fault_s: float) -> float | None:
        """Seconds from a fault to the first stop; None: not yet."""
        self.read()
        stops = [row["time_s"] for row in self.rows if "stop" in row and row["time_s"] >= fault_s]
        return stops[0] - fault_s if stops else None


def _until(happened: Callable[[], Any], each: Callable[[], None] = lambda: None) -> Any:
    end = time.monotonic() + _PATIENCE_S
    while True:
        each()
        found = happened()
        if found is not None and found is not False:
            return found
        if time.monotonic() > end:
            raise InputError("A device did not fall silent, or never played.")
        time.sleep(0.002)


def _patiently(client: LiveClient, feed: Callable[[], None]) -> None:
    """Feed; play again if this process did not come to its heartbeat, on a busy machine."""
    feed()
    for name, state in client.devices.items():
        if state.state == "stopped" and "did not answer" in state.text:
            client.arm(name)


@contextmanager
def _client() -> Iterator[LiveClient]:
    client = LiveClient()
    try:
        yield client
    finally:
        client.close()


def _operator_stops(folder: Path, rounds: int) -> list[float]:
    found = []
    path = folder / "log"
    with _client() as client:
        client.connect("band", DEVICE, {"kind": "simulator", "path": str(path)})
        log = _Log(path)
        for _ in range(rounds):
            log.rows.clear()

            def feed() -> None:
                client.events()
                client.send("band", _playing())
                client.heartbeat()

            _until(log.is_loud, partial(_patiently, client, feed))
            fault_s = time.monotonic()
            client.stop_all()
            found.append(_until(partial(log.silence_after, fault_s)))
            client.arm()
    return found


def _script_fails(folder: Path, rounds: int, source: str) -> list[float]:
    """From the moment at which the script fails, as it writes down itself."""
    found = []
    mark = folder / "mark"
    wish = _scripted(folder, "scripted", source.format(mark=str(mark)))
    with _client() as client:
        for k in range(rounds):
            mark.unlink(missing_ok=True)
            path = folder / f"log{k}"
            log = _Log(path)
            # Connected anew each time: after three faults it would stay off.
            client.disconnect("scripted")
            _connect(client, folder, "scripted", path, wish)

            def feed(time_s: float) -> None:
                client.events()
                client.send_haptics("scripted", packed(time_s, [], np.array(_playing())))
                client.heartbeat()

            _until(log.is_loud, partial(_patiently, client, partial(feed, 0.0)))
            _until(lambda: mark.exists() and bool(mark.read_text()), partial(feed, 1.0))
            fault_s = float(mark.read_text())
            found.append(_until(partial(log.silence_after, fault_s), partial(feed, 1.0)))
            path.unlink()
    return found


def _blender_fails(folder: Path, rounds: int, how: signal.Signals) -> list[float]:
    found = []
    package = __package__.split(".bench")[0] if __package__ else "hfx_blender"
    source = _SENDER.format(package=package, device=DEVICE, values=_playing())
    for k in range(rounds):
        path = folder / f"log{k}"
        log = _Log(path)
        process = subprocess.Popen([sys.executable, "-c", source, str(path)])
        try:
            _until(log.is_loud)
            fault_s = time.monotonic()
            os.kill(process.pid, how)
            found.append(_until(partial(log.silence_after, fault_s)))
        finally:
            process.kill()
            process.wait()
        path.unlink()
    return found


def _gaps(folder: Path, seconds: float) -> list[float]:
    """Between what a healthy device is sent, beside three hostile scripts that come again."""
    hostile = {
        "raises": "def render(haptics):\n    raise ValueError\n",
        "hangs": "def render(haptics):\n    while True: pass\n",
        "floods": _FLOODS,
    }
    wishes = {name: _scripted(folder, name, source) for name, source in hostile.items()}
    path = folder / "log"
    with _client() as client:
        client.connect("band", DEVICE, {"kind": "simulator", "path": str(path)})

        def feed() -> None:
            client.events()
            client.send("band", _playing())
            for name, wish in wishes.items():
                state = client.devices.get(name)
                if state is None or state.state == "fault":
                    client.disconnect(name)
                    _connect(client, folder, name, folder / f"log {name}", wish)
                client.send_haptics(name, packed(1.0, [], np.array(_playing())))
            client.heartbeat()

        log = _Log(path)
        _until(log.is_loud, partial(_patiently, client, feed))
        end = time.monotonic() + seconds
        due = time.monotonic()
        while time.monotonic() < end:
            feed()
            due = max(due + 1.0 / _RATE_HZ, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
        log.read()
        times = [row["time_s"] for row in log.rows if "values" in row and row["time_s"] < end]
    return np.diff(times).tolist()


def _scripted(folder: Path, name: str, source: str) -> dict[str, str]:
    """A device of that name with a script, in a folder of its own."""
    text = (resources.device_configs() / "forearm_band.json").read_text(encoding="utf-8")
    configuration = folder / f"{name}.json"
    configuration.write_text(text.replace('"id": "forearm_band"', f'"id": "{name}"'))
    configuration.with_suffix(".py").write_text(source)
    found = approval.script_of(f"{name}_left", folder)
    assert found is not None
    return found.as_wish()


def _connect(client: LiveClient, folder: Path, name: str, log: Path, wish: dict[str, str]) -> None:
    output = {"kind": "simulator", "path": str(log)}
    client.connect(name, f"{name}_left", output, folder=folder, script=wish)
