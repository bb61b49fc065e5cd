# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells of skin: the patch of each temperature vertex, by distance along the skin."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.engine.body import model
from hfx_blender.engine.body.levels_and_cells import cell_of_skin
from hfx_blender.engine.body.parts import CENTRE, LEFT, PARTS, RIGHT
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_tools.body_building.meshes import geodesic

LIMBS = ("upper_arm", "forearm", "upper_leg", "lower_leg")


@pytest.fixture(scope="module")
def coarse() -> model.PerceptualModel:
    return model.load_model("hfx-temperature-1")


@pytest.fixture(scope="module")
def fine() -> model.PerceptualModel:
    return model.load_model("hfx-pressure-1")


@pytest.fixture(scope="module")
def owner(coarse: model.PerceptualModel) -> np.ndarray:
    name, owner = cell_of_skin(coarse)
    assert name == "hfx-pressure-1"
    return owner


def test_the_shipped_cells_are_those_of_the_shipped_models(
    coarse: model.PerceptualModel, fine: model.PerceptualModel, owner: np.ndarray
) -> None:
    assert owner.dtype == np.int32 and owner.shape == (len(fine),)
    assert np.array_equal(owner, geodesic.owners(coarse, fine))
    with pytest.raises(ValueError, match="read-only"):
        owner[0] = 1


def test_a_cell_is_of_one_part_and_mirrored_exactly(
    coarse: model.PerceptualModel, fine: model.PerceptualModel, owner: np.ndarray
) -> None:
    assert np.array_equal(coarse.part[owner], fine.part)
    beside = fine.side != CENTRE
    assert np.array_equal(coarse.mirror[owner[beside]], owner[fine.mirror[beside]])
    assert not (coarse.side[owner[fine.side == LEFT]] == RIGHT).any()


def test_every_cell_has_skin_of_its_own_as_large_as_its_vertex_says(
    coarse: model.PerceptualModel, fine: model.PerceptualModel, owner: np.ndarray
) -> None:
    assert np.bincount(owner, minlength=len(coarse)).min() >= 1
    area = np.bincount(owner, fine.areas_m2, minlength=len(coarse))
    limb = np.isin(coarse.part, [PARTS.index(part) for part in LIMBS])
    assert np.bincount(owner)[limb].min() >= 20
    assert area[limb] == pytest.approx(coarse.areas_m2[limb], rel=0.3)


def test_a_cell_is_one_patch(
    coarse: model.PerceptualModel, fine: model.PerceptualModel, owner: np.ndarray
) -> None:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ends = np.sort(fine.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    inside = ends[owner[ends[:, 0]] == owner[ends[:, 1]]]
    graph = coo_array((np.ones(len(inside)), tuple(inside.T)), shape=(len(fine),) * 2)
    assert connected_components(graph, directed=False)[0] == len(coarse)


def test_distance_is_measured_along_the_skin_by_an_exact_method(
    coarse: model.PerceptualModel, fine: model.PerceptualModel, owner: np.ndarray
) -> None:
    # Exact geodesics (Mitchell, Mount and Papadimitriou 1987) on a forearm and a lower leg.
    igl = pytest.importorskip("igl")
    for part in ("forearm", "lower_leg"):
        own = (fine.part == PARTS.index(part)) & (fine.side == LEFT)
        seeds = np.flatnonzero((coarse.part == PARTS.index(part)) & (coarse.side == LEFT))
        inside = fine.triangles[own[fine.triangles].all(axis=1)]
        used, faces = np.unique(inside, return_inverse=True)
        points, faces = fine.vertices[used].astype(np.float64), faces.reshape(-1, 3)
        distance = []
        for seed in seeds:
            # A seed is not a vertex of the finer mesh: start at the nearest vertex, with an offset.
            away = np.linalg.norm(points - coarse.vertices[seed], axis=1)
            start = np.array([int(away.argmin())])
            ends = np.arange(len(points))
            empty = np.zeros(0, np.int64)
            exact_geodesic = igl.exact_geodesic(points, faces, start, empty, ends, empty)
            distance.append(np.asarray(exact_geodesic).ravel() + away.min())
        ours = np.array(distance)[np.searchsorted(seeds, owner[used]), np.arange(len(used))]
        least = np.min(distance, axis=0)
        # The nearest fine vertex is up to one spacing away from the seed.
        assert (ours - least).max() < 0.0275
        assert (ours > 1.02 * least).mean() < 0.1


def tube(radius_m: float, length_m: float, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return an open tube around the z axis, with rows shifted by half a step."""
    around, rows = (round(x / spacing_m) for x in (2.0 * np.pi * radius_m, length_m))
    row, column = np.divmod(np.arange(around * (rows + 1)), around)
    angle = 2.0 * np.pi * (column + 0.5 * (row % 2)) / around
    points = np.column_stack(
        (radius_m * np.cos(angle), radius_m * np.sin(angle), row * length_m / rows)
    )
    triangles = []
    for i in range(rows):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            c, d = (i + 1) * around + j, (i + 1) * around + (j + 1) % around
            triangles += [(a, b, c), (b, d, c)] if i % 2 == 0 else [(a, d, c), (a, b, d)]
    return points, np.array(triangles)


def of_one_part(points: np.ndarray, triangles: np.ndarray) -> model.PerceptualModel:
    shipped = model.load_model("hfx-temperature-1")
    count = len(points)
    return replace(
        shipped,
        vertices=points.astype(np.float32),
        triangles=triangles.astype(np.int32),
        part=np.full(count, PARTS.index("forearm"), np.uint8),
        side=np.full(count, LEFT, np.uint8),
        mirror=np.arange(count, dtype=np.int32),
    )


def test_on_a_thin_tube_the_path_goes_around() -> None:
    radius_m = 0.04
    points, triangles = tube(radius_m, 0.3, 0.005)
    angle, height = np.arctan2(points[:, 1], points[:, 0]), points[:, 2]
    seeds = np.array([[0.0, 0.05], [np.pi, 0.15], [0.0, 0.27]])  # angle, height
    turn = np.abs((angle - seeds[:, :1] + np.pi) % (2.0 * np.pi) - np.pi)
    along = np.hypot(radius_m * turn, height - seeds[:, 1:])  # the tube unrolled
    chord = np.hypot(2.0 * radius_m * np.sin(turn / 2.0), height - seeds[:, 1:])
    places = np.column_stack(
        (radius_m * np.cos(seeds[:, 0]), radius_m * np.sin(seeds[:, 0]), seeds[:, 1])
    )
    owner = geodesic.owners(of_one_part(places, np.zeros((0, 3))), of_one_part(points, triangles))
    ranked = np.sort(along, axis=0)
    clear = ranked[1] > 1.04 * ranked[0] + 0.001
    assert clear.mean() > 0.8
    assert np.array_equal(owner[clear], along.argmin(axis=0)[clear])
    assert (owner != chord.argmin(axis=0)).any()


def test_a_variant_has_the_same_cells_on_its_own_pressure_model(
    coarse: model.PerceptualModel, owner: np.ndarray
) -> None:
    origin = {"canonical": {"id": coarse.id, "hash": coarse.content_hash}}
    variant = replace(coarse, id=f"{coarse.id}+0123abcd", provenance=origin)
    name, actual = cell_of_skin(variant)
    assert name == "hfx-pressure-1+0123abcd"
    assert np.array_equal(actual, owner)


def test_a_model_fitted_to_an_avatar_has_equal_cells(
    coarse: model.PerceptualModel, owner: np.ndarray
) -> None:
    fitted = replace(coarse, vertices=2.0 * coarse.vertices)
    assert np.array_equal(cell_of_skin(fitted)[1], owner)


def test_models_without_cells_are_refused(
    coarse: model.PerceptualModel, fine: model.PerceptualModel
) -> None:
    with pytest.raises(InputError, match="'hfx-pressure-1' has no skin cells"):
        cell_of_skin(fine)
    old = {"canonical": {"id": coarse.id, "hash": "0" * 64}}
    with pytest.raises(InputError, match="a variant of another edition of 'hfx-temperature-1'"):
        cell_of_skin(replace(coarse, id=f"{coarse.id}+0123abcd", provenance=old))


@pytest.mark.parametrize(
    ("change", "message"),
    (
        (lambda path: path.write_bytes(b"PK"), "not readable as skin cells"),
        (lambda path: path.unlink(), "has no skin cells"),
        (lambda path: np.savez(path, owner=[0], model=["hfx-temperature-1", "0"], fine=["f", "0"]),
         "the cells are of another 'hfx-temperature-1'"),
    ),
)  # fmt: skip
def test_missing_or_broken_cells_are_reported(
    coarse: model.PerceptualModel,
    change: Callable[[Path], object],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("manifest.json", "cells.npz"):
        shutil.copy(resources.body_models() / name, tmp_path)
    change(tmp_path / "cells.npz")
    monkeypatch.setattr("hfx_blender.files.resources.body_models", lambda: tmp_path)
    with pytest.raises(InputError, match=message):
        cell_of_skin(coarse)
