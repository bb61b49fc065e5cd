# SPDX-License-Identifier: GPL-3.0-or-later
"""State of a reading pass between blocks: parts, near volumes, and cached rows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hfx_blender.reading.reading_pass import ReadingPass
from hfx_blender.reading.scene_reader import SceneReader

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

RATE_HZ = 24
NEAR, FAR = (0.0, 0.0, 1.2), (20.0, 0.0, 1.2)


def _follows(name: str, places: list[tuple[float, Any]]) -> Any:
    """A ball placed only by Blender: with a constraint copying the location of an empty."""
    ball = oracle.add_volume(name, "pressure", "SPHERE", NEAR, radius=0.2)
    target = oracle.empty(bpy.context.scene, f"{name} Target")
    oracle.key(target, "location", places)
    ball.constraints.new("COPY_LOCATION").target = target
    return ball


@pytest.fixture
def reading(scene: Any) -> Iterator[ReadingPass]:
    """Of a standing body: a plain ball, a far ball, an approaching ball, and a muted ball.

    The approaching ball has a driver on the pressure, so the location alone is too little.
    """
    scene.render.fps = RATE_HZ
    scene.frame_start, scene.frame_end = 0, 127
    oracle.add_avatar()
    oracle.add_volume("Plain", "pressure", "SPHERE", FAR, radius=0.2)
    _follows("Away", [(0, FAR)])
    comes = _follows("Comes", [(40, FAR), (48, NEAR), (56, FAR)])
    comes.driver_add("hfx.pressure").driver.expression = "7.0"
    _follows("Muted", [(0, NEAR)]).hfx.is_muted = True
    with ExitStack() as stack:
        reader = SceneReader(scene, rate_hz=Fraction(RATE_HZ))
        yield reader.open_pass(stack)


def _numbers(reading: ReadingPass) -> dict[str, int]:
    return {item.name: k for k, item in enumerate(reading.scene.effects)}


def test_parts_are_known_before_anything_is_read(reading: ReadingPass) -> None:
    number = _numbers(reading)
    assert set(reading.stepped_effects) == {number["Away"], number["Comes"]}
    assert reading.dormant == (number["Muted"],)
    assert [*reading.plan.bounded_numbers] == [number["Plain"]] and not reading.plan.effects
    assert reading.stepped_bodies == ()
    assert reading.in_scene == {number[name] for name in ("Plain", "Away", "Comes")}


def test_what_comes_near_is_read_in_full_until_it_is_far_again(reading: ReadingPass) -> None:
    number, far = _numbers(reading), reading.far_volumes
    assert set(far.numbers) == {number["Away"], number["Comes"]} and not far.in_full
    levels = {}
    for first in (0, 32, 64, 96):
        block = reading.block(np.arange(first, first + 32))
        levels[first] = float(block.effects[number["Comes"]].levels.max())
        assert far.in_full == ({number["Comes"]} if first == 32 else set())
    # Silent while far, except for the block read in full after the near block.
    assert levels == {0: 0.0, 32: 1.0, 64: 1.0, 96: 0.0}
    assert reading.counters.far["Away"] == {"0": 32, "32": 32, "64": 32, "96": 32}
    assert reading.counters.far["Comes"] == {"0": 32, "64": 32, "96": 32}
    assert far.not_seen_on == set()  # both are on from the first sample on


def test_the_last_rows_begin_the_next_block(reading: ReadingPass) -> None:
    assert reading.rows is not None
    reading.block(np.arange(32))
    stepped = reading.counters.times_stepped
    assert [*reading.rows.last] == [27, 28, 29, 30, 31]
    reading.block(np.arange(31, 64), history=1)
    again = 33  # the block comes near: read once more, in full
    assert reading.counters.times_stepped - stepped == 32 + again
    assert [*reading.rows.last] == [59, 60, 61, 62, 63]
