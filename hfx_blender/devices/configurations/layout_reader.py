# SPDX-License-Identifier: GPL-3.0-or-later
"""Part of a device configuration with the places of actuators and their panning."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, cast, get_args

import numpy as np

from ...engine.body.parts import PARTS, SIDES
from ...engine.rendering.device import (
    BodyPlace,
    Mount,
    Place,
    RoomPlace,
    Scheme,
    SchemeName,
    Statistic,
    VertexPlace,
    VertexSet,
)
from ...engine.rendering.mounts import place_on
from ...engine.rendering.panning.laws import LAWS, Law
from ...files.strict_json import Node

ID_PATTERN: Final = r"[a-z0-9][a-z0-9_-]{0,63}"
ID_DESCRIBED: Final = "1 to 64 of a-z, 0-9, _ and -, the first a letter or digit"

_OPTIONS: Final = {
    "coverage": ("statistic",),
    "barycentric": ("law",),
    "surface": ("law",),
    "splat": ("sigma_m",),
}
"""Options of each rendering scheme."""

_BEND_MM: Final = (3.0, 10_000.0)
"""Range of bend radii: from a fingertip's curve to one that cannot be told from a plane."""


def scheme(node: Node) -> Scheme:
    """Rendering scheme and its options."""
    members = node.members(required=("scheme",), optional=("options",))
    name = cast(SchemeName, members["scheme"].choice(get_args(SchemeName)))
    if "options" not in members:
        return Scheme(name)
    options = members["options"].members(required=(), optional=_OPTIONS.get(name, ()))
    found = Scheme(name)
    if "statistic" in options:
        statistic = cast(Statistic, options["statistic"].choice(get_args(Statistic)))
        found = Scheme(name, statistic=statistic)
    if "law" in options:
        found = Scheme(name, law=cast(Law, options["law"].choice(LAWS)))
    if "sigma_m" in options:
        found = Scheme(name, sigma_m=options["sigma_m"].number(0.001, 1.0, "m"))
    return found


def mount(node: Node) -> Mount:
    """Mount of a layout on the body; its axes are made orthogonal and of unit length."""
    members = node.members(required=("origin_m", "x_axis", "y_axis"), optional=("bend_radius_mm",))
    origin = members["origin_m"].triple(-3.0, 3.0, "m")
    x = np.array(members["x_axis"].triple(-1.0, 1.0))
    y = np.array(members["y_axis"].triple(-1.0, 1.0))
    if np.linalg.norm(x) < 0.1:
        members["x_axis"].fail("a direction: three numbers of which one is not near 0")
    x /= np.linalg.norm(x)
    y = y - (y @ x) * x
    if np.linalg.norm(y) < 0.1:
        members["y_axis"].fail("a direction across the x_axis")
    y /= np.linalg.norm(y)
    bend_m = _bend_m(members["bend_radius_mm"]) if "bend_radius_mm" in members else None
    return Mount(origin, (x[0], x[1], x[2]), (y[0], y[1], y[2]), bend_m)


def _bend_m(node: Node) -> float:
    least, most = _BEND_MM
    radius_mm = node.number(-most, most, "mm")
    if abs(radius_mm) < least:
        node.fail(f"a number from {least:g} to {most:g} mm, or its negative for a hollow")
    return radius_mm / 1000.0


def refuse_overlap(node: Node, mount: Mount, actuators: Node) -> None:
    """Reject a bent mount around which the pads of some actuators go twice."""
    if mount.bend_radius_m is None:
        return
    places = [each["place"]["pad"]["at_mm"] for each in actuators.value if "pad" in each["place"]]
    width_mm = max((x for x, _ in places), default=0) - min((x for x, _ in places), default=0)
    round_mm = 2000.0 * math.pi * abs(mount.bend_radius_m)
    if width_mm > round_mm:
        node.member("bend_radius_mm").fail(
            f"at least {math.ceil(width_mm / math.tau * 100.0) / 100.0:g} mm: pads are "
            f"{width_mm:g} mm apart along x, and the circumference is {round_mm:.1f} mm"
        )


def place(node: Node, mount: Mount | None) -> Place:
    """Place of one actuator."""
    kinds: dict[str, Callable[[Node], Place]] = {
        "placement": _body_place,
        "vertices": _vertex_place,
        "room": _room_place,
    }
    members = node.members(required=(), optional=(*kinds, "pad"))
    if len(members) != 1:
        node.fail("exactly one of " + ", ".join((*kinds, "pad")))
    ((kind, found),) = members.items()
    return _pad_place(found, mount) if kind == "pad" else kinds[kind](found)


def _parts(node: Node) -> tuple[str, ...]:
    parts = tuple(item.choice(PARTS) for item in node.items(least=1, most=len(PARTS)))
    if len(set(parts)) != len(parts):
        node.fail("each body part once")
    return parts


def _body_place(node: Node) -> BodyPlace:
    members = node.members(
        required=("parts", "centre_m", "radius_m"), optional=("side", "stroked_by")
    )
    return BodyPlace(
        parts=_parts(members["parts"]),
        centre_m=members["centre_m"].triple(-3.0, 3.0, "m"),
        radius_m=members["radius_m"].number(0.0, 1.0, "m"),
        side=members["side"].choice(SIDES) if "side" in members else None,
        stroked_by=_parts(members["stroked_by"]) if "stroked_by" in members else (),
    )


def _pad_place(node: Node, mount: Mount | None) -> BodyPlace:
    """Place given in the layout's own millimetres, which the mount puts on the body."""
    if mount is None:
        node.fail("a placement, vertices or room: the device has no 'mount' for a pad")
    members = node.members(required=("parts", "at_mm", "radius_m"), optional=("side",))
    x, y = (item.number(-2000.0, 2000.0, "mm") for item in members["at_mm"].items(least=2, most=2))
    (centre,) = place_on(mount, np.array([[x, y]]) / 1000.0)
    return BodyPlace(
        parts=_parts(members["parts"]),
        centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
        radius_m=members["radius_m"].number(0.0, 1.0, "m"),
        side=members["side"].choice(SIDES) if "side" in members else None,
    )


def _vertex_place(node: Node) -> VertexPlace:
    sets = tuple(_vertex_set(item) for item in node.items(least=1, most=8))
    if len({each.model_id for each in sets}) != len(sets):
        node.fail("each model once")
    return VertexPlace(sets)


def _vertex_set(node: Node) -> VertexSet:
    members = node.members(required=("model", "hash", "ids"))
    ids = members["ids"].items(least=1, most=100_000)
    vertices: list[int] = []
    for item in ids:
        lowest = vertices[-1] + 1 if vertices else 0
        vertices.append(item.integer(lowest, 2**31 - 1))
    return VertexSet(
        model_id=members["model"].text(ID_PATTERN, ID_DESCRIBED),
        content_hash=members["hash"].text(r"[0-9a-f]{64}", "a SHA-256 as 64 hexadecimal digits"),
        vertices=tuple(vertices),
    )


def _room_place(node: Node) -> RoomPlace:
    members = node.members(required=(), optional=("reaches", "at_m", "aim", "range_m", "cone_deg"))
    parts = _parts(members["reaches"]) if "reaches" in members else PARTS
    if "at_m" not in members:
        for name in ("aim", "range_m", "cone_deg"):
            if name in members:
                members[name].fail("left out: the device has no 'at_m' in the play space")
        return RoomPlace(parts)
    if "cone_deg" in members and "aim" not in members:
        members["cone_deg"].fail("left out: the device has no 'aim'")
    aim = None
    if "aim" in members:
        direction = np.array(members["aim"].triple(-1.0, 1.0))
        if np.linalg.norm(direction) < 0.1:
            members["aim"].fail("a direction: three numbers of which one is not near 0")
        x, y, z = direction / np.linalg.norm(direction)
        aim = float(x), float(y), float(z)
    cone_deg = members["cone_deg"].number(1.0, 360.0, "deg") if "cone_deg" in members else 360.0
    return RoomPlace(
        parts,
        at_m=members["at_m"].triple(-100.0, 100.0, "m"),
        aim=aim,
        range_m=members["range_m"].number(0.01, 100.0, "m") if "range_m" in members else 100.0,
        cone_deg=cone_deg,
    )
