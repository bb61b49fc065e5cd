# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail: subsets of the vertices, with a coarse vertex near every fine vertex."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from coarse_models import at_level

from hfx_blender.engine.body import levels_and_cells as level_files
from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import RIGHT
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_tools.body_building import level_making as making
from hfx_tools.body_building.meshes.nearest_places import locate

FINE = ("hfx-pressure-1", "hfx-vibration-1")
FLIP = np.array((-1.0, 1.0, 1.0), np.float32)


@pytest.fixture(params=[(identity, level) for identity in FINE for level in (1, 2)], ids=str)
def pair(
    request: pytest.FixtureRequest,
) -> tuple[model.PerceptualModel, model.PerceptualModel, np.ndarray, int]:
    identity, level = request.param
    fine = model.load_model(identity)
    return fine, *at_level(fine, level), level


Pair = tuple[model.PerceptualModel, model.PerceptualModel, np.ndarray, int]


def test_every_coarse_vertex_represents_itself(pair: Pair) -> None:
    fine, coarse, coarse_of, level = pair
    assert len(coarse) == pytest.approx(len(fine) / 4**level, rel=0.02)
    assert coarse_of.dtype == np.int32 and coarse_of.shape == (len(fine),)
    assert np.array_equal(np.unique(coarse_of), np.arange(len(coarse)))
    vertex_by_position = {point.tobytes(): vertex for vertex, point in enumerate(fine.vertices)}
    fine_ids = np.array([vertex_by_position[point.tobytes()] for point in coarse.vertices])
    assert np.array_equal(coarse_of[fine_ids], np.arange(len(coarse)))
    assert (np.diff(fine_ids) > 0).all()


def test_levels_keep_the_skin_and_its_area(pair: Pair) -> None:
    fine, coarse, coarse_of, level = pair
    every_seventh = slice(None, None, 7)
    places, points = fine.vertices[every_seventh].astype(float), coarse.vertices.astype(float)
    triangle, shares, _ = locate(places, points, coarse.triangles.astype(int))
    corners = points[coarse.triangles[triangle]]
    away = np.linalg.norm(np.einsum("ij,ijk->ik", shares, corners) - places, axis=1)
    assert np.average(away, weights=fine.areas_m2[every_seventh]) < (0.001 if level == 1 else 0.003)
    assert away.max() < (0.010 if level == 1 else 0.015)
    skin = [_surface_m2(item) for item in (fine, coarse)]
    assert skin[1] == pytest.approx(skin[0], rel=0.02)
    assert coarse.areas_m2.sum() == pytest.approx(fine.areas_m2.sum(), rel=1e-5)
    assert np.bincount(coarse_of, fine.areas_m2) == pytest.approx(coarse.areas_m2, rel=1e-5)


def _surface_m2(shown: model.PerceptualModel) -> float:
    a, b, c = (shown.vertices[shown.triangles[:, k]].astype(float) for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_left_and_right_mirror_each_other_to_the_bit(pair: Pair) -> None:
    fine, coarse, coarse_of, _ = pair
    assert np.array_equal(coarse.mirror[coarse.mirror], np.arange(len(coarse)))
    assert np.array_equal(coarse.vertices[coarse.mirror] * FLIP, coarse.vertices)
    assert np.array_equal(coarse.mirror[coarse_of], coarse_of[fine.mirror])
    assert (
        not (coarse.side[coarse.triangles] == RIGHT)
        .any(axis=1)[(coarse.vertices[coarse.triangles, 0] > 0.0).any(axis=1)]
        .any()
    )


def test_weights_of_a_level_are_rows_of_the_models(pair: Pair) -> None:
    fine, coarse, _, _ = pair
    vertex_by_position = {point.tobytes(): vertex for vertex, point in enumerate(fine.vertices)}
    for vertex in range(0, len(coarse), 97):
        origin = vertex_by_position[coarse.vertices[vertex].tobytes()]
        ours, theirs = (
            slice(*item.weights.offsets[[at, at + 1]])
            for item, at in ((coarse, vertex), (fine, origin))
        )
        assert np.array_equal(coarse.weights.bones[ours], fine.weights.bones[theirs])
        assert np.array_equal(coarse.weights.values[ours], fine.weights.values[theirs])
    assert coarse.weights.offsets[-1] == len(coarse.weights.values)


def test_a_level_says_that_its_ids_are_its_own(pair: Pair) -> None:
    fine, coarse, _, level = pair
    assert coarse.id == f"{fine.id}/level-{level}"
    with pytest.raises(InputError, match="is unknown"):
        model.load_model(coarse.id)


def test_level_0_is_the_model_and_temperature_has_no_other() -> None:
    same, coarse_of = at_level(model.load_model("hfx-temperature-1"), 0)
    assert same is model.load_model("hfx-temperature-1")
    assert np.array_equal(coarse_of, np.arange(len(same)))
    assert level_files.level_count(same) == 0
    assert level_files.level_count(model.load_model("hfx-pressure-1")) == 2
    for identity, level, there in (("hfx-temperature-1", 1, 0), ("hfx-pressure-1", 3, 2)):
        with pytest.raises(InputError, match=f"has levels 0 to {there}, not {level}"):
            at_level(model.load_model(identity), level)


def test_a_level_of_a_model_on_an_avatar_is_on_that_avatar() -> None:
    fine = model.load_model("hfx-pressure-1")
    tall = replace(fine, vertices=2.0 * fine.vertices)
    coarse, _ = at_level(tall, 2)
    assert np.array_equal(coarse.vertices, 2.0 * at_level(fine, 2)[0].vertices)


def test_levels_load_without_scipy() -> None:
    script = (
        "import sys; sys.modules['scipy'] = None\n"
        "from hfx_blender.engine.body.levels_and_cells import level_of\n"
        "from hfx_blender.engine.body.levels_and_cells import cell_of_skin\n"
        "from hfx_blender.engine.body.model import load_model\n"
        "print(len(level_of(load_model('hfx-pressure-1'), 1).vertices))\n"
        "print(len(cell_of_skin(load_model('hfx-temperature-1'))[1]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[1] == str(len(model.load_model("hfx-pressure-1")))


@pytest.mark.parametrize("count", (7, 10**6))
def test_impossible_counts_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match="vertices: expected 8 to"):
        making.coarser(model.load_model("hfx-temperature-1"), count)


def test_levels_are_made_the_same_twice_and_only_where_they_help(tmp_path: Path) -> None:
    fine = model.load_model("hfx-pressure-1")
    assert making.save(fine, tmp_path) == 2
    path = tmp_path / "pressure-levels.npz"
    first = path.read_bytes()
    making.save(fine, tmp_path)
    assert path.read_bytes() == first
    owner, levels = level_files.read_levels(path)
    assert owner == (fine.id, fine.content_hash)
    assert [len(item.vertices) for item in levels] == pytest.approx(
        [19210 / 4, 19210 / 16], rel=0.02
    )
    assert making.save(model.load_model("hfx-temperature-1"), tmp_path) == 0
    assert [path.name for path in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("change", "message"),
    (
        (lambda path: path.write_bytes(b"PK"), "not readable as levels of a model"),
        (lambda path: np.savez(path, model=["hfx-pressure-1", "0"]), "are of another"),
        (lambda path: path.unlink(), "has levels 0 to 0, not 1"),
    ),
)
def test_missing_or_broken_levels_are_reported(
    change: Callable[[Path], object],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fine = model.load_model("hfx-pressure-1")
    for name in ("manifest.json", "pressure-levels.npz"):
        shutil.copy(resources.body_models() / name, tmp_path)
    change(tmp_path / "pressure-levels.npz")
    monkeypatch.setattr("hfx_blender.files.resources.body_models", lambda: tmp_path)
    with pytest.raises(InputError, match=message):
        at_level(fine, 1)
