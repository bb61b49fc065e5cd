# SPDX-License-Identifier: GPL-3.0-or-later
"""Discovery of devices on ports with USB ids, and behind servers."""

from __future__ import annotations

import socket
from dataclasses import replace

import pytest
from live_process import BAND

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import discovery
from hfx_blender.devices.live.discovery import (
    Found,
    FoundPort,
    answers,
    found_devices,
    port_of,
    same_port,
)
from hfx_blender.devices.transports import buttplug
from hfx_blender.engine.rendering.device_config import (
    Brand,
    ButtplugEncoder,
    OutputConfig,
    WebsocketTransport,
)
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


@pytest.mark.parametrize("name", [device("HFX-99"), device(usb=()), replace(device(), brand=None)])
def test_a_missing_port_is_reported_with_the_present_ports(name):
    with pytest.raises(DeviceError, match=r"was not found; serial ports: /dev/ttyS0 \(built in\)"):
        port_of(name, PORTS)


def test_a_port_without_a_description_is_its_name_alone():
    with pytest.raises(DeviceError, match=r"serial ports: /dev/ttyS0\.$"):
        port_of(device(), [FoundPort("/dev/ttyS0", "", None, "")])


def test_found_devices_are_listed_with_ports():
    on_both = found_devices([device()], PORTS)
    assert [item.port for item in on_both] == ["/dev/ttyACM0", "/dev/ttyACM1"]
    assert found_devices([device("OTHER-*"), replace(device(), brand=None)], PORTS) == [
        Found(BAND, "/dev/ttyACM1", "a board", "OTHER-3")
    ]


@pytest.mark.parametrize(
    ("name", "serial", "expected"),
    [
        ("/dev/ttyACM0", "HFX-12", "/dev/ttyACM0"),
        ("/dev/ttyACM0", "OTHER-3", "/dev/ttyACM1"),  # the names were exchanged
        ("/dev/ttyACM0", "", "/dev/ttyACM0"),  # chosen without a serial number
        ("/dev/ttyS0", "HFX-12", "/dev/ttyS0"),  # the present port has no serial number
        ("/dev/ttyACM7", "HFX-12", "/dev/ttyACM7"),  # unknown: reported when opened
    ],
)
def test_a_board_is_found_again_under_another_name(name: str, serial: str, expected: str) -> None:
    assert same_port(device(), name, serial, PORTS) == expected


def test_another_board_under_the_name_of_one_that_is_gone_is_refused() -> None:
    with pytest.raises(DeviceError, match=r"GONE-1, which is on no port; on .* HFX-12"):
        same_port(device(), "/dev/ttyACM0", "GONE-1", PORTS)


def test_each_device_of_a_buttplug_server_is_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    outputs = {"0": {"Output": {"Vibrate": {"Value": [0, 20]}}}}
    names = {"0": ("Lush", "left"), "4": ("Lush", ""), "5": ("Lush", ""), "9": ("Edge", "")}
    served = buttplug.served_devices(
        {
            index: {
                **{"DeviceIndex": int(index), "DeviceName": name, "DeviceDisplayName": display},
                "DeviceFeatures": outputs,
            }
            for index, (name, display) in names.items()
        }
    )
    monkeypatch.setattr(discovery, "answers", lambda host, port: True)
    monkeypatch.setattr(buttplug, "devices_at", lambda host, port: served)
    how = ButtplugEncoder("Lush", ((0, "Vibrate"),))
    output = OutputConfig(how, WebsocketTransport("127.0.0.1", 12345))
    actual = found_devices([replace(device(), outputs=(output,))], [])
    assert [entry.unit for entry in actual] == ["Lush (left)", "Lush #4", "Lush #5"]
    assert actual[0].description == "Lush (left) at a program on 127.0.0.1:12345"


def test_programs_are_asked_once_for_all_devices_behind_them(monkeypatch):
    behind = [load_device("bhaptics_tactsuit_x40"), load_device("bhaptics_tactosy_left")]
    requests: list[tuple[str, int]] = []

    def answering(host: str, port: int) -> bool:
        requests.append((host, port))
        return True

    monkeypatch.setattr(discovery, "answers", answering)
    actual = found_devices(behind, [])
    assert [entry.device for entry in actual] == [item.id for item in behind]
    assert {entry.port for entry in actual} == {""}  # as configured
    assert len(requests) == 1
    monkeypatch.setattr(discovery, "answers", lambda host, port: False)
    assert found_devices(behind, []) == []


def test_a_listening_program_is_found():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert answers("127.0.0.1", port)
    assert not answers("127.0.0.1", port)


def test_discovery_stays_on_this_computer(monkeypatch: pytest.MonkeyPatch) -> None:
    def reached(*_: object) -> None:
        raise AssertionError("somebody outside was asked")

    monkeypatch.setattr(socket, "create_connection", reached)
    assert not answers("example.org", 80) and not answers("8.8.8.8", 53)
