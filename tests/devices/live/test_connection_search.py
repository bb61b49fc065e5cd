# SPDX-License-Identifier: GPL-3.0-or-later
"""What is missing for a connection is found before the connection, with the cure."""

from __future__ import annotations

import os
import sys
import types
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.live import connection_search
from hfx_blender.devices.live.connection_search import searched, why_not
from hfx_blender.devices.live.discovery import FoundPort
from hfx_blender.devices.live.live_settings import LiveSettings

UNO = "arduino_uno_pwm"


def first(device: Any, settings: LiveSettings) -> connection_search.Connections:
    search = searched(device, settings)
    actual = next(search)
    search.close()
    return actual


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("insoles", {"DEVICE"}),  # vibrate, and have no output
        ("pressure_vest", {"DEVICE", "AUDIO"}),
        (UNO, set()),
        ("sound_card_8", {"DEVICE"}),
    ],
)
def test_a_kind_that_would_be_refused_is_known_before(name: str, kinds: set[str]) -> None:
    device = load_device(name)
    every = ("SIMULATOR", "DEVICE", "AUDIO", "CSV")
    assert {kind for kind in every if why_not(device, kind)} == kinds


def ports_of(monkeypatch: pytest.MonkeyPatch, *ports: FoundPort) -> None:
    monkeypatch.setattr(connection_search, "serial_ports", lambda: list(ports))


def test_serial_ports_are_listed_and_a_missing_board_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    uno = load_device(UNO)
    assert uno.brand is not None
    board = FoundPort(str(tmp_path / "ttyACM0"), "Uno", uno.brand.usb[0])
    Path(board.name).touch()
    modem = FoundPort("/dev/ttyS0", "Modem", None)
    settings = LiveSettings("DEVICE")
    ports_of(monkeypatch, modem, board)
    actual = first(uno, settings)
    assert actual.ports == ((board.name, "Uno"), ("/dev/ttyS0", "Modem"))  # USB first
    assert actual.hint == ""
    ports_of(monkeypatch, modem)
    assert "switch it on" in first(uno, settings).hint
    assert "/dev/ttyX9 is missing" in first(uno, replace(settings, port="/dev/ttyX9")).hint
    ports_of(monkeypatch, board, replace(board, name="/dev/ttyACM1"))
    assert "several ports" in first(uno, settings).hint
    assert first(uno, replace(settings, port=board.name)).hint == ""
    if os.name == "posix":
        monkeypatch.setattr(os, "access", lambda *_: False)
        group = Path(board.name).group()
        assert f"add your user to the group '{group}'" in (
            first(uno, replace(settings, port=board.name)).hint
        )


def test_a_program_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    suit = load_device("bhaptics_tactsuit_x40")
    monkeypatch.setattr(connection_search, "answers", lambda host, port: False)
    actual = first(suit, LiveSettings("DEVICE"))
    assert actual.hint.endswith(":15881: start the bHaptics Player")
    monkeypatch.setattr(connection_search, "answers", lambda host, port: True)
    assert first(suit, LiveSettings("DEVICE")).hint == ""
    for port in ("x", "0", "65536", "9" * 5000):
        assert "is no network port" in first(suit, LiveSettings("DEVICE", port=port)).hint


def test_sound_cards_are_listed_with_their_channels(monkeypatch: pytest.MonkeyPatch) -> None:
    fake: Any = types.ModuleType("sounddevice")
    fake.default = types.SimpleNamespace(device=(1, 0))
    fake.query_hostapis = lambda: ({"name": "ALSA"},)
    fake.query_devices = lambda: [
        {"name": "Built-In", "max_output_channels": 2, "hostapi": 0},
        {"name": "Microphone", "max_output_channels": 0, "hostapi": 0},
        {"name": "USB Sound", "max_output_channels": 8, "hostapi": 0},
    ]
    monkeypatch.setitem(sys.modules, "sounddevice", fake)
    device = load_device("sound_card_8")  # 8 voice coils
    actual = first(device, LiveSettings("AUDIO"))
    assert actual.ports == (("Built-In, ALSA", "2 channels"), ("USB Sound, ALSA", "8 channels"))
    assert actual.hint == "Built-In, ALSA has 2 channels; the device needs 8"
    assert first(device, LiveSettings("AUDIO", port="USB Sound, ALSA")).hint == ""
    assert "named 'Gone'" in first(device, LiveSettings("AUDIO", port="Gone")).hint
    fake.query_devices = lambda: []
    assert first(device, LiveSettings("AUDIO")).hint.startswith("No sound card")
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    assert "need the Python package sounddevice" in first(device, LiveSettings("AUDIO")).hint


def test_a_log_needs_a_file() -> None:
    device = load_device("insoles")
    assert first(device, LiveSettings("CSV")).hint == "Choose a file for the log"
    assert first(device, LiveSettings("CSV", path="a.csv")).hint == ""
    assert first(device, LiveSettings("SIMULATOR")).hint == ""


def test_two_missing_boards_are_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_search, "serial_ports", list)
    uno = load_device(UNO)
    (output,) = uno.outputs
    parts = tuple(replace(output, actuators=part) for part in ((0, 1, 2), (3, 4, 5)))
    hint = first(replace(uno, outputs=parts), LiveSettings(kind="DEVICE")).hint
    assert hint.count("was not found") == 1 and ".." not in hint


def test_hints_name_the_outputs_of_a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection_search, "serial_ports", list)
    uno = load_device(UNO)
    (output,) = uno.outputs
    ids = [actuator.id for actuator in uno.actuators]
    parts = tuple(replace(output, actuators=part) for part in ((0, 1, 2), (3, 4, 5)))
    device = replace(uno, outputs=parts)
    settings = LiveSettings("DEVICE", port="/dev/ttyX9")
    text = first(device, settings).hint
    missing, by_usb = text.split(f". {ids[3]}, {ids[4]}, {ids[5]}: ")
    assert missing.startswith(f"{ids[0]}, {ids[1]}, {ids[2]}: /dev/ttyX9 is missing")
    assert "was not found" in by_usb
