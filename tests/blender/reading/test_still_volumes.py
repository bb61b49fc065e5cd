# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes that nothing moves: placed in bulk, read in full near skin only."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.engine.scene import AnimationBlock
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.curves.curve_reading import CurveEffect
from hfx_blender.reading.scene_reader import SceneReader

bpy = pytest.importorskip("bpy")
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


def _still_names(reader: SceneReader) -> set[str]:
    return {reader.description.effects[k].name for k in reader.plan.still_numbers}


def _only_block(reader: SceneReader) -> AnimationBlock:
    (block,) = reader.blocks()
    return block


def _keyed(ball: Any) -> None:
    oracle.key(ball, "location", [(1, FAR), (12, NEAR)])


def _driven(ball: Any) -> None:
    ball.driver_add("location", 0).driver.expression = "frame"


def _constrained(ball: Any) -> None:
    ball.constraints.new("COPY_LOCATION").target = oracle.empty(bpy.context.scene)


def _under_keyed_parent(ball: Any) -> None:
    top = oracle.empty(bpy.context.scene, "Top")
    ball.parent = oracle.empty(bpy.context.scene, "Middle", top)
    _keyed(top)


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
    [_keyed, _driven, _constrained, _under_keyed_parent, _on_a_path, _flattened, _answering],
)
def test_a_volume_that_may_move_or_answer_is_not_still(
    crowd: Any, change: Callable[[Any], None]
) -> None:
    change(crowd)
    names = _still_names(SceneReader(bpy.context.scene))
    assert len(names) == 39 and crowd.name not in names


def test_few_far_volumes_are_read_without_boxes_of_skin(crowd: Any) -> None:
    for obj in [obj for obj in bpy.data.objects if obj.name.startswith("Ball.")][:9]:
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
    assert len(_still_names(reader)) == 40 and len(read) == 1
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
