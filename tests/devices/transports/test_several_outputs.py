# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices with several outputs, such as two boards of a belt, at pseudo-terminals."""

import json
import os
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_devices import device, vibration

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.device_thread import DeviceThread
from hfx_blender.devices.host.duty_budget_store import identities
from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.live import discovery
from hfx_blender.devices.live.connection_search import searched
from hfx_blender.devices.live.live_settings import (
    LiveSettings,
    PortSettings,
    load,
    store,
    target_of,
)
from hfx_blender.engine.rendering.device_config import OutputConfig, SerialTransport, TextEncoder
from hfx_blender.errors import InputError

LINES = TextEncoder("", " ", 100, None)
MOTOR = vibration(fixed=True, maximum=10.0)


def belt():
    """Four motors: the first and last at one board, the others at a second, in reversed order."""
    outputs = [OutputConfig(LINES, SerialTransport(115200), k) for k in ((0, 3), (2, 1))]
    return device(*[MOTOR] * 4, outputs=tuple(outputs))


@pytest.fixture
def boards():
    pairs = [os.openpty() for _ in range(2)]
    ends = []
    for master, slave in pairs:
        os.set_blocking(master, False)
        ends.append(SimpleNamespace(master=master, name=os.ttyname(slave), slave=slave))
    yield ends
    for board in ends:
        for descriptor in (board.master, board.slave):
            if descriptor is not None:
                os.close(descriptor)


def received(board, wanted):
    """Return all text of a board, once it ends with ``wanted`` or 20 s have passed."""
    content, until = b"", time.monotonic() + 20.0
    while not content.endswith(wanted) and time.monotonic() < until:
        try:
            content += os.read(board.master, 4096)
        except BlockingIOError:
            time.sleep(0.005)
    return content


def target(*boards):
    return {"kind": "several", "outputs": [{"kind": "serial", "port": x.name} for x in boards]}


def columns(*strengths):
    return np.array([x for strength in strengths for x in (strength, 175.0)])


def test_each_board_gets_its_own_actuators_in_its_own_order(boards):
    output = open_output(belt(), target(*boards))
    output.send(columns(1.0, 2.0, 3.0, 4.0))  # of 10, at full scale 100
    assert received(boards[0], b"10 40\n") == b"10 40\n"
    assert received(boards[1], b"30 20\n") == b"30 20\n"
    output.stop()
    for board in boards:
        assert received(board, b"0 0\n0 0\n0 0\n").endswith(b"0 0\n" * 3)
    output.close()


def test_a_port_that_cannot_be_opened_closes_the_ports_before(boards):
    missing = SimpleNamespace(name="/dev/pts/999999")
    with pytest.raises(OutputLostError, match=r"Output 2: /dev/pts/999999 "):
        open_output(belt(), target(boards[0], missing))
    open_output(belt(), target(*boards)).close()  # the first port is free again


@pytest.mark.parametrize("count", [0, 1, 3])
def test_another_number_of_targets_is_refused(boards, count):
    with pytest.raises(OutputLostError, match=f"has 2 outputs; {count} are given"):
        open_output(belt(), target(*[boards[0]] * count))


def test_the_loss_of_a_board_silences_the_others(boards):
    events = []
    thread = DeviceThread(
        1,
        belt(),
        lambda: open_output(belt(), target(*boards)),
        lambda *a, **k: events.append((a, k)),
    )
    thread.start()
    thread.arm()
    until = time.monotonic() + 20.0
    while not any(a[0] == "armed" for a, _ in events) and time.monotonic() < until:
        time.sleep(0.01)
    thread.feed(columns(5.0, 5.0, 5.0, 5.0))
    received(boards[0], b"50 50\n")
    os.close(boards[1].master)  # unplugged
    os.close(boards[1].slave)
    boards[1].master = boards[1].slave = None
    while not any(a[0] == "lost" for a, _ in events) and time.monotonic() < until:
        thread.feed(columns(5.0, 5.0, 5.0, 5.0))
        time.sleep(0.01)
    lost_s = time.monotonic()
    assert any("Output 2: " in k.get("text", "") for a, k in events if a[0] == "lost")
    assert received(boards[0], b"0 0\n0 0\n0 0\n").endswith(b"0 0\n" * 3)
    assert time.monotonic() - lost_s < 5.0
    thread.close("end")
    thread.wait_closed()


def test_time_on_of_each_board_belongs_to_that_board(boards):
    first, *_ = identities(belt(), target(*boards))
    assert first.slots == ("0", "elsewhere a1", "elsewhere a2", "1")
    names = {x.name for x in identities(belt(), target(*boards))}
    assert {f"port {os.path.realpath(board.name)}" for board in boards} <= names


def test_settings_hold_a_port_for_each_output(boards, tmp_path, monkeypatch):
    settings = LiveSettings("DEVICE", boards[0].name, more=(PortSettings(boards[1].name),))
    store("belt", settings)
    assert load()["belt"] == settings
    assert target_of(belt(), settings) == target(*boards)


def test_the_dialog_lists_the_ports_of_each_output(monkeypatch):
    ports = [discovery.FoundPort(f"/dev/ttyACM{k}", "Uno", (1, 2)) for k in range(2)]
    monkeypatch.setattr("hfx_blender.devices.live.connection_search.serial_ports", lambda: ports)
    found = next(searched(belt(), LiveSettings("DEVICE")))
    for connections in (found, *found.more):
        assert [name for name, _ in connections.ports] == ["/dev/ttyACM0", "/dev/ttyACM1"]
    assert len(found.more) == 1


def test_a_device_is_found_if_all_of_its_outputs_are_present():
    worn = replace(belt(), brand=SimpleNamespace(usb=((1, 2),), serial="", vendor="", model=""))
    ports = [discovery.FoundPort(f"COM{k}", "Uno", (1, 2), f"s{k}") for k in (3, 4)]
    assert discovery.found_devices([worn], ports[:1]) == []
    (match,) = discovery.found_devices([worn], ports)
    assert (match.port, match.unit, match.more) == ("COM3", "s3", (("COM4", "s4"),))


def document(tmp_path, *parts, **further):
    place = {"placement": {"parts": ["torso"], "centre_m": [0, -0.1, 1.2], "radius_m": 0.2}}
    strength = {"unit": "m/s^2", "minimum": 0, "maximum": 10}
    parameters = {"amplitude_m_s2": strength, "frequency_hz": {"unit": "Hz", "fixed": 100}}
    encoder = {"kind": "text", "full_scale": 100}
    content = {
        "schema": "hfx-device",
        "version": 1,
        "id": "belt",
        "name": "Belt",
        "actuator_types": {"m": {"modality": "vibration", "parameters": parameters}},
        "actuators": [{"id": name, "type": "m", "place": place} for name in "abc"],
        "outputs": [{"encoder": encoder, "actuators": list(part)} for part in parts],
        **further,
    }
    path = tmp_path / "belt.json"
    path.write_text(json.dumps(content))
    return path


def test_the_configuration_names_the_actuators_of_each_output(tmp_path):
    worn = load_device(document(tmp_path, "ca", "b"))
    assert [output.actuators for output in worn.outputs] == [(2, 0), (1,)]
    assert [[a.id for a in part.actuators] for part in worn.parts] == [["c", "a"], ["b"]]


@pytest.mark.parametrize(
    ("parts", "further", "message"),
    [
        (
            ("ab", "bc"),
            {},
            r"belt\.json: outputs\[1\]\.actuators\[0\] is \"b\", allowed is an actuator",
        ),
        (("ab", "d"), {}, r"outputs\[1\]\.actuators\[0\] is \"d\", allowed is an actuator .*: c"),
        (("a", "b"), {}, "allowed is outputs for all actuators, also for c"),
        (
            ("abc",),
            {"output": {"encoder": {"kind": "text", "full_scale": 1}}},
            "allowed is no list next to 'output'",
        ),
    ],
)
def test_each_actuator_belongs_to_one_output(tmp_path, parts, further, message):
    with pytest.raises(InputError, match=message):
        load_device(document(tmp_path, *parts, **further))
