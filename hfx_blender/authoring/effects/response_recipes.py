# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses and swarms of volumes, as plain data for files of effects.

A response is a stack of filters with their controls in SI units and keys over time. A swarm is
what makes many small objects of one volume: a particle system, by its numbers. Forces and things
to bounce off are of the scene that a file is loaded into.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from ...engine.response_filters.controls import CONTROLS, About, FilterKind, Operation
from ...files.strict_json import MAX_S, Node

MOST_FILTERS: Final = 32
MOST_PARTICLES: Final = 4096

Keys = tuple[tuple[float, float], ...]
Number3 = tuple[float, float, float]


@dataclass(frozen=True)
class FilterRecipe:
    """Filter with its controls by the engine's names and units."""

    kind: str
    controls: dict[str, float]
    operation: str = "multiply"
    about: str = "centre"  # distance: centre, axis; sine: time as well
    is_muted: bool = False
    keys: tuple[tuple[str, Keys], ...] = ()  # by control: (seconds, value)


@dataclass(frozen=True)
class SwarmRecipe:
    """Particles, each of which is the volume; the emitter is an ellipsoid, born on its surface."""

    count: int
    seed: int = 0
    born_from_s: float = 0.0
    born_until_s: float = 1.0
    lifetime_s: float = 10.0
    location_m: Number3 = (0.0, 0.0, 0.0)
    radii_m: Number3 = (1.0, 1.0, 1.0)
    normal_speed_m_s: float = 0.0
    random_speed_m_s: float = 0.0
    brownian: float = 0.0
    drag: float = 0.0
    damping: float = 0.0
    gravity: float = 1.0  # share of the scene's


_RANGES: Final[dict[str, tuple[float, float, str]]] = {
    "born_from_s": (-86_400.0, 86_400.0, "s"),
    "born_until_s": (-86_400.0, 86_400.0, "s"),
    "lifetime_s": (0.001, 86_400.0, "s"),
    "normal_speed_m_s": (-1000.0, 1000.0, "m/s"),
    "random_speed_m_s": (0.0, 1000.0, "m/s"),
    "brownian": (0.0, 200.0, ""),
    "drag": (0.0, 1.0, ""),
    "damping": (0.0, 1.0, ""),
    "gravity": (-200.0, 200.0, ""),
}


def references_of(kind: FilterKind) -> tuple[str, ...]:
    """References that distances of a kind of filter may be measured from; empty if it measures
    none.
    """
    if kind is FilterKind.DISTANCE:
        return (About.CENTRE, About.AXIS)
    return (About.TIME, About.CENTRE, About.AXIS) if kind is FilterKind.SINE else ()


def response_of(node: Node) -> tuple[FilterRecipe, ...]:
    """A stack of filters, every field checked.

    Raises
    ------
    InputError
        For the first fault.
    """
    return tuple(_filter(each) for each in node.items(least=0, most=MOST_FILTERS))


def _filter(node: Node) -> FilterRecipe:
    entries = node.entries(allowed="an object")
    kinds = tuple(each.value for each in FilterKind)
    kind = FilterKind(entries["kind"].choice(kinds)) if "kind" in entries else FilterKind.IMPACT
    abouts = references_of(kind)
    required = ("kind", "controls", *(("about",) if abouts else ()))
    members = node.members(required=required, optional=("operation", "muted", "keys"))
    operations = tuple(each.value for each in Operation)
    controls = {each.name: each for each in CONTROLS[kind]}
    values = {
        name: value.number(controls[name].minimum, controls[name].maximum, controls[name].unit)
        for name, value in members["controls"].members(required=tuple(controls)).items()
    }
    keys = []
    animated = members["keys"].entries(allowed="an object") if "keys" in members else {}
    for name, curve in animated.items():
        if name not in controls:
            curve.fail("keys of one of " + ", ".join(controls))
        low, high = controls[name].minimum, controls[name].maximum
        keys.append((name, curve.curve(earliest_s=-MAX_S, lowest=low, highest=high)))
    return FilterRecipe(
        kind.value,
        values,
        members["operation"].choice(operations) if "operation" in members else "multiply",
        members["about"].choice(abouts) if abouts else "centre",
        "muted" in members and members["muted"].boolean(),
        tuple(keys),
    )


def response_document(response: tuple[FilterRecipe, ...]) -> list[dict[str, Any]]:
    """A stack of filters as JSON."""
    found = []
    for each in response:
        document: dict[str, Any] = {"kind": each.kind, "operation": each.operation}
        if references_of(FilterKind(each.kind)):
            document["about"] = each.about
        if each.is_muted:
            document["muted"] = True
        document["controls"] = dict(each.controls)
        if each.keys:
            document["keys"] = {name: [list(key) for key in keys] for name, keys in each.keys}
        found.append(document)
    return found


def swarm_of(node: Node) -> SwarmRecipe:
    """A swarm, every field checked.

    Raises
    ------
    InputError
        For the first fault.
    """
    members = node.members(
        required=("count",), optional=("seed", "location_m", "radii_m", *_RANGES)
    )
    found: dict[str, Any] = {
        name: members[name].number(*limits) for name, limits in _RANGES.items() if name in members
    }
    if "seed" in members:
        found["seed"] = members["seed"].integer(-(2**31), 2**31 - 1)
    for name, least in (("location_m", -1000.0), ("radii_m", 0.0)):
        if name in members:
            found[name] = members[name].triple(least, 1000.0, "m")
    recipe = SwarmRecipe(members["count"].integer(1, MOST_PARTICLES), **found)
    if recipe.born_until_s < recipe.born_from_s:
        node.fail("born_until_s not before born_from_s")
    return recipe


def swarm_document(swarm: SwarmRecipe) -> dict[str, Any]:
    """A swarm as JSON."""
    document = asdict(swarm)
    return {
        key: list(value) if isinstance(value, tuple) else value for key, value in document.items()
    }
