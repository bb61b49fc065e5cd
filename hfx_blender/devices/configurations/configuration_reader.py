# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of device configurations: JSON to ``DeviceConfig``, with conditions between fields."""

import ipaddress
import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from ...engine.arrays import F64
from ...engine.body.parts import PARTS
from ...engine.modality import MODALITIES, Modality, Parameter
from ...engine.rendering import device_config
from ...engine.rendering.conditioning.waveform import DriveCurve
from ...engine.rendering.mounts import place_on
from ...errors import InputError
from ...files.json_shapes import Node, Number
from ...files.kinds import refuse_another
from .device_shape import DEVICE, FULL_SCALES, LOCAL, OSC_ADDRESS, SCHEMA, TRANSPORT_OF

MAX_CHANNELS: Final = {"hfx-wire": 32, "vrc-haptics": 128}
_PORTS: Final = {"osc": 9000, "vrc-haptics": 1027, "buttplug": 12345, "bhaptics": 15881}


def device_from(document: Node) -> device_config.DeviceConfig:
    """Convert a JSON document to a device; without scripts. A device for one side gets the side as
    suffix of id and name.

    Raises InputError: with the first fault: file, place, found and allowed values.
    """
    refuse_another(document.value, document.file, SCHEMA)
    top = document.hold(DEVICE)
    types = {
        name: _actuator_type(name, node) for name, node in top["actuator_types"].members().items()
    }
    mount = _mount(top["mount"]) if "mount" in top else None
    actuators = _actuators(top["actuators"], types, mount)
    if mount is not None:
        _refuse_overlap(top["mount"], mount, top["actuators"])
    scheme, substitutions = device_config.Scheme(), {}
    if "rendering" in top:
        options = dict(top["rendering"].get("options", {}))
        options = {k: v if isinstance(v, str) else float(v) for k, v in options.items()}
        scheme = device_config.Scheme(top["rendering"].get("scheme"), **options)
    if "substitutions" in top:
        for source, node in top["substitutions"].members().items():
            substitutions[source] = _substitution(source, node, [a.type for a in actuators])
    brand = None
    if "brand" in top:
        node = top["brand"]
        pairs = ((ids["vendor_id"], ids["product_id"]) for ids in node.get("usb", ()))
        usb = tuple((int(vendor, 16), int(product, 16)) for vendor, product in pairs)
        brand = device_config.Brand(
            node.get("vendor"), node.get("model", ""), usb, node.get("serial", "")
        )
    side = top.get("side")
    size = top["size_m"] if "size_m" in top else None
    device_id, name = top.get("id"), top.get("name")
    return device_config.DeviceConfig(
        id=device_id if side is None else f"{device_id}_{side}",
        name=name if side is None else f"{name} ({side})",
        description=top.get("description", ""),
        actuator_types=types,
        actuators=actuators,
        scheme=scheme,
        mount=mount,
        substitutions=substitutions,
        gain=top["defaults"].number("gain", 1.0) if "defaults" in top else 1.0,
        brand=brand,
        width_m=None if size is None else size.number("width"),
        height_m=None if size is None else size.number("height"),
        side=side,
        outputs=_outputs(top, actuators),
    )


def _actuators(
    node: Node, types: dict[str, device_config.ActuatorType], mount: device_config.Mount | None
) -> tuple[device_config.Actuator, ...]:
    """Read the actuators, in order; ``types`` are the actuator types by name. InputError for an
    unknown type, an invalid place, or the id of an earlier actuator."""
    actuators = []
    for item in node.items():
        kind = types.get(item.get("type"))
        if kind is None:
            item["type"].fail("one of " + ", ".join(types))
        actuators.append(device_config.Actuator(item.get("id"), kind, _place(item["place"], mount)))
    known: set[str] = set()
    for item in node.items():
        own_id = item["id"]
        if own_id.value in known:
            raise InputError(
                f'{own_id.file}: {own_id.path} is "{own_id.value}", which an actuator before '
                "it has; allowed is a name of its own."
            )
        known.add(own_id.value)
    return tuple(actuators)


def _actuator_type(name: str, node: Node) -> device_config.ActuatorType:
    modality = MODALITIES[node.get("modality")]
    drive = _drive(node["drive"]) if "drive" in node else ()
    return device_config.ActuatorType(
        name=name,
        modality=modality.name,
        controls=(
            *(_control(modality, parameter, node) for parameter in modality.controls),
            *_custom_controls(node, modality),
        ),
        latency_ms=node.number("latency_ms", 0.0),
        update_interval_ms=node.number("update_interval_ms", 10.0),
        takes_waveform=node.get("takes_waveform", False),
        waveform=node.get("waveform", "sine"),
        is_tone_pair=node.get("tone_pair", False),
        drive=drive,
        thresholds=node.curve("detection_thresholds"),
        **{  # type: ignore[arg-type]  # all are numbers
            key: node.number(key)
            for key in ("slew_per_s", "maximum_on_s", "rest_s", "resonance_hz")
            if key in node
        },
    )


def _drive(node: Node) -> tuple[DriveCurve, ...]:
    """Drive curves in the order of the file; InputError unless frequencies rise strictly, and drive
    and output of each curve rise strictly from (0, 0), so that the curve can be inverted."""
    curves = []
    # A flat piece would have no single drive for an output, and could not be inverted.
    for item in node.items():
        points = item.curve("points")
        is_rising = all(a[0] < b[0] and a[1] < b[1] for a, b in itertools.pairwise(points))
        if points[0] != (0.0, 0.0) or not is_rising:
            item["points"].fail("pairs of drive and output that both rise from [0, 0]")
        curves.append(DriveCurve(item.number("frequency_hz"), points))
    if any(b.frequency_hz <= a.frequency_hz for a, b in itertools.pairwise(curves)):
        node.fail("curves of ascending frequency")
    return tuple(curves)


def _control(modality: Modality, known: Parameter, kind: Node) -> device_config.ActuatorControl:
    """Control of an actuator type for a parameter: range, limits and neutral value. Limits lie
    within the range, and below the modality's maximum for devices. The default of the neutral value
    is that of the modality, clipped to the limits. InputError for values outside, or for a list
    of allowed values without the neutral value."""
    node = kind["parameters"][known.name]
    if "fixed" in node:
        minimum = maximum = node.number("fixed")
    else:
        minimum, maximum = node.number("minimum"), node.number("maximum")
        node["maximum"].hold(Number(minimum, known.maximum, known.unit))
    lowest, highest = minimum, maximum
    if "limits" in kind and known.name in kind["limits"]:
        bounds = kind["limits"][known.name]
        if "minimum" in bounds:
            bounds["minimum"].hold(Number(minimum, maximum, known.unit))
            lowest = bounds.number("minimum")
        if "maximum" in bounds:
            bounds["maximum"].hold(Number(lowest, maximum, known.unit))
            highest = bounds.number("maximum")
    # Above all limits: no device may be hotter than the modality allows.
    highest = min(highest, known.device_maximum)
    if lowest > highest:
        node.fail(f"a range that reaches below {highest:g} {known.unit}, the hottest allowed")
    # The modality's neutral value may lie outside a device's limits, as skin temperature for a
    # heater.
    neutral = min(max(known.neutral, lowest), highest)
    if "neutral" in node:
        node["neutral"].hold(Number(lowest, highest, known.unit))
        neutral = node.number("neutral")
    if "values" not in node:
        return device_config.ActuatorControl(known.name, minimum, maximum, lowest, highest, neutral)
    values = _allowed_values(node["values"], kind, Number(minimum, maximum, known.unit))
    values = tuple(value for value in values if lowest <= value <= highest)
    if not values:
        node["values"].fail(f"a list with a value from {lowest:g} to {highest:g} {known.unit}")
    # The neutral frequency is not heard, so its default may move; silence of a strength may not.
    if "neutral" not in node and known.name != modality.strength:
        neutral = max((value for value in values if value <= neutral), default=values[0])
    if neutral not in values:
        node["values"].fail(f"a list with {neutral:g}, the neutral value")
    return device_config.ActuatorControl(
        known.name, minimum, maximum, lowest, highest, neutral, values
    )


def _custom_controls(kind: Node, modality: Modality) -> Iterator[device_config.ActuatorControl]:
    """Yield the custom controls of an actuator type. The neutral value is by default 0, clipped to
    the range, or the first choice. InputError for the name of a parameter, or for a value out of
    the range."""
    members = kind["custom"].members() if "custom" in kind else {}
    for name, node in members.items():
        if any(name == known.name for known in modality.parameters):
            node.fail("a name other than those of the modality's parameters")
        if "choices" in node:
            choices = tuple(node.get("choices"))
            last = float(len(choices) - 1)
            values = tuple(map(float, range(len(choices))))
            yield device_config.ActuatorControl(
                name, 0.0, last, 0.0, last, 0.0, values, "choice", choices
            )
            continue
        lowest, highest = node.number("minimum"), node.number("maximum")
        node["maximum"].hold(Number(lowest, 1e6, node.get("unit")))
        if "neutral" in node:
            node["neutral"].hold(Number(lowest, highest, node.get("unit")))
        neutral = node.number("neutral", min(max(0.0, lowest), highest))
        yield device_config.ActuatorControl(
            name, lowest, highest, lowest, highest, neutral, unit=node.get("unit")
        )


def _allowed_values(node: Node, kind: Node, in_range: Number) -> tuple[float, ...]:
    """Read the allowed values of a parameter, ascending. InputError for a value out of the range,
    and for actuators that take a waveform, whose samples lie between any values."""
    if kind.get("takes_waveform", False):
        node.fail("no list: actuators that take a waveform have a range only")
    for item in node.items():
        item.hold(in_range)
    return tuple(float(value) for value in node.value)


def _substitution(
    source: str, node: Node, types: list[device_config.ActuatorType]
) -> device_config.Substitution:
    """Read how a device with actuators of ``types`` plays the modality ``source``: target, scale
    and, for vibration, frequency, by default the first resonance of the vibration actuators, else
    the neutral frequency of the first. InputError if no actuator has the target modality."""
    target = node.get("as")
    targets = tuple(dict.fromkeys(kind.modality for kind in types if kind.modality != source))
    if target not in targets:
        node["as"].fail("one of " + ", ".join(targets))
    frequency_hz = None
    if target == "vibration":
        vibrating = [kind for kind in types if kind.modality == "vibration"]
        resonances = (kind.resonance_hz for kind in vibrating if kind.resonance_hz is not None)
        default_hz = next(resonances, vibrating[0].controls[1].neutral)
        frequency_hz = node.number("frequency_hz", default_hz)
    return device_config.Substitution(source, target, node["scale"].number("value"), frequency_hz)


def _mount(node: Node) -> device_config.Mount:
    """Read the mount of a layout: origin and bend radius, metres, None for a flat layout; the y
    axis is made orthogonal to x, and both of unit length. InputError for near-parallel or zero
    axes."""
    # Gram-Schmidt: the part of the y axis along the x axis is removed.
    x = _direction(node["x_axis"])
    y = np.array(node.numbers("y_axis"))
    y = y - (y @ x) * x
    if np.linalg.norm(y) < 0.1:
        node["y_axis"].fail("a direction across the x_axis")
    y /= np.linalg.norm(y)
    bend_m = node.number("bend_radius_mm") / 1000.0 if "bend_radius_mm" in node else None
    return device_config.Mount(
        _triple(node, "origin_m"), (x[0], x[1], x[2]), (y[0], y[1], y[2]), bend_m
    )


def _direction(node: Node) -> F64:
    """Unit vector (3,) of a node; InputError for a vector shorter than 0.1."""
    direction = np.array(node.value, np.float64)
    if np.linalg.norm(direction) < 0.1:
        node.fail("a direction: three numbers of which one is not near 0")
    return direction / np.linalg.norm(direction)  # type: ignore[no-any-return]


def _triple(node: Node, key: str) -> tuple[float, float, float]:
    x, y, z = node.numbers(key)
    return x, y, z


def _refuse_overlap(node: Node, mount: device_config.Mount, actuators: Node) -> None:
    """Raise InputError for a bent mount whose circumference is less than the extent of all pads
    along x; a flat mount passes."""
    if mount.bend_radius_m is None:
        return
    places = [a["place"]["pad"]["at_mm"] for a in actuators.value if "pad" in a["place"]]
    width_mm = max((x for x, _ in places), default=0) - min((x for x, _ in places), default=0)
    round_mm = 2000.0 * math.pi * abs(mount.bend_radius_m)
    if width_mm > round_mm:
        node["bend_radius_mm"].fail(
            f"at least {math.ceil(width_mm / math.tau * 100.0) / 100.0:g} mm: pads are "
            f"{width_mm:g} mm apart along x, and the circumference is {round_mm:.1f} mm"
        )


def _place(node: Node, mount: device_config.Mount | None) -> device_config.Place:
    """Read the place of an actuator: vertices, a place in the room, or a place on the body by its
    centre, metres, or as a pad, which ``mount`` converts to metres. Raises InputError: a model
    stands twice, an aim is near 0, or a pad has no ``mount``."""
    ((kind, member),) = node.members().items()
    if kind == "vertices":
        sets = tuple(
            device_config.VertexSet(x["model"], x["hash"], tuple(x["ids"])) for x in member.value
        )
        if len({vertex_set.model_id for vertex_set in sets}) != len(sets):
            member.fail("each model once")
        return device_config.VertexPlace(sets)
    if kind == "room":
        return _room_place(member)
    if "centre_m" in member:
        centre = _triple(member, "centre_m")
    elif mount is None:
        member.fail("a placement, vertices or room: the device has no 'mount' for a pad")
    else:
        # A pad lies on the mount's surface, whose coordinates are millimetres.
        (on_body,) = place_on(mount, np.array([member.numbers("at_mm")]) / 1000.0)
        centre = float(on_body[0]), float(on_body[1]), float(on_body[2])
    return device_config.BodyPlace(
        parts=tuple(member.get("parts")),
        centre_m=centre,
        radius_m=member.number("radius_m"),
        side=member.get("side"),
        stroked_by=tuple(member.get("stroked_by", ())),
    )


def _room_place(node: Node) -> device_config.RoomPlace:
    """Read a place in the room; ``reaches`` is by default all body parts. Without ``at_m`` all are
    reached equally; else range is by default 100 m, cone 360 degrees, aim None or a unit vector."""
    parts = tuple(node.get("reaches", PARTS))
    if "at_m" not in node:
        return device_config.RoomPlace(parts)
    x, y, z = _direction(node["aim"]) if "aim" in node else (0.0, 0.0, 0.0)
    return device_config.RoomPlace(
        parts,
        at_m=_triple(node, "at_m"),
        aim=(float(x), float(y), float(z)) if "aim" in node else None,
        range_m=node.number("range_m", 100.0),
        cone_deg=node.number("cone_deg", 360.0),
    )


def _outputs(
    top: Node, actuators: tuple[device_config.Actuator, ...]
) -> tuple[device_config.OutputConfig, ...]:
    """Read ``output``, or the list ``outputs`` with actuators by id; empty without both. InputError
    for both fields, and unless each actuator is in exactly one output."""
    if "output" in top:
        if "outputs" in top:
            top["outputs"].fail("no list next to 'output': write each output into 'outputs'")
        return (output(top["output"], actuators),)
    if "outputs" not in top:
        return ()
    numbers = {actuator.id: k for k, actuator in enumerate(actuators)}
    outputs = []
    unused = dict(numbers)
    for node in top["outputs"].items():
        indices = []
        for item in node["actuators"].items():
            if item.value not in unused:
                item.fail("an actuator that no other output has: " + ", ".join(unused))
            indices.append(unused.pop(item.value))
        part = tuple(actuators[k] for k in indices)
        outputs.append(replace(output(node, part), actuators=tuple(indices)))
    if unused:
        top["outputs"].fail("outputs for all actuators, also for " + ", ".join(unused))
    return tuple(outputs)


def output(node: Node, actuators: tuple[device_config.Actuator, ...]) -> device_config.OutputConfig:
    """Read the encoder and transport of a device, with default hosts and ports. Raises InputError:
    a host is not local, or the encoder does not fit number, silence or channels of the
    actuators."""
    kind = node["encoder"].get("kind")
    encoder = _encoder(node["encoder"], kind, actuators)
    transport = node["transport"] if "transport" in node else Node({}, node.file)
    # The encoder implies the kind of transport.
    if TRANSPORT_OF[kind] == "serial":
        return device_config.OutputConfig(
            encoder, device_config.SerialTransport(transport.get("baud", 115200))
        )
    # A board of VRC Haptics without a host is found by its announcements.
    default = "" if kind == "vrc-haptics" else "127.0.0.1"
    usual_port = _PORTS[kind]
    if isinstance(encoder, device_config.BhapticsEncoder):
        usual_port += encoder.sdk - 1  # the Player's port for each SDK
    host, port = transport.get("host", default), transport.get("port", usual_port)
    if host and not is_local(host):
        transport["host"].fail(LOCAL)
    is_udp = TRANSPORT_OF[kind] == "udp"
    return device_config.OutputConfig(
        encoder,
        (device_config.UdpTransport if is_udp else device_config.WebsocketTransport)(host, port),
    )


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


def _encoder(
    node: Node, kind: str, actuators: tuple[device_config.Actuator, ...]
) -> device_config.Encoder:
    """Read an encoder of a kind. InputError unless ``buttplug`` and ``bhaptics`` have an item for
    each actuator, and ``hfx-wire`` and ``vrc-haptics`` 32 and 128 actuators at most, all silent at
    their minimum."""
    if kind == "bytes":
        number = node.get("number")
        return device_config.BytesEncoder(
            header=bytes.fromhex(node.get("header", "")),
            number=number,
            full_scale=node.get("full_scale", FULL_SCALES[number]),
            checksum=node.get("checksum", "none"),
            footer=bytes.fromhex(node.get("footer", "")),
            stop=bytes.fromhex(node.get("stop")) if "stop" in node else None,
        )
    if kind == "text":
        start, separator = node.get("start", ""), node.get("separator", " ")
        return device_config.TextEncoder(start, separator, node.get("full_scale"), node.get("stop"))
    if kind == "osc":
        return _osc(node, actuators)
    if kind == "buttplug":
        _one_for_each(node["outputs"], len(actuators))
        outputs = tuple((item["feature"], item["output"]) for item in node.get("outputs"))
        return device_config.ButtplugEncoder(node.get("device_name", ""), outputs)
    if kind == "bhaptics":
        _one_for_each(node["dots"], len(actuators))
        dots = tuple((dot["position"], dot["index"]) for dot in node.get("dots"))
        return device_config.BhapticsEncoder(dots, node.get("sdk", 1))
    if len(actuators) > MAX_CHANNELS[kind]:
        node.fail(f"another encoder: this one takes {MAX_CHANNELS[kind]} actuators at most")
    for actuator in actuators:  # a board that falls silent sets its pins to 0
        if actuator.type.strength.neutral != actuator.type.strength.minimum:
            node.fail(f"another encoder: actuator '{actuator.id}' is not silent at its minimum")
    return device_config.WireEncoder() if kind == "hfx-wire" else device_config.VrcHapticsEncoder()


def _osc(node: Node, actuators: tuple[device_config.Actuator, ...]) -> device_config.Encoder:
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
    return device_config.OscEncoder(
        addresses,
        is_fraction=node.get("values", "fraction") == "fraction",
        is_bundle=node.get("send", "bundle") == "bundle",
    )


def _one_for_each(node: Node, count: int) -> None:
    """Reject a list without exactly ``count`` items, one for each actuator or channel."""
    if len(node.value) != count:
        node.fail(f"{count} items")
