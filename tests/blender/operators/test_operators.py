# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators: effect on the scene, and full reversal by a single undo step."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Quaternion, Vector

from hfx_blender.authoring import clips, painting
from hfx_blender.authoring.effects import effects
from hfx_blender.avatars import bodies
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS, SIDES
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.errors import InputError
from hfx_blender.operators import framing
from hfx_blender.operators.effects import effect_operators
from hfx_blender.operators.live import connect_operators
from hfx_blender.operators.painting import paint_view
from hfx_blender.reading.description.activation import ActivationSource, activation_of
from hfx_tools.demo import walking

FPS = 60


@pytest.fixture
def empty(scene: Any) -> Any:
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, 1000
    return scene


@pytest.fixture
def body(empty: Any) -> Any:
    bpy.ops.hfx.add_avatar()
    return bpy.context.object


def painted(modality: str = "pressure", name: str = "Touch") -> Any:
    bpy.ops.hfx.add_painted(modality=modality, name=name)
    return bpy.context.object


def volume(name: str = "Ball", **settings: object) -> Any:
    bpy.ops.hfx.add_volume(modality="vibration", name=name, **settings)
    return bpy.context.object


def activation_at(effect: Any, *frames: float) -> list[float]:
    """Activation evaluated by Blender's animation system."""
    values = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1)
        graph = bpy.context.evaluated_depsgraph_get()
        values.append(effect.evaluated_get(graph).hfx.activation)
    return values


def names() -> set[str]:
    return {obj.name for obj in bpy.data.objects}


# Bodies


def test_the_avatar_is_a_body_with_a_skin(body: Any) -> None:
    skin = body.hfx.avatar
    assert body.type == "ARMATURE" and body.hfx.role == "BODY" and body.hfx.uid
    assert skin.type == "MESH" and skin.parent == body
    assert [m.object for m in skin.modifiers if m.type == "ARMATURE"] == [body]
    height = max(v.co.z for v in skin.data.vertices) - min(v.co.z for v in skin.data.vertices)
    assert height == pytest.approx(1.8, abs=0.02)


def test_the_avatar_comes_to_the_cursor(empty: Any) -> None:
    empty.cursor.location = (1, 2, 3)
    bpy.ops.hfx.add_avatar()
    assert tuple(bpy.context.object.location) == (1, 2, 3)


def test_an_armature_can_be_marked_as_body(body: Any) -> None:
    rig = body.copy()
    rig.hfx.role = "NONE"
    rig.hfx.avatar = None
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.hfx.mark_body()
    assert rig.hfx.role == "BODY" and rig in effects.bodies_of(bpy.context.scene)


def test_a_walk_goes_the_way_at_an_even_speed(body: Any) -> None:
    walking.add_walk(body, [(0, 0, 0), (0, -2, 0), (2, -2, 0)], 0, 240)
    places = []
    for frame in (0, 60, 120, 180, 240):
        bpy.context.scene.frame_set(frame)
        places.append(tuple(body.matrix_world.translation))
    expected = [(0, 0, 0), (0, -1, 0), (0, -2, 0), (1, -2, 0), (2, -2, 0)]
    assert np.allclose(places, expected, atol=1e-5)
    # The rest pose faces -Y; after the corner the body faces +X.
    front = body.matrix_world.to_3x3() @ bpy.data.objects[body.name].location.__class__((0, -1, 0))
    assert np.allclose(front, (1, 0, 0), atol=1e-5)


@pytest.mark.parametrize("way", [[], [(1, 1, 0)], [(1, 1, 0), (1, 1, 0)]])
def test_a_walk_to_nowhere_is_refused(body: Any, way: list[tuple[float, ...]]) -> None:
    with pytest.raises(InputError, match=r"'Avatar'.*walk"):
        walking.add_walk(body, way, 0, 100)
    assert body.animation_data is None


# Volumes


@pytest.mark.parametrize("shape", ["CUBOID", "SPHERE", "CYLINDER", "CAPSULE"])
def test_a_volume_is_drawn_in_its_size_and_never_rendered(empty: Any, shape: str) -> None:
    effect = volume(shape=shape, size=(1, 2, 3), radius=0.5, height=3.0, location=(4, 5, 6))
    assert (effect.hfx.role, effect.hfx.kind, effect.hfx.shape) == ("EFFECT", "VOLUME", shape)
    assert effect.hide_render and effect.display_type == "WIRE"
    points = np.array([v.co for v in effect.data.vertices])
    extent = {"CUBOID": (1, 2, 3), "SPHERE": (1, 1, 1)}.get(shape, (1, 1, 3))
    assert np.allclose(np.ptp(points, axis=0), extent, atol=1e-5)
    assert tuple(effect.location) == (4, 5, 6)
    effect.hfx.size, effect.hfx.radius, effect.hfx.height = (2, 2, 2), 1.0, 2.0
    points = np.array([v.co for v in effect.data.vertices])
    assert np.allclose(np.ptp(points, axis=0), (2, 2, 2), atol=1e-5)


def test_defaults_are_those_of_the_engine(empty: Any) -> None:
    effect = volume()
    amplitude, frequency = MODALITIES["vibration"].parameters
    assert effect.hfx.amplitude == pytest.approx(amplitude.default)
    assert effect.hfx.frequency == pytest.approx(frequency.default)
    effect.hfx.amplitude = 1e9
    assert effect.hfx.amplitude == pytest.approx(amplitude.maximum)


def test_a_linked_duplicate_keeps_its_own_size(empty: Any) -> None:
    first = volume(radius=0.5)
    bpy.ops.object.duplicate(linked=True)
    second = bpy.context.object
    assert second.data == first.data
    second.hfx.radius = 2.0
    assert second.data != first.data
    assert np.ptp([v.co.x for v in first.data.vertices]) == pytest.approx(1.0, abs=1e-5)
    assert np.ptp([v.co.x for v in second.data.vertices]) == pytest.approx(4.0, abs=1e-5)
    assert (first.hfx.radius, second.hfx.radius) == (0.5, 2.0)


def test_a_volume_from_a_mesh_has_its_shape_and_moves_along(empty: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(location=(1, 2, 3))
    rock = bpy.context.object
    bpy.ops.hfx.volume_from_mesh(modality="pressure", name="Rock Touch")
    effect = bpy.context.object
    assert effect.data == rock.data and effect.hfx.shape == "MESH" and effect.hide_render
    rock.location.x, rock.scale.z = 7, 2
    bpy.context.view_layer.update()
    assert effect.matrix_world == rock.matrix_world
    assert len(rock.data.vertices) == 8 and len(rock.data.polygons) == 6
    assert not rock.hide_render and rock.hfx.role == "NONE"


def test_a_volume_from_a_mesh_keeps_the_modifiers_of_its_shape(empty: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(location=(1, 2, 3))
    rock = bpy.context.object
    rock.modifiers.new("Round", "CAST").factor = 0.8
    rock.animation_data_create()
    rock.constraints.new("LIMIT_LOCATION")
    bpy.ops.hfx.volume_from_mesh(modality="pressure")
    effect = bpy.context.object
    rock.modifiers["Round"].factor = 0.8
    graph = bpy.context.evaluated_depsgraph_get()
    shapes = [
        [tuple(vertex.co) for vertex in obj.evaluated_get(graph).data.vertices]
        for obj in (rock, effect)
    ]
    assert shapes[0] == shapes[1] != [tuple(vertex.co) for vertex in rock.data.vertices]
    assert not effect.constraints and effect.matrix_world == rock.matrix_world


# Clips


def test_a_clip_lasts_its_time_and_fades(empty: Any) -> None:
    effect = volume()
    assert activation_of(effect).source is ActivationSource.ALWAYS_ON
    bpy.ops.hfx.add_clip(start=60.0, duration=2.0, fade_in=0.5, fade_out=1.0)
    # 60 fps: from frame 60 to 180, rising for 30 frames and falling for 60.
    at = {59: 0, 60: 0, 67.5: 0.25, 75: 0.5, 90: 1, 105: 1, 120: 1, 150: 0.5, 165: 0.25, 181: 0}
    assert activation_at(effect, *at) == pytest.approx(list(at.values()), abs=1e-4)
    state = activation_of(effect)
    assert state.spans == ((60.0, 180.0),)
    assert [(item.frame_start, item.frame_end) for item in state.clips] == [(60.0, 180.0)]


def test_a_clip_starts_at_the_current_frame_unless_told_otherwise(empty: Any) -> None:
    effect = volume()
    empty.frame_set(42)
    bpy.ops.hfx.add_clip(duration=1.0)
    assert activation_of(effect).spans == ((42.0, 102.0),)


def test_clips_between_frames_stay_where_they_were_put(empty: Any) -> None:
    effect = volume()
    bpy.ops.hfx.add_clip(start=10.5, duration=0.2)  # 12 frames
    bpy.ops.hfx.add_clip(start=22.5, duration=0.2)  # begins where the first ends
    assert activation_of(effect).spans == ((10.5, 22.5), (22.5, 34.5))
    at = {10.4: 0, 10.6: 1, 22.4: 1, 22.6: 1, 34.4: 1, 34.6: 0}
    assert activation_at(effect, *at) == pytest.approx(list(at.values()), abs=1e-4)


def test_overlapping_clips_go_to_tracks_of_their_own(empty: Any) -> None:
    effect = volume()
    bpy.ops.hfx.add_clip(start=0.0, duration=1.0)
    bpy.ops.hfx.add_clip(start=30.0, duration=1.0, fade_in=0.25)
    bpy.ops.hfx.add_clip(start=100.0, duration=1.0)
    tracks = effect.animation_data.nla_tracks
    assert [len(track.strips) for track in tracks] == [2, 1]
    # The later strip fades in over the earlier active strip: no dip.
    at = {0: 1, 29: 1, 31: 1, 37.5: 1, 59: 1, 61: 1, 89: 1, 91: 0, 99: 0, 101: 1, 159: 1, 161: 0}
    assert activation_at(effect, *at) == pytest.approx(list(at.values()), abs=1e-4)


def test_a_clip_leaves_other_animation_alone(empty: Any) -> None:
    effect = volume("Old Name")
    for frame, value in ((0, 0.0), (100, 1.0)):
        effect.hfx.intensity = value
        effect.hfx.keyframe_insert("intensity", frame=frame)
    effect.name = "New Name"  # the action still has a slot with the old name
    curve = effect.animation_data.action
    bpy.ops.hfx.add_clip(start=0.0, duration=1.0)
    assert effect.animation_data.action == curve
    empty.frame_set(0)
    dim = effect.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx.intensity
    empty.frame_set(100)
    bright = effect.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx.intensity
    assert (dim, bright) == (0.0, 1.0)


def test_muted_clips_mean_off(empty: Any) -> None:
    effect = volume()
    bpy.ops.hfx.add_clip(start=0.0, duration=1.0)
    effect.animation_data.nla_tracks[0].strips[0].mute = True
    assert activation_of(effect).source is ActivationSource.OFF


def test_a_heartbeat_beats_in_time_within_one_envelope(empty: Any) -> None:
    effect = volume()
    bpy.ops.hfx.add_heartbeat(
        start=60.0, duration=2.0, beats_per_minute=120.0, fade_in=0.5, fade_out=0.5
    )
    # Four beats of 30 frames from frame 60 on; in each, pulses of 1 at 0.08 and 0.6 at 0.38 of the
    # beat, and silence in the second half. The fades are 30 frames at both ends of the whole.
    envelope = {
        0: lambda t: t / 30,
        1: lambda t: 1.0,
        2: lambda t: 1.0,
        3: lambda t: (120 - t) / 30,
    }
    for beat, fade in envelope.items():
        for share, height in (
            (0.04, 0.5),
            (0.08, 1),
            (0.14, 0.5),
            (0.25, 0),
            (0.38, 0.6),
            (0.7, 0),
        ):
            t = (beat + share) * 30
            [actual] = activation_at(effect, 60 + t)
            assert actual == pytest.approx(height * fade(t), abs=2e-3), (beat, share)
    assert activation_at(effect, 59, 181) == [0, 0]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"duration": 1.0, "fade_in": 0.6, "fade_out": 0.6}, "fades are longer"),
        ({"duration": 1.0, "fade_in": 1.5}, "fades are longer"),
    ],
)
def test_a_clip_that_cannot_be_is_refused(
    empty: Any, settings: dict[str, float], words: str
) -> None:
    effect = volume()
    with pytest.raises(RuntimeError, match=rf"'Ball'.*{words}"):
        bpy.ops.hfx.add_clip(start=0.0, **settings)
    assert activation_of(effect).source is ActivationSource.ALWAYS_ON


def test_more_beats_than_blender_repeats_are_refused(empty: Any) -> None:
    effect = volume()
    with pytest.raises(RuntimeError, match=r"'Ball'.*1200 repetitions"):
        bpy.ops.hfx.add_heartbeat(start=0.0, duration=60.0, beats_per_minute=1200.0)
    assert clips.strips_of(effect) == []
    bpy.ops.hfx.add_heartbeat(start=0.0, duration=50.0, beats_per_minute=1200.0)
    [(_, strip)] = clips.strips_of(effect)
    assert (strip.repeat, strip.scale) == pytest.approx((1000.0, 1.0))


# Painting


def test_filling_a_part_takes_exactly_its_vertices(body: Any) -> None:
    effect = painted("pressure")
    model = load_model("hfx-pressure-1")
    palm = model.part == PARTS.index("hand_palm")
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    left = palm & (model.side != SIDES.index("right"))
    assert effects.area(effect)[0] == np.flatnonzero(left).tolist()
    assert (model.vertices[left, 0] >= 0).all() and left.any()
    bpy.ops.hfx.fill_part(part="hand_palm", side="right")  # adds
    assert effects.area(effect)[0] == np.flatnonzero(palm).tolist()
    assert set(effects.area(effect)[1]) == {1.0}
    bpy.ops.hfx.fill_part(part="all")
    assert len(effects.area(effect)[0]) == len(model)


def test_an_area_is_set_from_json(body: Any) -> None:
    effect = painted()
    bpy.ops.hfx.set_area(area='{"30": 0.25, "7": 1, "8": 0}')
    assert effects.area(effect) == ([7, 30], [1.0, 0.25])
    model = load_model("hfx-pressure-1")
    assert (effect.hfx.model_id, effect.hfx.model_hash) == (model.id, model.content_hash)


@pytest.mark.parametrize(
    "area",
    [
        "",
        "[1, 2]",
        "{1: 1}",
        '{"x": 1}',
        '{"1": "full"}',
        '{"1": null}',
        '{"1": 1.5}',
        '{"1": -0.1}',
        '{"1": NaN}',
        '{"1": 1e999}',
        '{"1": 1' + "0" * 400 + "}",
        '{"-1": 1}',
        '{"19999999": 1}',
        '{"99999999999999999999": 1}',
        '{"1": 1, "01": 1.0, "-5": 0.5}',
    ],
)
def test_a_wrong_area_is_refused_and_the_old_one_kept(body: Any, area: str) -> None:
    effect = painted()
    bpy.ops.hfx.set_area(area='{"3": 0.5}')
    with pytest.raises(RuntimeError) as refusal:
        bpy.ops.hfx.set_area(area=area)
    message = str(refusal.value)
    assert "Traceback" not in message and len(message.strip().splitlines()) == 1
    assert effects.area(effect) == ([3], [0.5])


def test_painting_shows_the_area_and_takes_it_over(body: Any) -> None:
    effect = painted()
    bpy.ops.hfx.set_area(area='{"3": 0.5, "900": 1.0}')
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    assert body.hfx.avatar.hide_get() and canvas != effect
    assert len(canvas.data.vertices) == len(load_model("hfx-pressure-1"))
    group = canvas.vertex_groups[0]
    assert canvas.vertex_groups.active == group
    assert (group.weight(3), group.weight(900)) == (0.5, 1.0)
    group.add([5], 0.75, "REPLACE")  # a stroke of the brush
    group.remove([900])
    bpy.ops.hfx.paint_end()
    assert bpy.context.object == effect and not body.hfx.avatar.hide_get()
    assert effects.area(effect) == ([3, 5], [0.5, 0.75])
    assert not [obj for obj in bpy.data.objects if obj.name.endswith("Area")]
    assert not [mesh for mesh in bpy.data.meshes if mesh.name.endswith("Area")]


def test_clips_of_the_painted_effect_stay_in_the_nla_editor(body: Any) -> None:
    """The editor shows selected objects that are not hidden."""
    bpy.ops.hfx.add_volume()
    volume = bpy.context.object
    other, effect = painted(), painted()
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    assert canvas.get(painting.PAINTED_EFFECT) == effect
    assert set(bpy.context.selected_objects) == {effect, canvas}
    assert effect.visible_get() and other.visible_get() and not volume.visible_get()
    bpy.ops.hfx.paint_end()
    assert volume.visible_get() and bpy.context.selected_objects == [effect]


def test_painting_shows_weights_in_the_colour_of_the_effect() -> None:
    """The weight range is a preference of Blender: it returns, unsaved, and one in use is kept."""
    preferences = bpy.context.preferences
    view = preferences.view

    def shown() -> tuple[bool, list[tuple[float, ...]]]:
        elements = view.weight_color_range.elements
        return view.use_weight_color_range, [(e.position, *e.color) for e in elements]

    before, preferences.is_dirty = shown(), False
    paint_view.set_weight_colours((0.0, 1.0, 0.0, 1.0))
    is_used, colours = shown()
    assert is_used and colours[-1] == (1.0, 0.0, 1.0, 0.0, 1.0) and len(colours) == 2
    paint_view.set_weight_colours((1.0, 0.0, 0.0, 1.0))  # another viewport
    paint_view.set_weight_colours(None)
    assert shown() == before and not preferences.is_dirty
    view.use_weight_color_range = True
    try:
        paint_view.set_weight_colours((0.0, 1.0, 0.0, 1.0))
        assert shown() == (True, before[1])
    finally:
        view.use_weight_color_range = False


def test_the_fill_tool_fills_and_clears_the_part_of_a_vertex(body: Any) -> None:
    """A vertex in the left palm fills the left palm; both palms with Paint Both Sides."""
    effect, model = painted(), load_model("hfx-pressure-1")
    palms = model.part == PARTS.index("hand_palm")
    left, right = (palms & (model.side == SIDES.index(side)) for side in ("left", "right"))
    operator = SimpleNamespace()
    choose = bpy.types.HFX_OT_fill_part.choose
    choose(operator, int(np.flatnonzero(left)[0]), False)
    bpy.ops.hfx.fill_part(part=operator.part, side=operator.side)
    assert set(effects.area(effect)[0]) == set(np.flatnonzero(left).tolist())
    choose(operator, int(np.flatnonzero(right)[0]), True)
    bpy.ops.hfx.fill_part(part=operator.part, side=operator.side)
    assert set(effects.area(effect)[0]) == set(np.flatnonzero(left | right).tolist())
    bpy.ops.hfx.fill_part(part=operator.part, side="left", is_cleared=True)
    assert set(effects.area(effect)[0]) == set(np.flatnonzero(right).tolist())


def test_a_view_turned_while_painting_stays() -> None:
    """Half a turn about Z stays; a view that was only moved returns."""
    view = SimpleNamespace(
        view_location=Vector(), view_rotation=Quaternion(), view_distance=10.0,
        view_perspective="PERSP",
    )  # fmt: skip
    area: Any = SimpleNamespace(regions=[SimpleNamespace(type="WINDOW", data=view)])
    before = framing.state(area)
    view.view_distance = 3.0
    framing.restore(area, before)
    assert view.view_distance == 10.0
    view.view_rotation, view.view_distance = Quaternion((0.0, 0.0, 0.0, 1.0)), 3.0
    framing.restore(area, before)
    assert view.view_rotation.z == 1.0 and view.view_distance == 3.0
    view.view_rotation = Quaternion((-1.0, 0.0, 0.0, 0.0))  # the first rotation, negated
    framing.restore(area, before)
    assert view.view_distance == 10.0


def test_the_canvas_stands_where_the_body_does(body: Any) -> None:
    painted()
    bone = body.pose.bones[0]
    bone.location = (0.1, 0.2, 0.3)
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    assert [group.name for group in canvas.vertex_groups] == [canvas[painting.PAINTED_EFFECT].name]
    body.location = (5, 0, 0)
    graph = bpy.context.evaluated_depsgraph_get()
    shown = canvas.evaluated_get(graph)
    points = np.array([shown.matrix_world @ v.co for v in shown.data.vertices])
    skin = body.hfx.avatar.evaluated_get(graph)
    avatar = np.array([skin.matrix_world @ v.co for v in skin.data.vertices])
    assert np.allclose(points.min(axis=0), avatar.min(axis=0), atol=0.03)
    assert np.allclose(points.max(axis=0), avatar.max(axis=0), atol=0.03)


@pytest.mark.parametrize("name", ["add_clip", "add_heartbeat"])
def test_a_clip_of_the_painted_effect_ends_painting(body: Any, name: str) -> None:
    effect = painted()
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    canvas.vertex_groups[0].add([5], 0.75, "REPLACE")
    assert getattr(bpy.ops.hfx, name)() == {"FINISHED"}
    assert bpy.context.object == effect and bpy.context.mode == "OBJECT"
    assert effects.area(effect) == ([5], [0.75])
    assert len(clips.strips_of(effect)) == 1


def test_an_effect_covers_a_body_part_from_the_start(body: Any, capfd: Any) -> None:
    bpy.ops.hfx.add_on_part(modality="vibration", part="hand_palm")
    assert "no painted area" not in capfd.readouterr().out
    effect = bpy.context.object
    model = load_model("hfx-vibration-1")
    vertices = effects.area(effect)[0]
    assert effect.hfx.modality == "vibration" and 0 < len(vertices) < len(model) / 4
    bpy.ops.hfx.add_on_part(modality="pressure", part="all")
    assert len(effects.area(bpy.context.object)[0]) == len(load_model("hfx-pressure-1"))


def test_painting_refuses_what_it_could_not_take_over(body: Any) -> None:
    effect = painted()
    bpy.ops.hfx.set_area(area='{"3": 0.5}')
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    bpy.context.view_layer.objects.active = effect
    with pytest.raises(RuntimeError, match="being painted already"):
        bpy.ops.hfx.paint_begin()
    bpy.context.view_layer.objects.active = canvas
    canvas.vertex_groups.remove(canvas.vertex_groups[0])
    with pytest.raises(RuntimeError, match="was edited"):
        bpy.ops.hfx.paint_end()
    assert effects.area(effect) == ([3], [0.5])


def test_an_area_means_nothing_on_another_model(body: Any) -> None:
    effect = painted("pressure")
    bpy.ops.hfx.fill_part(part="head")
    effect.hfx.modality = "wind"  # felt on the same model
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    model = load_model("hfx-pressure-1")
    assert len(effects.area(effect)[0]) > np.count_nonzero(model.part == PARTS.index("head"))
    effect.hfx.modality = "temperature"
    bpy.ops.hfx.fill_part(part="torso")
    model = load_model("hfx-temperature-1")
    torso = np.flatnonzero(model.part == PARTS.index("torso"))
    assert effects.area(effect)[0] == torso.tolist()
    effect.hfx.modality = "pressure"
    bpy.ops.hfx.paint_begin()
    group = bpy.context.object.vertex_groups[0]
    with pytest.raises(RuntimeError, match="not in group"):
        group.weight(int(torso[0]))


def test_an_avatar_stands_beside_what_is_there_in_the_active_collection(empty: Any) -> None:
    bpy.ops.mesh.primitive_cube_add(size=2.0)  # as in Blender's start-up scene
    mine = bpy.data.collections.new("Mine")
    bpy.context.scene.collection.children.link(mine)
    layer = bpy.context.view_layer
    layer.active_layer_collection = layer.layer_collection.children["Mine"]
    bpy.ops.hfx.add_avatar(stands_free=True)
    body = bpy.context.object
    layer.update()
    skin = body.hfx.avatar
    across = [(skin.matrix_world @ Vector(corner)).x for corner in skin.bound_box]
    assert min(across) > 0.95 and min(across) < 1.5, "beside the cube, and near it"
    assert {o.name for o in mine.objects} == {body.name, skin.name}


def delete(body: Any) -> None:
    """As *X*: effects on a body keep the body in the file, but not in the scene."""
    with bpy.context.temp_override(selected_objects=[body]):
        bpy.ops.object.delete()


def test_painting_never_starts_on_a_deleted_body(body: Any) -> None:
    painted()
    delete(body)
    with pytest.raises(RuntimeError, match="not in the scene: press Move to Body"):
        bpy.ops.hfx.paint_begin()


def test_effects_of_a_deleted_body_move_to_another_at_their_places(body: Any) -> None:
    effect, alternative = painted(), painted(name="Other")
    bpy.ops.hfx.fill_part(part="head")
    area = effects.area(alternative)
    delete(body)
    assert effects.effects_without_body(bpy.context.scene) == [alternative, effect]
    new, _ = bodies.add_avatar(bpy.context)
    bpy.ops.hfx.move_to_body(which="GONE", body=new.name)
    assert effects.effects_without_body(bpy.context.scene) == []
    assert (effect.hfx.body, alternative.hfx.body) == (new, new)
    assert effects.area(alternative) == area


def test_the_avatar_that_replaces_a_deleted_one_takes_its_effects_along(body: Any) -> None:
    effect = painted()
    delete(body)
    new, _ = bodies.add_avatar(bpy.context)
    bpy.ops.hfx.mark_body()
    assert effect.hfx.body == new


def test_which_of_two_bodies_is_painted_on(body: Any) -> None:
    bpy.ops.hfx.add_avatar()
    second = bpy.context.object
    assert painted().hfx.body == second
    volume()
    with pytest.raises(RuntimeError, match="Several haptic bodies"):
        bpy.ops.hfx.add_painted(modality="pressure")


# Export


def test_export_writes_beside_the_chosen_name(body: Any, tmp_path: Path) -> None:
    bpy.context.scene.frame_end = 5
    painted()
    bpy.ops.hfx.fill_part(part="head")
    bpy.context.scene.hfx.devices.add().name = "back_pad"
    bpy.ops.hfx.export(filepath=str(tmp_path / "mine.hfxtrack"))
    actual = sorted(path.name for path in tmp_path.iterdir())
    assert actual == ["mine.back_pad.csv", "mine.hfxtrack", "mine.report.json"]
    assert json.loads((tmp_path / "mine.report.json").read_text())["scene"] == "Scene"


@pytest.mark.parametrize("name", ["", "folder"])
def test_export_needs_a_file_name(body: Any, tmp_path: Path, name: str) -> None:
    painted()
    bpy.ops.hfx.fill_part(part="head")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RuntimeError, match="Choose a file"):
        bpy.ops.hfx.export(filepath=str(tmp_path / name) if name else "")


# Poll conditions, and undoing


@pytest.mark.parametrize(
    ("operator", "words"),
    [
        ("add_painted", "haptic body first"),
        ("volume_from_mesh", "Select a mesh"),
        ("mark_body", "Select an armature"),
        ("add_clip", "Select a haptic effect"),
        ("add_heartbeat", "Select a haptic effect"),
        ("paint_begin", "Select a painted effect"),
        ("paint_end", "Nothing is being painted"),
        ("fill_part", "Select a painted effect"),
        ("set_area", "Select a painted effect"),
        ("export", "haptic effect first"),
    ],
)
def test_an_operator_says_what_it_needs(empty: Any, operator: str, words: str) -> None:
    with pytest.raises(RuntimeError, match=words):
        getattr(bpy.ops.hfx, operator)()


def _steps() -> dict[str, Any]:
    return {
        "add_avatar": lambda: bpy.ops.hfx.add_avatar(),
        "add_volume": lambda: bpy.ops.hfx.add_volume(modality="wind"),
        "add_painted": lambda: bpy.ops.hfx.add_painted(modality="wind"),
        "fill_part": lambda: bpy.ops.hfx.fill_part(part="head"),
        "add_clip": lambda: bpy.ops.hfx.add_clip(start=3.0),
        "paint_begin": lambda: bpy.ops.hfx.paint_begin(),
    }


def _state() -> dict[str, Any]:
    return {
        obj.name: (
            effects.area(obj),
            obj.hfx.role,
            [(s.frame_start, s.frame_end) for _, s in clips.strips_of(obj)],
        )
        for obj in bpy.data.objects
    }


@pytest.mark.parametrize("name", _steps())
def test_one_undo_takes_one_operator_back(body: Any, name: str) -> None:
    painted()
    bpy.ops.hfx.set_area(area='{"3": 0.5}')
    bpy.ops.ed.undo_push(message="before")
    before = _state()
    _steps()[name]()
    after = _state()
    assert after != before
    bpy.ops.ed.undo_push(message=name)
    bpy.ops.ed.undo()
    assert _state() == before
    bpy.ops.ed.redo()
    assert _state() == after


@pytest.mark.parametrize("unit_m", [0.01, 0.0254])
def test_an_avatar_and_volumes_are_as_large_as_people_in_any_unit(
    scene: Any, unit_m: float
) -> None:
    scene.unit_settings.scale_length = unit_m
    bpy.ops.hfx.add_avatar()
    skin = bpy.context.object.children[0]
    bpy.context.view_layer.update()
    assert 1.6 < skin.dimensions.z * unit_m < 2.0
    bpy.ops.hfx.add_volume(modality="pressure", shape="CUBOID")
    assert [edge * unit_m for edge in bpy.context.object.hfx.size] == pytest.approx([1.0] * 3)
    bpy.ops.hfx.add_volume(modality="pressure", shape="SPHERE", radius=3.0)
    assert bpy.context.object.hfx.radius == 3.0, "a script's numbers are Blender units"


@pytest.mark.parametrize(
    ("x", "y", "view"), [(10, 10, "front"), (10, 70, "top"), (70, 10, "right"), (300, 10, "turned")]
)
def test_a_place_in_quad_view_is_of_the_view_that_shows_it(x: int, y: int, view: str) -> None:
    corners = {"front": (0, 0), "top": (0, 60), "right": (60, 0), "turned": (60, 60)}
    regions = [SimpleNamespace(type="UI", x=0, y=0, width=999, height=999, data="sidebar")]
    for name, (left, bottom) in corners.items():
        position = {"x": left, "y": bottom, "width": 60, "height": 60}
        regions.append(SimpleNamespace(type="WINDOW", data=name, **position))

    assert framing.region_at(SimpleNamespace(regions=regions), x, y).data == view


@pytest.mark.parametrize(
    "operator",
    [connect_operators.HFX_OT_live_add, effect_operators.HFX_OT_add_vector_sensation],
)
def test_a_choice_of_a_menu_is_the_only_question(operator: Any) -> None:
    """A background process never calls ``invoke``: called here with a stand-in."""
    menus: list[str] = []
    stand_in_class = type("StandIn", (SimpleNamespace,), {"bl_label": "Add"})
    manager = SimpleNamespace(popup_menu=lambda draw, title: menus.append(title))
    for is_chosen, result in ((True, {"FINISHED"}), (False, {"CANCELLED"})):
        properties = SimpleNamespace(is_property_set=lambda _name, is_chosen=is_chosen: is_chosen)
        stand_in = stand_in_class(
            properties=properties, bl_property="name", execute=lambda _context: {"FINISHED"}
        )
        context = SimpleNamespace(window_manager=manager)
        assert operator.invoke(stand_in, context, None) == result
    assert len(menus) == 1  # without a choice, as from Menu Search


def test_an_operator_answered_in_a_menu_names_its_property() -> None:
    """`invoke`, as by a button, reads the property; a script's call does not."""
    from hfx_blender.operators.shared import MenuOperator

    kinds = MenuOperator.__subclasses__()
    assert {"HFX_OT_live_add", "HFX_OT_live_find"} <= {kind.__name__ for kind in kinds}
    for kind in kinds:
        assert kind.bl_property in kind.__annotations__, kind
    # Without a property to choose, the button runs the operator.
    assert not hasattr(connect_operators.HFX_OT_live_phone, "invoke")
