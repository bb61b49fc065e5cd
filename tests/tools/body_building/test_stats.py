# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of spacings, on a body small enough for a pencil."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import PARTS
from hfx_tools.body_building import correspondence, stats


@pytest.fixture
def pencil() -> model.PerceptualModel:
    """Return two triangles: 0 1 2 on the head with sides 3, 4, 5 cm, vertex 3 on the torso."""
    vertices = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.04, 0], [0.03, 0.04, 0]], np.float32)
    return replace(
        model.load_model("hfx-temperature-1"),
        vertices=vertices,
        triangles=np.array([[0, 1, 2], [1, 3, 2]], np.int32),
        part=np.array([0, 0, 0, 1], np.uint8),
        side=np.ones(4, np.uint8),
    )


def test_spacing_counts_each_edge_inside_a_part_once(pencil: model.PerceptualModel) -> None:
    mean, sd = stats.spacing_m(pencil)
    assert mean[0] == pytest.approx(0.04)
    assert sd[0] == pytest.approx(np.sqrt(2.0 / 3.0) * 0.01)
    assert np.isnan(mean[1:]).all()


def test_the_table_has_one_row_for_each_part_and_says_nothing_of_lone_vertices(
    pencil: model.PerceptualModel,
) -> None:
    rows = stats.table([pencil])
    assert [row.part for row in rows] == list(PARTS)
    assert (rows[0].vertices, rows[0].mean_mm, rows[0].target_mm) == (3, 40.0, 50.0)
    assert (rows[1].vertices, rows[1].mean_mm, rows[1].sd_mm) == (1, None, None)
    assert (rows[1].table_1_mm, rows[1].table_1_sd_mm) == (50.4, 24.6)
    head, torso = stats.as_text(rows).splitlines()[1:3]
    assert head.split() == [
        "head", "3", "50.0", "40.00", "-20.0%", "8.16", "0.204",
        f"{rows[0].gap_mm:.2f}", "48.80", "(22.80)",
    ]  # fmt: skip
    assert torso.split()[3:7] == ["-", "-", "-", "-"]


def test_the_shipped_table_agrees_with_the_manifest() -> None:
    entries = model.manifest()["models"]
    for row in stats.table(model.load_model(identity) for identity in entries):
        statistics = entries[f"hfx-{row.modality}-1"]["statistics"][row.part]
        assert (row.vertices, row.mean_mm) == (statistics["vertices"], statistics["mean_mm"])


def test_a_model_corresponds_to_itself_and_to_a_coarser_one_within_its_cells() -> None:
    coarse, fine = model.load_model("hfx-temperature-1"), model.load_model("hfx-pressure-1")
    own = correspondence.nearest_ids(coarse, coarse)
    assert np.array_equal(own, np.arange(len(coarse)))
    onto = correspondence.nearest_ids(fine, coarse)
    assert np.array_equal(coarse.part[onto], fine.part)
    wrong_side = (coarse.side[onto] != fine.side) & (fine.side != 0) & (coarse.side[onto] != 0)
    assert not wrong_side.any()
