# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that are not numbers: refused where they stand in the file, silent where they arise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hfx_blender import compat
from hfx_blender.errors import InputError

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")


@pytest.fixture
def ball(scene: Any) -> Any:
    """A ball around the belly of an avatar; twelve frames."""
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_avatar()
    return oracle.add_volume("Ball", "temperature", "SPHERE", (0.0, 0.0, 1.1), radius=0.4)


@pytest.fixture
def nowhere(scene: Any) -> Any:
    """An object without a place, size or turn before frame 6, and at the origin from then on."""
    obj = oracle.empty(scene, "Nowhere")
    for path, value in (("location", 0.0), ("scale", 1.0), ("rotation_euler", 0.0)):
        oracle.key(obj, path, [(frame, (value,) * 3) for frame in (1, 6, 12)])
    for curve in compat.fcurves(obj):
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
        curve.keyframe_points[0].co = (1, math.nan)
    return obj


@pytest.mark.parametrize("what", ["COPY_LOCATION", "COPY_SCALE", "COPY_TRANSFORMS"])
def test_a_matrix_that_is_not_a_number(scene: Any, ball: Any, nowhere: Any, what: str) -> None:
    ball.constraints.new(what).target = nowhere
    ball.hfx.radius = 1.2  # reaches the body from the origin too
    evaluation = oracle.evaluate(scene, rate_hz=24)
    (block,) = evaluation.reader.blocks()
    sound = np.isfinite(block.effects[0].matrices).all(axis=(1, 2)).tolist()
    assert sound == [False] * 5 + [True] * 7, "the constraint does not do what this is about"
    assert sorted(evaluation.samples["Ball"]) == list(range(5, 12))
    ((message, count),) = evaluation.counters.warnings.items()
    assert "not a number" in message and count == 5


@pytest.mark.parametrize("path", ["hfx.temperature", "hfx.activation", "hfx.intensity"])
def test_a_value_that_is_not_a_number(scene: Any, ball: Any, nowhere: Any, path: str) -> None:
    driver = ball.driver_add(path).driver
    driver.type = "SUM"
    variable = driver.variables.new()
    variable.targets[0].id, variable.targets[0].data_path = nowhere, "scale.x"
    scene.frame_set(1)
    evaluated = ball.evaluated_get(bpy.context.view_layer.depsgraph)
    if math.isfinite(evaluated.path_resolve(path)):
        pytest.skip("this Blender keeps drivers from writing such values")
    evaluation = oracle.evaluate(scene, rate_hz=24)
    samples = evaluation.samples["Ball"]
    assert sorted(samples) == list(range(5, 12))
    assert evaluation.counters.warnings == {
        "effect 'Ball': a value is not a finite number; it is silent there": 5
    }
    for sample in samples.values():
        assert np.isfinite(sample.parameters).all() and 0 < sample.level <= 1


def test_a_body_that_is_nowhere(scene: Any, ball: Any, nowhere: Any) -> None:
    body = bpy.data.objects["Avatar"]
    body.constraints.new("COPY_LOCATION").target = nowhere
    oracle.add_painted("Head", "temperature", body, part="head")
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert sorted(evaluation.samples["Ball"]) == list(range(5, 12))
    assert sorted(evaluation.samples["Head"]) == list(range(12)), "it needs no pose"
    warning = "body 'Avatar': its pose is not a finite number; it feels nothing there"
    assert evaluation.counters.warnings == {warning: 5}
    moving = oracle.evaluate(scene, rate_hz=24, record=("positions", "velocities"))
    assert sorted(moving.samples["Head"]) == list(range(5, 12))
    for samples in moving.samples.values():
        for sample in samples.values():
            assert np.isfinite(sample.positions).all() and np.isfinite(sample.velocities).all()
    assert moving.counters.warnings == {warning: 10}


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0), (0, 1, 1), (1e-20, 1, 1e20)])
def test_a_flat_volume(scene: Any, ball: Any, scale: tuple[float, float, float]) -> None:
    ball.scale = scale
    ball.rotation_euler = (0.3, 0.2, 0.1)
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert evaluation.samples == {}
    if scale != (1e-20, 1, 1e20):  # that one is just very thin and very long
        assert list(evaluation.counters.warnings.values()) == [12]


def test_parameters_are_kept_in_their_ranges(scene: Any, ball: Any) -> None:
    """A driver may write past a property's limits; a device must never see that."""
    source = oracle.empty(scene)
    source["value"] = 1e9
    driver = ball.driver_add("hfx.temperature").driver
    driver.type = "SUM"
    driver.variables.new().targets[0].id = source
    driver.variables[0].targets[0].data_path = '["value"]'
    evaluation = oracle.evaluate(scene)
    for sample in evaluation.samples["Ball"].values():
        assert sample.parameters.tolist() == [60.0]


def test_a_body_that_is_scaled_to_nothing(scene: Any, ball: Any) -> None:
    body = bpy.data.objects["Avatar"]
    oracle.key(body, "scale", [(1, (1, 1, 1)), (6, (0, 0, 0))])
    for curve in compat.fcurves(body):
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert sorted(evaluation.samples["Ball"]) == list(range(5))
    ((message, count),) = evaluation.counters.warnings.items()
    assert "'Avatar'" in message and "scaled to nothing" in message and count == 7


def test_a_flat_volume_is_named(scene: Any, ball: Any) -> None:
    ball.scale = (1, 1, 0)
    [message] = oracle.evaluate(scene, rate_hz=24).counters.warnings
    assert message.startswith("effect 'Ball' is flattened")


# Keys


def _break_a_key(curve: Any, value: float = math.nan) -> None:
    point = curve.keyframe_points[1]
    point.co = (point.co[0], value)


def test_a_key_that_is_not_a_number(scene: Any, ball: Any) -> None:
    oracle.key(ball, "hfx.temperature", [(1, 20.0), (6, 30.0), (12, 40.0)])
    _break_a_key(compat.fcurves(ball)[0])
    with pytest.raises(InputError, match=r"^'Ball': key 2 .*'hfx\.temperature'.*finite"):
        oracle.evaluate(scene)


def test_a_clip_with_such_a_key(scene: Any, ball: Any) -> None:
    strip = oracle.add_clip(ball, 2, 10)
    _break_a_key(compat.strip_fcurves(strip)[0])
    with pytest.raises(InputError, match=r"^'Ball': key 2 .*'hfx\.activation'.*finite"):
        oracle.evaluate(scene)


def test_a_body_with_such_a_key(scene: Any, ball: Any) -> None:
    body = bpy.data.objects["Avatar"]
    oracle.key(body, "location", [(1, (0, 0, 0)), (6, (0, 0, 1))])
    _break_a_key(compat.fcurves(body)[2], -math.inf)
    with pytest.raises(InputError, match=r"^'Avatar': key 2 .*'location' \[2\].*finite"):
        oracle.evaluate(scene)


def test_a_parent_with_such_a_key(scene: Any, ball: Any) -> None:
    """Keys of an effect's or a body's parents count as its own."""
    carrier = oracle.empty(scene, "Carrier")
    ball.parent = oracle.empty(scene, "Arm", parent=carrier)
    oracle.key(carrier, "location", [(1, (0, 0, 0)), (6, (0, 0, 1))])
    _break_a_key(compat.fcurves(carrier)[0])
    with pytest.raises(InputError, match=r"^'Carrier': key 2 .*'location' \[0\].*finite"):
        oracle.evaluate(scene)


def test_effects_whose_parent_has_a_key_that_is_no_number_are_each_left_out(
    scene: Any, ball: Any, nowhere: Any
) -> None:
    others = [
        oracle.add_volume(name, "pressure", "SPHERE", (0.0, 0.0, 1.1), radius=0.4)
        for name in ("One", "Other")
    ]
    for other in others:
        other.parent = nowhere
    for curve in compat.fcurves(nowhere):
        curve.keyframe_points[0].co = (1, 0.0)
    curve = compat.fcurves(nowhere)[4]
    curve.keyframe_points[1].co = (6, math.inf)
    reader = oracle.evaluate(scene, rate_hz=24).reader
    assert [effect.name for effect in reader.description.effects] == ["Ball"]
    why = f"'Nowhere': key 2 of the F-curve '{curve.data_path}' [{curve.array_index}] is not a"
    left = [text for text in reader.description.warnings if why in text]
    assert [text.partition(" was left out")[0] for text in left] == [
        "effect 'One'",
        "effect 'Other'",
    ]
