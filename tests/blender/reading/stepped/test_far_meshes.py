# SPDX-License-Identifier: GPL-3.0-or-later
"""Of a deforming mesh volume far from all skin only the bounding box is read."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfx_blender.authoring.effects.effect_values import ShapeCache
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped.stepped_volumes import FarVolumes, swept_boxes

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")


@pytest.fixture
def blob(scene: Any) -> Any:
    """A deforming mesh volume 20 m away from a body, in a scene of 24 frames."""
    scene.frame_start, scene.frame_end = 1, 24
    oracle.add_avatar()
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=0.3)
    source = bpy.context.object
    effect = oracle.add_mesh_volume("Blob", "vibration", source)
    effect.parent = None
    effect.location = (20.0, 0.0, 1.2)
    bpy.data.objects.remove(source)
    modifier = effect.modifiers.new("Bend", "SIMPLE_DEFORM")
    modifier.deform_method = "BEND"
    oracle.key(effect, f'modifiers["{modifier.name}"].angle', [(1, 0.0), (24, 1.0)])
    return effect


def test_no_mesh_is_made_far_away(scene: Any, blob: Any, made: list[str]) -> None:
    evaluation = oracle.evaluate(scene, rate_hz=48)
    assert made == []
    assert evaluation.samples == {}
    assert evaluation.reader.counters.times_stepped > evaluation.reader.time.sample_count


@pytest.mark.parametrize(
    "keys",
    [
        [(1, 20.0), (12, 0.0), (24, 20.0)],
        [(1, 0.0), (8, 20.0), (16, 20.0), (24, 0.0)],
        [(1, 20.0), (11, 20.0), (12, 0.0), (13, -20.0), (24, -20.0)],
    ],
    ids=["comes by", "goes and comes", "passes fast"],
)
def test_what_comes_near_is_felt_as_if_all_was_read(
    scene: Any, blob: Any, made: list[str], monkeypatch: pytest.MonkeyPatch, keys: Any
) -> None:
    oracle.key(blob, "location", [(frame, (x, 0.0, 1.2)) for frame, x in keys])
    rate_hz = 200  # several blocks

    def felt() -> dict[int, tuple[list[int], list[float]]]:
        evaluation = oracle.evaluate(scene, rate_hz=rate_hz, tolerance=STANDARD)
        samples = evaluation.samples["Blob"].items()
        return {k: (s.vertices.tolist(), s.weights.tolist()) for k, s in samples}

    lazy, examples = felt(), len(made)
    always = np.ones(1, np.bool_)
    monkeypatch.setattr(FarVolumes, "are_near", lambda self, places, poses: always)
    assert lazy == felt()
    assert 0 < examples < len(made) - examples


def test_the_box_is_around_the_evaluated_mesh(scene: Any, blob: Any) -> None:
    scene.frame_set(24)
    evaluated = blob.evaluated_get(bpy.context.evaluated_depsgraph_get())
    shapes = ShapeCache()
    box, mesh = shapes.box_of(blob, evaluated), shapes.shape_of(blob, evaluated)
    assert box is not None
    assert np.abs(box.bounds - mesh.bounds).max() < 1e-6
    # The mesh is bent.
    assert np.ptp(mesh.bounds, axis=0) != pytest.approx([0.6, 0.6, 0.6], abs=0.01)


def test_shapes_that_are_asked_for_are_read(scene: Any, blob: Any, made: list[str]) -> None:
    """A picture of the scene shows also volumes without contact."""
    reader = SceneReader(scene, with_far=True)
    shapes = [shape for block in reader.blocks() for shape in block.effects[0].shapes]
    assert shapes and made
    assert all(len(shape.vertices) > 8 for shape in shapes)


def test_a_mesh_without_an_inside_is_told_where_it_matters(scene: Any, blob: Any) -> None:
    """Open at the end of the animation, near the skin."""
    build = blob.modifiers.new("Open", "MASK")
    group = blob.vertex_groups.new(name="Half")
    half = [vertex.index for vertex in blob.data.vertices if vertex.co.z > 0.0]
    group.add(half, 1.0, "REPLACE")
    build.vertex_group = "Half"
    oracle.key(blob, "location", [(1, (20.0, 0.0, 1.2)), (24, (0.0, 0.0, 1.2))])
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert any("'Blob'" in text for text in evaluation.reader.faults)
    assert evaluation.samples == {}


def test_turns_while_it_is_hidden_make_no_box_larger() -> None:
    """A cube of 2 m, 5 m away; with turning, the bounding sphere of the corners counts."""
    matrices = np.tile(np.eye(4), (3, 2, 1, 1))
    matrices[..., 0, 3] = 5.0
    matrices[1, :, :2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    bounds = np.tile([[-1.0] * 3, [1.0] * 3], (3, 2, 1, 1))
    there = np.array([[True, True], [False, True], [True, True]])
    low, high = swept_boxes(matrices, bounds, there)
    assert low[0] == pytest.approx([4.0, -1.0, -1.0], abs=1e-4)
    assert high[0] == pytest.approx([6.0, 1.0, 1.0], abs=1e-4)
    assert low[1, 0] < 5.0 - 3.0**0.5 and high[1, 0] > 5.0 + 3.0**0.5
