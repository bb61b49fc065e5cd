# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes within a known box: placed in bulk, read in full near skin only."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.engine.counters import ReadingCounters, as_reported
from hfx_blender.engine.scene import AnimationBlock
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.curves.curve_reading import CurveEffect
from hfx_blender.reading.scene_reader import SceneReader

bpy = pytest.importorskip("bpy")
Vector = pytest.importorskip("mathutils").Vector
oracle = pytest.importorskip("oracle")

NEAR, FAR = (0.0, 0.0, 1.2), (20.0, 0.0, 1.2)


@pytest.fixture
def crowd(scene: Any) -> Any:
    """A body and 40 balls far away, for 12 frames; returns the first ball."""
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    first = oracle.add_volume("Ball", "pressure", "SPHERE", FAR, radius=0.2)
    for k in range(39):
        ball = first.copy()
        ball.hfx.uid = ""
        ball.location = (20.0 + k, 5.0, 1.2)
        scene.collection.objects.link(ball)
    return first


def _bounded_names(reader: SceneReader) -> set[str]:
    return {reader.description.effects[k].name for k in reader.plan.bounded_numbers}


def _balls() -> list[Any]:
    return [obj for obj in bpy.data.objects if obj.name.startswith("Ball")]


def _only_block(reader: SceneReader) -> AnimationBlock:
    (block,) = reader.blocks()
    return block


def _keyed_to_skin(ball: Any) -> None:
    oracle.key(ball, "location", [(1, FAR), (12, NEAR)])


def _driven(ball: Any) -> None:
    ball.driver_add("location", 0).driver.expression = "frame"


def _constrained(ball: Any) -> None:
    ball.constraints.new("COPY_LOCATION").target = oracle.empty(bpy.context.scene)


def _under_keyed_parent(ball: Any) -> None:
    top = oracle.empty(bpy.context.scene, "Top")
    ball.parent = oracle.empty(bpy.context.scene, "Middle", top)
    _keyed_to_skin(top)


def _on_a_path(ball: Any) -> None:
    curve = bpy.data.curves.new("Path", "CURVE")
    curve.dimensions, curve.use_path = "3D", True
    curve.splines.new("POLY").points.add(1)
    curve.splines[0].points[1].co = (0.0, 0.0, 3.0, 1.0)
    ball.parent = bpy.data.objects.new("Path", curve)
    bpy.context.scene.collection.objects.link(ball.parent)


def _flattened(ball: Any) -> None:
    ball.scale = (1.0, 0.0, 1.0)


def _answering(ball: Any) -> None:
    ball.hfx.response.add()


@pytest.mark.parametrize(
    "change",
    [
        _keyed_to_skin,
        _driven,
        _constrained,
        _under_keyed_parent,
        _on_a_path,
        _flattened,
        _answering,
    ],
)
def test_a_volume_that_may_move_or_answer_is_not_bounded(
    crowd: Any, change: Callable[[Any], None]
) -> None:
    change(crowd)
    names = _bounded_names(SceneReader(bpy.context.scene))
    assert len(names) == 39 and crowd.name not in names


@pytest.fixture
def keyed_crowd(crowd: Any) -> Any:
    """Key the balls of ``crowd`` and 40 copies of the first ball at two frames; return a ball that
    is bounded by its keys."""
    for _ in range(40):
        ball = crowd.copy()
        ball.hfx.uid = ""
        bpy.context.scene.collection.objects.link(ball)
    for ball in _balls():
        x, y, z = ball.location
        oracle.key(ball, "location", [(1, (x, y, z)), (12, (x, y + 3.0, z))])
    return bpy.data.objects["Ball.001"]


def _cyclic(ball: Any) -> None:
    compat.fcurves(ball)[0].modifiers.new("CYCLES")


def _noisy(ball: Any) -> None:
    compat.fcurves(ball)[1].modifiers.new("NOISE")


def _extrapolated(ball: Any) -> None:
    compat.fcurves(ball)[0].extrapolation = "LINEAR"


def _elastic(ball: Any) -> None:
    compat.fcurves(ball)[0].keyframe_points[0].interpolation = "ELASTIC"


def _bouncing(ball: Any) -> None:
    compat.fcurves(ball)[2].keyframe_points[0].interpolation = "BOUNCE"


def _swinging_back(ball: Any) -> None:
    compat.fcurves(ball)[2].keyframe_points[0].interpolation = "BACK"


def _without_number(ball: Any) -> None:
    compat.fcurves(ball)[0].keyframe_points[1].co[1] = float("nan")


def _out_of_order(ball: Any) -> None:
    compat.fcurves(ball)[0].keyframe_points[0].co[0] = 20.0


def _in_strips(ball: Any) -> None:
    data = ball.animation_data
    data.nla_tracks.new().strips.new("Strip", 1, data.action)


def _under_a_parent(ball: Any) -> None:
    ball.parent = oracle.empty(bpy.context.scene, "Top")


def _through_no_size(ball: Any) -> None:
    oracle.key(ball, "scale", [(1, (1.0, 1.0, 1.0)), (12, (1.0, -1.0, 1.0))])


def _faded(ball: Any) -> None:
    oracle.key(ball, "hfx.intensity", [(1, 1.0), (12, 0.5)])


def _growing(ball: Any) -> None:
    oracle.key(ball, "hfx.radius", [(1, 0.2), (12, 30.0)])


def _blinking(ball: Any) -> None:
    oracle.key(ball, "hide_viewport", [(1, False), (12, True)])


@pytest.mark.parametrize(
    "change",
    [
        *(_cyclic, _noisy, _extrapolated, _elastic, _bouncing, _swinging_back, _without_number),
        *(_in_strips, _driven, _constrained, _under_a_parent, _through_no_size, _faded, _growing),
        *(_out_of_order, _blinking, _answering),
    ],
)
def test_a_keyed_volume_of_unknown_reach_is_not_bounded(
    keyed_crowd: Any, change: Callable[[Any], None]
) -> None:
    assert keyed_crowd.name in _bounded_names(SceneReader(bpy.context.scene))
    change(keyed_crowd)
    assert keyed_crowd.name not in _bounded_names(SceneReader(bpy.context.scene))


def test_some_keyed_volumes_are_compared_with_blender(keyed_crowd: Any) -> None:
    reader = SceneReader(bpy.context.scene)
    assert len(reader.plan.effects) >= 16
    assert len(_bounded_names(reader)) + len(reader.plan.effects) == 80


def test_no_corner_leaves_the_box_of_the_keys(scene: Any) -> None:
    """Boxes of cuboids with random keys and handles hold all corners that Blender's own matrices
    give at many fractions of frames."""
    rng = np.random.default_rng(7)
    oracle.add_avatar()
    for k in range(64):
        size = rng.uniform(0.1, 2.0, 3)
        cuboid = oracle.add_volume(f"Cuboid {k}", "pressure", "CUBOID", (50.0, 0.0, 0.0), size=size)
        cuboid.delta_location, cuboid.delta_scale = rng.normal(size=3), rng.uniform(0.5, 2.0, 3)
        frames = np.sort(rng.uniform(-5.0, 40.0, rng.integers(1, 6))).tolist()
        oracle.key(cuboid, "location", [(f, rng.normal(0.0, 5.0, 3)) for f in frames])
        oracle.key(cuboid, "rotation_euler", [(f, rng.normal(0.0, 3.0, 3)) for f in frames])
        if k % 2:
            oracle.key(cuboid, "scale", [(f, rng.uniform(1.0, 3.0, 3)) for f in frames])
        for curve in compat.fcurves(cuboid):
            for point in curve.keyframe_points:
                point.interpolation = str(rng.choice(["CONSTANT", "LINEAR", "BEZIER", "BEZIER"]))
                point.handle_left_type = point.handle_right_type = "FREE"
                reach = 0.3 if curve.data_path == "scale" else 6.0
                point.handle_left = point.co + Vector((-rng.uniform(0, 60), rng.normal(0, reach)))
                point.handle_right = point.co + Vector((rng.uniform(0, 60), rng.normal(0, reach)))
    reader = SceneReader(scene)
    assert reader.plan.bounded is not None
    places, numbers = reader.plan.bounded._places, reader.plan.bounded.numbers
    boxes = places.boxes[0][places.there[0]]
    assert len(numbers) > 20, "else the random scales go through 0"
    corners = np.array([*itertools.product((-0.5, 0.5), repeat=3)])
    widest = np.zeros((len(numbers), 3))
    for frame in np.arange(-10.0, 50.0, 0.37):
        scene.frame_set(int(frame // 1), subframe=frame % 1.0)
        for k, number in enumerate(numbers):
            obj = bpy.data.objects[reader.description.effects[number].name]
            matrix = np.array(obj.evaluated_get(bpy.context.view_layer.depsgraph).matrix_world)
            world = corners * obj.hfx.size @ matrix[:3, :3].T + matrix[:3, 3]
            assert (boxes[k, 0] - 1e-4 <= world).all() and (world <= boxes[k, 1] + 1e-4).all()
            widest[k] = np.maximum(widest[k], np.abs(world - boxes[k].mean(axis=0)).max(axis=0))
    share = widest / (0.5 * (boxes[:, 1] - boxes[:, 0]))
    assert np.median(share) > 0.5, "the boxes are not needlessly large"


def test_keyed_volumes_near_skin_are_read_as_all_are(keyed_crowd: Any) -> None:
    for number, ball in enumerate(_balls()[1:12]):
        oracle.key(ball, "location", [(1, (2.0 + number, 0.0, 1.2)), (12, NEAR)])
    reader = SceneReader(bpy.context.scene)
    block, whole = _only_block(reader), _only_block(SceneReader(bpy.context.scene, with_far=True))
    bounded = {*reader.plan.bounded_numbers}
    near = {k for k in bounded if block.effects[k].matrices is not None}
    assert 3 <= len(near) < len(bounded)
    for k, (effect, read) in enumerate(zip(block.effects, whole.effects, strict=True)):
        if k in near or k not in bounded:
            np.testing.assert_array_equal(effect.matrices, read.matrices)
            np.testing.assert_array_equal(effect.levels, read.levels)
        else:
            assert not effect.levels.any() and effect.matrices is None


def test_few_far_volumes_are_read_without_boxes_of_skin(crowd: Any) -> None:
    for obj in _balls()[1:10]:
        bpy.data.objects.remove(obj)
    block = _only_block(SceneReader(bpy.context.scene))
    assert all(effect.matrices is not None for effect in block.effects)


def test_only_volumes_near_skin_are_read(crowd: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    crowd.parent = oracle.empty(bpy.context.scene, "Top")
    crowd.parent.location, crowd.parent.scale = (0.0, 0.0, 1.0), (2.0, 1.0, 0.5)
    crowd.location = (0.1, 0.0, 0.4)
    read: list[CurveEffect] = []
    whole = CurveEffect.read
    monkeypatch.setattr(CurveEffect, "read", lambda s, f: read.append(s) or whole(s, f))
    reader = SceneReader(bpy.context.scene)
    block = _only_block(reader)
    assert len(_bounded_names(reader)) == 40 and len(read) == 1
    blocks = {e.name: b for e, b in zip(reader.description.effects, block.effects, strict=True)}
    # Top's scale times the radius; the place is Top's plus the scaled place of the ball.
    placed = np.diag([0.4, 0.2, 0.1, 1.0])
    placed[:3, 3] = 0.2, 0.0, 1.2
    near = blocks.pop("Ball")
    assert near.matrices is not None and len(near.matrices) == len(block.indices)
    np.testing.assert_allclose(near.matrices, placed[None].repeat(len(block.indices), 0), atol=1e-7)
    assert (near.levels == 1.0).all()
    assert all(not far.levels.any() and far.matrices is None for far in blocks.values())


def test_a_file_of_the_scene_has_far_places(crowd: Any) -> None:
    block = _only_block(SceneReader(bpy.context.scene, with_far=True))
    matrices = [effect.matrices for effect in block.effects]
    places = [round(float(m[0, 0, 3])) for m in matrices if m is not None]
    assert sorted(places) == [20, *range(20, 59)]


def test_a_body_that_walks_to_still_volumes_feels_them(crowd: Any, tmp_path: Path) -> None:
    body = bpy.data.objects["Avatar"]
    oracle.key(
        body, "location", [(1, (0.0, 0.0, 0.0)), (6, (0.0, 0.0, 0.0)), (12, (*FAR[:2], 0.0))]
    )
    for curve in compat.fcurves(body):
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
    settings = ExportSettings(rate_hz=Fraction(24))
    report = export_scene(bpy.context.scene, tmp_path, "s", settings)
    felt = {line["effect"]: line for line in report.effects}
    assert felt["Ball"]["felt"] and felt["Ball"]["from_s"] == pytest.approx(11 / 24)
    far = [line for name, line in felt.items() if name != "Ball"]
    assert {line["reason"] for line in far if not line["felt"]} == {"touches no body"}


def test_the_report_counts_what_no_skin_reaches(crowd: Any, tmp_path: Path) -> None:
    """39 of 40 volumes are out of reach at 12 frames, and none for a format with all volumes."""
    crowd.location = NEAR
    settings = ExportSettings(rate_hz=Fraction(24))
    report = export_scene(bpy.context.scene, tmp_path, "s", settings)
    assert report.as_dict()["reading"]["out_of_reach"] == 39 * 12
    every = export_scene(bpy.context.scene, tmp_path, "s", replace(settings, formats=("glb",)))
    assert every.as_dict()["reading"]["out_of_reach"] == 0


def test_parts_of_a_scene_add_up_to_its_volumes_out_of_reach() -> None:
    """Two parts share the block of sample 64; the second part begins with it."""
    whole = ReadingCounters(out_of_reach={"0": 64, "64": 10})
    whole.add(ReadingCounters(out_of_reach={"64": 10, "128": 5}))
    assert as_reported(whole.as_dict())["out_of_reach"] == 79
