# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's own avatar becomes a haptic body: followed, painted on, stored, or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.scene import SkinBinding, SurfaceBinding
from hfx_blender.errors import InputError

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")
from own_avatar import mark, own_avatar  # noqa: E402

from hfx_blender.authoring import painting  # noqa: E402
from hfx_blender.avatars import bodies, stored_fits  # noqa: E402
from hfx_blender.engine.stepwise import finish  # noqa: E402

MODEL_ID = "hfx-pressure-1"


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    scene.frame_start, scene.frame_end = 1, 6
    rig, skin = own_avatar(scene)
    mark(rig, skin)
    return rig, skin


def world_surface_distance(skin: Any, points: np.ndarray) -> np.ndarray:
    """Distance of world points from an evaluated mesh."""
    from mathutils.bvhtree import BVHTree

    evaluated = skin.evaluated_get(bpy.context.evaluated_depsgraph_get())
    tree = BVHTree.FromPolygons(
        [evaluated.matrix_world @ vertex.co for vertex in evaluated.data.vertices],
        [tuple(polygon.vertices) for polygon in evaluated.data.polygons],
    )
    return np.array([tree.find_nearest(point)[3] for point in points.tolist()])


def bend(rig: Any) -> None:
    """Bend a rig from rest into a pose with raised arms, bent knees and closed hands."""
    for name, angles in (
        ("LeftArm", (0.5, 0.2, 0.3)),
        ("RightForeArm", (0.9, 0.0, 0.4)),
        ("LeftLeg", (1.0, 0.0, 0.0)),
        ("RightHandIndex2", (0.8, 0.0, 0.0)),
        ("Spine1", (0.3, 0.1, 0.0)),
    ):
        bone = rig.pose.bones[f"mixamorig:{name}"]
        bone.rotation_mode = "XYZ"
        bone.keyframe_insert("rotation_euler", frame=1)
        bone.rotation_euler = angles
        bone.keyframe_insert("rotation_euler", frame=6)


def test_the_fit_lies_on_the_avatar_in_the_world(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    assert rig.hfx.role == "BODY" and rig.hfx.avatar == skin
    for model_id in ("hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1"):
        fitted = stored_fits.fitted_model(rig, model_id)
        assert len(fitted.vertices) == len(load_model(model_id))
        world = np.array(rig.matrix_world)
        points = fitted.vertices @ world[:3, :3].T + world[:3, 3]
        distance = world_surface_distance(skin, points[:: len(points) // 500])
        # The canonical models lie up to 4.5 mm over the coarse avatar.
        assert distance.max() < 0.007 and np.median(distance) < 0.001


def test_another_mesh_of_the_same_shape_gets_nearly_the_same_fit(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    exact = stored_fits.fitted_model(rig, MODEL_ID).vertices
    skin.modifiers["Armature"].show_viewport = False
    skin.modifiers.new("Decimate", "DECIMATE").ratio = 0.4
    graph = bpy.context.evaluated_depsgraph_get()
    mesh = bpy.data.meshes.new_from_object(skin.evaluated_get(graph), depsgraph=graph)
    skin.modifiers.remove(skin.modifiers["Decimate"])
    skin.modifiers["Armature"].show_viewport = True
    skin.data = mesh
    mark(rig, skin)
    error_m = np.linalg.norm(stored_fits.fitted_model(rig, MODEL_ID).vertices - exact, axis=1) / 100
    model = load_model(MODEL_ID)
    for part in np.unique(model.part):
        assert np.median(error_m[model.part == part]) < 0.005


def test_positions_are_as_blender_deforms_the_painted_mesh(
    scene: Any, anna: tuple[Any, Any]
) -> None:
    rig, skin = anna
    bend(rig)
    effect = oracle.add_painted("Felt", "pressure", rig)
    evaluation = oracle.evaluate(scene, record=("positions",), rate_hz=10)
    assert isinstance(evaluation.reader.description.bodies[0].binding, SkinBinding)
    for index in evaluation.reader.sample_indices.tolist():
        oracle.set_time(scene, evaluation.reader.time.frame(index))
        positions = evaluation.of("Felt", index).positions
        canvas = painting.begin(bpy.context, effect)  # in the pose of this frame
        expected = oracle.world_vertices(scene, canvas)
        painting.end(effect)
        assert np.linalg.norm(positions - expected, axis=1).max() < 1e-5
        assert np.percentile(world_surface_distance(skin, positions[::40]), 95) < 0.003


def test_an_avatar_that_more_than_bones_deform_is_followed_by_its_surface(
    scene: Any, anna: tuple[Any, Any]
) -> None:
    rig, skin = anna
    skin.modifiers["Armature"].use_deform_preserve_volume = True
    bend(rig)
    oracle.add_painted("Felt", "pressure", rig)
    evaluation = oracle.evaluate(scene, record=("positions",), rate_hz=10)
    assert isinstance(evaluation.reader.description.bodies[0].binding, SurfaceBinding)
    index = int(evaluation.reader.sample_indices[-1])
    oracle.set_time(scene, evaluation.reader.time.frame(index))
    positions = evaluation.of("Felt", index).positions
    assert world_surface_distance(skin, positions[::40]).max() < 0.0025


def test_the_fit_survives_copy_save_and_append(
    scene: Any, anna: tuple[Any, Any], tmp_path: Path
) -> None:
    before = stored_fits.fitted_model(anna[0], MODEL_ID)
    copy = anna[0].copy()
    path = tmp_path / "anna.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    actual = [stored_fits.fitted_model(copy, MODEL_ID)]
    bpy.ops.wm.open_mainfile(filepath=str(path))
    actual.append(stored_fits.fitted_model(bpy.data.objects["Anna"], MODEL_ID))
    for link in (False, True):
        bpy.ops.wm.read_homefile(use_empty=True)
        with bpy.data.libraries.load(str(path), link=link) as (_, requested):
            requested.objects = ["Anna"]
        actual.append(stored_fits.fitted_model(requested.objects[0], MODEL_ID))
    for after in actual:
        assert after.vertices.tobytes() == before.vertices.tobytes()
        assert after.weights.values.tobytes() == before.weights.values.tobytes()
        assert after.anchors.corners.tobytes() == before.anchors.corners.tobytes()
        assert after.bone_names == before.bone_names


def test_the_built_in_avatar_needs_no_fit(scene: Any) -> None:
    rig, skin = bodies.add_avatar(bpy.context)
    mark(rig, skin)
    assert not stored_fits.is_fitted(rig)


@pytest.mark.parametrize("edit", ["bone", "mesh"])
def test_an_avatar_that_was_edited_since_is_refused(
    scene: Any, anna: tuple[Any, Any], edit: str
) -> None:
    rig, skin = anna
    if edit == "bone":
        bpy.context.view_layer.objects.active = rig
        bpy.ops.object.mode_set(mode="EDIT")
        rig.data.edit_bones["mixamorig:LeftHand"].head.x += 3.0
        bpy.ops.object.mode_set(mode="OBJECT")
    else:
        skin.data.vertices.add(1)
    with pytest.raises(InputError, match="fit the body again"):
        stored_fits.fitted_model(rig, MODEL_ID)
    mark(rig, skin)
    assert stored_fits.fitted_model(rig, MODEL_ID) is not None


def test_doubtful_bones_are_warnings(scene: Any) -> None:
    rig, skin = own_avatar(scene)
    warnings = finish(bodies.adding_body(rig, skin))
    assert any("toes" in warning for warning in warnings)


def _no_mesh(rig: Any, skin: Any) -> None:
    bpy.data.objects.remove(skin)


def _no_weights(rig: Any, skin: Any) -> None:
    skin.vertex_groups.clear()


def _no_faces(rig: Any, skin: Any) -> None:
    skin.data.clear_geometry()


def _no_human(rig: Any, skin: Any) -> None:
    for number, bone in enumerate(rig.data.bones):
        bone.name = f"tentacle{number}"
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in rig.data.edit_bones:
        bone.parent = None
    bpy.ops.object.mode_set(mode="OBJECT")


def _not_human(rig: Any, skin: Any) -> None:
    """Shins and feet stand out to the side, thrice as long: known names, no person."""
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in rig.data.edit_bones:
        bone.use_connect = False
    for bone in rig.data.edit_bones:
        if bone.name.endswith(("LeftLeg", "RightLeg", "Foot", "ToeBase")):
            for end in (bone.head, bone.tail):
                end.xyz = end.y, end.z, 3.0 * end.x
    bpy.ops.object.mode_set(mode="OBJECT")


def _mirrored(rig: Any, skin: Any) -> None:
    skin.scale.x = -1.0


def _flat(rig: Any, skin: Any) -> None:
    rig.scale = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_no_mesh, "has no mesh"),
        (_no_weights, "follow no bone"),
        (_no_faces, "has no faces"),
        (_no_human, "human"),
        (_not_human, "human"),
        (_mirrored, "negative scale"),
        (_flat, "scaled by zero"),
    ],
)
def test_what_cannot_be_used_is_refused_and_nothing_changes(
    scene: Any, spoil: Any, message: str
) -> None:
    rig, skin = own_avatar(scene, centimetres=False)
    spoil(rig, skin)
    bpy.context.view_layer.update()
    meshes = [obj for obj in scene.objects if obj.type == "MESH"]
    before = everything(rig)
    with pytest.raises(RuntimeError, match=message) as caught:
        mark(rig, *meshes)
    assert len(str(caught.value).strip().splitlines()) == 1
    assert everything(rig) == before


def test_without_scipy_it_is_told_what_to_install(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, skin = own_avatar(scene, centimetres=False)
    before = everything(rig)
    monkeypatch.setattr(bodies, "find_spec", lambda name: None)
    with pytest.raises(RuntimeError, match="needs the Python package scipy"):
        mark(rig, skin)
    assert everything(rig) == before


def test_a_mesh_without_armature_is_told_to_get_one(scene: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match="Select an armature"):
        bpy.ops.hfx.mark_body()


def test_a_linked_armature_is_refused(scene: Any, tmp_path: Path) -> None:
    rig, _ = own_avatar(scene, centimetres=False)
    path = tmp_path / "anna.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, requested):
        requested.objects = [rig_name := "Anna", "Anna Skin"]
    rig, skin = requested.objects
    assert rig.name == rig_name
    for obj in (rig, skin):
        bpy.context.scene.collection.objects.link(obj)
    with pytest.raises(RuntimeError, match="is linked from"):
        mark(rig, skin)
    assert rig.hfx.role == "NONE"


def everything(rig: Any) -> dict[str, Any]:
    """State left unchanged by a refused body."""
    hfx = rig.hfx
    return {
        "data": {
            name: [block.name for block in getattr(bpy.data, name)]
            for name in ("objects", "meshes", "armatures", "materials", "collections")
        },
        "own": sorted(rig.keys()),
        "hfx": (hfx.role, hfx.uid, hfx.avatar, len(hfx.avatar_parts), len(hfx.bone_map)),
        "active": bpy.context.view_layer.objects.active,
    }
