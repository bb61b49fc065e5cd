# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of the output of a configuration: encoder and transport."""

from __future__ import annotations

import ipaddress
from typing import Final

from ...engine.rendering.device_config import (
    Actuator,
    BhapticsEncoder,
    ButtplugEncoder,
    BytesEncoder,
    Encoder,
    OscEncoder,
    OutputConfig,
    SerialTransport,
    TextEncoder,
    UdpTransport,
    WebsocketTransport,
    WireEncoder,
)
from ...files.json_shapes import Node
from .device_shape import FULL_SCALES, LOCAL, OSC_ADDRESS, TRANSPORT_OF

MAX_WIRE_CHANNELS: Final = 32

_PORTS: Final = {"osc": 9000, "buttplug": 12345, "bhaptics": 15881}


def output(node: Node, actuators: tuple[Actuator, ...]) -> OutputConfig:
    """Read the encoder and transport of a device, with default hosts and ports. Raises InputError:
    a host is not local, or the encoder does not fit number, silence or channels of the
    actuators."""
    kind = node["encoder"].get("kind")
    encoder = _encoder(node["encoder"], kind, actuators)
    transport = node["transport"] if "transport" in node else Node({}, node.file)
    # The encoder implies the kind of transport.
    if TRANSPORT_OF[kind] == "serial":
        return OutputConfig(encoder, SerialTransport(transport.get("baud", 115200)))
    host, port = transport.get("host", "127.0.0.1"), transport.get("port", _PORTS[kind])
    if not is_local(host):
        transport["host"].fail(LOCAL)
    is_udp = TRANSPORT_OF[kind] == "udp"
    return OutputConfig(encoder, (UdpTransport if is_udp else WebsocketTransport)(host, port))


def is_local(host: str) -> bool:
    """Test that a host is "localhost", or a loopback or private network address. False for other
    names, and for multicast, unspecified and reserved addresses."""
    if host == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    if address.is_loopback:
        return True
    # Python counts some of these as private.
    is_odd = address.is_multicast or address.is_unspecified or address.is_reserved
    return address.is_private and not is_odd


def _encoder(node: Node, kind: str, actuators: tuple[Actuator, ...]) -> Encoder:
    """Read an encoder of a kind. InputError unless ``buttplug`` and ``bhaptics`` have an item for
    each actuator, and ``hfx-wire`` 32 actuators at most, all silent at their minimum."""
    if kind == "bytes":
        number = node.get("number")
        return BytesEncoder(
            header=bytes.fromhex(node.get("header", "")),
            number=number,
            full_scale=node.get("full_scale", FULL_SCALES[number]),
            checksum=node.get("checksum", "none"),
            footer=bytes.fromhex(node.get("footer", "")),
            stop=bytes.fromhex(node.get("stop")) if "stop" in node else None,
        )
    if kind == "text":
        start, separator = node.get("start", ""), node.get("separator", " ")
        return TextEncoder(start, separator, node.get("full_scale"), node.get("stop"))
    if kind == "osc":
        return _osc(node, actuators)
    if kind == "buttplug":
        _one_for_each(node["outputs"], len(actuators))
        outputs = tuple((item["feature"], item["output"]) for item in node.get("outputs"))
        return ButtplugEncoder(node.get("device_name", ""), outputs)
    if kind == "bhaptics":
        _one_for_each(node["dots"], len(actuators))
        return BhapticsEncoder(tuple((dot["position"], dot["index"]) for dot in node.get("dots")))
    if len(actuators) > MAX_WIRE_CHANNELS:
        node.fail(f"another encoder: this one takes {MAX_WIRE_CHANNELS} actuators at most")
    for actuator in actuators:  # a board that falls silent sets its pins to 0
        if actuator.type.strength.neutral != actuator.type.strength.minimum:
            node.fail(f"another encoder: actuator '{actuator.id}' is not silent at its minimum")
    return WireEncoder()


def _osc(node: Node, actuators: tuple[Actuator, ...]) -> Encoder:
    """Read OSC addresses, one for each control with a range, or one template for all; by default
    shares of full scale in bundles. InputError for another number, or a template with the same
    address for two controls."""
    counts = [sum(c.minimum < c.maximum for c in x.type.controls) for x in actuators]
    # A single template has to give a different address for each channel.
    if "address" in node:
        address = node.get("address")
        if sum(counts) > 1 and "{actuator}" not in address and "{number}" not in address:
            node["address"].fail(f"{OSC_ADDRESS.note}, which differs for each actuator")
        if max(counts) > 1 and "{control}" not in address and "{number}" not in address:
            node["address"].fail(f"{OSC_ADDRESS.note}, which differs for each control")
        addresses: tuple[str, ...] = (address,)
    else:
        _one_for_each(node["addresses"], sum(counts))
        addresses = tuple(node.get("addresses"))
    return OscEncoder(
        addresses,
        is_fraction=node.get("values", "fraction") == "fraction",
        is_bundle=node.get("send", "bundle") == "bundle",
    )


def _one_for_each(node: Node, count: int) -> None:
    """Reject a list without exactly ``count`` items, one for each actuator or channel."""
    if len(node.value) != count:
        node.fail(f"{count} items")
