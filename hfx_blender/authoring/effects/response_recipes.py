# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact responses and particle swarms of volumes, as plain data for effect files.

A response is a stack of filters with controls in SI units and keyframes over time. A swarm is a
particle system that emits a volume. Forces and colliders belong to the scene, not to the file.
"""

from dataclasses import dataclass
from typing import Any, Final

from ...engine.response_filters.controls import CONTROLS, About, FilterKind, Operation
from ...files import json_shapes

MOST_FILTERS: Final = 32
MOST_PARTICLES: Final = 4096

Keys = tuple[tuple[float, float], ...]
Number3 = tuple[float, float, float]


@dataclass(frozen=True)
class FilterRecipe:
    """Filter with its controls, in names and units of the engine."""

    kind: str
    controls: dict[str, float]
    operation: str = "multiply"
    about: str = "centre"  # of distances: centre, axis; sine: also time
    is_muted: bool = False
    keys: tuple[tuple[str, Keys], ...] = ()  # by control: (seconds, value)


@dataclass(frozen=True)
class SwarmRecipe:
    """Particle system that emits a volume from the surface of an ellipsoid."""

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
    gravity: float = 1.0  # share of the scene's gravity


_NUMBERS: Final = {
    "born_from_s": json_shapes.Number(-86_400.0, 86_400.0, "s"),
    "born_until_s": json_shapes.Number(-86_400.0, 86_400.0, "s"),
    "lifetime_s": json_shapes.Number(0.001, 86_400.0, "s"),
    "normal_speed_m_s": json_shapes.Number(-1000.0, 1000.0, "m/s"),
    "random_speed_m_s": json_shapes.Number(0.0, 1000.0, "m/s"),
    "brownian": json_shapes.Number(0.0, 200.0),
    "drag": json_shapes.Number(0.0, 1.0),
    "damping": json_shapes.Number(0.0, 1.0),
    "gravity": json_shapes.Number(-200.0, 200.0),
}

SWARM: Final = json_shapes.strict(
    {"count": json_shapes.Number(1, MOST_PARTICLES, is_whole=True)},
    {
        "seed": json_shapes.Number(-(2**31), 2**31 - 1, is_whole=True),
        "location_m": json_shapes.numbers(3, -1000.0, 1000.0, "m"),
        "radii_m": json_shapes.numbers(3, 0.0, 1000.0, "m"),
        **_NUMBERS,
    },
    into=SwarmRecipe,
)


def references_of(kind: FilterKind) -> tuple[str, ...]:
    """Allowed values of ``about``: centre and axis for DISTANCE, time too for SINE; else empty."""
    if kind is FilterKind.DISTANCE:
        return (About.CENTRE, About.AXIS)
    return (About.TIME, About.CENTRE, About.AXIS) if kind is FilterKind.SINE else ()


def _filter(
    kind: str, controls: dict[str, float], *, muted: bool = False, **more: Any
) -> FilterRecipe:
    keys = tuple(more.pop("keys", {}).items())
    return FilterRecipe(kind, controls, is_muted=muted, keys=keys, **more)


def _filter_shape(kind: FilterKind) -> json_shapes.Record:
    controls = CONTROLS[kind]
    references = references_of(kind)
    # Keys may precede time 0 of the file.
    keys = {
        control.name: json_shapes.curve(
            earliest_s=-86_400.0, lowest=control.minimum, highest=control.maximum
        )
        for control in controls
    }
    return json_shapes.strict(
        {
            "controls": json_shapes.strict(
                {c.name: json_shapes.Number(c.minimum, c.maximum, c.unit) for c in controls}
            ),
            **({"about": json_shapes.Text(references)} if references else {}),
        },
        {
            "operation": json_shapes.Text(tuple(operation.value for operation in Operation)),
            "muted": json_shapes.Flag(),
            "keys": json_shapes.strict({}, keys),
        },
        into=_filter,
    )


RESPONSE: Final = json_shapes.Items(
    json_shapes.tagged("kind", {kind.value: _filter_shape(kind) for kind in FilterKind}),
    0,
    MOST_FILTERS,
)


def response_document(response: tuple[FilterRecipe, ...]) -> list[dict[str, Any]]:
    """JSON objects of filters in order; ``about`` only where the kind has it, ``muted`` only if
    true, ``keys`` only if present."""
    documents = []
    for recipe in response:
        document: dict[str, Any] = {"kind": recipe.kind, "operation": recipe.operation}
        if references_of(FilterKind(recipe.kind)):
            document["about"] = recipe.about
        if recipe.is_muted:
            document["muted"] = True
        document["controls"] = recipe.controls
        if recipe.keys:
            document["keys"] = dict(recipe.keys)
        documents.append(document)
    return documents


def refuse_reversed_births(node: json_shapes.Node) -> None:
    """Raise InputError if ``born_until_s`` of a swarm (default 1) is before ``born_from_s``."""
    # JSON shapes check members one by one; this rule compares two, of which one has a default.
    recipe: SwarmRecipe = node.read(SWARM)
    if recipe.born_until_s < recipe.born_from_s:
        node.fail("born_until_s not before born_from_s")
