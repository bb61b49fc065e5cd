# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatars of several meshes: chosen, fitted and followed as a single surface."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.scene import SkinBinding, SurfaceBinding
from hfx_blender.engine.stepwise import finish
from hfx_blender.errors import InputError

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")
from mathutils import Matrix  # noqa: E402
from mathutils.bvhtree import BVHTree  # noqa: E402
from own_avatar import mark, opened  # noqa: E402

from hfx_blender.avatars import (  # noqa: E402
    avatar_meshes,
    bodies,
    body_binding,
    bone_table,
    stored_fits,
)
from hfx_blender.blender import early_imports  # noqa: E402

MODEL_ID = "hfx-temperature-1"


def strongest_bones(skin: Any) -> list[str]:
    """Strongest bone of each vertex of a mesh."""
    names = [group.name for group in skin.vertex_groups]
    return [
        names[max(vertex.groups, key=lambda element: element.weight).group]
        for vertex in skin.data.vertices
    ]


def cut_out(
    skin: Any,
    name: str,
    wanted: Callable[[str], bool],
    place: Callable[[Any], bool] = lambda _: True,
) -> Any:
    """Copy a mesh object with only the faces moved by given bones at a given location."""
    bones = strongest_bones(skin)
    mesh = skin.data
    faces = [
        list(face.vertices)
        for face in mesh.polygons
        if wanted(bones[face.vertices[0]]) and place(skin.matrix_world @ face.center)
    ]
    stored = sorted({vertex for face in faces for vertex in face})
    number = {vertex: k for k, vertex in enumerate(stored)}
    new = bpy.data.meshes.new(name)
    new.from_pydata(
        [tuple(mesh.vertices[vertex].co) for vertex in stored],
        [],
        [[number[vertex] for vertex in face] for face in faces],
    )
    part = bpy.data.objects.new(name, new)
    bpy.context.scene.collection.objects.link(part)
    for group in skin.vertex_groups:
        part.vertex_groups.new(name=group.name)
    for k, vertex in enumerate(stored):
        for element in mesh.vertices[vertex].groups:
            part.vertex_groups[element.group].add([k], element.weight, "REPLACE")
    part.parent = skin.parent
    part.modifiers.new("Armature", "ARMATURE").object = skin.parent
    return part


def is_hand(bone: str) -> bool:
    return "Hand" in bone or bone in _EXTRA["hand"]


def is_head(bone: str) -> bool:
    return bone.endswith(("Head", "Neck")) or bone in _EXTRA["head"]


def behind_the_face(place: Any) -> bool:
    """Locations of hair on the tests' avatar, 1.8 m tall and looking towards -Y."""
    return place.z > 1.58 and (place.y > -0.06 or place.z > 1.74)


def is_trunk(bone: str) -> bool:
    return "Spine" in bone or bone.endswith("Hips") or bone in _EXTRA["trunk"]


_EXTRA: dict[str, set[str]] = {"hand": set(), "head": set(), "trunk": set()}


def _sort_extras(rig: Any) -> None:
    """Extra bones without a Mixamo name belong to their nearest named parent."""
    for actual in _EXTRA.values():
        actual.clear()
    for bone in rig.data.bones:
        if not bone.name.startswith("extra"):
            continue
        above = bone.parent
        while above is not None and above.name.startswith("extra"):
            above = above.parent
        name = "" if above is None else above.name
        for kind, test in (("hand", is_hand), ("head", is_head), ("trunk", is_trunk)):
            if name and not name.startswith("extra") and test(name):
                _EXTRA[kind].add(bone.name)


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    rig, skin = opened()
    _sort_extras(rig)
    return rig, skin


def in_pieces(skin: Any) -> dict[str, Any]:
    """Body, head and hands as objects of their own, the whole mesh gone."""
    parts = {
        "Hands": cut_out(skin, "Hands", is_hand),
        "Head": cut_out(skin, "Head", is_head),
        "Body": cut_out(skin, "Body", lambda bone: not is_hand(bone) and not is_head(bone)),
    }
    bpy.data.objects.remove(skin)
    return parts


def swell(part: Any, distance: float) -> Any:
    """Move a mesh outwards: hair over a head, a jacket over a torso."""
    part.data.update()
    normals = [vertex.normal.copy() for vertex in part.data.vertices]
    for vertex, normal in zip(part.data.vertices, normals, strict=True):
        vertex.co += distance * normal
    return part


def eyes_of(rig: Any) -> Any:
    """Two small balls moved by the head."""
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.012, location=(0.03, -0.09, 1.7))
    eyes = bpy.context.object
    eyes.name = "Eyes"
    head = next(bone.name for bone in rig.data.bones if bone.name.endswith(":Head"))
    group = eyes.vertex_groups.new(name=head)
    group.add(list(range(len(eyes.data.vertices))), 1.0, "REPLACE")
    eyes.modifiers.new("Armature", "ARMATURE").object = rig
    return eyes


def chosen(rig: Any, *selected: Any) -> list[str]:
    """Meshes taken by "Add Haptic Body" with the present selection."""
    for obj in bpy.context.scene.objects:
        obj.select_set(obj in (rig, *selected))
    return [mesh.name for mesh in finish(bodies.choosing_meshes(bpy.context, rig))]


def names_of(rig: Any) -> list[str]:
    return [mesh.name for mesh in avatar_meshes.meshes_of(rig)]


def test_the_selected_meshes_are_fitted_to_as_one_body(scene: Any) -> None:
    rig, skin = opened(is_fitted=True)
    _sort_extras(rig)
    whole = stored_fits.fitted_model(rig, "hfx-pressure-1").vertices
    parts = in_pieces(skin)
    mark(rig, *parts.values())
    assert names_of(rig)[0] == "Body" and sorted(names_of(rig)) == ["Body", "Hands", "Head"]
    fitted = stored_fits.fitted_model(rig, "hfx-pressure-1")
    error_m = np.linalg.norm(fitted.vertices - whole, axis=1)
    model = load_model("hfx-pressure-1")
    for part in np.unique(model.part):
        assert np.median(error_m[model.part == part]) < 0.005
    # Each vertex is bound to the mesh at the same location.
    counts = np.cumsum([len(mesh.data.vertices) for mesh in avatar_meshes.meshes_of(rig)])
    assert fitted.anchors.corners.max() < counts[-1]
    on_mesh = np.searchsorted(counts, fitted.anchors.corners[:, 0], side="right")
    fingers = model.part == 6
    assert np.all(on_mesh[fingers] == names_of(rig).index("Hands"))
    assert np.mean(on_mesh[model.part == 0] == names_of(rig).index("Head")) > 0.8


def test_what_is_seen_is_taken_and_the_rest_is_named(
    anna: tuple[Any, Any], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, skin = anna
    for _ in range(2):  # more vertices than the skin has: size must not decide
        swell(cut_out(skin, "Hair", is_head, behind_the_face), 0.03)
    swell(cut_out(skin, "Jacket", is_trunk), 0.03)
    eyes_of(rig)
    hidden = cut_out(skin, "Hidden Body", lambda _: True)
    in_pieces(skin)
    hidden.hide_set(True)
    assert sorted(chosen(rig)) == ["Body", "Hands", "Head", "Jacket"]
    rig.hfx.felt_layer = "SKIN"
    assert chosen(rig)[0] == "Body" and sorted(chosen(rig)) == ["Body", "Hands", "Head"]
    searched: list[object] = []
    real = bone_table.map_bones
    monkeypatch.setattr(bone_table, "map_bones", lambda *a: searched.append(a) or real(*a))
    mark(rig)
    assert len(searched) == 1  # for the choice of meshes, the fit and the table
    output = capfd.readouterr().out
    assert "left out, as they show no skin: 'Eyes' and 'Hair' and 'Hair.001' and 'Jacket'" in output
    # With a new active layer, the same button takes different meshes.
    rig.hfx.felt_layer = "VISIBLE"
    assert sorted(chosen(rig)) == ["Body", "Hands", "Head", "Jacket"]


def test_clothes_count_where_there_is_no_skin_under_them(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    swell(cut_out(skin, "Shirt", is_trunk), 0.01)
    cut_out(skin, "Skin", lambda bone: not is_trunk(bone))
    bpy.data.objects.remove(skin)
    assert sorted(chosen(rig)) == ["Shirt", "Skin"]


def test_a_body_keeps_its_meshes_until_others_are_selected(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    parts = in_pieces(skin)
    swell(cut_out(parts["Head"], "Hair", is_head), 0.03)
    bodies.mark_body(rig, [parts["Body"], bpy.data.objects["Hair"]])
    assert chosen(rig) == ["Body", "Hair"]
    assert chosen(rig, parts["Head"], parts["Body"]) == ["Body", "Head"]


def test_a_mesh_that_follows_no_bone_is_no_part_of_the_skin(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match=r"'Cube' follows no bone of 'Anna'"):
        mark(rig, skin, bpy.data.objects["Cube"])
    assert rig.hfx.role == "NONE" and not rig.hfx.avatar and not rig.hfx.avatar_parts


def test_meshes_with_transforms_of_their_own_are_followed_by_their_surface(
    anna: tuple[Any, Any],
) -> None:
    rig, skin = anna
    parts = in_pieces(skin)
    change = Matrix.LocRotScale((0.3, -0.2, 0.1), None, (2.0, 2.0, 2.0))
    parts["Head"].data.transform(change.inverted())
    parts["Head"].matrix_world = change
    bpy.context.view_layer.update()
    mark(rig, *parts.values())
    assert isinstance(body_binding.binding_of(rig, [MODEL_ID]), SkinBinding)
    parts["Hands"].modifiers["Armature"].use_deform_preserve_volume = True
    binding = body_binding.binding_of(rig, [MODEL_ID])
    assert isinstance(binding, SurfaceBinding) and "Preserve Volume" in binding.reason

    arm = rig.pose.bones["mixamorig:LeftForeArm"]
    head = rig.pose.bones["mixamorig:Head"]
    for bone, angles in ((arm, (0.9, 0.0, 0.4)), (head, (0.5, 0.3, 0.0))):
        bone.rotation_mode, bone.rotation_euler = "XYZ", angles
    rig.location = (0.0, 5.0, 0.0)
    graph = bpy.context.evaluated_depsgraph_get()
    surface = body_binding.read_surfaces(rig, lambda obj: obj.evaluated_get(graph))
    anchors = binding.anchors[MODEL_ID]
    points = np.einsum("vc,vci->vi", anchors.weights, surface[anchors.corners])
    to_world = np.array(rig.hfx.avatar.evaluated_get(graph).matrix_world)
    points = points @ to_world[:3, :3].T + to_world[:3, 3]
    trees = [_tree(mesh, graph) for mesh in parts.values()]
    distance = [min(tree.find_nearest(point)[3] for tree in trees) for point in points.tolist()]
    assert np.max(distance) < 1e-4

    # An export reads the same.
    oracle.add_painted("Felt", "temperature", rig)
    evaluation = oracle.evaluate(bpy.context.scene, record=("positions",), rate_hz=1)
    assert any("Preserve Volume" in text for text in evaluation.reader.description.warnings)
    index = int(evaluation.reader.sample_indices[0])
    positions = evaluation.of("Felt", index).positions
    heights = np.abs(anchors.offset_m)
    assert np.all(np.linalg.norm(positions - points, axis=1) < heights + 1e-4)


def _tree(mesh: Any, graph: Any) -> BVHTree:
    """Tree of a posed mesh, with quads cut as in the rest pose."""
    evaluated = mesh.evaluated_get(graph)
    mesh.data.calc_loop_triangles()
    return BVHTree.FromPolygons(
        [evaluated.matrix_world @ vertex.co for vertex in evaluated.data.vertices],
        [tuple(triangle.vertices) for triangle in mesh.data.loop_triangles],
    )


def test_what_was_edited_since_is_told_by_the_mesh(anna: tuple[Any, Any], tmp_path: Path) -> None:
    rig, skin = anna
    parts = in_pieces(skin)
    mark(rig, *parts.values())
    path = tmp_path / "anna.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    rig = bpy.data.objects["Anna"]
    assert stored_fits.fitted_model(rig, MODEL_ID) is not None
    bpy.data.objects["Head"].data.vertices.add(1)
    with pytest.raises(InputError, match="mesh 'Head', which has"):
        stored_fits.fitted_model(rig, MODEL_ID)
    bpy.data.objects.remove(bpy.data.objects["Head"])
    with pytest.raises(InputError, match=r"fitted to 3 meshes .*, its avatar has 2 now"):
        stored_fits.fitted_model(rig, MODEL_ID)


def test_a_body_can_be_told_to_follow_its_bones_or_its_surface(scene: Any) -> None:
    rig, skin = opened(is_fitted=True)
    assert body_binding.warning_of(rig) is None
    rig.hfx.follow = "SURFACE"
    assert isinstance(body_binding.binding_of(rig, [MODEL_ID]), SurfaceBinding)
    assert "surface, because that is chosen" in body_binding.warning_of(rig)
    skin.modifiers["Armature"].use_deform_preserve_volume = True
    rig.hfx.follow = "BONES"
    assert isinstance(body_binding.binding_of(rig, [MODEL_ID]), SkinBinding)
    assert "although Preserve Volume is on" in body_binding.warning_of(rig)
    rig.hfx.follow = "AUTO"
    assert isinstance(body_binding.binding_of(rig, [MODEL_ID]), SurfaceBinding)
    assert "because Preserve Volume is on" in body_binding.warning_of(rig)
    rig.hfx.follow, rig.hfx.avatar = "SURFACE", None
    with pytest.raises(InputError, match="has no mesh"):
        body_binding.binding_of(rig, [MODEL_ID])


def test_the_built_in_avatar_can_follow_the_surface_of_several_meshes(scene: Any) -> None:
    rig, skin = bodies.add_avatar(bpy.context)
    mark(rig, skin)
    rig.hfx.follow = "SURFACE"
    one = body_binding.binding_of(rig, [MODEL_ID]).anchors[MODEL_ID]
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 9))
    mark(rig, skin, bpy.context.object)
    two = body_binding.binding_of(rig, [MODEL_ID]).anchors[MODEL_ID]
    assert rig.hfx.avatar == skin and names_of(rig)[1] == "Cube"
    rest = np.array([vertex.co for vertex in skin.data.vertices])
    for anchors in (one, two):
        corners = rest[anchors.corners]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        places = np.einsum("vc,vci->vi", anchors.weights, corners)
        places += anchors.offset_m[:, None] * across
        assert np.abs(places - load_model(MODEL_ID).vertices).max() < 2e-4


def test_a_volume_that_comes_and_goes_is_felt_on_a_surface_as_with_positions(scene: Any) -> None:
    """A volume present twice; with positions, the surface is read at all times."""
    rig, skin = bodies.add_avatar(bpy.context)
    mark(rig, skin)
    rig.hfx.follow = "SURFACE"
    scene.frame_start, scene.frame_end = 0, 127  # four blocks of 32 samples
    ball = oracle.add_volume("Ball", "temperature", "SPHERE", (0.0, 0.0, 1.1), radius=0.2)
    ball.constraints.new("LIMIT_LOCATION")
    places = [(0, 9.0), (30, 9.0), (36, 0.0), (40, 9.0), (96, 9.0), (127, 0.05)]
    oracle.key(ball, "location", [(frame, (x, 0.0, 1.1)) for frame, x in places])

    def felt(**record: Any) -> dict[int, bytes]:
        evaluation = oracle.evaluate(scene, rate_hz=scene.render.fps, **record)
        samples = evaluation.samples["Ball"].items()
        return {k: item.vertices.tobytes() for k, item in samples}

    lazy, every = felt(), felt(record=["positions"])
    assert lazy == every and {36, 127} <= lazy.keys() and 80 not in lazy


def test_a_fit_waits_for_the_imports_of_the_other_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both threads would import the same packages, and wait for each other."""
    is_done = threading.Event()
    imports = threading.Thread(target=is_done.wait)
    imports.start()
    monkeypatch.setattr(early_imports, "begin", lambda: imports)
    steps = bodies._importing()
    assert next(steps) == 0.0 and next(steps) == 0.0
    is_done.set()
    assert list(steps) in ([], [0.0])
    assert not imports.is_alive()
