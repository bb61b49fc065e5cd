# SPDX-License-Identifier: GPL-3.0-or-later
"""Guards against faults that whole processes hardly ever show: each alone, without any process."""

from __future__ import annotations

import io
import math
import struct
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from live_process import BAND, playing

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import host as host_module
from hfx_blender.devices.live.client import DeviceState, LiveClient
from hfx_blender.devices.live.encoders import Channels
from hfx_blender.devices.live.host import Host
from hfx_blender.devices.live.lane import Lane
from hfx_blender.devices.live.messages import (
    EVERY_DEVICE,
    Kind,
    Message,
    json_to,
    message,
    values_to,
)
from hfx_blender.devices.live.output import OutputLostError
from hfx_blender.devices.live.script_process import ScriptProcess
from hfx_blender.devices.live.transports import serial_port
from hfx_blender.devices.live.transports.wire_board import WireBoard

DEVICE = load_device(BAND)


class Kept:
    """An output that keeps what it is given."""

    def __init__(self) -> None:
        self.given: list[Any] = []

    def send(self, values: Any) -> None:
        self.given.append(values)

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


def lane_of(device: Any) -> tuple[Lane, Kept]:
    """A lane that is open, without its threads."""
    output = Kept()
    lane = Lane(0, device, lambda: output, lambda *_, **__: None)
    lane._output, lane._is_open = output, True
    return lane, output


def test_a_stopped_lane_takes_no_values_and_no_pulse() -> None:
    lane, _ = lane_of(DEVICE)
    lane.feed(playing())
    lane.pulse(2)
    assert not lane._waiting and lane._pulse is None
    lane.arm()
    lane.feed(playing())
    lane.pulse(2)
    assert len(lane._waiting) == 1 and lane._pulse is not None


def test_a_stop_forgets_what_waits_and_so_does_an_arm() -> None:
    lane, _ = lane_of(DEVICE)
    lane.arm()
    lane.feed(playing())
    lane.stop("enough")
    assert not lane._waiting
    lane._waiting.append((0.0, playing()))  # one that slipped through
    lane.arm()
    assert not lane._waiting


def test_a_device_that_is_not_open_yet_is_not_armed_but_will_be() -> None:
    lane, _ = lane_of(DEVICE)
    lane._is_open = False
    lane.arm()
    assert not lane._is_armed and lane._is_wanted


def test_after_a_stop_everything_begins_from_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = {n: replace(k, slew_per_s=100.0) for n, k in DEVICE.actuator_types.items()}
    actuators = tuple(replace(a, type=kinds[a.type.name]) for a in DEVICE.actuators)
    lane, _ = lane_of(replace(DEVICE, actuators=actuators))
    begun: list[str] = []
    for name in ("_guard", "_ramp", "_pace"):
        monkeypatch.setattr(getattr(lane, name), "reset", lambda name=name: begun.append(name))
    lane.arm()

    def ended(*_: Any) -> None:
        lane._is_closed = True

    monkeypatch.setattr(lane, "_step", ended)
    lane._play()
    assert sorted(begun) == ["_guard", "_pace", "_ramp"]


class Process:
    """An output process that takes its time."""

    def __init__(self) -> None:
        self.is_killed = False

    def poll(self) -> None:
        return None

    def wait(self, timeout: float | None = None) -> None:
        if not self.is_killed:
            raise subprocess.TimeoutExpired("host", timeout or 0.0)

    def kill(self) -> None:
        self.is_killed = True


@pytest.fixture
def client() -> LiveClient:
    found = LiveClient()
    found._process = Process()  # type: ignore[assignment]
    found.devices["band"] = DeviceState(1, "band", "armed")
    return found


def test_stop_all_goes_first_and_leaves_no_values_behind(client: LiveClient) -> None:
    client.arm()
    client.send("band", playing())
    client.stop_all("enough")
    assert not client._newest
    assert client._urgent[0] == message(Kind.STOP, EVERY_DEVICE, b"enough")


def test_an_output_process_that_does_not_end_is_ended(client: LiveClient) -> None:
    process = client._process
    client.close()
    assert process.is_killed  # type: ignore[union-attr]
    assert client._urgent[-1] == message(Kind.STOP)


def test_there_are_only_so_many_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_module, "MAX_DEVICES", 2)
    told: list[tuple[str, int, str]] = []
    host = Host(lambda event, number, text="", **_: told.append((event, number, text)))  # type: ignore[arg-type]
    wish = json_to({"configuration": BAND, "output": {"kind": "simulator"}})
    for number in (1, 2, 3):
        host.take(Message(Kind.CONNECT, number, wish))
    host.silence("the test is over")
    assert ("lost", 3, "more than 2 devices") in told
    assert not any(event == "lost" for event, number, _ in told if number < 3)


def test_a_port_that_leads_elsewhere_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "file"
    elsewhere.touch()
    monkeypatch.setattr(serial_port.os.path, "realpath", lambda name: str(elsewhere))
    with pytest.raises(OutputLostError, match="leads to"):
        serial_port._reserved("/dev/ttyACM0")


def test_a_script_that_answers_without_being_asked_is_not_heard() -> None:
    class Worker:
        stdout = io.BytesIO(message(Kind.READY, 0) + message(Kind.ANSWER, 0, values_to(playing())))

    answers: list[Any] = []
    faults: list[str] = []
    script = ScriptProcess({}, answers.append, faults.append, lambda text: None)
    script._process = Worker()  # type: ignore[assignment]
    script._deadline_s = math.inf  # it was started, so that it may say that it is ready
    script._listen(script._process)  # type: ignore[arg-type]
    assert not answers
    assert faults == ["its script spoke without being asked"]


def test_a_board_that_is_ready_for_another_session_is_not_ready() -> None:
    board = WireBoard.__new__(WireBoard)
    board._crc, board._channels, board._is_ready = 7, Channels(DEVICE, strengths_only=True), False
    board._name = "/dev/ttyACM0"
    board._understand_ready(struct.pack("<IB", 6, 8))
    assert not board._is_ready
    board._understand_ready(struct.pack("<IB", 7, 8))
    assert board._is_ready
