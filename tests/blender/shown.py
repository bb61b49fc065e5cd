# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic volumes as shown by Blender at a time, with instances, by separate exact formulas."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import bpy
import igl
import numpy as np
import oracle


def inside(graph: Any, modality: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points, (V, 3), inside spheres and meshes of a modality; and points clear of all volumes."""
    inside, clear = np.zeros(len(points), bool), np.ones(len(points), bool)
    for instance in graph.object_instances:
        shown = instance.object
        hfx = shown.hfx
        if hfx.role != "EFFECT" or hfx.kind != "VOLUME" or hfx.modality != modality:
            continue
        matrix = np.array([row[:] for row in instance.matrix_world])
        if hfx.shape == "SPHERE":
            local = (points - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
            away = np.linalg.norm(local, axis=1) - hfx.radius
            inside |= away <= 0
            clear &= np.abs(away) * np.abs(matrix[:3, :3]).max() > oracle.BOUNDARY_M
        else:
            held, away = _in_mesh(shown.data, matrix, points)
            inside |= held
            clear &= away > oracle.BOUNDARY_M
    return inside, clear


def _in_mesh(mesh: Any, matrix: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mesh.calc_loop_triangles()
    corners = np.array([v.co[:] for v in mesh.vertices]) @ matrix[:3, :3].T + matrix[:3, 3]
    faces = np.array([t.vertices[:] for t in mesh.loop_triangles], np.int64)
    held = np.rint(np.abs(igl.winding_number(corners, faces, points))) > 0
    return held, np.sqrt(igl.point_mesh_squared_distance(points, corners, faces)[0])


def assert_felt(
    scene: Any, rate_hz: int, *, every: int = 3, tolerance: Any = None, least: int = 100
) -> Any:
    """Assert vibrations exactly at Blender's shown volumes; return the evaluated objects."""
    actual = oracle.evaluate(scene, rate_hz=rate_hz, tolerance=tolerance or oracle.PAPER)
    body = next(obj for obj in scene.objects if obj.hfx.role == "BODY")
    model = oracle.model_object(scene, body, "vibration")
    total = 0
    for index in range(0, actual.reader.time.sample_count, every):
        oracle.set_time(scene, Fraction(actual.reader.time.frame(index)))
        graph = bpy.context.evaluated_depsgraph_get()
        held, clear = inside(graph, "vibration", oracle.world_vertices(scene, model))
        expected = np.zeros(len(held), bool)
        for samples in actual.samples.values():
            if index in samples:
                expected[samples[index].vertices] = True
        false, missed = expected & ~held & clear, held & ~expected & clear
        assert not false.any() and not missed.any(), (index, false.sum(), missed.sum())
        total += int(held.sum())
    assert total >= least
    bpy.data.objects.remove(model)
    return actual
