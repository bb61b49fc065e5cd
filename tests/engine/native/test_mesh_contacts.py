# SPDX-License-Identifier: GPL-3.0-or-later
"""Contacts with mesh volumes are the same with the compiled library and without."""

from __future__ import annotations

import copy
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_twins import MESHES, needs_library, without_library

sys.path.insert(0, str(Path(__file__).parents[1]))

from coverage_synthetic import ball, evaluated, sheet  # of the folder above

from hfx_blender.engine.parallel.serialization import packed, unpacked
from hfx_blender.engine.tolerance import STANDARD, parse
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind
from hfx_blender.engine.volume.sweep import passage

pytestmark = needs_library

ROWS = 5
FALLOFFS = {
    "none": Falloff(),
    "smooth": Falloff(FalloffKind.SMOOTH, 0.6),
    "linear to the core": Falloff(FalloffKind.LINEAR, 1.0),
}


def flight(speed_m_s: float, size: float, turning: float) -> np.ndarray:
    """Placing matrices (ROWS, 4, 4) at 100 Hz: through the origin, aslant, stretched."""
    matrices = np.tile(np.eye(4), (ROWS, 1, 1))
    for row in range(ROWS):
        angle = 0.4 + turning * row
        turn = np.eye(3)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        matrices[row, :3, :3] = size * turn @ np.diag([1.0, 0.8, 1.1])
        time_s = (row - ROWS / 2) / 100.0
        matrices[row, :3, 3] = speed_m_s * time_s * np.array([0.3, 0.2, 1.0]) + [0.03, 0, 0.02]
    return matrices


@pytest.mark.parametrize(
    ("name", "falloff", "speed_m_s"),
    [
        ("a torus", "none", 0.5),
        ("a torus", "smooth", 12.0),
        ("rough", "linear to the core", 0.5),
        ("rough", "none", 12.0),
        ("overlaps", "smooth", 0.5),
        ("open", "linear to the core", 12.0),
    ],
)
def test_skin_feels_the_same(name: str, falloff: str, speed_m_s: float) -> None:
    vertices, triangles = MESHES[name]
    body = sheet(12) if speed_m_s > 1.0 else ball(0.08, 2)
    matrices = flight(speed_m_s, 0.06, 0.05)
    tolerance = STANDARD if speed_m_s > 1.0 else parse("3mm,10ms,1%")
    found = []
    for is_plain in (False, True):
        with without_library() if is_plain else pytest.MonkeyPatch.context():
            shape = MeshVolume(vertices, triangles, name)
            weights, _, _ = evaluated(
                body, shape, matrices, falloff=FALLOFFS[falloff], tolerance=tolerance
            )
        found.append(weights)
    compiled, plain = found
    assert np.count_nonzero(plain) > 10
    np.testing.assert_array_equal(compiled > 0.0, plain > 0.0)
    np.testing.assert_allclose(compiled, plain, rtol=1e-6, atol=1e-7)


def test_a_mesh_that_was_asked_is_handed_over_as_one_that_was_not() -> None:
    """Pointers prepared for the library are valid in this process only, and are not pickled."""
    shape, points = MeshVolume(*MESHES["rough"], "rough"), np.zeros((3, 2))
    untouched = packed(shape)
    assert shape.contains(points).all() and shape.rise(points).all()
    assert shape.clearance(points).all() and shape.bounds.any()
    assert packed(shape) == untouched
    there = unpacked(untouched)
    np.testing.assert_array_equal(there.rise(points), shape.rise(points))
    assert copy.deepcopy(shape).contains(points).all()


def test_a_cap_over_a_hole_is_surface_to_what_flies_through_it() -> None:
    """A tunnel open at both ends is closed: what passes through both caps was inside."""
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    ring = np.stack([0.2 * np.cos(turns), 0.2 * np.sin(turns), np.full(24, -1.0)], axis=1)
    vertices = np.concatenate([ring, ring * [1, 1, -1]])
    a = np.arange(24)
    b = (a + 1) % 24
    triangles = np.concatenate([np.stack([a, b, b + 24], 1), np.stack([a, b + 24, a + 24], 1)])
    starts, ends = np.array([[0.01], [0.02], [-3.0]]), np.array([[0.01], [0.02], [3.0]])
    for is_plain in (False, True):
        with without_library() if is_plain else pytest.MonkeyPatch.context():
            tunnel = MeshVolume(vertices, triangles.astype(np.int32), "Tunnel")
            assert "2 holes were" in tunnel.note
            first, last = passage(tunnel, starts, ends)
        np.testing.assert_allclose([first[0], last[0]], [1 / 3, 2 / 3], rtol=1e-12)
