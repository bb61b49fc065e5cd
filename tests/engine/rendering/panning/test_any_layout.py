# SPDX-License-Identifier: GPL-3.0-or-later
"""Every scheme on any layout: no NaN, no jump, constant power where promised.

The schemes come from the device configuration, so a new scheme is tested automatically; only the
promise is listed below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.body.parts import PARTS, SIDES
from hfx_blender.engine.rendering import coverage
from hfx_blender.engine.rendering.device_config import LAWS, Actuator, BodyPlace, Scheme, SchemeName
from hfx_blender.engine.rendering.panning import bursts, constant_power, positional, surface_panning
from hfx_blender.engine.rendering.schemes import PannedLayout, panned_layout

PANNING = tuple(name for name in get_args(SchemeName) if name != "coverage")
KEEPS_POWER = {
    "nearest": True,
    "barycentric": "law",
    "surface": "law",
    "ring": True,
    "line": True,
    "vbap": True,
    "splat": False,
    "brush": True,
    "saltation": True,
}
JUMPS = {"nearest", "saltation"}  # half way between two actuators, as documented
EVERY = [
    (name, law) for name in PANNING for law in (LAWS if KEEPS_POWER[name] == "law" else LAWS[:1])
]

SIDE = 19  # vertices along a sheet of skin, 5 mm apart
MOTOR = load_device("back_pad").actuators[0].type


def sheet() -> PerceptualModel:
    """Return skin bent round an upright cylinder of 12 cm, 9 cm wide and high."""
    u, v = (item.ravel() for item in np.meshgrid(*[np.arange(SIDE) * 0.005 - 0.045] * 2))
    turn = u / 0.12
    normals = np.column_stack((np.sin(turn), np.cos(turn), 0.0 * u))
    corner = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = (
        item.ravel()
        for item in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1])
    )
    return replace(
        load_model("hfx-temperature-1"),
        vertices=(0.12 * normals + np.column_stack((0 * u, 0 * u, v + 1.2))).astype(np.float32),
        triangles=np.concatenate([np.column_stack((a, b, c)), np.column_stack((a, c, d))]),
        normals=normals.astype(np.float32),
        part=np.full(len(u), PARTS.index("torso"), np.uint8),
        side=np.full(len(u), SIDES.index("left"), np.uint8),
    )


SKIN = sheet()


def layout_of(scheme: str, law: str, centres: np.ndarray) -> PannedLayout:
    actuators = tuple(
        Actuator(f"a{k}", MOTOR, BodyPlace(("torso",), (float(x), float(y), float(z)), 0.01))
        for k, (x, y, z) in enumerate(centres)
    )
    device = replace(
        load_device("back_pad"),
        actuators=actuators,
        mount=None,
        scheme=Scheme(scheme, law=law),  # type: ignore[arg-type]
    )
    layout = panned_layout(device, actuators, SKIN)
    assert layout is not None
    return layout


def vertex(column: int, row: int) -> int:
    return row * SIDE + column


LAYOUTS = {
    "one": [vertex(9, 9)],
    "two": [vertex(4, 9), vertex(14, 9)],
    "two above each other": [vertex(9, 4), vertex(9, 14)],
    "two at one place": [vertex(9, 9)] * 2,
    "three in a line, one in the middle": [vertex(9, 3), vertex(9, 9), vertex(9, 15)],
    "three round the middle, one twice": [vertex(3, 9), vertex(9, 9), vertex(9, 9), vertex(15, 9)],
    "five in a line, uneven": [vertex(9, k) for k in (1, 2, 7, 9, 16)],
    "a triangle": [vertex(3, 3), vertex(15, 3), vertex(9, 15)],
    "three by three": [vertex(c, r) for c in (3, 9, 15) for r in (3, 9, 15)],
    "all corners twice": [vertex(c, r) for c in (3, 15) for r in (3, 15)] * 2,
}

layouts = st.one_of(
    st.sampled_from(list(LAYOUTS.values())),
    st.lists(st.integers(0, SIDE * SIDE - 1), min_size=1, max_size=8),
)
triangles = st.integers(0, len(SKIN.triangles) - 1)
shares = st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)).map(
    lambda s: np.array([1.0 - np.sqrt(s[0]), np.sqrt(s[0]) * (1.0 - s[1]), np.sqrt(s[0]) * s[1]])
)


def shown(layout: PannedLayout, triangle: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return the gains at points of a triangle, a function of corner shares (n, 3)."""
    fade = np.zeros(len(SKIN))
    fade[layout.vertices] = layout.fade
    corners = SKIN.triangles[triangle]
    points = SKIN.vertices[corners].astype(np.float64)
    return lambda weights: layout.at(weights @ points) * (weights @ fade[corners])[:, None]


def largest_jump(gains: Callable[[np.ndarray], np.ndarray], one: np.ndarray, end: np.ndarray):
    """Return the largest change on a path after repeated refinement around the maximum."""
    low, high = 0.0, 1.0
    for _ in range(6):
        way = np.linspace(low, high, 33)
        actual = gains(one + way[:, None] * (end - one))
        change = np.abs(np.diff(actual, axis=0)).max(axis=1)
        k = int(np.argmax(change))
        low, high = way[k], way[k + 1]
    return change[k]


def test_each_scheme_has_a_power_promise():
    assert set(KEEPS_POWER) == set(PANNING)


SOURCES = {
    "Danieau": coverage,
    "Schneider": positional.NearestPanning,
    "Schneider, flat": positional,
    "Schneider, skin": surface_panning,
    "Politis": constant_power,
    "Pulkki": constant_power,
    "Westover": positional.GaussianSplatting,
    "Israr": bursts,
    "Geldard": bursts,
}


def test_each_scheme_names_its_paper_in_page_and_module():
    page = (Path(__file__).parents[4] / "docs" / "rendering-schemes.md").read_text("utf-8")
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| `")]
    papers = {name.strip(" `"): source for _, name, _, _, source, _ in rows}
    assert set(papers) == set(get_args(SchemeName))
    authors = {item.split(",")[0] for item in SOURCES}
    for name, source in papers.items():
        assert any(author in source for author in authors), name
    for author, written in SOURCES.items():
        assert author.split(",")[0] in (written.__doc__ or ""), author
    assert "*Notice*" in page and "patents" in page


@pytest.mark.parametrize(("scheme", "law"), EVERY)
@example([0, 152, 172, 253], 488, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
@given(chosen=layouts, triangle=triangles, one=shares, end=shares)
@settings(max_examples=10)
def test_gains_are_continuous_along_the_skin(scheme, law, chosen, triangle, one, end):
    layout = layout_of(scheme, law, SKIN.vertices[chosen].astype(np.float64))
    jump = largest_jump(shown(layout, triangle), one, end)
    assert jump < 1e-3 or scheme in JUMPS


@pytest.mark.parametrize(("scheme", "law"), EVERY)
@given(chosen=layouts, triangle=triangles, where=shares)
@settings(max_examples=10)
def test_gains_are_finite_and_keep_promised_power(scheme, law, chosen, triangle, where):
    layout = layout_of(scheme, law, SKIN.vertices[chosen].astype(np.float64))
    inside = where @ SKIN.vertices[SKIN.triangles[triangle]].astype(np.float64)
    at_actuators = SKIN.vertices[chosen].astype(np.float64)
    between = 0.5 * (at_actuators + np.roll(at_actuators, 1, axis=0))
    far = inside * np.array([[1e3], [-1e3], [1e30], [1e300], [-1e-300]])
    places = np.concatenate([inside[None], at_actuators, between, far])
    gains = layout.at(places)
    assert gains.shape == (len(places), len(chosen))
    assert np.isfinite(gains).all() and gains.min() >= 0.0 and gains.max() <= 1.0 + 1e-9
    if KEEPS_POWER[scheme] is True or (KEEPS_POWER[scheme] == "law" and law == "power"):
        power = np.sum(gains[: 1 + len(chosen)] ** 2, axis=1)
        assert np.abs(10.0 * np.log10(power)).max() < 0.1


CROSS = np.array([[0.0, 0.0], [0.02, 0.0], [-0.02, 0.0], [0.0, 0.02], [0.0, -0.02]])


@pytest.mark.parametrize("count", [3, 5], ids=["line", "cross"])
@pytest.mark.parametrize(("scheme", "law"), EVERY)
def test_a_central_actuator_plays_alone_at_its_position(scheme, law, count):
    """From the middle, the actuator has no direction."""
    flat = CROSS[:count, ::-1]
    centres = np.column_stack((flat[:, 0], 0.0 * flat[:, 0] + 0.12, flat[:, 1] + 1.2))
    gains = layout_of(scheme, law, centres).at(centres)
    assert np.isfinite(gains).all()
    if (scheme, count) not in {("ring", 3), ("ring", 5), ("line", 5), ("splat", 3), ("splat", 5)}:
        # On the skin, actuators stand on vertices; two vertices are slightly off the cross.
        assert gains == pytest.approx(
            np.eye(count), abs=0.06 if scheme in ("surface", "brush") else 1e-6
        )
    elif KEEPS_POWER[scheme]:
        assert np.sum(gains**2, axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize(("scheme", "law"), EVERY)
@pytest.mark.parametrize("name", LAYOUTS)
def test_a_place_that_is_no_number_plays_nothing(scheme, law, name):
    layout = layout_of(scheme, law, SKIN.vertices[LAYOUTS[name]].astype(np.float64))
    good = SKIN.vertices[0].astype(np.float64)
    bad = np.array([[np.nan, 0.0, 1.0], [0.0, np.inf, 1.0], [0.0, 0.0, -np.inf]])
    gains = layout.at(np.concatenate([good[None], bad]))
    assert not gains[1:].any()
    assert np.array_equal(gains[0], layout.at(good[None])[0])
