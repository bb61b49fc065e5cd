# SPDX-License-Identifier: GPL-3.0-or-later
"""Wires of volumes: redrawn after edits of the mesh, and warned about by exports."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hfx_blender.authoring import handlers, volumes
from hfx_blender.blender import compat, events
from hfx_blender.reading.scene_reader import SceneReader

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

SIZES = {
    "CUBOID": {"size": (0.4, 0.6, 1.0)},
    "SPHERE": {"radius": 0.5},
    "CYLINDER": {"radius": 0.3, "height": 0.8},
    "CAPSULE": {"radius": 0.2, "height": 1.2},
}
HALVES = {
    "CUBOID": (0.2, 0.3, 0.5),
    "SPHERE": (0.5, 0.5, 0.5),
    "CYLINDER": (0.3, 0.3, 0.4),
    "CAPSULE": (0.2, 0.2, 0.6),
}
"""Half of the extents of the wires of :data:`SIZES`."""


@pytest.fixture
def body(scene: Any) -> Any:
    scene.frame_start, scene.frame_end = 1, 2
    return oracle.add_avatar()


@pytest.fixture
def in_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Handlers act as in a Blender with a window."""
    app = SimpleNamespace(background=False)
    fake = SimpleNamespace(app=app, types=bpy.types, data=bpy.data)
    monkeypatch.setattr(handlers, "bpy", fake)


def add(shape: str, name: str = "Ball", **settings: Any) -> Any:
    volume = oracle.add_volume(
        name, "pressure", shape, (0.0, 0.0, 1.1), **(settings or SIZES[shape])
    )
    bpy.context.view_layer.update()
    return volume


def select(*objects: Any) -> None:
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    bpy.context.view_layer.objects.active = objects[0]


def apply_scale(volume: Any, scale: tuple[float, float, float] = (2.0, 2.0, 2.0)) -> None:
    select(volume)
    volume.scale = scale
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    bpy.context.view_layer.update()


def move_in_edit_mode(volume: Any) -> None:
    select(volume)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.transform.translate(value=(0.0, 0.0, 0.7))
    bpy.context.view_layer.update()


def stored(volume: Any) -> Any:
    """Raw stored properties, written without the property's update."""
    return compat.stored_properties(volume)["hfx"]


def points_of(volume: Any) -> np.ndarray:
    return np.array([vertex.co[:] for vertex in volume.data.vertices])


def corners_of(volume: Any) -> list[float]:
    points = points_of(volume)
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def warnings() -> list[str]:
    texts = SceneReader(bpy.context.scene).description.warnings
    return [text for text in texts if "wire" in text]


def warning(name: str) -> str:
    return (
        f"effect '{name}': its wire differs from its size in the panel Haptic Effect, which is "
        "exported; change the size there instead of applying a scale or editing the mesh"
    )


@pytest.mark.parametrize("shape", SIZES)
def test_a_wire_spans_its_shape(body: Any, shape: str) -> None:
    volume = add(shape)
    half = HALVES[shape]
    assert corners_of(volume) == pytest.approx([-h for h in half] + [*half])
    points = points_of(volume)
    assert len(points) == {"CUBOID": 8, "SPHERE": 96, "CYLINDER": 72, "CAPSULE": 132}[shape]
    if shape == "SPHERE":
        assert np.linalg.norm(points, axis=1) == pytest.approx(0.5)
        assert [np.sum(np.abs(points[:, k]) < 1e-7) for k in range(3)] == [36, 36, 36]
    if shape == "CAPSULE":
        # The distance from the axis between the centres of the caps, at height -0.4 and 0.4.
        ends = np.clip(points[:, 2], -0.4, 0.4)
        assert np.linalg.norm(points - ends[:, None] * [0, 0, 1], axis=1) == pytest.approx(0.2)
        lengths = [np.linalg.norm(np.subtract(*points[[*e.vertices]])) for e in volume.data.edges]
        assert sum(length > 0.1 for length in lengths) == 4, "the sides of the cylinder"


@pytest.mark.parametrize("shape", SIZES)
def test_applying_a_scale_redraws_the_wire(body: Any, in_window: None, shape: str) -> None:
    volume = add(shape)
    before = points_of(volume)
    apply_scale(volume)
    assert points_of(volume) == pytest.approx(before, abs=1e-6)
    assert tuple(volume.scale) == (1.0, 1.0, 1.0) and not warnings()


def test_moving_the_origin_redraws_the_wire(body: Any, in_window: None) -> None:
    volume = add("SPHERE")
    select(volume)
    bpy.context.scene.cursor.location = (0.0, 0.0, 1.4)
    bpy.ops.object.origin_set(type="ORIGIN_CURSOR")
    bpy.context.view_layer.update()
    assert volume.location.z == pytest.approx(1.4)
    assert corners_of(volume) == pytest.approx([-0.5] * 3 + [0.5] * 3)


def test_edits_are_redrawn_after_edit_mode(body: Any, in_window: None) -> None:
    volume = add("SPHERE")
    move_in_edit_mode(volume)
    assert volume.mode == "EDIT"
    volume.update_from_editmode()
    volume.update_tag()
    bpy.context.view_layer.update()
    assert corners_of(volume)[5] == pytest.approx(1.2)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    assert corners_of(volume) == pytest.approx([-0.5] * 3 + [0.5] * 3)


def test_joined_and_separated_wires_are_redrawn(body: Any, in_window: None) -> None:
    ball, box = add("SPHERE"), add("CUBOID", "Box")
    box.location.x = 3.0
    bpy.context.view_layer.update()
    select(ball, box)
    bpy.ops.object.join()
    bpy.context.view_layer.update()
    assert "Box" not in bpy.data.objects and len(ball.data.vertices) == 96
    select(ball)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.separate(type="LOOSE")
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    parts = [obj for obj in bpy.data.objects if obj.name.startswith("Ball")]
    assert [len(part.data.vertices) for part in parts] == [96, 96, 96]


def test_an_emptied_wire_is_redrawn(body: Any, in_window: None) -> None:
    volume = add("SPHERE")
    volume.data.clear_geometry()
    bpy.context.view_layer.update()
    assert len(volume.data.vertices) == 96


def test_faces_of_a_joined_model_stay(body: Any, in_window: None) -> None:
    volume = add("SPHERE")
    bpy.ops.mesh.primitive_cube_add(size=4.0, location=(0.0, 0.0, 1.1))
    cube = bpy.context.object
    select(volume, cube)
    bpy.ops.object.join()
    bpy.context.view_layer.update()
    assert len(volume.data.polygons) == 6 and warnings() == [warning("Ball")]


def test_a_running_transform_keeps_the_vertices(
    body: Any, in_window: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = add("SPHERE")
    asked = []
    monkeypatch.setattr(volumes, "is_painting", lambda operator: asked.append(operator) or True)
    apply_scale(volume)
    assert corners_of(volume)[3] == pytest.approx(1.0) and set(asked) == {"TRANSFORM_OT_"}
    monkeypatch.setattr(volumes, "is_painting", events.is_painting)
    volume.update_tag()
    bpy.context.view_layer.update()
    assert corners_of(volume)[3] == pytest.approx(0.5)


@pytest.mark.parametrize("what", ["modifier", "shape key", "nan", "negative"])
def test_a_wire_is_redrawn_once(
    body: Any, in_window: None, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    volume = add("SPHERE")
    if what == "modifier":
        volume.modifiers.new("Row", "ARRAY")
    elif what == "shape key":
        volume.shape_key_add(name="Basis")
        key = volume.shape_key_add(name="Wide")
        for point in key.data:
            point.co *= 3.0
        key.value = 1.0
    else:  # past the limits of the property
        stored(volume)["radius"] = float("nan") if what == "nan" else -2.0
    drawn = []
    draw = volumes.refresh_display
    monkeypatch.setattr(
        volumes, "refresh_display", lambda effect: drawn.append(effect) or draw(effect)
    )
    for _ in range(4):
        volume.data.update_tag()
        volume.update_tag()
        bpy.context.view_layer.update()
    assert len(drawn) <= (what == "negative")


def test_linked_duplicates_get_wires_of_their_own(body: Any, in_window: None) -> None:
    volume = add("SPHERE")
    copy = volume.copy()
    bpy.context.scene.collection.objects.link(copy)
    bpy.context.view_layer.update()
    assert copy.data == volume.data
    move_in_edit_mode(volume)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.view_layer.update()
    for obj in (volume, copy):
        assert corners_of(obj) == pytest.approx([-0.5] * 3 + [0.5] * 3)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("scale", [(2.0, 2.0, 2.0), (1.0, 1.0, 1.01)])
def test_an_export_names_an_edited_wire(
    body: Any, shape: str, scale: tuple[float, float, float]
) -> None:
    volume = add(shape)
    apply_scale(volume, scale)
    points = points_of(volume)
    assert warnings() == [warning("Ball")]
    assert np.array_equal(points_of(volume), points), "an export changes nothing"
    volume.hfx.is_muted = True
    add("SPHERE", "Other")
    assert not warnings(), "nothing of a muted volume is exported"


def test_the_warning_ends_with_a_size_set_in_the_panel(body: Any) -> None:
    volume = add("SPHERE")
    apply_scale(volume)
    volume.hfx.radius = 1.0
    assert not warnings()


def test_each_edited_wire_of_equal_volumes_is_named(body: Any) -> None:
    for name in ("A", "B", "C"):
        add("SPHERE", name)
    apply_scale(bpy.data.objects["B"])
    bpy.data.objects["C"].data.clear_geometry()
    assert warnings() == [warning("B"), warning("C")]


def test_a_file_saved_with_an_edited_wire(body: Any, tmp_path: Path) -> None:
    volume = add("SPHERE")
    move_in_edit_mode(volume)
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "edited.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "edited.blend"))
    assert warnings() == [warning("Ball")]
    assert corners_of(bpy.data.objects["Ball"])[5] == pytest.approx(1.2)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (-2.0, -2.0, -2.0), (0.5, 3.0, 1.0)])
def test_untouched_volumes_give_no_warning(
    body: Any, shape: str, scale: tuple[float, float, float]
) -> None:
    volume = add(shape)
    volume.scale = scale
    volume.rotation_euler = 0.3, 0.2, 0.1
    bpy.context.view_layer.update()
    assert not warnings()


@pytest.mark.parametrize(
    ("shape", "settings"),
    [
        ("SPHERE", {"radius": 0.0}),
        ("CUBOID", {"size": (1.0, 0.0, 1e-6)}),
        ("CYLINDER", {"radius": 1e-5, "height": 1e5}),
        ("CAPSULE", {"radius": 0.7, "height": 0.2}),
    ],
)
def test_extreme_sizes_give_no_warning(body: Any, shape: str, settings: dict[str, Any]) -> None:
    add(shape, **settings)
    add("SPHERE", "Other")
    assert not warnings()


def test_modifiers_and_hidden_volumes_give_no_warning(body: Any) -> None:
    row, hidden = add("SPHERE", "Row"), add("SPHERE", "Hidden")
    row.modifiers.new("Row", "ARRAY")
    bpy.context.view_layer.update()
    assert row.bound_box[6][0] == pytest.approx(1.5)
    hidden.hide_set(True)
    bpy.context.view_layer.update()
    hidden.hfx.radius = 2.0
    assert not warnings()


@pytest.mark.parametrize("path", ["radius", "size", "shape"])
def test_animated_sizes_give_no_warning(body: Any, path: str) -> None:
    volume = add("CUBOID" if path == "size" else "SPHERE")
    value = {"radius": 2.0, "size": (3.0, 3.0, 3.0), "shape": "CYLINDER"}[path]
    volume.hfx.keyframe_insert(path, frame=1)
    setattr(volume.hfx, path, value)
    volume.hfx.keyframe_insert(path, frame=2)
    bpy.context.scene.frame_set(1)
    # The wire is that of the last edit, at frame 2.
    assert getattr(volume.hfx, path) != value and not warnings()


def test_linked_duplicates_of_another_size_give_no_warning(body: Any) -> None:
    volume = add("SPHERE")
    copy = volume.copy()
    bpy.context.scene.collection.objects.link(copy)
    stored(copy)["radius"] = 2.0
    bpy.context.view_layer.update()
    assert copy.data == volume.data and copy.hfx.radius == 2.0
    assert not warnings()


def test_overrides_of_another_size_keep_the_linked_mesh(
    body: Any, in_window: None, tmp_path: Path
) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    lamp = add("SPHERE", "Lamp")
    bpy.data.libraries.write(str(tmp_path / "lamp.blend"), {lamp})
    bpy.data.objects.remove(lamp)
    with bpy.data.libraries.load(str(tmp_path / "lamp.blend"), link=True) as (_, into):
        into.objects = ["Lamp"]
    (linked,) = into.objects
    override = linked.override_create()
    bpy.context.scene.collection.objects.link(override)
    stored(override)["radius"] = 2.0
    override.update_tag()
    bpy.context.view_layer.update()
    assert override.data.library is not None and override.hfx.radius == 2.0
    assert not warnings()


def test_meshes_and_surfaces_keep_their_mesh(body: Any, in_window: None) -> None:
    bpy.ops.mesh.primitive_cube_add(size=0.3, location=(0.0, 0.0, 1.1))
    cube = bpy.context.object
    bpy.ops.hfx.volume_from_mesh(modality="pressure")
    volume = next(obj for obj in bpy.data.objects if obj.hfx.shape == "MESH")
    cube.data.vertices[0].co *= 2.0
    cube.data.update()
    bpy.context.view_layer.update()
    assert len(volume.data.polygons) == 6 and not warnings()
