# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of the places of actuators, the mount and the rendering scheme of a configuration."""

from __future__ import annotations

import math

import numpy as np

from ...engine.arrays import F64
from ...engine.body.parts import PARTS
from ...engine.rendering.device_config import (
    BodyPlace,
    Mount,
    Place,
    RoomPlace,
    Scheme,
    VertexPlace,
    VertexSet,
)
from ...engine.rendering.mounts import place_on
from ...files.json_shapes import Node


def scheme(node: Node) -> Scheme:
    """Read the rendering scheme by name, with its options; absent options have their defaults."""
    options = dict(node.get("options", {}))
    if "sigma_m" in options:
        options["sigma_m"] = float(options["sigma_m"])
    return Scheme(node.get("scheme"), **options)


def mount(node: Node) -> Mount:
    """Read the mount of a layout: origin and bend radius, metres, None for a flat layout; the y
    axis is made orthogonal to x, and both of unit length. InputError for near-parallel or zero
    axes.
    """
    # Gram-Schmidt: the part of the y axis along the x axis is removed.
    x = _direction(node["x_axis"])
    y = np.array(node.numbers("y_axis"))
    y = y - (y @ x) * x
    if np.linalg.norm(y) < 0.1:
        node["y_axis"].fail("a direction across the x_axis")
    y /= np.linalg.norm(y)
    bend_m = node.number("bend_radius_mm") / 1000.0 if "bend_radius_mm" in node else None
    return Mount(_triple(node, "origin_m"), (x[0], x[1], x[2]), (y[0], y[1], y[2]), bend_m)


def _direction(node: Node) -> F64:
    """Unit vector (3,) of a node; InputError for a vector shorter than 0.1."""
    direction = np.array(node.value, np.float64)
    if np.linalg.norm(direction) < 0.1:
        node.fail("a direction: three numbers of which one is not near 0")
    return direction / np.linalg.norm(direction)  # type: ignore[no-any-return]


def _triple(node: Node, key: str) -> tuple[float, float, float]:
    x, y, z = node.numbers(key)
    return x, y, z


def refuse_overlap(node: Node, mount: Mount, actuators: Node) -> None:
    """Raise InputError for a bent mount whose circumference is less than the extent of all pads
    along x; a flat mount passes.
    """
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


def place(node: Node, mount: Mount | None) -> Place:
    """Read the place of an actuator: vertices, a place in the room, or a placement or pad on the
    body.
    Raises InputError: a model stands twice, an aim is near 0, or a pad has no ``mount``.
    """
    ((kind, member),) = node.members().items()
    if kind == "vertices":
        return _vertex_place(member)
    if kind == "room":
        return _room_place(member)
    return _body_place(member, mount)


def _body_place(node: Node, mount: Mount | None) -> BodyPlace:
    """Read a place on the body: ``centre_m``, or ``at_mm`` of a pad, converted by the mount to
    metres. InputError for a pad with ``mount`` None.
    """
    if "centre_m" in node:
        centre = _triple(node, "centre_m")
    elif mount is None:
        node.fail("a placement, vertices or room: the device has no 'mount' for a pad")
    else:
        (on_body,) = place_on(mount, np.array([node.numbers("at_mm")]) / 1000.0)
        centre = float(on_body[0]), float(on_body[1]), float(on_body[2])
    return BodyPlace(
        parts=tuple(node.get("parts")),
        centre_m=centre,
        radius_m=node.number("radius_m"),
        side=node.get("side"),
        stroked_by=tuple(node.get("stroked_by", ())),
    )


def _vertex_place(node: Node) -> VertexPlace:
    sets = tuple(VertexSet(item["model"], item["hash"], tuple(item["ids"])) for item in node.value)
    if len({vertex_set.model_id for vertex_set in sets}) != len(sets):
        node.fail("each model once")
    return VertexPlace(sets)


def _room_place(node: Node) -> RoomPlace:
    """Read a place in the room; ``reaches`` is by default all body parts. Without ``at_m`` all are
    reached equally; else range is by default 100 m, cone 360 degrees, aim None or a unit vector.
    """
    parts = tuple(node.get("reaches", PARTS))
    if "at_m" not in node:
        return RoomPlace(parts)
    x, y, z = _direction(node["aim"]) if "aim" in node else (0.0, 0.0, 0.0)
    return RoomPlace(
        parts,
        at_m=_triple(node, "at_m"),
        aim=(float(x), float(y), float(z)) if "aim" in node else None,
        range_m=node.number("range_m", 100.0),
        cone_deg=node.number("cone_deg", 360.0),
    )
