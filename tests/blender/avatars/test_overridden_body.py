# SPDX-License-Identifier: GPL-3.0-or-later
"""A linked and overridden character gives the same contacts as a local character."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.paths import paths
from hfx_blender.avatars import avatar_meshes, stored_fits
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.live_scene import LiveScene

PLACE = (0.0, 0.1, 1.2)


def character(
    path: Path,
    *,
    is_body: bool = True,
    scale: float = 1.0,
    parts: int = 1,
    with_point: bool = False,
) -> None:
    """A file with a collection 'Anna': an armature with meshes."""
    bpy.ops.hfx.add_avatar()
    rig = bpy.context.object
    rig.name = "Anna"
    if parts > 1:
        (skin,) = avatar_meshes.meshes_of(rig)
        second = skin.copy()
        second.data = skin.data.copy()
        bpy.context.collection.objects.link(second)
        avatar_meshes.store_meshes(rig, [skin, second])
    if not is_body:
        rig.hfx.role, rig.hfx.avatar, rig.hfx.uid = "NONE", None, ""
    objects = [rig, *rig.children_recursive]
    if with_point:
        bpy.ops.hfx.add_spot(modality="vibration", name="Point")
        point = bpy.context.object
        paths.draw(point, np.array([(-0.09, 0.076, 1.35), (0.09, 0.076, 1.35)]))
        objects.append(point)
    if scale != 1.0:
        rig.scale = (scale,) * 3
        for item in objects:
            item.select_set(True)
        bpy.context.view_layer.objects.active = rig
        bpy.ops.object.transform_apply(scale=True)
    collection = bpy.data.collections.new("Anna")
    bpy.context.scene.collection.children.link(collection)
    for item in dict.fromkeys([*objects, *avatar_meshes.meshes_of(rig)]):
        for old in list(item.users_collection):
            old.objects.unlink(item)
        collection.objects.link(item)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)


def linked(path: Path) -> Any:
    with bpy.data.libraries.load(str(path), link=True) as (_, expected):
        expected.collections = ["Anna"]
    return expected.collections[0]


def overridden(path: Path) -> Any:
    """The armature of the override."""
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 25, 0, 4
    linked(path).override_hierarchy_create(scene, bpy.context.view_layer, do_fully_editable=True)
    body = next(o for o in scene.objects if o.type == "ARMATURE")
    assert body.override_library is not None
    for item in bpy.context.view_layer.objects:
        item.select_set(item == body)
    bpy.context.view_layer.objects.active = body
    return body


def lean(body: Any) -> None:
    bone = next(b for b in body.pose.bones if b.name.startswith("spine03"))
    bone.rotation_mode = "XYZ"
    bone.rotation_euler.x = 0.4
    bone.keyframe_insert("rotation_euler", frame=0)


def add_effects() -> None:
    bpy.ops.hfx.add_spot(modality="vibration", name="Point")
    bpy.ops.hfx.add_volume(shape="SPHERE")
    volume = bpy.context.object
    volume.hfx.radius, volume.location = 0.2, PLACE


def felt() -> list[tuple[list[int], list[float]]]:
    scene = bpy.context.scene
    scene.frame_set(2)
    runs = LiveScene(scene, bpy.context.view_layer, STANDARD).runs()
    return [(run.vertices.tolist(), np.round(run.weights, 3).tolist()) for run in runs]


def reopen(path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))


def body_of_scene() -> Any:
    return next(o for o in bpy.context.scene.objects if o.hfx.role == "BODY")


def test_an_overridden_body_is_felt_as_its_own_file_s_even_after_saving(
    scene: Any, tmp_path: Path
) -> None:
    bpy.ops.hfx.add_avatar()
    lean(bpy.context.object)
    add_effects()
    own = felt()
    bpy.ops.wm.read_homefile(use_empty=True)
    character(tmp_path / "anna.blend")
    lean(overridden(tmp_path / "anna.blend"))
    add_effects()
    assert felt() == own
    reopen(tmp_path / "shot.blend")
    body = body_of_scene()
    assert body.hfx.avatar.override_library is not None, "not the mesh of the other file"
    assert felt() == own
    report = export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())
    assert report.notes == ()
    with TrackReader(tmp_path / "a.hfxtrack") as track:
        assert sum(len(run.vertices) for run in track.runs()) > 100


def test_all_meshes_of_an_overridden_avatar_stay_its_own(scene: Any, tmp_path: Path) -> None:
    character(tmp_path / "anna.blend", parts=2)
    overridden(tmp_path / "anna.blend")
    reopen(tmp_path / "shot.blend")
    meshes = avatar_meshes.meshes_of(body_of_scene())
    assert len(meshes) == 2
    assert all(mesh.override_library is not None for mesh in meshes)


def test_an_overridden_character_becomes_a_body_and_stays_one(scene: Any, tmp_path: Path) -> None:
    """With a separate fit, because the character is taller than the canonical avatar."""
    character(tmp_path / "anna.blend", is_body=False, scale=1.1)
    body = overridden(tmp_path / "anna.blend")
    bpy.ops.hfx.mark_body()
    assert stored_fits.is_fitted(body)
    add_effects()
    before, uid, rows = felt(), body.hfx.uid, len(body.hfx.bone_map)
    quality = stored_fits.quality_of(body)
    assert rows > 100 and quality
    reopen(tmp_path / "shot.blend")
    again = body_of_scene()
    assert again.hfx.uid == uid and len(again.hfx.bone_map) == rows
    assert stored_fits.quality_of(again) == quality
    assert felt() == before


def test_an_overridden_point_moves_on_its_path_but_its_path_is_the_other_file_s(
    scene: Any, tmp_path: Path
) -> None:
    character(tmp_path / "anna.blend", with_point=True)
    overridden(tmp_path / "anna.blend")
    point = next(o for o in bpy.context.scene.objects if o.hfx.kind == "SPOT")
    bpy.context.view_layer.objects.active = point
    before = list(point[paths.PATH])
    for operator, options in (
        (bpy.ops.hfx.slide_spot, {"place": (0.09, 0.076, 1.35)}),
        (bpy.ops.hfx.draw_path, {"stroke": [{"name": "", "place": (0, 0.05, 1.2), "time": 0.0}]}),
    ):
        with pytest.raises(RuntimeError, match=r"belongs to anna\.blend.*make the effect local"):
            operator(**options)
    assert list(point[paths.PATH]) == before
    bpy.ops.hfx.slide_spot(place=(0.09, 0.076, 1.35), along_path=True)
    assert point.hfx.path_position == pytest.approx(1.0, abs=1e-3)


def test_a_linked_character_cannot_be_marked_and_is_told_what_to_do(
    scene: Any, tmp_path: Path
) -> None:
    character(tmp_path / "anna.blend", is_body=False)
    scene = bpy.context.scene
    scene.collection.children.link(linked(tmp_path / "anna.blend"))
    bpy.context.view_layer.objects.active = next(o for o in scene.objects if o.type == "ARMATURE")
    with pytest.raises(RuntimeError, match=r"'Anna' is linked from .*library override"):
        bpy.ops.hfx.mark_body()


def test_a_body_that_is_only_an_instance_is_told(scene: Any, tmp_path: Path) -> None:
    character(tmp_path / "anna.blend")
    empty = bpy.data.objects.new("Anna Here", None)
    empty.instance_type, empty.instance_collection = (
        "COLLECTION",
        linked(tmp_path / "anna.blend"),
    )
    bpy.context.scene.collection.objects.link(empty)
    bpy.ops.hfx.add_volume(shape="SPHERE")
    from hfx_blender.errors import InputError

    with pytest.raises(InputError, match="'Anna' only as an instance, by 'Anna Here'"):
        export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())
