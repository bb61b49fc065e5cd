# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of device configurations: JSON to ``DeviceConfig``, with conditions between fields."""

from __future__ import annotations

import itertools

from ...engine.modality import MODALITIES, Modality, Parameter
from ...engine.rendering.conditioning.drive import DriveCurve
from ...engine.rendering.device_config import (
    Actuator,
    ActuatorControl,
    ActuatorType,
    Brand,
    DeviceConfig,
    Mount,
    Scheme,
    Substitution,
)
from ...errors import InputError
from ...files.json_shapes import Node, Number
from ...files.kinds import refuse_another
from . import layout_reader, output_reader
from .device_shape import DEVICE, SCHEMA


def device_from(document: Node) -> DeviceConfig:
    """Convert a JSON document to a device; without scripts. A device for one side gets the side as
    suffix of id and name.

    Raises InputError: with the first fault: file, place, found and allowed values.
    """
    refuse_another(document.value, document.file, SCHEMA)
    top = document.hold(DEVICE)
    types = {
        name: _actuator_type(name, node) for name, node in top["actuator_types"].members().items()
    }
    mount = layout_reader.mount(top["mount"]) if "mount" in top else None
    actuators = tuple(_actuator(node, types, mount) for node in top["actuators"].items())
    _refuse_repeated_ids(top["actuators"])
    if mount is not None:
        layout_reader.refuse_overlap(top["mount"], mount, top["actuators"])
    side = top.get("side")
    size = top["size_m"] if "size_m" in top else None
    device_id, name = top.get("id"), top.get("name")
    return DeviceConfig(
        id=device_id if side is None else f"{device_id}_{side}",
        name=name if side is None else f"{name} ({side})",
        description=top.get("description", ""),
        actuator_types=types,
        actuators=actuators,
        scheme=layout_reader.scheme(top["rendering"]) if "rendering" in top else Scheme(),
        mount=mount,
        substitutions=_substitutions(top["substitutions"], actuators)
        if "substitutions" in top
        else {},
        gain=top["defaults"].number("gain", 1.0) if "defaults" in top else 1.0,
        brand=_brand(top["brand"]) if "brand" in top else None,
        width_m=None if size is None else size.number("width"),
        height_m=None if size is None else size.number("height"),
        side=side,
        output=output_reader.output(top["output"], actuators) if "output" in top else None,
    )


def _refuse_repeated_ids(actuators: Node) -> None:
    """Raise ``InputError`` at the first actuator with the id of an earlier actuator."""
    seen: set[str] = set()
    for actuator in actuators.items():
        node = actuator["id"]
        if node.value in seen:
            raise InputError(
                f'{node.file}: {node.path} is "{node.value}", which an actuator before '
                "it has; allowed is a name of its own."
            )
        seen.add(node.value)


def _brand(node: Node) -> Brand:
    usb = ((int(ids["vendor_id"], 16), int(ids["product_id"], 16)) for ids in node.get("usb", ()))
    return Brand(node.get("vendor"), node.get("model", ""), tuple(usb), node.get("serial", ""))


def _actuator_type(name: str, node: Node) -> ActuatorType:
    modality = MODALITIES[node.get("modality")]
    drive = _drive(node["drive"]) if "drive" in node else ()
    return ActuatorType(
        name=name,
        modality=modality.name,
        controls=tuple(_control(modality, parameter, node) for parameter in modality.controls),
        latency_ms=node.number("latency_ms", 0.0),
        update_interval_ms=node.number("update_interval_ms", 10.0),
        takes_waveform=node.get("takes_waveform", False),
        waveform=node.get("waveform", "sine"),
        drive=drive,
        thresholds=node.curve("detection_thresholds"),
        **{
            key: node.number(key)
            for key in ("slew_per_s", "maximum_on_s", "rest_s", "resonance_hz")
            if key in node
        },
    )


def _drive(node: Node) -> tuple[DriveCurve, ...]:
    """Drive curves in the order of the file; InputError unless frequencies rise strictly, and drive
    and output of each curve rise strictly from (0, 0), so that the curve can be inverted.
    """
    curves = []
    for item in node.items():
        points = item.curve("points")
        is_rising = all(a[0] < b[0] and a[1] < b[1] for a, b in itertools.pairwise(points))
        if points[0] != (0.0, 0.0) or not is_rising:
            item["points"].fail("pairs of drive and output that both rise from [0, 0]")
        curves.append(DriveCurve(item.number("frequency_hz"), points))
    if any(b.frequency_hz <= a.frequency_hz for a, b in itertools.pairwise(curves)):
        node.fail("curves of ascending frequency")
    return tuple(curves)


def _control(modality: Modality, known: Parameter, kind: Node) -> ActuatorControl:
    """Control of an actuator type for a parameter: range, limits and neutral value. Limits lie
    within the range, and below the modality's maximum for devices. The default of the neutral value
    is that of the modality, clipped to the limits. InputError for values outside.
    """
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
    neutral = min(max(known.neutral, lowest), highest)
    if "neutral" in node:
        node["neutral"].hold(Number(lowest, highest, known.unit))
        neutral = node.number("neutral")
    return ActuatorControl(known.name, minimum, maximum, lowest, highest, neutral)


def _actuator(node: Node, types: dict[str, ActuatorType], mount: Mount | None) -> Actuator:
    kind = types.get(node.get("type"))
    if kind is None:
        node["type"].fail("one of " + ", ".join(types))
    return Actuator(node.get("id"), kind, layout_reader.place(node["place"], mount))


def _substitutions(node: Node, actuators: tuple[Actuator, ...]) -> dict[str, Substitution]:
    types = tuple(actuator.type for actuator in actuators)
    return {name: _substitution(name, item, types) for name, item in node.members().items()}


def _substitution(source: str, node: Node, types: tuple[ActuatorType, ...]) -> Substitution:
    target = node.get("as")
    targets = tuple(dict.fromkeys(kind.modality for kind in types if kind.modality != source))
    if target not in targets:
        node["as"].fail("one of " + ", ".join(targets))
    frequency_hz = None
    if target == "vibration":
        frequency_hz = node.number("frequency_hz", _own_frequency_hz(types))
    return Substitution(source, target, node["scale"].number("value"), frequency_hz)


def _own_frequency_hz(types: tuple[ActuatorType, ...]) -> float:
    """Default frequency, Hz, for modalities played as vibration: the first resonance of the
    vibration actuators in order, else the neutral frequency of the first.
    """
    vibrating = [kind for kind in types if kind.modality == "vibration"]
    resonances = (kind.resonance_hz for kind in vibrating if kind.resonance_hz is not None)
    return next(resonances, vibrating[0].controls[1].neutral)
