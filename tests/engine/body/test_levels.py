# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail: fewer vertices, and every fine one stands somewhere near."""

from __future__ import annotations

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.building import levels


def test_a_level_covers_the_whole_model() -> None:
    fine = model.load_model("hfx-pressure-1")
    level = levels.coarser(fine, 3000)
    assert len(level.vertices) == pytest.approx(3000, rel=0.05)
    assert level.coarse_of.shape == (len(fine),)
    # Every coarse vertex stands for at least one fine vertex, and every fine one has a stand-in.
    assert set(level.coarse_of.tolist()) == set(range(len(level.vertices)))
    assert np.unique(level.triangles).tolist() == list(range(len(level.vertices)))
    apart = np.linalg.norm(level.vertices[level.coarse_of] - fine.vertices, axis=1)
    assert np.median(apart) < 0.01 and apart.max() < 0.12
    assert np.linalg.norm(level.vertices - fine.vertices[level.nearest], axis=1).max() < 0.03


@pytest.mark.parametrize("count", (3, 10**6))
def test_impossible_counts_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match="vertices: expected 4 to"):
        levels.coarser(model.load_model("hfx-temperature-1"), count)
