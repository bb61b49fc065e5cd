# SPDX-License-Identifier: GPL-3.0-or-later
"""A device configuration's JSON as plain data, every field checked."""

from __future__ import annotations

import itertools
import re
from typing import Any, Final

from ...engine.modality import AMBIENT_NEUTRAL_C, MODALITIES
from ...engine.modality import Parameter as ModalityParameter
from ...engine.rendering.conditioning.drive import DriveCurve
from ...engine.rendering.conditioning.waveform import WAVEFORMS, Waveform
from ...engine.rendering.device import (
    Actuator,
    ActuatorType,
    Brand,
    Control,
    DeviceConfig,
    Mount,
    Scheme,
    Substitution,
)
from ...errors import InputError
from ...files.kinds import refuse_another
from ...files.strict_json import Node
from . import layout_reader, output_reader
from .layout_reader import ID_DESCRIBED, ID_PATTERN

SCHEMA: Final = "hfx-device"
VERSION: Final = 1

MAX_ACTUATORS: Final = 1000
MAX_TEMPERATURE_C: Final = 40.0
"""Highest temperature of any device: a conservative default for heat near skin, not a certified
one."""

WEARABLE_SIDES: Final = ("left", "right")

_CONTROLS: Final = {
    "vibration": ("amplitude_m_s2", "frequency_hz"),
    "pressure": ("pressure_kpa",),
    "temperature": ("temperature_c",),
    "wind": ("speed_m_s",),
}
"""Controls of an actuator by modality, its strength first."""


_IN_TIME: Final = {
    "slew_per_s": (0.001, 1e6),
    "maximum_on_s": (0.01, 86_400.0),
    "rest_s": (0.0, 86_400.0),
}
"""Limits in time that an actuator type may have, and their ranges."""

_MEASURED: Final = ("resonance_hz", "drive", "detection_thresholds")
"""Optional measured properties of a vibration actuator type."""

_FREQUENCIES_HZ: Final = (0.1, 1000.0)
_SERIAL: Final = r"[A-Za-z0-9_.:*?-]{1,64}"
_SERIAL_DESCRIBED: Final = "1 to 64 of letters, digits, _ . : -, and * and ? for any"


def device_from(document: Node) -> DeviceConfig:
    """Understand a whole configuration.

    Raises
    ------
    InputError
        For the first fault: file, place in it, what was found and what is allowed.
    """
    refuse_another(document.value, document.file, SCHEMA)
    top = document.members(
        required=("schema", "version", "id", "name", "actuator_types", "actuators"),
        optional=(
            "description",
            "brand",
            "size_m",
            "mount",
            "side",
            "rendering",
            "substitutions",
            "defaults",
            "output",
        ),
    )
    top["schema"].choice((SCHEMA,))
    top["version"].integer(VERSION, VERSION)
    types = {
        name: _actuator_type(name, node)
        for name, node in top["actuator_types"]
        .entries(allowed="an object with at least one actuator type", least=1)
        .items()
    }
    mount = layout_reader.mount(top["mount"]) if "mount" in top else None
    actuators = tuple(
        _actuator(node, types, mount)
        for node in top["actuators"].items(least=1, most=MAX_ACTUATORS)
    )
    _refuse_repeated_ids(top["actuators"], actuators)
    if mount is not None:
        layout_reader.refuse_overlap(top["mount"], mount, top["actuators"])
    side = top["side"].choice(WEARABLE_SIDES) if "side" in top else None
    width_m, height_m = _size(top["size_m"]) if "size_m" in top else (None, None)
    device_id, name = top["id"].text(ID_PATTERN, ID_DESCRIBED), top["name"].text()
    return DeviceConfig(
        id=device_id if side is None else f"{device_id}_{side}",
        name=name if side is None else f"{name} ({side})",
        description=top["description"].text() if "description" in top else "",
        actuator_types=types,
        actuators=actuators,
        scheme=layout_reader.scheme(top["rendering"]) if "rendering" in top else Scheme(),
        mount=mount,
        substitutions=_substitutions(top.get("substitutions"), actuators),
        gain=_gain(top["defaults"]) if "defaults" in top else 1.0,
        brand=_brand(top["brand"]) if "brand" in top else None,
        width_m=width_m,
        height_m=height_m,
        side=side,
        output=output_reader.output(top["output"], actuators) if "output" in top else None,
    )


def _refuse_repeated_ids(node: Node, actuators: tuple[Actuator, ...]) -> None:
    seen: set[str] = set()
    for i, actuator in enumerate(actuators):
        if actuator.id in seen:
            raise InputError(
                f'{node.file}: {node.path}[{i}].id is "{actuator.id}", which an actuator before '
                "it has; allowed is a name of its own."
            )
        seen.add(actuator.id)


def _size(node: Node) -> tuple[float, float]:
    members = node.members(required=("width", "height"))
    return members["width"].number(0.001, 10.0, "m"), members["height"].number(0.001, 10.0, "m")


def _brand(node: Node) -> Brand:
    members = node.members(required=("vendor",), optional=("model", "usb", "serial"))
    usb = []
    for item in members["usb"].items(least=1, most=16) if "usb" in members else ():
        ids = item.members(required=("vendor_id", "product_id"))
        usb.append((_usb_id(ids["vendor_id"]), _usb_id(ids["product_id"])))
    model = members["model"].text() if "model" in members else ""
    serial = members["serial"].text(_SERIAL, _SERIAL_DESCRIBED) if "serial" in members else ""
    return Brand(members["vendor"].text(), model, tuple(usb), serial)


def _usb_id(node: Node) -> int:
    return int(node.text(r"0x[0-9a-f]{4}", 'four hexadecimal digits such as "0x2341"'), 16)


def _gain(node: Node) -> float:
    members = node.members(required=(), optional=("gain",))
    return members["gain"].number(0.0, 10.0) if "gain" in members else 1.0


def _actuator_type(name: str, node: Node) -> ActuatorType:
    if not re.fullmatch(ID_PATTERN, name):
        raise InputError(
            f"{node.file}: {node.path}: the name of an actuator type is {ID_DESCRIBED}."
        )
    members = node.members(
        required=("modality", "parameters"),
        optional=(
            "latency_ms",
            "update_interval_ms",
            "limits",
            "takes_waveform",
            "waveform",
            *_IN_TIME,
            *_MEASURED,
        ),
    )
    modality = members["modality"].choice(tuple(MODALITIES))
    takes_waveform = "takes_waveform" in members and members["takes_waveform"].boolean()
    if takes_waveform and modality != "vibration":
        members["takes_waveform"].fail("left out: only vibration is played as a waveform")
    if "waveform" in members and not takes_waveform:
        members["waveform"].fail('left out: it needs "takes_waveform": true')
    for each in _MEASURED:
        if each in members and modality != "vibration":
            members[each].fail("left out: it is a property of vibration only")
    names = _CONTROLS[modality]
    ranges = members["parameters"].members(required=names)
    limits = members["limits"].members(required=(), optional=names) if "limits" in members else {}
    latency = members.get("latency_ms")
    interval = members.get("update_interval_ms")
    return ActuatorType(
        name=name,
        modality=modality,
        controls=tuple(_control(modality, each, ranges[each], limits.get(each)) for each in names),
        latency_ms=0.0 if latency is None else latency.number(0.0, 60_000.0, "ms"),
        update_interval_ms=10.0 if interval is None else interval.number(0.1, 60_000.0, "ms"),
        takes_waveform=takes_waveform,
        waveform=_waveform(members.get("waveform")),
        **_in_time_and_measured(members),
    )


def _waveform(node: Node | None) -> Waveform:
    if node is None:
        return "sine"
    chosen = node.choice(WAVEFORMS)
    return next(each for each in WAVEFORMS if each == chosen)


def _in_time_and_measured(members: dict[str, Node]) -> dict[str, Any]:
    """Time limits and measured curves of an actuator type."""
    found: dict[str, Any] = {
        name: members[name].number(*_IN_TIME[name]) for name in _IN_TIME if name in members
    }
    if "resonance_hz" in members:
        found["resonance_hz"] = members["resonance_hz"].number(*_FREQUENCIES_HZ, "Hz")
    if "drive" in members:
        curves = [_curve(node) for node in members["drive"].items(least=1, most=32)]
        if any(b.frequency_hz <= a.frequency_hz for a, b in itertools.pairwise(curves)):
            members["drive"].fail("curves of ascending frequency")
        found["drive"] = tuple(curves)
    if "detection_thresholds" in members:
        node = members["detection_thresholds"]
        pairs = [
            _pair(each, _FREQUENCIES_HZ, (0.0, 1000.0)) for each in node.items(least=1, most=64)
        ]
        if any(b[0] <= a[0] for a, b in itertools.pairwise(pairs)):
            node.fail("pairs of ascending frequency")
        found["thresholds"] = tuple(pairs)
    return found


def _curve(node: Node) -> DriveCurve:
    members = node.members(required=("frequency_hz", "points"))
    points = [
        _pair(each, (0.0, 1.0), (0.0, 1000.0))
        for each in members["points"].items(least=2, most=256)
    ]
    is_rising = all(a[0] < b[0] and a[1] < b[1] for a, b in itertools.pairwise(points))
    if points[0] != (0.0, 0.0) or not is_rising:
        members["points"].fail("pairs of drive and output that both rise from [0, 0]")
    return DriveCurve(members["frequency_hz"].number(*_FREQUENCIES_HZ, "Hz"), tuple(points))


def _pair(
    node: Node, first: tuple[float, float], second: tuple[float, float]
) -> tuple[float, float]:
    one, other = node.items(least=2, most=2)
    return one.number(*first), other.number(*second)


def _control(modality: str, name: str, node: Node, limits: Node | None) -> Control:
    known = next(each for each in MODALITIES[modality].parameters if each.name == name)
    is_strength = name == MODALITIES[modality].strength
    # Strengths but temperature are silent at 0, which therefore must be in their range.
    is_silent_at_0 = is_strength and modality != "temperature"
    minimum, maximum = _range(node, known, may_be_fixed=not is_strength)
    if is_silent_at_0 and minimum != 0.0:
        node.member("minimum").fail("0, at which the actuator is silent")
    lowest, highest = minimum, maximum
    if limits is not None:
        bounds = limits.members(required=(), optional=("minimum", "maximum"))
        if "minimum" in bounds:
            high = 0.0 if is_silent_at_0 else maximum
            lowest = bounds["minimum"].number(minimum, high, known.unit)
        if "maximum" in bounds:
            highest = bounds["maximum"].number(lowest, maximum, known.unit)
    if modality == "temperature":
        highest = min(highest, MAX_TEMPERATURE_C)
        if lowest > highest:
            node.fail(f"a range that reaches below {MAX_TEMPERATURE_C:g} degC, the hottest allowed")
    neutral = 0.0 if is_silent_at_0 else min(max(_default(name), lowest), highest)
    if "neutral" in node.value:
        high = 0.0 if is_silent_at_0 else highest
        neutral = node.member("neutral").number(lowest, high, known.unit)
    return Control(name, minimum, maximum, lowest, highest, neutral)


def _default(name: str) -> float:
    """Neutral value of a control whose configuration names none."""
    return {"temperature_c": AMBIENT_NEUTRAL_C, "frequency_hz": 100.0}[name]


def _range(node: Node, known: ModalityParameter, *, may_be_fixed: bool) -> tuple[float, float]:
    if may_be_fixed and isinstance(node.value, dict) and "fixed" in node.value:
        members = node.members(required=("unit", "fixed"))
        members["unit"].choice((known.unit,))
        fixed = members["fixed"].number(known.minimum, known.maximum, known.unit)
        return fixed, fixed
    members = node.members(required=("unit", "minimum", "maximum"), optional=("neutral",))
    members["unit"].choice((known.unit,))
    minimum = members["minimum"].number(known.minimum, known.maximum, known.unit)
    return minimum, members["maximum"].number(minimum, known.maximum, known.unit)


def _actuator(node: Node, types: dict[str, ActuatorType], mount: Mount | None) -> Actuator:
    members = node.members(required=("id", "type", "place"))
    return Actuator(
        id=members["id"].text(ID_PATTERN, ID_DESCRIBED),
        type=types[members["type"].choice(tuple(types))],
        place=layout_reader.place(members["place"], mount),
    )


def _substitutions(node: Node | None, actuators: tuple[Actuator, ...]) -> dict[str, Substitution]:
    if node is None:
        return {}
    types = tuple(each.type for each in actuators)
    sources = node.members(required=(), optional=tuple(MODALITIES))
    return {name: _substitution(name, each, types) for name, each in sources.items()}


def _substitution(source: str, node: Node, types: tuple[ActuatorType, ...]) -> Substitution:
    targets = tuple(dict.fromkeys(each.modality for each in types if each.modality != source))
    value: Any = node.value
    is_vibration = isinstance(value, dict) and value.get("as") == "vibration"
    optional = ("frequency_hz",) if is_vibration else ()
    members = node.members(required=("as", "scale"), optional=optional)
    target = members["as"].choice(targets)
    frequency_hz = None
    if "frequency_hz" in members:
        frequency_hz = members["frequency_hz"].number(0.1, 1000.0, "Hz")
    elif is_vibration:
        frequency_hz = _own_frequency_hz(types)
    scale = members["scale"].members(required=("value", "unit"))
    units = {name: _strength_unit(name) for name in (source, target)}
    scale["unit"].choice((f"{units[target]} per {units[source]}",))
    return Substitution(
        source,
        target,
        # A negative scale makes sense only where a strength can be negative: wind that cools.
        scale["value"].number(-1000.0 if target == "temperature" else 0.0, 1000.0),
        frequency_hz,
    )


def _own_frequency_hz(types: tuple[ActuatorType, ...]) -> float:
    """The frequency of what has none: the resonance, else the neutral, or only, frequency."""
    vibrating = [each for each in types if each.modality == "vibration"]
    resonances = (each.resonance_hz for each in vibrating if each.resonance_hz is not None)
    return next(resonances, vibrating[0].controls[1].neutral)


def _strength_unit(modality: str) -> str:
    found = MODALITIES[modality]
    return next(each.unit for each in found.parameters if each.name == found.strength)
