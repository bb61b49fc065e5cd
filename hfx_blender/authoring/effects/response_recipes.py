# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses and swarms of volumes, as plain data for files of effects.

A response is a stack of filters with their controls in SI units and keys over time. A swarm is
what makes many small objects of one volume: a particle system, by its numbers. Forces and things
to bounce off are of the scene that a file is loaded into.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from ...engine.response_filters.controls import CONTROLS, About, FilterKind, Operation
from ...files.json_shapes import (
    Flag,
    Items,
    Node,
    Number,
    Record,
    Text,
    curve,
    numbers,
    strict,
    tagged,
)

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


_NUMBERS: Final = {
    "born_from_s": Number(-86_400.0, 86_400.0, "s"),
    "born_until_s": Number(-86_400.0, 86_400.0, "s"),
    "lifetime_s": Number(0.001, 86_400.0, "s"),
    "normal_speed_m_s": Number(-1000.0, 1000.0, "m/s"),
    "random_speed_m_s": Number(0.0, 1000.0, "m/s"),
    "brownian": Number(0.0, 200.0),
    "drag": Number(0.0, 1.0),
    "damping": Number(0.0, 1.0),
    "gravity": Number(-200.0, 200.0),
}


SWARM: Final = strict(
    {"count": Number(1, MOST_PARTICLES, is_whole=True)},
    {
        "seed": Number(-(2**31), 2**31 - 1, is_whole=True),
        "location_m": numbers(3, -1000.0, 1000.0, "m"),
        "radii_m": numbers(3, 0.0, 1000.0, "m"),
        **_NUMBERS,
    },
    into=SwarmRecipe,
)


def references_of(kind: FilterKind) -> tuple[str, ...]:
    """References that distances of a kind of filter may be measured from; empty if it measures
    none.
    """
    if kind is FilterKind.DISTANCE:
        return (About.CENTRE, About.AXIS)
    return (About.TIME, About.CENTRE, About.AXIS) if kind is FilterKind.SINE else ()


def _filter(
    kind: str, controls: dict[str, float], *, muted: bool = False, **more: Any
) -> FilterRecipe:
    keys = tuple(more.pop("keys", {}).items())
    return FilterRecipe(kind, controls, is_muted=muted, keys=keys, **more)


def _filter_shape(kind: FilterKind) -> Record:
    controls = CONTROLS[kind]
    references = references_of(kind)
    keys = {
        each.name: curve(earliest_s=-86_400.0, lowest=each.minimum, highest=each.maximum)
        for each in controls
    }
    return strict(
        {
            "controls": strict(
                {each.name: Number(each.minimum, each.maximum, each.unit) for each in controls}
            ),
            **({"about": Text(references)} if references else {}),
        },
        {
            "operation": Text(tuple(each.value for each in Operation)),
            "muted": Flag(),
            "keys": strict({}, keys),
        },
        into=_filter,
    )


RESPONSE: Final = Items(
    tagged("kind", {kind.value: _filter_shape(kind) for kind in FilterKind}), 0, MOST_FILTERS
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
        document["controls"] = each.controls
        if each.keys:
            document["keys"] = dict(each.keys)
        found.append(document)
    return found


def refuse_reversed_births(node: Node) -> None:
    """Raise InputError for a swarm that is born until before it is born from."""
    recipe: SwarmRecipe = node.read(SWARM)
    if recipe.born_until_s < recipe.born_from_s:
        node.fail("born_until_s not before born_from_s")
