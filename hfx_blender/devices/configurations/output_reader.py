# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of a device configuration that says how the device is connected and spoken to."""

from __future__ import annotations

import ipaddress
from collections.abc import Callable
from typing import Any, Final, cast, get_args

from ...engine.rendering.device import Actuator
from ...engine.rendering.device_output import (
    BhapticsEncoder,
    ButtplugEncoder,
    BytesEncoder,
    Checksum,
    Encoder,
    NumberFormat,
    OscEncoder,
    OutputConfig,
    SerialTransport,
    TextEncoder,
    Transport,
    UdpTransport,
    WebsocketTransport,
    WireEncoder,
)
from ...files.strict_json import Node

BAUDS: Final = (9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600, 1000000)

BUTTPLUG_OUTPUTS: Final = ("Vibrate", "Rotate", "Oscillate", "Constrict", "Spray", "Temperature")

BHAPTICS_POSITIONS: Final = {
    "VestFront": 20,
    "VestBack": 20,
    "Head": 6,
    "ForearmL": 6,
    "ForearmR": 6,
    "HandL": 3,
    "HandR": 3,
    "FootL": 3,
    "FootR": 3,
    "GloveL": 6,
    "GloveR": 6,
}
"""Motors of each place that the bHaptics Player knows."""

MAX_WIRE_CHANNELS: Final = 32

_PLACEHOLDERS: Final = r"\{(?:device|actuator|control|number|side|Side)\}"
_OSC_ADDRESS: Final = rf"(?:/(?:[A-Za-z0-9_.\-]|{_PLACEHOLDERS})+)+"
_HEX: Final = r"(?:[0-9a-f]{2}){1,32}"
_SHORT_TEXT: Final = r"[\x20-\x7e]{0,32}"
_FULL_SCALES: Final = {"u8": 0xFF, "u16le": 0xFFFF, "u16be": 0xFFFF}
_TRANSPORT_OF: Final = {
    "hfx-wire": "serial",
    "bytes": "serial",
    "text": "serial",
    "osc": "udp",
    "buttplug": "websocket",
    "bhaptics": "websocket",
}
_PORTS: Final = {"osc": 9000, "buttplug": 12345, "bhaptics": 15881}


def output(node: Node, actuators: tuple[Actuator, ...]) -> OutputConfig:
    """Encoder and transport of a device.

    Raises
    ------
    InputError
    """
    members = node.members(required=("encoder",), optional=("transport",))
    readers: dict[str, Callable[[Node, tuple[Actuator, ...]], Encoder]] = {
        "hfx-wire": _wire,
        "bytes": _bytes,
        "text": _text,
        "osc": _osc,
        "buttplug": _buttplug,
        "bhaptics": _bhaptics,
    }
    kind = _kind(members["encoder"], tuple(readers))
    encoder = readers[kind](members["encoder"], actuators)
    if "transport" in members:
        return OutputConfig(encoder, _transport(members["transport"], kind))
    if _TRANSPORT_OF[kind] == "serial":
        return OutputConfig(encoder, SerialTransport(115200))
    is_udp = _TRANSPORT_OF[kind] == "udp"
    return OutputConfig(
        encoder, (UdpTransport if is_udp else WebsocketTransport)("127.0.0.1", _PORTS[kind])
    )


def _kind(node: Node, kinds: tuple[str, ...]) -> str:
    members = node.entries(allowed="an object with a 'kind'")
    if "kind" not in members:
        node.members(required=("kind",))
    return members["kind"].choice(kinds)


def _transport(node: Node, encoder: str) -> Transport:
    kind = _kind(node, (_TRANSPORT_OF[encoder],))
    if kind == "serial":
        members = node.members(required=("kind", "baud"))
        if members["baud"].integer(BAUDS[0], BAUDS[-1]) not in BAUDS:
            members["baud"].fail("one of " + ", ".join(map(str, BAUDS)))
        return SerialTransport(members["baud"].value)
    members = node.members(required=("kind",), optional=("host", "port"))
    host = members["host"].text(r"[0-9A-Za-z:.]{1,45}", _LOCAL) if "host" in members else ""
    if host and not is_local(host):
        members["host"].fail(_LOCAL)
    port = members["port"].integer(1, 65535) if "port" in members else _PORTS[encoder]
    made = UdpTransport if kind == "udp" else WebsocketTransport
    return made(host or "127.0.0.1", port)


_LOCAL: Final = 'localhost or an address of a private network such as "192.168.0.7"'


def is_local(host: str) -> bool:
    """Test a host for this computer or an address of a private network; names are neither."""
    if host == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    if address.is_loopback:
        return True
    is_odd = address.is_multicast or address.is_unspecified or address.is_reserved
    return address.is_private and not is_odd


def _wire(node: Node, actuators: tuple[Actuator, ...]) -> Encoder:
    node.members(required=("kind",))
    if len(actuators) > MAX_WIRE_CHANNELS:
        node.fail(f"another encoder: this one takes {MAX_WIRE_CHANNELS} actuators at most")
    for each in actuators:  # a board that falls silent sets its pins to 0
        if each.type.strength.neutral != each.type.strength.minimum:
            node.fail(f"another encoder: actuator '{each.id}' is not silent at its minimum")
    return WireEncoder()


def _bytes(node: Node, _actuators: tuple[Actuator, ...]) -> Encoder:
    members = node.members(
        required=("kind", "number"),
        optional=("header", "full_scale", "checksum", "footer", "stop"),
    )
    number = cast(NumberFormat, members["number"].choice(get_args(NumberFormat)))
    checksum = members["checksum"].choice(get_args(Checksum)) if "checksum" in members else "none"
    most = _FULL_SCALES[number]
    return BytesEncoder(
        header=_hex(members.get("header")) or b"",
        number=number,
        full_scale=members["full_scale"].integer(1, most) if "full_scale" in members else most,
        checksum=cast(Checksum, checksum),
        footer=_hex(members.get("footer")) or b"",
        stop=_hex(members.get("stop")),
    )


def _hex(node: Node | None) -> bytes | None:
    described = 'hexadecimal bytes such as "ff0a", 32 at most'
    return None if node is None else bytes.fromhex(node.text(_HEX, described))


def _text(node: Node, _actuators: tuple[Actuator, ...]) -> Encoder:
    members = node.members(required=("kind", "full_scale"), optional=("start", "separator", "stop"))
    short: dict[str, Any] = {
        key: members[key].text(_SHORT_TEXT, "up to 32 printable ASCII characters")
        for key in ("start", "separator", "stop")
        if key in members
    }
    if short.get("separator", " ") == "" or any(c.isdigit() for c in short.get("separator", "")):
        members["separator"].fail("1 to 32 printable ASCII characters without digits")
    return TextEncoder(
        start=short.get("start", ""),
        separator=short.get("separator", " "),
        full_scale=members["full_scale"].integer(1, 65535),
        stop=short.get("stop"),
    )


def _osc(node: Node, actuators: tuple[Actuator, ...]) -> Encoder:
    members = node.members(required=("kind",), optional=("address", "addresses", "values", "send"))
    if ("address" in members) == ("addresses" in members):
        node.fail("either 'address' or 'addresses'")
    described = "an OSC address such as /hfx/{device}/{actuator}/{control}"
    if "address" in members:
        address = members["address"].text(_OSC_ADDRESS, described)
        count = sum(1 for a in actuators for c in a.type.controls if c.minimum < c.maximum)
        is_named = "{actuator}" in address or "{number}" in address
        if count > 1 and not is_named:
            members["address"].fail(f"{described}, which differs for each actuator")
        several = any(sum(c.minimum < c.maximum for c in a.type.controls) > 1 for a in actuators)
        if several and "{control}" not in address and "{number}" not in address:
            members["address"].fail(f"{described}, which differs for each control")
        addresses: tuple[str, ...] = (address,)
    else:
        count = sum(1 for a in actuators for c in a.type.controls if c.minimum < c.maximum)
        found = members["addresses"].items(least=count, most=count)
        addresses = tuple(item.text(_OSC_ADDRESS, described) for item in found)
        if len(set(addresses)) != len(addresses):
            members["addresses"].fail("each address once")
    values = members["values"].choice(("fraction", "unit")) if "values" in members else "fraction"
    send = members["send"].choice(("bundle", "messages")) if "send" in members else "bundle"
    return OscEncoder(addresses, is_fraction=values == "fraction", is_bundle=send == "bundle")


def _buttplug(node: Node, actuators: tuple[Actuator, ...]) -> Encoder:
    members = node.members(required=("kind", "outputs"), optional=("device_name",))
    outputs = []
    for item in members["outputs"].items(least=len(actuators), most=len(actuators)):
        each = item.members(required=("feature", "output"))
        outputs.append((each["feature"].integer(0, 255), each["output"].choice(BUTTPLUG_OUTPUTS)))
    if len(set(outputs)) != len(outputs):
        members["outputs"].fail("each feature and output once")
    name = members["device_name"].text() if "device_name" in members else ""
    return ButtplugEncoder(name, tuple(outputs))


def _bhaptics(node: Node, actuators: tuple[Actuator, ...]) -> Encoder:
    members = node.members(required=("kind", "dots"))
    dots = []
    for item in members["dots"].items(least=len(actuators), most=len(actuators)):
        each = item.members(required=("position", "index"))
        position = each["position"].choice(tuple(BHAPTICS_POSITIONS))
        dots.append((position, each["index"].integer(0, BHAPTICS_POSITIONS[position] - 1)))
    if len(set(dots)) != len(dots):
        members["dots"].fail("each position and index once")
    return BhapticsEncoder(tuple(dots))
