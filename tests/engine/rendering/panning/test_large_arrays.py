# SPDX-License-Identifier: GPL-3.0-or-later
"""Hundreds of actuators, up to the thousand of a configuration: no quadratic work.

Instead of timing, calls are counted and memory is measured.
"""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.body.skin_distance import SkinDistances
from hfx_blender.engine.rendering.device_config import Actuator, BodyPlace, Scheme, SchemeName
from hfx_blender.engine.rendering.panning import complex as panning_complex
from hfx_blender.engine.rendering.schemes import cells_of

COUNT = 150
"""Of the thousand that there may be, so that the test is quick; work grows with their number."""
MODEL = load_model("hfx-pressure-1")


def actuators() -> tuple[Actuator, ...]:
    """Return positions all over the back, about 2 cm apart, off the vertices."""
    rng = np.random.default_rng(3)
    back = (MODEL.part == PARTS.index("torso")) & (MODEL.normals[:, 1] > 0.3)
    places = MODEL.vertices[rng.choice(np.flatnonzero(back), COUNT)] + rng.normal(
        0.0, 0.002, (COUNT, 3)
    )
    kind = load_device("back_pad").actuators[0].type
    return tuple(
        Actuator(f"a{k}", kind, BodyPlace(("torso",), (float(x), float(y), float(z)), 0.01))
        for k, (x, y, z) in enumerate(places)
    )


ARRAY = actuators()


@pytest.mark.parametrize("scheme", get_args(SchemeName))
def test_hundreds_of_actuators_are_set_up_in_modest_work_and_memory(scheme, monkeypatch):
    measured, tried = [0], [0]
    around, barycentric = SkinDistances.around, panning_complex.barycentric

    def counted_around(self, *arguments):
        measured[0] += 1
        return around(self, *arguments)

    def counted_barycentric(points, corners):
        tried[0] += len(points)
        return barycentric(points, corners)

    monkeypatch.setattr(SkinDistances, "around", counted_around)
    monkeypatch.setattr(panning_complex, "barycentric", counted_barycentric)
    device = replace(load_device("back_pad"), actuators=ARRAY, mount=None, scheme=Scheme(scheme))
    tracemalloc.start()
    cells = cells_of(device, ARRAY, MODEL)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert np.count_nonzero(cells.counts) > 0.5 * COUNT
    assert peak < 70 << 20, f"{peak >> 20} MiB"
    assert measured[0] < COUNT / 2, f"{measured[0]} measurements along the skin"
    assert tried[0] < 100 * len(MODEL), f"{tried[0]} places of triangles"
