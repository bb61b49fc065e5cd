# SPDX-License-Identifier: GPL-3.0-or-later
"""Library of materials, and distinguishing features of the strokes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.texture import procedural
from hfx_blender.engine.texture.mcha import blurred_slope
from hfx_blender.errors import InputError
from hfx_tools.bench.surfaces import textile_correlation, texture_chart
from hfx_tools.bench.surfaces import texture as bench
from hfx_tools.bench.surfaces.textile_correlation import PAPER_R


@pytest.mark.parametrize("name", procedural.MATERIALS)
def test_a_material_tiles_without_a_seam_and_is_the_same_for_the_same_seed(name: str) -> None:
    material = procedural.material(name)
    field, rough = material.make(128, 5)
    again, _ = material.make(128, 5)
    second, _ = material.make(128, 6)
    np.testing.assert_array_equal(field.heights_m, again.heights_m)
    assert not np.array_equal(field.heights_m, second.heights_m)
    assert field.size_m == pytest.approx((material.size_m, material.size_m))
    assert rough.min() >= 0.0 and rough.max() <= 1.0
    for axis in (0, 1):
        steps = np.abs(np.diff(field.heights_m, axis=axis))
        first, last = np.take(field.heights_m, 0, axis), np.take(field.heights_m, -1, axis)
        assert np.abs(first - last).mean() <= 2.0 * steps.mean(axis=axis).max() + 1e-12
        assert np.abs(first - last).max() <= 1.5 * steps.max()


def test_the_library_has_variants_of_each_kind() -> None:
    kinds = [material.kind for material in procedural.MATERIALS.values()]
    assert all(kinds.count(kind) >= 3 for kind in procedural.KINDS)
    assert set(kinds) == set(procedural.KINDS)
    with pytest.raises(InputError, match="gravel-fine"):
        procedural.material("cheese")
    with pytest.raises(InputError, match="16 or more"):
        procedural.material("wood-oak").make(4)


def test_gravel_is_stronger_than_metal_by_the_same_slope() -> None:
    strength = {
        kind: np.mean(
            [
                blurred_slope(material.make(192)[0], 1e-4).mean()
                for material in procedural.MATERIALS.values()
                if material.kind == kind
            ]
        )
        for kind in procedural.KINDS
    }
    assert strength["gravel"] > strength["fabric"] > strength["metal"]
    assert strength["gravel"] > strength["wood"] > strength["metal"]


@pytest.mark.parametrize("draft", procedural.DRAFTS)
def test_a_weave_repeats_in_its_period_and_direction(draft: str) -> None:
    cloth = procedural.Weave(draft, 0.5e-3, 0.1e-3)
    field = procedural.woven(cloth, 0.03, 480)
    repeat = int(
        np.lcm(*np.array([len(procedural.DRAFTS[draft]), len(procedural.DRAFTS[draft][0])]))
    )
    threads = repeat * round(60 / repeat)
    across = np.roll(field.heights_m, 480 * repeat // threads, axis=1)
    if (480 * repeat) % threads == 0:
        np.testing.assert_allclose(across, field.heights_m, atol=1e-12)
    assert np.ptp(field.heights_m) == pytest.approx(0.1e-3)
    turned = procedural.woven(procedural.Weave(draft, 0.5e-3, 0.1e-3, np.pi / 2.0), 0.03, 480)
    assert turned.heights_m.std() == pytest.approx(field.heights_m.std(), rel=0.02)


@pytest.mark.parametrize(
    "make",
    [
        lambda: procedural.Weave("knit", 1e-3, 1e-4),
        lambda: procedural.Weave("plain", 0.0, 1e-4),
        lambda: procedural.Weave("plain", 1e-3, float("nan")),
        lambda: procedural.woven(procedural.Weave("satin", 1e-2, 1e-4), 0.01, 64),
    ],
)
def test_an_invalid_weave_is_refused(make: object) -> None:
    with pytest.raises(InputError):
        make()  # type: ignore[operator]


def test_the_reference_fabrics_go_from_smooth_to_rough() -> None:
    depths = [
        reference_fabric.depth_m for reference_fabric in procedural.reference_fabrics().values()
    ]
    assert depths == sorted(depths) and len(depths) == 3


def test_the_textile_renderers_output_goes_with_measured_roughness(tmp_path: Path) -> None:
    correlation = textile_correlation.correlation(1, texels=192)
    fast = 1
    for recipe, rows in correlation["median_r"].items():
        # ISO 4288 measures coarse cloth at 8 mm; weaves keep the paper's values at 2.5 mm, too.
        least, coarse = rows[0][fast], rows[1][fast]
        assert (np.array(coarse) >= PAPER_R).all(), recipe
        assert (np.array(least) >= PAPER_R).all() or "weaves" not in recipe, recipe
    assert len(correlation["surfaces"]) == 36
    texture_chart.draw(correlation, tmp_path / "chart.svg")
    chart = (tmp_path / "chart.svg").read_text()
    # A point for each surface, speed and parameter; a point for each family, and three in legends.
    points = 6 * len(correlation["surfaces"]) + 6 * len(correlation["sets"])
    assert points <= chart.count("<use") <= points + 200


def test_materials_are_distinguished_on_unseen_maps_directions_and_speeds() -> None:
    identification = bench.identification(1, 1, texels=192)
    assert identification["share"] >= 0.9
    assert np.sum(identification["confusion"]) == 3 * 3 * len(procedural.MATERIALS)
    assert (
        np.diag(identification["confusion"]) / np.sum(identification["confusion"], axis=1) >= 0.8
    ).all()


def test_salient_collisions_keep_more_than_the_first_collisions() -> None:
    rows = [row for row in bench.salience(short=True) if row["speed_m_s"] == 0.1]
    assert rows
    for row in rows:
        assert row["salient"] > row["first_come"]
        assert row["salient"] > 0.85
