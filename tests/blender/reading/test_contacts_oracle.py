# SPDX-License-Identifier: GPL-3.0-or-later
"""Contact sets, vertex for vertex, against Blender's own deformation and exact formulas."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.reference.pose import world_points
from hfx_blender.engine.tolerance import STANDARD

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

FRAMES = (1, 30)
RATE_HZ = 7  # with 24 frames a second nearly every sample is at a sub-frame
SHAPES = ("CUBOID", "SPHERE", "CYLINDER", "CAPSULE", "TORUS", "BLOB")
MODALITIES = ("vibration", "pressure", "temperature", "wind")
PERCEIVED_ON = {"wind": "pressure"}
FALLOFFS = (("none", 1.0), ("linear", 1.0), ("smooth", 0.4), ("none", 1.0))


def _stretched(scene: Any, effect: Any, _body: Any) -> None:
    effect.rotation_euler = (0.4, -0.7, 1.1)
    effect.scale = (1.6, 0.5, 1.1)


def _sheared(scene: Any, effect: Any, _body: Any) -> None:
    effect.parent = oracle.empty(scene)
    effect.parent.scale = (1.8, 0.6, 1.0)
    effect.parent.rotation_euler = (0.0, 0.3, 0.5)
    bpy.context.view_layer.update()
    effect.matrix_parent_inverse.identity()
    effect.location = effect.parent.matrix_world.inverted() @ effect.location
    effect.rotation_euler = (0.6, 0.5, 0.9)


def _mirrored(scene: Any, effect: Any, _body: Any) -> None:
    effect.rotation_euler = (0.2, 1.0, -0.5)
    effect.scale = (-1.2, 0.8, 1.3)


def _keyed(scene: Any, effect: Any, _body: Any) -> None:
    start, shift = np.array(effect.location), np.array([0.2, 0.1, 0.15])
    oracle.key(effect, "location", [(1, start - [0.15, 0, 0.2]), (30, start + shift)])
    oracle.key(effect, "rotation_euler", [(1, (0, 0, 0)), (30, (2.0, 1.0, -1.5))])
    oracle.key(effect, "scale", [(1, (0.6, 1.0, 1.2)), (30, (1.3, 0.7, -0.9))])


def _parented(scene: Any, effect: Any, body: Any) -> None:
    """A chain: world, a turning empty, a stretched empty, the effect."""
    outer = oracle.empty(scene)
    oracle.key(outer, "rotation_euler", [(1, (0, 0, 0)), (30, (0, 0, 0.8))])
    inner = oracle.empty(scene, parent=outer)
    inner.scale = (0.9, 1.2, 1.0)
    inner.rotation_euler = (0.1, 0.2, 0.0)
    effect.parent = inner
    effect.location = (0.05, -0.3, 1.2)
    effect.scale = (1.5, 1.5, 1.5)


def _on_a_bone(scene: Any, effect: Any, body: Any) -> None:
    effect.parent = body
    effect.parent_type = "BONE"
    effect.parent_bone = "lowerarm01.L" if "lowerarm01.L" in body.data.bones else "spine03"
    effect.location = (0.0, 0.0, 0.0)
    effect.scale = (0.5, 0.7, 0.6)


TRANSFORMS: dict[str, Callable[[Any, Any, Any], None]] = {
    "stretched": _stretched,
    "sheared": _sheared,
    "mirrored": _mirrored,
    "keyed": _keyed,
    "parented": _parented,
    "on_a_bone": _on_a_bone,
}


def _mesh(scene: Any, shape: str, location: tuple[float, float, float]) -> Any:
    """A closed mesh, not convex: a torus with a hole, or a sphere with moving dents."""
    if shape == "TORUS":
        bpy.ops.mesh.primitive_torus_add(
            major_radius=0.3, minor_radius=0.12, major_segments=24, minor_segments=9
        )
    else:
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=0.35)
        mesh = bpy.context.object.data
        for vertex in mesh.vertices:
            vertex.co *= 1.0 + 0.35 * np.sin(9 * vertex.co.x) * np.cos(8 * vertex.co.z)
    source = bpy.context.object
    source.location = location
    source.rotation_euler = (0.3, 0.2, 0.1)
    return source


def _add(scene: Any, name: str, shape: str, modality: str, at: tuple[float, float, float]) -> Any:
    if shape in ("TORUS", "BLOB"):
        effect = oracle.add_mesh_volume(name, modality, _mesh(scene, shape, at))
        effect.parent, effect.location = None, at
        if shape == "BLOB":
            wave = effect.modifiers.new("Twist", "SIMPLE_DEFORM")
            wave.deform_method = "TWIST"
            oracle.key(effect, 'modifiers["Twist"].angle', [(1, -1.0), (30, 1.5)])
        return effect
    settings = {
        "CUBOID": {"size": (0.5, 0.7, 0.4)},
        "SPHERE": {"radius": 0.35},
        "CYLINDER": {"radius": 0.25, "height": 0.6},
        "CAPSULE": {"radius": 0.2, "height": 0.8},
    }[shape]
    return oracle.add_volume(name, modality, shape, at, **settings)


PLACES = ((0.1, 0.0, 1.4), (0.3, -0.4, 1.1), (-0.2, -0.5, 0.7), (0.05, -0.3, 0.3), (0.0, -0.6, 1.6))


@pytest.fixture(scope="module")
def evaluated(registered: Any) -> Iterator[tuple[Any, Any, dict[int, dict[str, np.ndarray]]]]:
    """A walking body among volumes of every shape under every transform, evaluated once.

    Yields the scene, the evaluation, and the reference's vertices by sample and modality.
    """
    registered.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = FRAMES
    scene.render.fps = 24
    body = oracle.add_avatar()
    oracle.add_walk(body, [(0.0, 0.0, 0.0), (0.2, -0.9, 0.05)], *FRAMES)
    references = {m: oracle.model_object(scene, body, m) for m in MODALITIES[:3]}
    for i, shape in enumerate(SHAPES):
        for j, transform in enumerate(TRANSFORMS):
            modality = MODALITIES[(i + j) % 4]
            effect = _add(scene, f"{shape} {transform}", shape, modality, PLACES[(2 * i + j) % 5])
            TRANSFORMS[transform](scene, effect, body)
            if shape not in ("TORUS", "BLOB"):
                effect.hfx.falloff, effect.hfx.falloff_share = FALLOFFS[(i + 3 * j) % 4]
    evaluation = oracle.evaluate(scene, rate_hz=RATE_HZ)
    indices = evaluation.reader.sample_indices.tolist()
    assert len(indices) >= 8
    positions = {}
    for index in indices:
        oracle.set_time(scene, evaluation.reader.time.frame(index))
        positions[index] = {
            modality: oracle.world_vertices(scene, obj) for modality, obj in references.items()
        }
    yield scene, evaluation, positions


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize("shape", SHAPES)
def test_contacts_are_those_of_the_reference(evaluated: Any, shape: str, transform: str) -> None:
    scene, evaluation, positions = evaluated
    name = f"{shape} {transform}"
    effect = bpy.data.objects[name]
    modality = PERCEIVED_ON.get(effect.hfx.modality, effect.hfx.modality)
    touched = uncertain = 0
    for index, points in positions.items():
        oracle.set_time(scene, evaluation.reader.time.frame(index))
        verdict = oracle.judge(scene, effect, points[modality])
        weights = np.zeros(len(points[modality]))
        sample = evaluation.of(name, index)
        if sample is not None:
            weights[sample.vertices] = sample.weights
            assert (np.diff(sample.vertices) > 0).all()
            assert (sample.weights > 0).all() and (sample.weights <= 1).all()
        wrong = np.flatnonzero(((weights > 0) != verdict.inside) & verdict.clear)
        assert not len(wrong), (index, wrong[:5], len(wrong))
        if verdict.weights is not None:
            expected = np.where(verdict.inside, verdict.weights, 0.0)
            # A position error of 1e-5 m, over the smallest half width of a volume here.
            assert np.abs(weights - expected)[verdict.clear].max() < 1e-4
        touched += np.count_nonzero(verdict.inside & verdict.clear)
        uncertain += np.count_nonzero(~verdict.clear)
    assert touched > 20 * (1 if modality == "temperature" else 10), "a volume that tests nothing"
    assert uncertain < 0.01 * touched + 5


def test_the_reference_poses_skin_where_blender_does(evaluated: Any) -> None:
    """The definition of a pose, for all vertices, within the precision of float32."""
    _, evaluation, positions = evaluated
    (body,) = evaluation.reader.description.bodies
    for block in evaluation.blocks:
        for row in range(block.history, len(block.indices)):
            for modality, expected in positions[int(block.indices[row])].items():
                model = load_model(f"hfx-{modality}-1")
                points = world_points(model, body.binding, block.poses[0], row)
                assert np.abs(points.T - expected).max() < 1e-6


def test_the_volumes_cut_the_body(evaluated: Any) -> None:
    """Most samples have vertices inside and outside, so that the comparison is meaningful."""
    _, evaluation, positions = evaluated
    sizes = [
        len(sample.vertices) / len(next(iter(positions.values()))[sample.stream.model_id[4:-2]])
        for samples in evaluation.samples.values()
        for sample in samples.values()
    ]
    assert len(sizes) > 0.6 * len(SHAPES) * len(TRANSFORMS) * len(positions)
    assert max(sizes) < 0.8
    assert evaluation.reader.stepping_note.startswith("stepped a scratch scene")


def test_cells_of_skin_feel_whatever_their_vertices_feel(evaluated: Any) -> None:
    """Coverage adds skin around the vertices of the vertex test, and loses no vertex."""
    scene, paper, positions = evaluated
    chosen = {f"{shape} {name}" for shape, name in zip(SHAPES, TRANSFORMS, strict=False)}
    for name in paper.samples:
        bpy.data.objects[name].hfx.is_muted = name not in chosen
    try:
        cells = oracle.evaluate(scene, rate_hz=RATE_HZ, tolerance=STANDARD)
    finally:
        for name in paper.samples:
            bpy.data.objects[name].hfx.is_muted = False
    added = 0
    for name in sorted(chosen & set(paper.samples)):
        samples = paper.samples[name]
        modality = PERCEIVED_ON.get(
            bpy.data.objects[name].hfx.modality, bpy.data.objects[name].hfx.modality
        )
        for index, sample in samples.items():
            weights = np.zeros(len(positions[index][modality]))
            actual = cells.of(name, index)
            assert actual is not None
            weights[actual.vertices] = actual.weights
            assert (weights[actual.vertices] > 0.0).all() and weights.max() <= 1.0
            # Temperature cells are sampled on different vertices; falloff may be weaker than 5 %.
            if modality != "temperature":
                strong = sample.vertices[sample.weights > 0.05]
                assert (weights[strong] > 0.0).all()
            added += len(actual.vertices) - len(sample.vertices)
    assert added > 0
