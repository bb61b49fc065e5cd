# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators for painted areas, without the brush."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips, painting
from hfx_blender.authoring.effects import effects
from hfx_blender.engine.body.model import load_avatar, load_model
from hfx_blender.engine.body.parts import LEFT, PARTS, RIGHT
from hfx_blender.engine.track.track_reader import TrackReader
from hfx_blender.files import resources
from hfx_blender.reading.description import activation

PALM = PARTS.index("hand_palm")


@pytest.fixture
def effect(scene: Any) -> Any:
    """A pressure effect on the left palm."""
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    return bpy.context.object


def model_of(effect: Any) -> Any:
    return effects.model_of(effect)


def painted(effect: Any) -> set[int]:
    return set(np.flatnonzero(painting.weights_of(effect)).tolist())


def left_palm(model: Any) -> set[int]:
    return set(np.flatnonzero((model.part == PALM) & (model.side != RIGHT)).tolist())


@pytest.mark.parametrize("while_painting", [False, True])
def test_grow_shrink_invert_and_clear(effect: Any, while_painting: bool) -> None:
    model = model_of(effect)
    start = painted(effect)
    assert start == left_palm(model)
    if while_painting:
        bpy.ops.hfx.paint_begin()
    bpy.ops.hfx.area_filter(action="grow", steps=2)
    assert painted(effect) > start
    bpy.ops.hfx.area_filter(action="shrink", steps=2)
    assert start <= painted(effect) < set(range(len(model)))
    bpy.ops.hfx.area_filter(action="clear")
    assert not painted(effect)
    bpy.ops.hfx.area_filter(action="invert")
    assert len(painted(effect)) == len(model)
    if while_painting:
        bpy.ops.hfx.paint_end()
        assert len(effects.area(effect)[0]) == len(model)


def test_what_is_changed_while_painting_is_seen_on_the_canvas(effect: Any) -> None:
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    bpy.ops.hfx.area_filter(action="clear")
    group = canvas.vertex_groups[0].index
    assert not any(e.group == group for v in canvas.data.vertices for e in v.groups)


@pytest.mark.parametrize("has_clip", [False, True])
def test_painting_names_the_buttons_that_end_it(effect: Any, has_clip: bool, capfd: Any) -> None:
    for track in list(effect.animation_data.nla_tracks if effect.animation_data else ()):
        effect.animation_data.nla_tracks.remove(track)
    if has_clip:
        bpy.ops.hfx.add_clip()
    capfd.readouterr()
    bpy.ops.hfx.paint_begin()
    report = capfd.readouterr().out
    assert "press Finish Painting" in report
    assert ("Finish, Add Clip" in report) is not has_clip


def test_smoothing_softens_the_edge(effect: Any) -> None:
    bpy.ops.hfx.area_filter(action="smooth", steps=3)
    weights = painting.weights_of(effect)
    assert ((weights > 0.05) & (weights < 0.95)).any()


def test_mirroring_an_area(effect: Any) -> None:
    model = model_of(effect)
    start = painted(effect)
    bpy.ops.hfx.area_mirror(action="flip")
    assert painted(effect) == {int(model.mirror[v]) for v in start}
    bpy.ops.hfx.area_mirror(action="right")
    assert painted(effect) == start | {int(model.mirror[v]) for v in start}


def test_a_mirrored_copy_is_an_effect_of_its_own_with_the_same_clips(effect: Any) -> None:
    clips.add_clip(effect, 1, 11)
    start = painted(effect)
    bpy.ops.hfx.effect_mirrored()
    copy = next(o for o in effects.effects_of(bpy.context.scene) if o != effect)
    model = model_of(effect)
    assert painted(copy) == {int(model.mirror[v]) for v in start}
    assert copy.hfx.uid != effect.hfx.uid
    ((_, strip),) = clips.strips_of(copy)
    ((_, original),) = clips.strips_of(effect)
    assert strip.action != original.action
    assert activation.activation_of(copy).clips[0].frame_end == 11
    bpy.context.scene.frame_set(5)
    assert copy.evaluated_get(bpy.context.evaluated_depsgraph_get()).hfx.activation == 1.0


def test_an_area_is_copied_to_another_modality(effect: Any) -> None:
    bpy.ops.hfx.add_painted(modality="temperature", name="Warm")
    warm = bpy.context.object
    bpy.context.view_layer.objects.active = effect
    effect.select_set(True)
    warm.select_set(True)
    bpy.ops.hfx.area_copy()
    assert painted(warm) == left_palm(model_of(warm))


def test_an_area_is_kept_when_another_modality_is_chosen(effect: Any) -> None:
    assert not bpy.ops.hfx.area_keep.poll()
    effect.hfx.modality = "temperature"
    assert effects.has_other_area(effect)
    bpy.ops.hfx.area_keep()
    assert painted(effect) == left_palm(model_of(effect))
    assert not effects.has_other_area(effect)


def test_copying_needs_somewhere_to_copy_to(effect: Any) -> None:
    with pytest.raises(RuntimeError, match="Select the target painted effects"):
        bpy.ops.hfx.area_copy()


def picture(values: np.ndarray, name: str = "Map") -> Any:
    """An image from rows (H, W) of grey, the first row at the bottom."""
    image = bpy.data.images.new(name, values.shape[1], values.shape[0], float_buffer=True)
    colours = np.ones((*values.shape, 4), np.float32)
    colours[..., :3] = values[..., None]
    image.pixels.foreach_set(colours.ravel())
    return image


def test_an_image_paints_through_the_uv_map(effect: Any) -> None:
    """U as grey: every vertex gets the U of the nearest skin location."""
    ramp = np.tile((np.arange(512) + 0.5) / 512, (4, 1))
    picture(ramp)
    bpy.ops.hfx.area_from_image(image="Map")
    model, avatar = model_of(effect), load_avatar()
    weights = painting.weights_of(effect)
    # By hand for vertices on an avatar triangle within a single half quad, so that all corners have
    # one location on the map.
    uv_of: dict[int, set[float]] = {}
    for face, uv in zip(avatar.faces.tolist(), avatar.uv.tolist(), strict=True):
        for corner, (u, _) in zip(face, uv, strict=True):
            if corner >= 0:
                uv_of.setdefault(corner, set()).add(round(u, 6))
    checked = 0
    for vertex in range(0, len(model), 37):
        corners = model.avatar_vertices[vertex].tolist()
        if all(len(uv_of.get(c, ())) == 1 for c in corners):
            u = sum(
                w * next(iter(uv_of[c]))
                for c, w in zip(corners, model.avatar_weights[vertex].tolist(), strict=True)
            )
            assert weights[vertex] == pytest.approx(u, abs=0.01)
            checked += 1
    assert checked > 200


@pytest.mark.parametrize("channel", ["brightness", "darkness", "alpha"])
def test_channels_of_an_image(effect: Any, channel: str) -> None:
    picture(np.full((2, 2), 0.25))
    bpy.ops.hfx.area_from_image(image="Map", channel=channel)
    expected = {"brightness": 0.25, "darkness": 0.75, "alpha": 1.0}[channel]
    assert painting.weights_of(effect) == pytest.approx(expected, abs=1e-3)


def test_images_that_cannot_be_used_are_refused_and_nothing_is_lost(effect: Any) -> None:
    start = painted(effect)
    with pytest.raises(RuntimeError, match="no image 'Missing'"):
        bpy.ops.hfx.area_from_image(image="Missing")
    picture(np.ones((2, 2)))
    with pytest.raises(RuntimeError, match="no UV map 'Other'"):
        bpy.ops.hfx.area_from_image(image="Map", uv_map="Other")
    lost = bpy.data.images.new("Lost", 4, 4)
    lost.source = "FILE"
    lost.filepath = "//nowhere.png"
    with pytest.raises(RuntimeError, match="has no pixels"):
        bpy.ops.hfx.area_from_image(image="Lost")
    assert painted(effect) == start


def select_vertices(obj: Any, flags: np.ndarray) -> None:
    """Select vertices as in Edit Mode: an edge needs both ends selected, a face every corner."""
    for kind in ("edges", "polygons"):
        elements = getattr(obj.data, kind)
        elements.foreach_set("select", np.zeros(len(elements), np.bool_))
    obj.data.vertices.foreach_set("select", flags)


def test_selected_vertices_of_the_canvas_are_painted(effect: Any) -> None:
    start = painted(effect)
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    flags = np.zeros(len(canvas.data.vertices), np.bool_)
    flags[[10, 20, 30]] = True
    select_vertices(canvas, flags)
    bpy.ops.hfx.area_from_selection()
    assert painted(effect) == start | {10, 20, 30}
    bpy.ops.hfx.area_from_selection(blend="replace")
    assert painted(effect) == {10, 20, 30}


def test_selected_vertices_of_the_avatar_are_painted(effect: Any) -> None:
    avatar = effect.hfx.body.hfx.avatar
    part = load_avatar().part
    side = load_avatar().side
    flags = (part == PALM) & (side == LEFT)
    select_vertices(avatar, flags)
    bpy.ops.hfx.area_from_selection(blend="replace")
    model = model_of(effect)
    actual = painted(effect)
    inner = {v for v in left_palm(model) if flags[model.avatar_vertices[v]].all()}
    assert inner and inner <= actual
    assert all(flags[model.avatar_vertices[v]].any() for v in actual)


def test_nothing_selected_is_told(effect: Any) -> None:
    avatar = effect.hfx.body.hfx.avatar
    avatar.data.vertices.foreach_set("select", np.zeros(len(avatar.data.vertices), np.bool_))
    with pytest.raises(RuntimeError, match="No vertices are selected"):
        bpy.ops.hfx.area_from_selection()


def test_an_export_while_painting_has_what_was_painted(effect: Any, tmp_path: Path) -> None:
    bpy.context.scene.frame_end = bpy.context.scene.frame_start
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    canvas.vertex_groups[0].remove(list(range(len(canvas.data.vertices))))
    canvas.vertex_groups[0].add([10, 20, 30], 1.0, "REPLACE")
    bpy.ops.hfx.export(filepath=str(tmp_path / "x.hfxtrack"), formats={"track"})
    with TrackReader(tmp_path / "x.hfxtrack") as track:
        felt = {vertex for run in track.runs() for sample in run for vertex in sample.vertices}
    assert felt == {10, 20, 30}
    assert painting.canvas_of(effect) == canvas, "painting goes on"


def test_saving_while_painting_stores_what_was_painted(effect: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    group = canvas.vertex_groups[0]
    group.remove(list(range(len(canvas.data.vertices))))
    group.add([5], 0.5, "REPLACE")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    assert effects.area(effect) == ([5], [0.5])


def test_an_area_is_saved_for_every_file_and_modality(
    effect: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HFX_USER_DATA", str(tmp_path))
    before = effects.area(effect)
    assert before[0]
    bpy.ops.hfx.save_area(name="My palm")
    bpy.ops.hfx.area_filter(action="clear")
    bpy.ops.hfx.fill_part(part="saved:My palm")
    assert effects.area(effect)[0] == before[0]
    bpy.ops.hfx.add_painted(modality="pressure", name="Other")
    bpy.ops.hfx.fill_part(part="saved:My palm")
    second = bpy.context.object
    model = model_of(second)
    inside, _ = effects.area(second)
    near = model.part[np.array(inside)]
    assert np.mean(near == PALM) > 0.8  # vertices of the second model, and few more
    bpy.ops.hfx.area_filter(action="clear")
    bpy.ops.hfx.save_area(name="My palm")  # an empty area is removed
    with pytest.raises(TypeError):
        bpy.ops.hfx.fill_part(part="saved:My palm")


def test_an_unreadable_file_of_areas_is_never_replaced(
    effect: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HFX_USER_DATA", str(tmp_path))
    bpy.ops.hfx.save_area(name="My palm")
    path = resources.saved_areas()
    damaged = path.read_bytes()[:-1]
    path.write_bytes(damaged)
    with pytest.raises(RuntimeError, match=path.name):
        bpy.ops.hfx.save_area(name="Other")
    assert path.read_bytes() == damaged and painting.saved_names() == []


def test_the_arrow_of_a_painted_wind_stands_at_its_area_on_the_posed_body(effect: Any) -> None:
    body, touch = effect.hfx.body, effect
    assert touch.location.length == 0.0, "only wind has a direction"
    body.location = (3.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    bpy.ops.hfx.add_painted(modality="wind")
    wind = bpy.context.object
    bpy.ops.hfx.paint_begin()
    bpy.ops.hfx.fill_part(part="hand_palm", side="left")
    bpy.ops.hfx.paint_end()
    model = model_of(wind)
    left = model.vertices[sorted(left_palm(model))].mean(axis=0)
    aside = np.array(body.location)
    assert np.linalg.norm(left + aside - wind.location) < 0.05
    wind.location = (0.0, 0.0, 2.0)
    bpy.ops.hfx.area_mirror(action="flip")
    assert np.linalg.norm(left * (-1, 1, 1) + aside - wind.location) < 0.05


def test_the_part_under_the_mouse_is_named_as_people_say_it(effect: Any) -> None:
    from hfx_blender.operators.painting.paint_view import part_name

    model = model_of(effect)
    left = int(np.flatnonzero((model.part == PALM) & (model.side == LEFT))[0])
    assert part_name(model, left) == "Palms (left)"
    middle = int(np.flatnonzero(model.side == 0)[0])
    assert "(" not in part_name(model, middle)
    assert part_name(model, len(model) + 5) == ""


def test_an_avatar_that_was_hidden_stays_hidden_after_painting(effect: Any) -> None:
    skin = effect.hfx.body.hfx.avatar
    for was_hidden in (True, False):
        skin.hide_set(was_hidden)
        bpy.ops.hfx.paint_begin()
        assert skin.hide_get()
        bpy.ops.hfx.paint_end()
        assert skin.hide_get() == was_hidden


@pytest.mark.parametrize("kind", ["FULL_COPY", "LINK_COPY"])
def test_a_copy_of_the_scene_made_while_painting_is_shown_again(effect: Any, kind: str) -> None:
    layer = bpy.context.view_layer
    bpy.ops.hfx.paint_begin()
    bpy.ops.scene.new(type=kind)
    bpy.ops.hfx.paint_end()
    copied = bpy.context.object.hfx.body.hfx.avatar
    assert bpy.context.view_layer != layer and not copied.hide_get()
    if kind == "LINK_COPY":  # of the same objects: painting has ended in both
        assert not copied.hide_get(view_layer=layer)
    elif painting.canvas_of(effect) is not None:
        bpy.context.window.scene = layer.id_data
        bpy.ops.hfx.paint_end()
        assert not effect.hfx.body.hfx.avatar.hide_get()


def test_an_area_that_is_spoilt_is_told_and_can_be_cleared(effect: Any) -> None:
    effect["hfx_vertices"], effect["hfx_weights"] = [10**8], [1.0]
    with pytest.raises(RuntimeError, match="not one of the model's"):
        bpy.ops.hfx.area_filter(action="grow")
    bpy.ops.hfx.area_filter(action="clear")
    bpy.ops.hfx.area_filter(action="grow")


def test_the_brush_reaches_a_vertex_wherever_it_is(effect: Any) -> None:
    bpy.ops.hfx.paint_begin()
    canvas, model = bpy.context.object, load_model("hfx-pressure-1")
    edges = model.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    lengths = np.linalg.norm(np.diff(model.vertices[edges], axis=1)[:, 0], axis=1)
    for part in ("torso", "fingers"):
        (vertex, *_) = np.flatnonzero(model.part == PARTS.index(part))
        mean = lengths[(edges == vertex).any(axis=1)].mean()
        assert painting.spacing(canvas, effect, vertex) == pytest.approx(mean, rel=0.5)
    assert painting.spacing(canvas, effect, 10**6) == painting.spacing(canvas, effect)
