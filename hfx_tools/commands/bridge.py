# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx bridge``: passes HFX's output by OSC to devices with another protocol."""

from __future__ import annotations

import argparse
import os
import socket
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

from hfx_blender.commands.console import Console
from hfx_blender.errors import DeviceError, UsageError
from hfx_blender.processes import process_end
from hfx_blender.tracking.osc_packets import decode

SILENT_S: Final = 1.0
"""Time without a datagram after which the device is silenced."""

_STEP_S: Final = 0.05
PASSWORD: Final = "HFX_DYSON_PASSWORD"


class Bridged(Protocol):
    """Device of a bridge."""

    def set(self, values: dict[str, float]) -> None:
        """Apply values by actuator; without any the device is silent. Raises DeviceError."""

    def close(self) -> None:
        """Silence the device and disconnect."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "bridge",
        help="pass live output to a Dyson fan or a Myo",
        description="Receive the live output of HFX by OSC on this computer, and pass it to a "
        "device. The device is silenced a second after the last value, and at the end (Ctrl-C).",
    )
    kinds = parser.add_subparsers(dest="kind", metavar="DEVICE", required=True)
    dyson = kinds.add_parser("dyson", help="a fan of Dyson's Link series, by MQTT")
    dyson.add_argument("--host", required=True, help="address of the fan in the home network")
    dyson.add_argument("--mqtt-port", type=int, default=1883, metavar="PORT")
    dyson.add_argument("--serial", required=True, help="serial number on the fan's sticker")
    dyson.add_argument(
        "--product",
        default="475",
        help="number in the fan's Wi-Fi name: 475 Pure Cool Link (default), 455 Hot+Cool Link",
    )
    dyson.add_argument("--port", type=int, default=9010, help="UDP port of the output")
    myo = kinds.add_parser("myo", help="a Thalmic Myo, by Bluetooth LE")
    myo.add_argument("--address", default="", help="Bluetooth address (default: the first found)")
    myo.add_argument("--port", type=int, default=9011, help="UDP port of the output")
    parser.set_defaults(run=run)
    for kind in (dyson, myo):
        kind.set_defaults(run=run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Connect the device and pass values until Ctrl-C; returns 0."""
    device: Bridged
    if options.kind == "dyson":
        from ..bridges.dyson import DysonFan

        password = os.environ.get(PASSWORD, "")
        if not password:
            raise UsageError(f"dyson: set {PASSWORD} to the Wi-Fi password on the fan's sticker")
        device = DysonFan(
            options.host, options.mqtt_port, options.serial, options.product, password
        )
    else:
        from ..bridges.myo import Myo

        device = Myo(options.address)
    try:
        try:
            console.say(f"Connected. Values are received on UDP port {options.port}; Ctrl-C ends.")
            passed(device, options.port, lambda: not process_end.check())
        finally:
            device.close()
    except process_end.TerminatedError:
        # The usual sentence is about files, which a bridge does not write.
        if process_end.claims_farewell():
            console.warn("hfx: ended; the device is silent")
        raise
    return 0


def passed(device: Bridged, port: int, goes_on: Callable[[], bool]) -> None:
    """Pass values received on a UDP port of this computer to a device while ``goes_on()``. Raises
    DeviceError: the port is in use, or the device is lost."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind(("127.0.0.1", port))
        except OSError as error:
            raise DeviceError(f"UDP port {port} cannot be opened ({error}).") from None
        receiver.settimeout(_STEP_S)
        values: dict[str, float] = {}
        last_s = time.monotonic()
        while goes_on():
            try:
                datagram = receiver.recv(65_536)
            except TimeoutError:
                datagram = b""
            if datagram:
                last_s = time.monotonic()
                for message in decode(datagram).messages:
                    if message.arguments and isinstance(message.arguments[0], int | float):
                        actuator = message.address.rpartition("/")[2]
                        values[actuator] = float(message.arguments[0])
            if time.monotonic() - last_s > SILENT_S:
                values = {}
            device.set(values)
