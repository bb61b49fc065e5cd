# SPDX-License-Identifier: GPL-3.0-or-later
"""Every change of haptic results, by every way of editing, is shown at the next redraw."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import painting
from hfx_blender.authoring.effects import effects
from hfx_blender.blender.events import is_waiting, remove_timers
from hfx_blender.operators.shared import HfxOperator
from hfx_blender.playback.evaluation import evaluation
from hfx_blender.playback.preview.preview import preview
from hfx_blender.playback.timeline.timeline_recorder import recorder
from hfx_blender.reading.description.scene_settings import scene_tolerance
from hfx_blender.reading.live_scene import LiveScene

NO_CHANGE = {"HFX_OT_effect_preset", "HFX_OT_live_stop_all", "HFX_OT_paint_status"}
"""Operators that change nothing of the scene, so that they have a base of their own."""

ELSEWHERE = (
    *("export", "add_avatar", "add_rain", "add_from_library", "feel_fabric", "live_", "paste"),
    *("update_values", "path_from_library", "paint_begin", "area_from_selection", "generate_"),
)
"""Operators that take long, or lead to no state of their own: they add as others of these do."""


@pytest.fixture
def following(scene: Any) -> Iterator[Any]:
    """The preview's handlers, missing in a Blender without a window."""
    preview.listen()
    preview.forget()
    yield scene
    preview.stop_listening()
    preview.forget()


def redraw() -> None:
    """Redraw as Blender does: timers, evaluation of tagged data, drawing."""
    preview.schedule_check()
    idle()


def idle() -> None:
    for _ in range(3):
        if is_waiting(preview.check_scene):
            remove_timers(preview.check_scene)
            preview.check_scene()
        bpy.context.view_layer.update()


def rows(runs: list[Any]) -> dict[tuple[str, str], np.ndarray]:
    """Strength of each vertex in contact with an effect, with the effect's parameters."""
    actual = {}
    for run in runs:
        for sample in run:
            order = np.argsort(sample.vertices)
            samples = np.column_stack([sample.vertices, sample.weights])[order]
            actual[sample.stream.effect_id, sample.stream.body_id] = np.append(
                samples.ravel(), [sample.level, *np.ravel(list(sample.parameters))]
            )
    return actual


def shown() -> dict[tuple[str, str], np.ndarray]:
    return rows(evaluation.runs())


def afresh() -> dict[tuple[str, str], np.ndarray]:
    scene, layer = bpy.context.scene, bpy.context.view_layer
    for obj in scene.objects:
        obj.update_tag()
    scene.frame_set(scene.frame_current)
    try:
        return rows(LiveScene(scene, layer, scene_tolerance(scene)).runs())
    except ValueError:
        return {}


def other_value(prop: Any, value: Any) -> Any:
    """Allowed value of a property, different from the present value."""
    if prop.type == "BOOLEAN":
        return not value
    if prop.type == "ENUM":
        return next(
            enum_item.identifier for enum_item in prop.enum_items if enum_item.identifier != value
        )
    if prop.type == "STRING":
        return value + "x"
    if prop.type == "POINTER":
        return None if value is not None else bpy.data.objects["Other"]
    if prop.is_array:
        return [other_number(prop, item) for item in value]
    return other_number(prop, value)


def other_number(prop: Any, value: float) -> float:
    return prop.hard_min if value > prop.hard_min else type(value)(min(prop.hard_max, value + 1))


@pytest.fixture
def only_told(following: Any) -> Iterator[None]:
    """Show nothing, so that only noticed changes cost time."""
    manager = bpy.context.window_manager
    manager.hfx_preview = manager.hfx_show_actuators = False
    yield
    manager.hfx_preview = manager.hfx_show_actuators = True


def test_every_property_of_effects_and_bodies_is_told(only_told: None) -> None:
    effect = effects.add_volume(bpy.context.scene, "vibration", "SPHERE")
    bpy.data.objects.new("Other", bpy.data.meshes.new("Other"))
    lists = (item for item in effect.hfx.bl_rna.properties if item.type == "COLLECTION")
    items = [getattr(effect.hfx, item.identifier).add() for item in lists]
    redraw()
    untold, count = [], 0
    for owner in (effect.hfx, effect.hfx.surface, *items):
        for prop in owner.bl_rna.properties:
            is_object = prop.type != "POINTER" or prop.fixed_type.identifier == "Object"
            if prop.is_readonly or prop.type == "COLLECTION" or not is_object:
                continue
            if prop.identifier == "role":  # no effect any more: the list of effects is compared
                continue
            preview.is_drawn = True
            setattr(owner, prop.identifier, other_value(prop, getattr(owner, prop.identifier)))
            redraw()
            count += 1
            if preview.is_drawn:
                untold.append(prop.identifier)
    assert count > 90
    assert untold == []


def test_a_stroke_on_the_canvas_is_no_change_of_an_effect(following: Any) -> None:
    """The area of the effect stays until *Finish Painting*: nothing is evaluated or redrawn."""
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure")
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    redraw()
    preview.is_drawn = True
    canvas.vertex_groups[0].add([5], 0.75, "REPLACE")
    canvas.data.update()
    bpy.context.view_layer.update()
    assert preview.is_drawn and not is_waiting(preview.check_scene)
    canvas[painting.PAINTED_EFFECT].location.x += 1.0
    bpy.context.view_layer.update()
    assert not preview.is_drawn and is_waiting(preview.check_scene)


def test_areas_and_lists_that_a_script_changes_are_told(only_told: None) -> None:
    effect = effects.add_volume(bpy.context.scene, "vibration", "SPHERE")
    redraw()
    for change in (
        lambda: effect.hfx.drive.add(),
        lambda: effect.__setitem__(effects.WEIGHTS, [0.5, 0.25]),
        lambda: effect[effects.WEIGHTS].__setitem__(1, 0.75),
        lambda: effect.hfx.drive.clear(),
    ):
        preview.is_drawn = True
        change()
        redraw()
        assert not preview.is_drawn


def test_a_change_that_is_evaluated_while_the_scene_is_read_is_told(
    only_told: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    effect = effects.add_volume(bpy.context.scene, "vibration", "SPHERE")
    redraw()
    preview.is_drawn = True
    effect.hfx.radius = 0.7
    monkeypatch.setattr(preview, "is_describing", True)
    bpy.context.view_layer.update()  # as reading does
    assert not preview.is_drawn


def test_colours_of_the_old_record_go_with_an_edit_during_reading(
    following: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.ops.hfx.add_avatar()
    ball = a_ball_in_the_chest()
    redraw()
    recorder.update_now(following)
    idle()
    ball.location.z = 9.0  # far above the avatar
    with monkeypatch.context() as reading:
        reading.setattr(preview, "is_describing", True)
        bpy.context.view_layer.update()
    frame = following.frame_current_final
    # A redraw before the timer still has the record from before the edit.
    assert preview.content.layers(following.hfx.palette, recorder.valid, frame)
    preview.reread()
    idle()
    assert recorder.valid is None
    assert preview.content.layers(following.hfx.palette, recorder.valid, frame) == []


def operators() -> list[str]:
    return [name for name in dir(bpy.types) if name.startswith("HFX_OT_")]


def test_every_operator_has_the_base_that_tells_the_preview(registered: Any) -> None:
    assert {
        name for name in operators() if not issubclass(getattr(bpy.types, name), HfxOperator)
    } == NO_CHANGE


def a_painted_palm() -> Any:
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    return bpy.context.object


def a_ball_in_the_chest() -> Any:
    bpy.ops.hfx.add_volume(modality="vibration", radius=0.2, location=(0, 0, 1.2))
    return bpy.context.object


def a_point_on_the_back() -> Any:
    bpy.ops.hfx.add_spot(modality="pressure")
    return bpy.context.object


@pytest.mark.parametrize("make", [a_painted_palm, a_ball_in_the_chest, a_point_on_the_back])
def test_after_every_operator_is_shown_what_is_felt(
    following: Any, make: Callable[[], Any]
) -> None:
    bpy.ops.hfx.add_avatar()
    make().name = "Active"
    ran = []
    for name in operators():
        short = name.removeprefix("HFX_OT_")
        if name in NO_CHANGE or short.startswith(ELSEWHERE):
            continue
        if bpy.data.objects.get("Active") is None:
            make().name = "Active"
        active = bpy.data.objects["Active"]
        bpy.context.view_layer.objects.active = active
        active.select_set(True)
        idle()
        call = getattr(bpy.ops.hfx, short)
        try:
            if not call.poll() or call() != {"FINISHED"}:
                continue
        except (RuntimeError, TypeError):  # needs a file, a window, or another object
            continue
        ran.append(short)
        idle()
        seen, true = shown(), afresh()
        assert seen.keys() == true.keys(), short
        for key, values in true.items():
            assert np.array_equal(seen[key], values), (short, key)
    assert len(ran) > 9
