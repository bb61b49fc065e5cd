# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices are found on ports whose ids are their own, and behind programs that answer."""

from __future__ import annotations

import socket
from dataclasses import replace

import pytest
from live_process import BAND

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import discovery
from hfx_blender.devices.live.discovery import Found, FoundPort, answers, found_devices, port_of
from hfx_blender.engine.rendering.device import Brand
from hfx_blender.errors import DeviceError

UNO = (0x2341, 0x0043)
PORTS = [
    FoundPort("/dev/ttyS0", "built in", None),
    FoundPort("/dev/ttyACM0", "a board", UNO, "HFX-12"),
    FoundPort("/dev/ttyACM1", "a board", UNO, "OTHER-3"),
    FoundPort("/dev/ttyUSB0", "something", (1, 2), "HFX-13"),
]


def device(serial: str = "", usb: tuple[tuple[int, int], ...] = (UNO,)):
    return replace(load_device(BAND), brand=Brand("Nobody", "None", usb, serial))


def test_a_pattern_of_serial_numbers_chooses_between_boards_of_one_kind():
    assert port_of(device("HFX-*"), PORTS) == "/dev/ttyACM0"
    assert port_of(device("OTHER-?"), PORTS) == "/dev/ttyACM1"


def test_without_a_pattern_ids_alone_must_be_enough():
    assert port_of(device(), PORTS[:2]) == "/dev/ttyACM0"
    with pytest.raises(DeviceError, match="on several ports"):
        port_of(device(), PORTS)


@pytest.mark.parametrize(
    "wanted", [device("HFX-99"), device(usb=()), replace(device(), brand=None)]
)
def test_what_is_not_there_is_told_with_what_is(wanted):
    with pytest.raises(DeviceError, match=r"was not found; serial ports: /dev/ttyS0 \(built in\)"):
        port_of(wanted, PORTS)


def test_what_is_there_is_listed_with_the_port_to_connect_it_by():
    on_both = found_devices([device()], PORTS)
    assert [each.port for each in on_both] == ["/dev/ttyACM0", "/dev/ttyACM1"]
    assert found_devices([device("OTHER-*"), replace(device(), brand=None)], PORTS) == [
        Found(BAND, "/dev/ttyACM1", "a board")
    ]


def test_programs_are_asked_once_for_all_devices_behind_them(monkeypatch):
    behind = [load_device("bhaptics_tactsuit_x40"), load_device("bhaptics_tactosy_left")]
    asked: list[tuple[str, int]] = []

    def answering(host: str, port: int) -> bool:
        asked.append((host, port))
        return True

    monkeypatch.setattr(discovery, "answers", answering)
    found = found_devices(behind, [])
    assert [each.device for each in found] == [each.id for each in behind]
    assert {each.port for each in found} == {""}  # as configured
    assert len(asked) == 1
    monkeypatch.setattr(discovery, "answers", lambda host, port: False)
    assert found_devices(behind, []) == []


def test_a_program_answers_if_it_takes_connections():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert answers("127.0.0.1", port)
    assert not answers("127.0.0.1", port)


def test_nobody_outside_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def reached(*_: object) -> None:
        raise AssertionError("somebody outside was asked")

    monkeypatch.setattr(socket, "create_connection", reached)
    assert not answers("example.org", 80) and not answers("8.8.8.8", 53)
