# SPDX-License-Identifier: GPL-3.0-or-later
"""A device is found on the one port whose ids are its own."""

from __future__ import annotations

from dataclasses import replace

import pytest
from live_process import BAND

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live.discovery import FoundPort, port_of
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
