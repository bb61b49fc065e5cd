# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's way to thin a body, on a ball of two parts; and both ways compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import skin_ball
from skin_ball import RADIUS_M, SPACING_M, spacings

from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import CENTRE, PARTS
from hfx_blender.errors import UsageError
from hfx_blender.files import resources
from hfx_tools.body_building import assemble, build, left_skin, stats, thresholds
from hfx_tools.body_building.meshes import measure, quadric


@pytest.fixture(scope="module")
def skin() -> left_skin.LeftSkin:
    return skin_ball.ball()


@pytest.fixture(scope="module")
def samples(skin: left_skin.LeftSkin) -> left_skin.Samples:
    return left_skin.sample(skin, spacings())


@pytest.fixture(scope="module")
def half(skin: left_skin.LeftSkin) -> left_skin.Half:
    return quadric.decimate(skin, spacings())


def test_each_part_reaches_its_mean_spacing_by_itself(half: left_skin.Half) -> None:
    ends = np.unique(np.sort(half.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    assert np.array_equal(half.part[ends[:, 0]], half.part[ends[:, 1]])
    lengths = np.linalg.norm(half.points[ends[:, 0]] - half.points[ends[:, 1]], axis=1)
    for number, spacing in enumerate(SPACING_M):
        assert lengths[half.part[ends[:, 0]] == number].mean() == pytest.approx(spacing, rel=0.05)
    assert set(half.part.tolist()) == {0, 1}
    assert np.linalg.norm(half.points, axis=1) == pytest.approx(RADIUS_M, rel=0.02)


def test_simplified_halves_keep_the_midline(half: left_skin.Half) -> None:
    assert half.points[:, 0].min() == 0.0
    assert half.is_midline.sum() > 2.0 * RADIUS_M * np.pi / max(SPACING_M) / 2.0
    body = assemble.whole(half)
    assert np.array_equal(body.points[body.mirror] * (-1.0, 1.0, 1.0), body.points)
    assert (body.side == CENTRE).sum() == half.is_midline.sum()
    normals = assemble.vertex_normals(body.points, body.triangles)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)


def test_its_vertices_share_out_all_of_the_skin(
    half: left_skin.Half, samples: left_skin.Samples
) -> None:
    areas = quadric.areas_m2(half, samples)
    assert (areas > 0.0).all()
    assert areas.sum() == pytest.approx(2.0 * np.pi * RADIUS_M**2, rel=2e-3)
    for number in (0, 1):
        skin = samples.areas_m2[samples.part == number].sum()
        assert areas[half.part == number].sum() == pytest.approx(skin)


def test_gaps_and_errors_are_those_of_the_naive_way(
    half: left_skin.Half, samples: left_skin.Samples
) -> None:
    indices = np.arange(0, len(samples.points), 5000)
    gaps = measure.gaps_m(samples, half.points)
    for at in indices:
        nearest = np.linalg.norm(half.points - samples.points[at], axis=1).min()
        assert nearest <= gaps[samples.part[at]] + 1e-12
    assert (gaps[:2] > 0.3 * np.array(SPACING_M)).all() and not gaps[2:].any()
    errors = measure.errors_m(samples, half.points, half.triangles)
    assert (errors[:2] > 0.0).all() and (errors[:2] < 0.002).all()


def test_triangles_back_to_back_still_have_a_normal() -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]])
    vertex_normals = assemble.vertex_normals(points, np.array([[0, 1, 2], [2, 1, 0], [3, 3, 3]]))
    assert np.linalg.norm(vertex_normals, axis=1) == pytest.approx(1.0)


def test_a_decimated_model_has_an_id_of_its_own() -> None:
    row = thresholds.LITERATURE_MM["pressure"]
    assert thresholds.model_id("pressure", row, "quadric") == "hfx-pressure-1-quadric"
    model_id = thresholds.model_id("pressure", thresholds.TABLE_1_MM["pressure"], "quadric")
    plain = thresholds.model_id("pressure", thresholds.TABLE_1_MM["pressure"])
    assert model_id == f"{plain}-quadric" and plain != "hfx-pressure-1"


def test_the_canonical_folder_is_for_the_canonical_method(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds the canonical models"):
        build.build(None, resources.body_models(), method="quadric")
    with pytest.raises(ValueError, match="method: expected one of"):
        build.build(None, tmp_path, method="magic")


def test_even_cells_are_more_even_than_quadric_decimation_everywhere() -> None:
    for entry in model.manifest()["models"].values():
        for part, cells in entry["statistics"].items():
            decimated = entry["quadric"][part]
            if cells["sd_mm"]:
                ours, theirs = (item["sd_mm"] / item["mean_mm"] for item in (cells, decimated))
                assert ours < theirs
            # A foot of three temperature vertices is a sketch either way.
            if cells["target_mm"] < 100.0:
                assert cells["gap_mm"] < decimated["gap_mm"]


def test_both_ways_stand_side_by_side() -> None:
    index = model.manifest()
    times = {modality: {"cells_s": 60.0, "quadric_s": 5.0} for modality in thresholds.MODALITIES}
    for taken, extra in ((times, 1), ({}, 0)):
        lines = stats.comparison_as_text(index, taken).splitlines()
        assert len(lines) == 2 + 3 * (len(PARTS) + 3 + extra)
        table = lines[3 : 3 + len(PARTS) + 2 + extra]
        assert len({len(line) for line in table}) == 1
        bars = {tuple(at for at, sign in enumerate(line) if sign == "|") for line in table}
        assert len(bars) == 1
    pressure = index["models"]["hfx-pressure-1"]
    total = next(line for line in lines if line.startswith("all")).split("|")
    vertices = sum(row["vertices"] for row in pressure["quadric"].values())
    assert total[2].split()[0] == str(vertices)
