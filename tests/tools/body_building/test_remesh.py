# SPDX-License-Identifier: GPL-3.0-or-later
"""Remesher on a ball of two parts, with a known result."""

from __future__ import annotations

import numpy as np
import pytest
import skin_ball
from skin_ball import spacings

from hfx_tools.body_building import assemble, left_skin
from hfx_tools.body_building.meshes import remesh

SPACING_M = 2.0 * np.array(skin_ball.SPACING_M)
"""Coarse: each remesh takes seconds."""


def remeshed(ball: left_skin.LeftSkin) -> remesh.Remesher:
    return remesh.remesh(ball, 2.0 * spacings(), lambda _share, _text: None)


@pytest.fixture(scope="module")
def ball() -> left_skin.LeftSkin:
    return skin_ball.ball()


@pytest.fixture(scope="module")
def meshed(ball: left_skin.LeftSkin) -> remesh.Remesher:
    return remeshed(ball)


def test_samples_cover_the_half_ball(ball: left_skin.LeftSkin) -> None:
    samples = left_skin.sample(ball, spacings())
    assert samples.areas_m2.sum() == pytest.approx(2.0 * np.pi * 0.15**2, rel=2e-3)
    assert np.linalg.norm(samples.points, axis=1) == pytest.approx(0.15, rel=1e-3)
    out = np.einsum("ij,ij->i", samples.normals, samples.points) / 0.15
    assert out.min() > 0.99


def test_remeshing_reaches_the_spacings_inside_the_parts(meshed: remesh.Remesher) -> None:
    mean = meshed.mean_spacing(meshed.points)[:2]
    assert mean == pytest.approx(SPACING_M, rel=0.015)
    upper = meshed.points[:, 2] > 1e-3
    assert (meshed.part[upper] == 0).all()
    assert (meshed.part[meshed.points[:, 2] < -3e-3] == 1).all()
    assert (meshed.largest_gaps_m()[:2] < 0.8 * SPACING_M).all()


def test_the_cells_share_out_all_of_the_skin(meshed: remesh.Remesher) -> None:
    assert meshed.areas_m2().sum() == pytest.approx(2.0 * np.pi * 0.15**2, rel=2e-3)
    whole_cells = meshed.areas_m2() * np.where(meshed.is_midline, 2.0, 1.0)
    for number, spacing in enumerate(SPACING_M):
        cells = whole_cells[meshed.part == number]
        assert cells.std() / cells.mean() < 0.2
        assert cells.mean() == pytest.approx(np.sqrt(0.75) * spacing**2, rel=0.1)


def test_the_whole_is_a_closed_ball(meshed: remesh.Remesher) -> None:
    body = assemble.whole(meshed.result())
    directed = body.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {tuple(edge) for edge in directed.tolist()}
    assert len(forward) == len(directed)
    assert forward == {(end, start) for start, end in forward}
    assert len(body.points) - len(forward) // 2 + len(body.triangles) == 2
    a, b, c = (body.points[body.triangles[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    # A triangle of edges s lies s^2 / 8 R below the sphere on average, by Pythagoras.
    lacking = 3.0 * np.square(SPACING_M).mean() / 8.0 / 0.15**2
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * 0.15**3 * (1.0 - lacking), rel=2e-3)
    assert np.array_equal(body.points[body.mirror] * (-1.0, 1.0, 1.0), body.points)


def test_the_same_input_gives_the_same_mesh(
    ball: left_skin.LeftSkin, meshed: remesh.Remesher
) -> None:
    again = remeshed(ball)
    assert np.array_equal(meshed.points, again.points) and len(again.points) > 100
    assert np.array_equal(meshed.triangles, again.triangles)
