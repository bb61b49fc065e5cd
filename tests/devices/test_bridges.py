# SPDX-License-Identifier: GPL-3.0-or-later
"""Bridges to devices of other protocols, against doubles: an MQTT broker, and Bluetooth's package.

Expected bytes are those of the MQTT standard (OASIS, version 3.1.1) and of Thalmic Labs' myohw.h.
"""

from __future__ import annotations

import base64
import hashlib
import json
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.transports.osc import OscOutput
from hfx_blender.errors import DeviceError
from hfx_tools.bridges import dyson, mqtt, myo
from hfx_tools.commands import bridge


class Broker:
    """Double of a broker: keeps the bytes of all packets, and answers the first one."""

    def __init__(self, code: int = 0) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.packets: list[tuple[int, bytes]] = []
        self._code = code
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        connection, _ = self._listener.accept()
        stream = connection.makefile("rb")
        while first := stream.read(1):
            length, shift = 0, 0
            while True:
                (digit,) = stream.read(1)
                length |= (digit & 127) << shift
                shift += 7
                if digit < 128:
                    break
            self.packets.append((first[0], stream.read(length)))
            if first[0] == 0x10:
                connection.sendall(bytes([0x20, 2, 0, self._code]))

    def messages(self) -> list[tuple[str, Any]]:
        found = []
        for kind, body in list(self.packets):
            if kind == 0x30:
                (count,) = struct.unpack(">H", body[:2])
                found.append((body[2 : 2 + count].decode(), json.loads(body[2 + count :])))
        return found


def until(condition: Any) -> None:
    for _ in range(400):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("not within 4 s")


@pytest.fixture
def broker() -> Broker:
    return Broker()


def test_the_bytes_are_those_of_the_standard(broker: Broker) -> None:
    client = mqtt.MqttPublisher("127.0.0.1", broker.port, "hfx", "u", "pw")
    client.publish("a/b", b"x" * 200)
    client.close()
    until(lambda: len(broker.packets) == 3)
    # Protocol name and level 4; user, password and clean session; 30 s; client, user, password.
    connect = b"\0\x04MQTT\x04\xc2\0\x1e\0\x03hfx\0\x01u\0\x02pw"
    assert broker.packets[0] == (0x10, connect)
    assert broker.packets[1] == (0x30, b"\0\x03a/b" + b"x" * 200)
    assert broker.packets[2] == (0xE0, b"")


@pytest.mark.parametrize(
    ("count", "expected"),
    [(0, b"\0"), (127, b"\x7f"), (128, b"\x80\x01"), (321, b"\xc1\x02"), (16_384, b"\x80\x80\x01")],
)
def test_lengths_are_those_of_table_2_4(count: int, expected: bytes) -> None:
    assert mqtt._length(count) == expected


def test_a_refusal_and_a_missing_broker_are_named() -> None:
    with pytest.raises(DeviceError, match="the user name or password is wrong"):
        mqtt.MqttPublisher("127.0.0.1", Broker(code=4).port, "hfx")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(DeviceError, match="cannot be reached"):
        mqtt.MqttPublisher("127.0.0.1", port, "hfx")


@pytest.mark.parametrize(
    ("values", "heats", "expected"),
    [
        ({}, False, {"fmod": "OFF"}),
        ({"fan": 0.0, "air": 24.0}, True, {"fmod": "OFF"}),
        ({"fan": 2.0}, False, {"fmod": "FAN", "fnsp": "0005"}),
        ({"fan": 4.0, "air": 37.0}, False, {"fmod": "FAN", "fnsp": "0010"}),
        ({"fan": 0.1}, False, {"fmod": "FAN", "fnsp": "0001"}),
        # 300 K are 27 degrees.
        (
            {"fan": 0.0, "air": 27.0},
            True,
            {"fmod": "FAN", "fnsp": "0001", "hmod": "HEAT", "hmax": "3000"},
        ),
        ({"fan": 2.0, "air": 18.0}, True, {"fmod": "FAN", "fnsp": "0005", "hmod": "OFF"}),
    ],
)
def test_states_of_the_fan(values: Any, heats: bool, expected: Any) -> None:
    assert dyson.state_of(values, heats=heats) == expected


def test_the_fan_follows_the_output_and_stops_with_it(
    broker: Broker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shipped configuration through HFX's own OSC output, the bridge, and the broker."""
    monkeypatch.setattr(bridge, "SILENT_S", 0.3)
    fan = dyson.DysonFan("127.0.0.1", broker.port, "ABC", "475", "secret")
    device = load_device("dyson_pure_cool_link")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    goes_on = threading.Event()
    thread = threading.Thread(target=bridge.passed, args=(fan, port, lambda: not goes_on.is_set()))
    thread.start()
    output = OscOutput(device, device.output.encoder, "127.0.0.1", port)
    try:
        values = device.neutral
        values[0] = 2.0  # m/s

        def is_blowing() -> bool:
            output.send(values)
            return any(m["data"]["fmod"] == "FAN" for _, m in broker.messages())

        until(is_blowing)
        topic, message = broker.messages()[-1]
        assert topic == "475/ABC/command"
        assert (message["msg"], message["mode-reason"]) == ("STATE-SET", "LAPP")
        assert message["data"] == {"fmod": "FAN", "fnsp": "0005"}
        until(lambda: broker.messages()[-1][1]["data"] == {"fmod": "OFF"})
    finally:
        goes_on.set()
        thread.join()
        output.close()
        fan.close()
    password = base64.b64encode(hashlib.sha512(b"secret").digest())
    assert broker.packets[0][1].endswith(b"\0\x03ABC" + struct.pack(">H", len(password)) + password)


def test_a_vibration_of_the_myo() -> None:
    """myohw.h: command 7, 18 bytes, six steps of duration (uint16, ms) and strength (uint8)."""
    assert myo.vibrate(1.0) == bytes([7, 18, 0x2C, 0x01, 255]) + bytes(15)
    assert myo.vibrate(0.5)[4] == 128 and myo.vibrate(-1.0)[4] == 0
    assert len(myo.vibrate(2.0)) == 20


@pytest.fixture
def bleak(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Double of the package bleak; returns the log of its calls."""
    log: list[Any] = []

    class Client:
        def __init__(self, found: Any) -> None:
            log.append(("client", found))

        async def connect(self) -> None:
            log.append("connect")

        async def write_gatt_char(self, uuid: str, data: bytes, response: bool) -> None:
            log.append((uuid, data, response))

        async def disconnect(self) -> None:
            log.append("disconnect")

    class Scanner:
        @staticmethod
        async def find_device_by_filter(accepts: Any) -> Any:
            seen = [("mouse", ["1812"]), ("band", [myo.CONTROL_SERVICE.upper()])]
            for device, uuids in seen:
                if accepts(device, SimpleNamespace(service_uuids=uuids)):
                    return device
            return None

    module: Any = ModuleType("bleak")
    module.BleakClient, module.BleakScanner = Client, Scanner
    monkeypatch.setitem(sys.modules, "bleak", module)
    yield log


def test_the_band_is_found_driven_and_silenced(bleak: list[Any]) -> None:
    band = myo.Myo()
    assert bleak == [("client", "band"), "connect"]
    band.set({"band": 1.0})
    band.set({"band": 1.0})  # holds for 0.3 s: nothing to repeat yet
    assert bleak[2:] == [(myo.COMMAND, myo.vibrate(1.0), False)]
    time.sleep(0.2)
    band.set({"band": 1.0})
    assert len(bleak) == 4
    band.close()
    assert bleak[4:] == [(myo.COMMAND, myo.vibrate(0.0), False), "disconnect"]


def test_without_bluetooth_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setitem(sys.modules, "bleak", None)
    assert cli.run(["bridge", "myo"]) == 4
    assert "pip install 'hfx-blender[bluetooth]'" in capsys.readouterr().err


def test_a_fan_without_a_password_is_wrong_usage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(bridge.PASSWORD, raising=False)
    assert cli.run(["bridge", "dyson", "--host", "127.0.0.1", "--serial", "ABC"]) == 2
