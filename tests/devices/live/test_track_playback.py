# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx play``: samples at the track's times, and silence at every kind of end."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import own_devices
import pytest
from live_process import BAND, is_loud, rows_of
from own_devices import own_folder, scripted
from raw_server import RawServer
from test_render_process import HEADER, STREAMS, places, vibration

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.workers.live_frame import LiveFrame, decode_live_frame, encode_live_frame
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import TrackWriter
from hfx_blender.tracking.osc_packets import OscMessage
from hfx_blender.tracking.receiver import ReceivedMessage
from hfx_blender.tracking.value_addresses import address_of
from hfx_tools.commands import followed_clock, playback_loop
from hfx_tools.commands.played_track import PlayedTrackSource
from hfx_tools.live_body.controlled_playback import ControlledSource, weakened
from hfx_tools.live_body.live_values import LiveValues

RATE_HZ = 20


@pytest.fixture
def track(tmp_path: Path) -> Path:
    """Write a track of 1.5 s with 10 m/s^2 on all skin from 0.5 to 1 s."""
    return written(tmp_path / "buzz.hfxtrack", 1.5, range(10, 20))


def written(path: Path, length_s: float, loud: range) -> Path:
    frames = round(length_s * RATE_HZ)
    time = TimeBase(Fraction(RATE_HZ), Fraction(RATE_HZ), 1, 1, frames)
    with TrackWriter(path, replace(HEADER, time=time), full_precision=True) as writer:
        for index in loud:
            run = vibration(STREAMS[0], 10.0, 100.0)
            at = np.array([index])
            writer.append([replace(run, indices=at, times_s=at / RATE_HZ)])
    return path


def test_gain_mute_and_intensity_arrive_by_osc(track: Path) -> None:
    class Received:
        waiting: list[ReceivedMessage] = []

        def take(self) -> list[ReceivedMessage]:
            messages, self.waiting = self.waiting, []
            return messages

    class Client:
        devices = {"band": SimpleNamespace(number=7)}

        def show(self, moment: LiveFrame) -> None:
            self.moment = moment

    receiver, client = Received(), Client()
    with PlayedTrackSource(track) as source:
        name = source.header.effects[0].name
        controlled = ControlledSource(source, LiveValues(receiver), {})  # type: ignore[arg-type]
        (level,) = source.frame(0.75).runs[0].levels

        def levels(parameter: str, value: float) -> list[float]:
            address = address_of(
                "all" if parameter in ("gain", "mute") else "effect", name, parameter
            )
            receiver.waiting.append(ReceivedMessage(OscMessage(address, (value,)), 0.0))
            controlled.show(client, 0.75)  # type: ignore[arg-type]
            return [float(run.levels[0]) for run in client.moment.runs]

        assert levels("gain", 0.25) == [level] and client.moment.gains == {7: 0.25}
        assert levels("mute", 1.0) == [level] and client.moment.gains == {7: 0.0}
        assert levels("intensity", 0.5) == [0.5 * level]
        assert levels("intensity", 0.0) == []


def test_values_are_weakened_towards_neutral() -> None:
    band = load_device(BAND)
    values = band.neutral.copy()
    values[:2] = 10.0, 120.0  # amplitude and frequency of the first actuator
    # Half of 10 m/s^2; a frequency stays.
    assert weakened(values, 0.5, band)[:2].tolist() == [5.0, 120.0]
    assert weakened(values, 0.0, band).tolist() == band.neutral.tolist()


def arguments(track: Path, *more: str) -> list[str]:
    return ["play", str(track), "--device", BAND, "--to", "simulator", *more]


def test_a_track_plays_at_its_times_and_ends_in_silence(track: Path, tmp_path: Path) -> None:
    log = tmp_path / "band.jsonl"
    assert cli.run(arguments(track, "--path", str(log))) == 0
    rows = rows_of(log)
    loud = [row["time_s"] for row in rows if is_loud(row)]
    assert max(row["values"][0] for row in rows if "values" in row) == 10.0
    # Late on a busy machine, never early: half a second is felt, then half a second of nothing.
    assert loud[0] - rows[0]["time_s"] > 0.45
    assert rows[-1]["time_s"] - loud[-1] > 0.4
    assert "stop" in rows[-1]


@pytest.mark.skipif(os.name != "posix", reason="POSIX limits of files' sizes")
@pytest.mark.parametrize("kind", ["simulator", "log"])
def test_a_log_that_cannot_be_written_is_no_fault_of_a_device(
    track: Path, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import resource

    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # the limit would cut cached modules short
    log = tmp_path / "band.log"
    command = [*arguments(track, "--path", str(log)), "--to", kind]
    done = subprocess.run(
        [sys.executable, "-m", "hfx_blender", *command],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200)),
    )
    why = os.strerror(errno.EFBIG)
    assert (done.returncode, done.stderr) == (3, f"hfx: {log} cannot be written ({why}).\n")
    assert not log.exists()


def test_ctrl_c_and_a_kill_end_in_silence(tmp_path: Path) -> None:
    track = written(tmp_path / "long.hfxtrack", 30.0, range(30 * RATE_HZ))
    for number in (signal.SIGINT, signal.SIGKILL):
        log = tmp_path / f"{number.name}.jsonl"
        command = [sys.executable, "-m", "hfx_blender", *arguments(track, "--path", str(log))]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        until(partial(sounds, log))
        process.send_signal(number)
        assert process.wait() == (130 if number == signal.SIGINT else -signal.SIGKILL)
        until(partial(has_stopped, log))


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_a_serial_device_gets_its_bytes_and_its_stop(track: Path, tmp_path: Path) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    device = tmp_path / "belt.json"
    device.write_text(json.dumps(SERIAL))
    options = ["play", str(track), "--device", str(device), "--port", os.ttyname(slave)]
    assert cli.run(options) == 0
    sent = os.read(master, 1 << 20).decode()
    os.close(master)
    os.close(slave)
    assert "m 1000\n" in sent
    assert sent.endswith("off\n" * 3)


@pytest.mark.parametrize("reads", [True, False])
def test_a_stop_that_did_not_arrive_is_a_failure_of_the_device(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], reads: bool
) -> None:
    player = RawServer(reads=reads, says_goodbye=True)
    device = tmp_path / "vest.json"
    dots = [{"position": "VestFront", "index": 0}]
    output = {
        "encoder": {"kind": "bhaptics", "dots": dots},
        "transport": {"kind": "websocket", "host": "127.0.0.1", "port": player.port},
    }
    device.write_text(json.dumps({**SERIAL, "output": output}))
    track = written(tmp_path / "short.hfxtrack", 0.2, range(0, 4))
    code = cli.run(["play", str(track), "--device", str(device)])
    player.close()
    printed = capfd.readouterr()
    assert (code, "played" in printed.out) == ((0, True) if reads else (4, False)), printed
    assert ("the server does not read any more" in printed.err) is not reads


def test_a_failure_of_the_device_and_a_time_outside_have_their_exit_codes(
    track: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["play", str(track), "--device", BAND]) == 4  # no actuator is driven
    assert cli.run(arguments(track, "--from", "1.5")) == 2
    assert cli.run(arguments(tmp_path / "none.hfxtrack")) == 3
    foreign = tmp_path / "notes"
    foreign.write_text("not a log")
    assert cli.run(arguments(track, "--path", str(foreign))) == 3
    assert foreign.read_text() == "not a log"


def test_late_actuators_are_given_later_samples(track: Path) -> None:
    with PlayedTrackSource(track) as played:
        sent = played.frame(0.45, later_s={40.0: 0.49, 60.0: 0.51})
        assert not sent.runs and not sent.later[40.0]
        live_frame = decode_live_frame(encode_live_frame(sent, places()), STREAMS)
    assert list(live_frame.runs) == [] and list(live_frame.later[40.0]) == []
    (later,) = live_frame.later[60.0]
    assert later.parameters.tolist() == [[10.0, 100.0]]
    assert len(later.vertices) == len(vibration(STREAMS[0], 1.0, 1.0).vertices)


def until(happened: Callable[[], object]) -> None:
    end = time.monotonic() + 60.0
    while not happened():
        assert time.monotonic() < end, "never happened"
        time.sleep(0.01)


def sounds(log: Path) -> bool:
    return any(map(is_loud, rows_of(log)))


def has_stopped(log: Path) -> bool:
    return "stop" in rows_of(log)[-1]


PLACE = {"parts": ["torso"], "centre_m": [0.0, -0.1, 1.2], "radius_m": 0.1}
SERIAL = {
    "schema": "hfx-device",
    "version": 1,
    "id": "belt",
    "name": "Belt",
    "description": "One motor on a wire.",
    "actuator_types": {
        "motor": {
            "modality": "vibration",
            "parameters": {
                "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 10},
                "frequency_hz": {"unit": "Hz", "fixed": 150},
            },
        }
    },
    "actuators": [
        {"id": "m", "type": "motor", "place": {"placement": PLACE}},
    ],
    "output": {
        "encoder": {"kind": "text", "start": "m ", "full_scale": 1000, "stop": "off"},
        "transport": {"kind": "serial", "baud": 115200},
    },
}


def test_followed_clip_is_silent_while_the_clock_stands_and_jumps_over_what_lies_between() -> None:
    # Rows at 10 Hz with a strong one at 3.0 s, which a jump from 1 s to 5 s must not play.
    from hfx_tools.commands.played_clip import PlayedClip, _Rows

    clip = PlayedClip.__new__(PlayedClip)
    clip._rate_hz, clip._last, clip.start_s, clip.end_s, clip._shown = 10.0, 99, 0.0, 10.0, None
    values = np.array([[1.0], [9.0], [2.0]])
    rows = _Rows(np.array([0, 30, 31]), values, np.array([1, 9, 2]))
    clip._actuators, clip._neutral = {"x": [rows]}, {"x": np.zeros(1)}
    sent: list[float] = []

    class Client:
        def send(self, _name: str, row: object) -> None:
            sent.append(float(np.asarray(row)[0]))

    for time_s in (1.0, 11.0, 5.0, 5.1):
        clip.show(Client(), time_s)  # type: ignore[arg-type]
    assert sent == [1.0, 0.0, 2.0, 2.0]


def test_a_signal_is_noticed_within_5_ms_of_a_slow_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame of a track at 20 Hz waits for 50 ms."""
    now_s, looked_s = [0.0], []

    def check() -> None:
        looked_s.append(now_s[0])

    def sleep(seconds: float) -> None:
        now_s[0] += seconds

    clock = SimpleNamespace(monotonic=lambda: now_s[0], sleep=sleep)
    monkeypatch.setattr(playback_loop, "time", clock)
    monkeypatch.setattr(playback_loop, "check", check)
    client: Any = SimpleNamespace(
        heartbeat=lambda: None,
        events=lambda: [],
        devices={"band": SimpleNamespace(is_armed=True)},
    )
    playback_loop._wait_alive(client, 0.05, print)
    assert now_s[0] == pytest.approx(0.05)
    assert max(b - a for a, b in pairwise(looked_s)) <= 0.005 + 1e-9


LOUD = """
def render(haptics):
    print(f"called at {haptics.time_s:.6f} s")
    return [5.0, 100.0] * 8
"""


@pytest.fixture
def loud_band(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Approve a device whose script returns 5 m/s^2 at every call; return the device's name."""
    scripted(own_folder(tmp_path, monkeypatch), LOUD)
    return own_devices.BAND


def called_s(printed: str) -> list[float]:
    """Times of the calls of :data:`LOUD`, as printed by ``hfx play``."""
    lines = [line.split() for line in printed.splitlines() if "called at" in line]
    assert all(line[:3] == ["my_band_left:", "called", "at"] for line in lines)
    return [float(line[3]) for line in lines]


def test_a_script_is_called_for_the_times_of_the_track_only(
    track: Path, tmp_path: Path, loud_band: str, capfd: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "band.jsonl"
    options = ["play", str(track), "--device", loud_band, "--to", "simulator", "--path", str(log)]
    assert cli.run(options) == 0
    printed = capfd.readouterr()
    assert "called at" not in printed.out
    assert called_s(printed.err) and max(called_s(printed.err)) <= 1.5
    rows = [row for row in rows_of(log) if "values" in row]
    assert any(map(is_loud, rows)) and not is_loud(rows[-1])  # silent before the stop bytes


@pytest.mark.parametrize("controlled", [False, True])
def test_no_script_plays_while_the_followed_time_stands_still(
    tmp_path: Path,
    loud_band: str,
    controlled: bool,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before any time, at a pause, and before and after the track, devices are silent."""
    track = written(tmp_path / "buzz.hfxtrack", 1.5, range(10, 20))
    log = tmp_path / "band.jsonl"

    def last_is_loud() -> bool:
        values = [row for row in rows_of(log) if "values" in row]
        return bool(values) and is_loud(values[-1])

    def times_s() -> Iterator[float | None]:
        yield from [None] * 20
        assert not any(map(is_loud, rows_of(log)))
        for still_s in (None, 99.0, -1.0):
            end = time.monotonic() + 60.0
            while not last_is_loud():
                assert time.monotonic() < end, "the script is not played"
                yield 0.75
            while last_is_loud():
                assert time.monotonic() < end, "the device is not silent"
                yield still_s
            count = len(rows_of(log))
            yield from [still_s] * 20
            assert not any(map(is_loud, rows_of(log)[count:]))
        raise KeyboardInterrupt

    class Clock:
        name = "a clock"

        def __init__(self, *_: object) -> None:
            self._times = times_s()

        def __call__(self) -> float | None:
            return next(self._times)

        def close(self) -> None: ...

    monkeypatch.setattr(followed_clock, "FollowedClock", Clock)
    options = ["play", str(track), "--device", loud_band, "--to", "simulator", "--path", str(log)]
    options += ["--follow", "1", *(["--osc", "0"] if controlled else [])]
    assert cli.run(options) == 130
    assert set(called_s(capfd.readouterr().err)) == {0.75}
