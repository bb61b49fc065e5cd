# SPDX-License-Identifier: GPL-3.0-or-later
"""A driver failing at some frames silences only these frames, and one warning names the driver."""

from __future__ import annotations

from typing import Any

import pytest

from hfx_blender.reading.stepped.drivers import RetriedDrivers

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

FAILS_FROM_12 = {
    "division by zero": "0.5 if frame < 12 else 1 / (frame - frame)",
    "root of a negative number": "sqrt(11 - frame) * 0 + 0.5",
    "Python": "[0.5][0] if frame < 12 else [0.5][1]",
    "Python, no number": "[0.5][0] if frame < 12 else float('nan')",
}
"""Expressions that are 0.5 at frames 0 to 11 and fail from frame 12 on."""


@pytest.fixture
def ball(scene: Any) -> Any:
    """A volume inside the torso of an avatar, in a scene of the frames 0 to 24."""
    scene.frame_start, scene.frame_end, scene.render.fps = 0, 24, 25
    oracle.add_avatar()
    return oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, -0.1, 1.2), radius=0.2)


def _drive(owner: Any, path: str, expression: str, index: int = -1) -> Any:
    curve = owner.driver_add(path, index) if index >= 0 else owner.driver_add(path)
    curve.driver.type, curve.driver.expression = "SCRIPTED", expression
    return curve


def _felt(evaluation: Any, effect: str = "Ball") -> list[int]:
    return sorted(evaluation.samples.get(effect, {}))


def _failures(evaluation: Any) -> dict[str, list[int]]:
    faults = evaluation.reader.faults
    return {text: sorted(at) for text, at in faults.items() if "driver" in text}


@pytest.mark.parametrize("expression", FAILS_FROM_12.values(), ids=FAILS_FROM_12)
@pytest.mark.parametrize("frame", [0, 20])  # the user's own, before and after the failure
def test_felt_where_blender_gives_a_value(
    scene: Any, ball: Any, expression: str, frame: int
) -> None:
    _drive(ball, "hfx.intensity", expression)
    scene.frame_set(frame)
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == [*range(12)]
    assert [*evaluation.levels("Ball").values()] == pytest.approx([0.5] * 12, abs=1e-6)
    (text,) = _failures(evaluation)
    assert "'hfx.intensity'" in text and "'Ball'" in text
    assert _failures(evaluation)[text] == [*range(12, 25)]


def test_the_users_scene_is_as_at_his_own_frame(scene: Any, ball: Any) -> None:
    curve = _drive(ball, "hfx.intensity", FAILS_FROM_12["division by zero"])
    scene.frame_set(3)
    oracle.evaluate(scene, rate_hz=25)
    assert curve.driver.is_valid
    scene.frame_set(4)
    evaluated = ball.evaluated_get(scene.view_layers[0].depsgraph)
    assert evaluated.hfx.intensity == pytest.approx(0.5, abs=1e-6)


def test_an_expression_that_never_runs(scene: Any, ball: Any) -> None:
    _drive(ball, "hfx.intensity", "no such thing (")
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == []
    assert [*_failures(evaluation).values()] == [[*range(25)]]


def test_a_place(scene: Any, ball: Any) -> None:
    """Two metres away with a working driver; Blender leaves the value at 0 from frame 12 on."""
    _drive(ball, "location", "2 if frame < 12 else 1 / (frame - frame)", 0)
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == [*range(12, 25)]
    (text,) = _failures(evaluation)
    assert "'location[0]'" in text


def test_a_bone(scene: Any, ball: Any) -> None:
    """The hand is turned into the ball by a driver of the upper arm while the driver works."""
    body = next(obj for obj in scene.objects if obj.hfx.role == "BODY")
    bone = body.pose.bones["upperarm01.R"]
    bone.rotation_mode = "XYZ"
    _drive(body, 'pose.bones["upperarm01.R"].rotation_euler', "sqrt(11 - frame)", 0)
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == [*range(25)]
    (text,) = _failures(evaluation)
    assert "upperarm01.R" in text and _failures(evaluation)[text] == [*range(12, 25)]


def test_a_shape_key_and_an_influence(scene: Any, ball: Any) -> None:
    far = oracle.empty(scene)
    far.location = (0.0, 0.0, 9.0)
    constraint = ball.constraints.new("COPY_LOCATION")
    constraint.target = far
    _drive(
        ball,
        'constraints["Copy Location"].influence',
        "1 if frame < 12 else 1 / (frame - frame)",
    )
    bpy.ops.mesh.primitive_cube_add(size=0.4, location=(0, -0.1, 1.2))
    source = bpy.context.object
    source.shape_key_add()
    source.shape_key_add(name="Away").data[0].co.x = 3.0
    _drive(
        source.data.shape_keys, 'key_blocks["Away"].value', "0 if frame < 20 else sqrt(0 - frame)"
    )
    effect = oracle.add_mesh_volume("Cube", "pressure", source)
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == [*range(12, 25)]
    assert _felt(evaluation, effect.name) == [*range(25)]
    assert sorted(map(tuple, _failures(evaluation).values())) == [
        (*range(12, 25),),
        (*range(20, 25),),
    ]


def test_what_a_variable_cannot_tell(scene: Any, ball: Any) -> None:
    """The variable is no number at first, and only the variable's own animation shows a change."""
    lever = oracle.empty(scene)
    lever["pull"] = 0.0
    oracle.key(lever, '["pull"]', [(0, 0.0), (7, 0.0), (8, 2.0), (24, 2.0)])
    curve = _drive(ball, "hfx.intensity", "1 / v")
    variable = curve.driver.variables.new()
    variable.name = "v"
    variable.targets[0].id, variable.targets[0].data_path = lever, '["pull"]'
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == [*range(8, 25)]
    assert [*_failures(evaluation).values()] == [[*range(8)]]


def test_what_drives_nothing_or_is_not_felt_is_not_told(scene: Any, ball: Any) -> None:
    prop = oracle.empty(scene)
    _drive(prop, "location", "1 / (frame - frame)", 0)
    muted = _drive(ball, "hfx.amplitude", "1 / (frame - frame)")
    muted.mute = True
    _drive(ball, "hfx.intensity", "0.5 if frame < 30 else 0.25")
    ball["gone"] = 1.0
    _drive(ball, '["gone"]', "1 / (frame - frame)")
    del ball["gone"]
    evaluation = oracle.evaluate(scene, rate_hz=25)
    assert _felt(evaluation) == [*range(25)]
    assert _failures(evaluation) == {}


def test_drivers_that_a_handler_removes_meanwhile(scene: Any, ball: Any) -> None:
    _drive(ball, "hfx.intensity", FAILS_FROM_12["division by zero"])
    _drive(ball, "location", "1 / (frame - frame)", 0)
    drivers = RetriedDrivers([ball], tags=True)
    drivers.evaluate(lambda: scene.frame_set(3))
    assert ["location" in text for text in drivers.failures] == [True]

    def remove() -> None:
        scene.frame_set(13)
        ball.driver_remove("location", 0)

    drivers.evaluate(remove)
    assert ["intensity" in text for text in drivers.failures] == [True]
    ball.driver_remove("hfx.intensity")
    drivers.evaluate(lambda: scene.frame_set(14))
    assert drivers.failures == ()
