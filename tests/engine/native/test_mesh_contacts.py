# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh volumes sent to other processes, and caps over holes."""

from __future__ import annotations

import copy
import pickle

import numpy as np
from mesh_twins import MESHES, needs_library

from hfx_blender.engine.reference import sweep as reference
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_tools.bench.volumes import clearances, passages

pytestmark = needs_library


def test_a_mesh_that_was_asked_is_handed_over_as_one_that_was_not() -> None:
    """Pointers prepared for the library are valid in this process only, and are not pickled."""
    shape, points = MeshVolume(*MESHES["rough"], "rough"), np.zeros((3, 2))
    untouched = pickle.dumps(shape)
    assert shape.contains(points).all() and shape.core_radius
    assert clearances(shape, points).all() and shape.bounds.any()
    assert pickle.dumps(shape) == untouched
    there = pickle.loads(untouched)
    assert there.core_radius == shape.core_radius
    assert copy.deepcopy(shape).contains(points).all()


def test_a_cap_over_a_hole_is_part_of_the_surface() -> None:
    """A tunnel open at both ends is closed: an object passing both caps was inside."""
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    ring = np.stack([0.2 * np.cos(turns), 0.2 * np.sin(turns), np.full(24, -1.0)], axis=1)
    vertices = np.concatenate([ring, ring * [1, 1, -1]])
    a = np.arange(24)
    b = (a + 1) % 24
    triangles = np.concatenate([np.stack([a, b, b + 24], 1), np.stack([a, b + 24, a + 24], 1)])
    starts, ends = path = np.array([[[0.01], [0.02], [-3.0]], [[0.01], [0.02], [3.0]]])
    tunnel = MeshVolume(vertices, triangles.astype(np.int32), "Tunnel")
    assert "2 holes were" in tunnel.note
    for actual in (passages(tunnel, starts, ends), reference.passage(tunnel, path)):
        np.testing.assert_allclose(np.ravel(actual), [1 / 3, 2 / 3], rtol=1e-12)
