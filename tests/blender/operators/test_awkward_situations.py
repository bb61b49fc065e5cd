# SPDX-License-Identifier: GPL-3.0-or-later
"""Every operator in awkward situations: a message or success, never a traceback.

Each situation is set up once. After an operator with an effect the scene may be different, so the
important state (active object, mode) is set up again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import hfx_scenes
import pytest

_NOT_HERE = {
    "live_connect",  # starts processes
    "live_phone",
    "live_play",
    "live_disconnect",
    "live_stop_all",
    "live_approve",
    "live_revoke",
    "live_import",
    "stroke_pad",  # modal
    "paint_status",
    "export",  # slow, with separate tests
    "bake_response",
    "place_dropped",
}
_ARGUMENTS: dict[str, list[dict[str, Any]]] = {
    "add_from_library": [{"name": "hug"}],
    "add_rain": [{"duration": 0.5}],
    "add_vector_sensation": [{"device": "back_pad"}],
    "area_filter": [{"action": "grow"}, {"action": "invert"}],
    "draw_fades": [{}, {"name": "Clip"}],
    "live_add": [{"name": "back_pad"}],
    "modulate": [{"scope": "ALL"}],
    "remove_clip": [{}, {"name": "Clip"}],
    "scale_frequency": [{"scope": "ALL"}],
    "scale_strength": [{"scope": scope} for scope in ("SELECTED", "COLLECTION", "ALL")],
    "set_area": [{}, {"area": '{"1": 1}'}],
}
_SLOW = (
    "add_avatar",
    "add_from_library",
    "add_spot",
    "add_surface",
    "add_vector_sensation",
    "area_from_image",
    "area_from_selection",
    "area_mirror",
    "fit_body",
    "generate_surface",
    "live_add",
    "paint_begin",
    "paste_effects",
    "record_track",
    "show_model",
    "update_values",
)
"""Each of them in a fourth of the situations, so that the tests stay quick."""

_WITH_ALL = ("avatar_in_edit_mode", "linked_file", "excluded_collection", "spoilt_area")


def _activate(name: str, mode: str = "OBJECT") -> None:
    layer, active = bpy.context.view_layer, bpy.context.object
    if active is not None and active.name == name and active.mode == mode:
        if bpy.context.selected_objects == [active]:
            return
    if bpy.context.object is not None and bpy.context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    actual = layer.objects.get(name)
    layer.objects.active = actual
    if actual is not None:
        actual.select_set(True)
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def _body() -> Any:
    return next(obj for obj in bpy.data.objects if obj.hfx.role == "BODY")


def _nothing() -> Callable[[], None]:
    bpy.ops.wm.read_homefile(use_empty=True)
    return lambda: _activate("")


def _no_active_object() -> Callable[[], None]:
    return lambda: _activate("")


def _volume_in_edit_mode() -> Callable[[], None]:
    return lambda: _activate("Ball", "EDIT")


def _avatar_in_edit_mode() -> Callable[[], None]:
    name = _body().hfx.avatar.name
    return lambda: _activate(name, "EDIT")


def _body_in_pose_mode() -> Callable[[], None]:
    return lambda: _activate("Avatar", "POSE")


def _being_painted() -> Callable[[], None]:
    _activate("Touch")
    bpy.ops.hfx.paint_begin()

    def again() -> None:
        if "Touch Area" in bpy.context.view_layer.objects:
            _activate("Touch Area", "WEIGHT_PAINT")

    return again


def _painted_effect_deleted() -> Callable[[], None]:
    _activate("Touch")
    bpy.ops.hfx.paint_begin()
    bpy.data.objects.remove(bpy.data.objects["Touch"])
    return lambda: _activate("Touch Area")


def _body_deleted() -> Callable[[], None]:
    bpy.data.objects.remove(_body())
    return lambda: _activate("Touch")


def _avatar_deleted() -> Callable[[], None]:
    bpy.data.objects.remove(_body().hfx.avatar)
    return lambda: _activate("Touch")


def _body_of_another_scene() -> Callable[[], None]:
    second = bpy.data.scenes.new("Other")
    for name in ("Touch", "Ball"):
        second.collection.objects.link(bpy.data.objects[name])
    bpy.context.window.scene = second
    return lambda: _activate("Touch")


def _excluded_collection() -> Callable[[], None]:
    layer = bpy.context.view_layer.layer_collection
    layer.children["HFX Effects"].exclude = True
    return lambda: _activate("Avatar")


def _hidden_effect() -> Callable[[], None]:
    def again() -> None:
        _activate("Ball")
        if "Ball" in bpy.context.view_layer.objects:
            bpy.data.objects["Ball"].hide_set(True)

    return again


def _linked_file() -> Callable[[], None]:
    path = bpy.data.filepath
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(path, link=True) as (there, here):
        here.collections, here.objects = ["HFX Effects"], there.objects
    scene = bpy.context.scene
    scene.collection.children.link(here.collections[0])
    for obj in here.objects:
        if obj.name not in scene.objects:
            scene.collection.objects.link(obj)
    return lambda: _activate("Touch")


def _mesh_without_vertices() -> Callable[[], None]:
    empty = bpy.data.objects.new("Empty Mesh", bpy.data.meshes.new("Empty Mesh"))
    bpy.context.scene.collection.objects.link(empty)
    return lambda: _activate("Empty Mesh")


def _armature_without_bones() -> Callable[[], None]:
    empty = bpy.data.objects.new("Empty Rig", bpy.data.armatures.new("Empty Rig"))
    bpy.context.scene.collection.objects.link(empty)
    return lambda: _activate("Empty Rig")


def _spoilt_area() -> Callable[[], None]:
    effect = bpy.data.objects["Touch"]
    effect["hfx_vertices"], effect["hfx_weights"] = [10**8, -4], [1.0, float("nan")]
    return lambda: _activate("Touch")


def _other_modality() -> Callable[[], None]:
    bpy.data.objects["Touch"].hfx.modality = "temperature"
    return lambda: _activate("Touch")


def _flat_body() -> Callable[[], None]:
    _body().scale = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    return lambda: _activate("Touch")


SITUATIONS = {
    function.__name__.strip("_"): function
    for function in (
        _nothing,
        _no_active_object,
        _volume_in_edit_mode,
        _avatar_in_edit_mode,
        _body_in_pose_mode,
        _being_painted,
        _painted_effect_deleted,
        _body_deleted,
        _avatar_deleted,
        _body_of_another_scene,
        _excluded_collection,
        _hidden_effect,
        _linked_file,
        _mesh_without_vertices,
        _armature_without_bones,
        _spoilt_area,
        _other_modality,
        _flat_body,
    )
}


@pytest.fixture(scope="module")
def saved(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene()
    _activate("Touch")
    bpy.ops.hfx.add_clip(name="Clip")
    return hfx_scenes.save(tmp_path_factory.mktemp("awkward") / "scene.blend")


def _operators() -> Iterator[tuple[str, dict[str, Any]]]:
    for name in sorted(dir(bpy.ops.hfx)):
        if name not in _NOT_HERE:
            for arguments in _ARGUMENTS.get(name, [{}]):
                yield name, arguments


@pytest.mark.parametrize("situation", SITUATIONS)
def test_every_operator_works_or_says_what_it_needs(
    saved: Path, situation: str, tmp_path: Path
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(saved))
    again = SITUATIONS[situation]()
    turn = list(SITUATIONS).index(situation)
    faults = []
    for name, arguments in _operators():
        is_turn = name not in _SLOW or _SLOW.index(name) % 4 == turn % 4
        if not is_turn and situation not in _WITH_ALL:
            continue
        again()
        operator = getattr(bpy.ops.hfx, name)
        can = operator.poll()
        try:
            operator(**arguments)
        except RuntimeError as error:
            text = str(error)
            refused = text.partition(".poll() ")[2]
            is_told = text.startswith("Error: ") if can else refused.strip() not in ("", _UNTOLD)
            if not is_told or "Traceback" in text or "Python:" in text:
                faults.append(f"{name}{arguments or ''}: {text.strip()}")
        in_a_mode = {o for o in bpy.context.view_layer.objects if o.mode != "OBJECT"}
        if in_a_mode - {bpy.context.object}:
            faults.append(f"{name}{arguments or ''}: left an object in its mode")
    assert faults == []


_UNTOLD = "failed, context is incorrect"
