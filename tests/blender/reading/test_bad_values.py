# SPDX-License-Identifier: GPL-3.0-or-later
"""Values outside of numbers: silent at their time, with correct results at all further times."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hfx_blender.blender import compat
from hfx_blender.reading.description.missed_effects import flattened_warning

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
    assert evaluation.counters.flattened == {"Ball": 5} and not evaluation.counters.warnings


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
    warning = "body 'Avatar': its pose is no usable number; "
    only_painted = "no volume is felt there, painted effects go on"
    assert evaluation.counters.warnings == {warning + only_painted: 5}
    moving = oracle.evaluate(scene, rate_hz=24, record=("positions", "velocities"))
    assert sorted(moving.samples["Head"]) == list(range(5, 12))
    for samples in moving.samples.values():
        for sample in samples.values():
            assert np.isfinite(sample.positions).all() and np.isfinite(sample.velocities).all()
    assert moving.counters.warnings == {warning + "nothing is felt there": 10}


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0), (0, 1, 1), (1e-20, 1, 1e20)])
def test_a_flat_volume(scene: Any, ball: Any, scale: tuple[float, float, float]) -> None:
    ball.scale = scale
    ball.rotation_euler = (0.3, 0.2, 0.1)
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert evaluation.samples == {}
    if scale != (1e-20, 1, 1e20):  # only very thin and very long
        assert evaluation.counters.flattened == {"Ball": 12}


def test_parameters_are_kept_in_their_ranges(scene: Any, ball: Any) -> None:
    """A driver may write past a property's limits; a device never gets such a value."""
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


def test_a_flat_volume_is_named() -> None:
    [message] = flattened_warning({"Ball": 12})
    words = "is flattened, infinite or not a number: it is not felt (12 times)"
    assert message == f"effect 'Ball' {words}"


# Keys


def _break_a_key(curve: Any, value: float = math.nan) -> None:
    point = curve.keyframe_points[1]
    point.co = (point.co[0], value)


def _kept_to_its_key(evaluation: Any, effect: str) -> None:
    """Felt, but for the samples 5 to 10, frames 6 to 11, where a key is no number."""
    assert sorted(evaluation.samples[effect]) == [*range(5), 11]


def _steps(curves: Any) -> None:
    for curve in curves:
        for point in curve.keyframe_points:
            point.interpolation = "CONSTANT"


@pytest.mark.parametrize("path", ["hfx.temperature", "hfx.intensity", "hfx.radius", "scale"])
def test_a_key_that_is_not_a_number(scene: Any, ball: Any, path: str) -> None:
    value = ball.path_resolve(path)
    value = tuple(value) if path == "scale" else value
    oracle.key(ball, path, [(1, value), (6, value), (12, value)])
    _steps(compat.fcurves(ball))
    _break_a_key(compat.fcurves(ball)[0])
    oracle.add_volume("Sound", "pressure", "SPHERE", (0.0, 0.0, 1.1), radius=0.4)
    evaluation = oracle.evaluate(scene, rate_hz=24)
    _kept_to_its_key(evaluation, "Ball")
    assert sorted(evaluation.samples["Sound"]) == [*range(12)]
    counters = evaluation.counters
    assert [*counters.warnings.values(), *counters.flattened.values()] == [6]
    assert evaluation.reader.description.warnings == ()
    (note,) = evaluation.reader.notes
    assert note.startswith(f"'Ball': key 2 of the F-curve '{path}'") and "finite" in note


def test_a_handle_that_is_not_a_number(scene: Any, ball: Any) -> None:
    """As in Blender's own curve: a handle counts between its own key and the next key."""
    oracle.key(ball, "hfx.intensity", [(1, 0.5), (6, 0.5), (9, 0.5), (12, 0.5)])
    curve = compat.fcurves(ball)[0]
    for point in curve.keyframe_points:
        point.interpolation = "BEZIER"
        point.handle_left_type = point.handle_right_type = "FREE"
    curve.keyframe_points[1].handle_right = (7, math.nan)
    right = [k for k in range(12) if math.isfinite(curve.evaluate(1 + k))]
    assert set(right) > {*range(5), 9, 10, 11} and 6 not in right
    assert sorted(oracle.evaluate(scene, rate_hz=24).samples["Ball"]) == right


def test_a_clip_with_such_a_key(scene: Any, ball: Any) -> None:
    strip = oracle.add_clip(ball, 2, 10)
    _steps(compat.strip_fcurves(strip))
    _break_a_key(compat.strip_fcurves(strip)[0])
    oracle.add_clip(ball, 11, 12)
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert sorted(evaluation.samples["Ball"]) == [*range(1, 9), 10, 11]
    assert [*evaluation.counters.warnings.values()] == [1]


def test_a_body_with_such_a_key(scene: Any, ball: Any) -> None:
    """Then no volume touches the body; effects painted on the body go on."""
    body = bpy.data.objects["Avatar"]
    oracle.key(body, "location", [(1, (0, 0, 0)), (6, (0, 0, 0)), (12, (0, 0, 0))])
    _steps(compat.fcurves(body))
    _break_a_key(compat.fcurves(body)[2], -math.inf)
    oracle.add_painted("Head", "temperature", body, part="head")
    evaluation = oracle.evaluate(scene, rate_hz=24)
    _kept_to_its_key(evaluation, "Ball")
    assert sorted(evaluation.samples["Head"]) == [*range(12)]


def test_a_bone_with_such_a_key(scene: Any, ball: Any) -> None:
    body = bpy.data.objects["Avatar"]
    body.pose.bones["upperarm01.R"].rotation_mode = "XYZ"
    path = 'pose.bones["upperarm01.R"].rotation_euler'
    oracle.key(body, path, [(1, (0, 0, 0)), (6, (0, 0, 0)), (12, (0, 0, 0))])
    _steps(compat.fcurves(body))
    _break_a_key(compat.fcurves(body)[1])
    evaluation = oracle.evaluate(scene, rate_hz=24)
    _kept_to_its_key(evaluation, "Ball")
    assert [*evaluation.counters.warnings.values()] == [6]


def test_a_parent_with_such_a_key(scene: Any, ball: Any) -> None:
    carrier = oracle.empty(scene, "Carrier")
    ball.parent = oracle.empty(scene, "Arm", parent=carrier)
    oracle.key(carrier, "location", [(1, (0, 0, 0)), (6, (0, 0, 0)), (12, (0, 0, 0))])
    _steps(compat.fcurves(carrier))
    _break_a_key(compat.fcurves(carrier)[0])
    evaluation = oracle.evaluate(scene, rate_hz=24)
    _kept_to_its_key(evaluation, "Ball")
    assert [note[:17] for note in evaluation.reader.notes] == ["'Carrier': key 2 "]


def test_effects_whose_parent_is_nowhere_leave_the_others_as_they_are(
    scene: Any, ball: Any, nowhere: Any
) -> None:
    for name in ("One", "Other"):
        effect = oracle.add_volume(name, "pressure", "SPHERE", (0.0, 0.0, 1.1), radius=0.4)
        effect.parent = nowhere
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert sorted(evaluation.samples["Ball"]) == [*range(12)]
    assert sorted(evaluation.samples["One"]) == sorted(evaluation.samples["Other"])
    assert sorted(evaluation.samples["One"]) == [*range(5, 12)]
    assert [*evaluation.counters.flattened.values()] == [5, 5]


@pytest.mark.parametrize("weight", [math.nan, math.inf, 1e30, -1.0])
def test_a_painted_weight_that_is_none(scene: Any, ball: Any, weight: float) -> None:
    body = bpy.data.objects["Avatar"]
    head = oracle.add_painted("Head", "temperature", body, part="head")
    weights, vertices = list(head["hfx_weights"]), list(head["hfx_vertices"])
    head["hfx_weights"] = [weight, *weights[1:]]
    evaluation = oracle.evaluate(scene, rate_hz=24)
    assert evaluation.samples["Head"][0].vertices.tolist() == vertices[1:]
    (warning,) = evaluation.reader.description.warnings
    assert "'Head': 1 painted weights" in warning
