# SPDX-License-Identifier: GPL-3.0-or-later
"""Momentary contacts, from the engine to the rows of a device."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from rendering_synthetic import MODELS, at, make_device, make_header

from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
)
from hfx_blender.engine.volume.analytic import Cuboid
from hfx_blender.engine.volume.shape import Falloff

SAMPLES = 400
BLOCK = 32


def _blocks(passes: np.ndarray) -> list[AnimationBlock]:
    """Return blocks of a wall of 1 mm passing all dots before the given samples, at 50 m/s."""
    side = np.where(np.cumsum(np.isin(np.arange(SAMPLES), passes)) % 2, -1.0, 1.0)
    matrices = np.tile(np.diag([1.0, 1.0, 0.0005, 1.0]), (SAMPLES, 1, 1))
    matrices[:, 2, 3] = 0.25 * side
    blocks = []
    for begin in range(0, SAMPLES, BLOCK):
        part = slice(max(begin - 1, 0), begin + BLOCK)
        count = len(matrices[part])
        still = np.tile(np.eye(4), (count, 1, 1))
        blocks.append(
            AnimationBlock(
                np.arange(SAMPLES)[part],
                (
                    EffectBlock(
                        np.ones(count), np.full((count, 1), 6.0), matrices[part], (Cuboid(),)
                    ),
                ),
                (PoseBlock(np.ones(count, bool), still, still[:, None, :3]),),
                int(begin > 0),
            )
        )
    return blocks


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("interval_ms", [10.0, 50.0, 35.0])
def test_no_pass_is_missed_by_a_device(seed: int, interval_ms: float) -> None:
    rng = np.random.default_rng(seed)
    passes = np.sort(rng.choice(np.arange(1, SAMPLES), 40, replace=False))
    header = make_header({"wall": "pressure"}, SAMPLES)
    effect = EffectDescription("wall", "Wall", "pressure", "dots-pressure", HapticVolume(Falloff()))
    body = BodyDescription("body", "Body", SkinBinding(("root",)))
    scene = SceneDescription(header.time, (body,), (effect,))
    engine = Engine(scene, models=MODELS.__getitem__)
    device = make_device({"p": ("pressure", at(4))}, interval_ms=interval_ms)
    renderer = Renderer(header, device, MODELS.__getitem__)
    for block in _blocks(passes):
        renderer.add(engine.evaluate(block))
    values = renderer.raster().values[:, 0]
    every = Fraction(interval_ms) / 10
    intervals = [int(row / every) for row in range(SAMPLES)]
    hit = {intervals[row] for row in passes.tolist()}
    expected = [6.0 if interval in hit else 0.0 for interval in intervals]
    assert values == pytest.approx(expected)
    assert len(hit) == (40 if interval_ms == 10.0 else len(hit)) > 20
