# SPDX-License-Identifier: GPL-3.0-or-later
"""Modifiers and shape keys of an avatar's mesh: the change of the skin is measured."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hfx_blender.engine.scene import SkinBinding, SurfaceBinding

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

from hfx_blender.avatars import bodies, body_binding, evaluated_skin  # noqa: E402


@pytest.fixture
def avatar(scene: Any) -> tuple[Any, Any]:
    return bodies.add_avatar(bpy.context)


def modifier(kind: str, **settings: Any) -> Callable[[Any], Any]:
    def add(skin: Any) -> Any:
        added = skin.modifiers.new(kind.title(), kind)
        for name, value in settings.items():
            setattr(added, name, value)
        return added

    return add


def mask(skin: Any) -> Any:
    """Hide the skin below the ankles."""
    group = skin.vertex_groups.new(name="hidden")
    group.add([v.index for v in skin.data.vertices if v.co.z < 0.1], 1.0, "REPLACE")
    return modifier("MASK", vertex_group="hidden", invert_vertex_group=True)(skin)


def in_scene(obj: Any) -> Any:
    bpy.context.scene.collection.objects.link(obj)
    return obj


def normals_of_another(skin: Any) -> Any:
    source = in_scene(bpy.data.objects.new("Source", skin.data.copy()))
    return modifier(
        "DATA_TRANSFER", object=source, use_loop_data=True, data_types_loops={"CUSTOM_NORMAL"}
    )(skin)


def around(kind: str, target: str, bind: str = "") -> Callable[[Any], Any]:
    """A deforming modifier with a box around the skin, bound to the skin or unbound."""

    def add(skin: Any) -> Any:
        box = in_scene(bpy.data.objects.new("Box", bpy.data.meshes.new("Box")))
        corners = [(x, y, z) for z in (-0.1, 2.0) for y in (-0.6, 0.6) for x in (-1.2, 1.2)]
        faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
        box.data.from_pydata(corners, [], faces)
        added = modifier(kind, **{target: box})(skin)
        if bind:
            with bpy.context.temp_override(object=skin, active_object=skin):
                getattr(bpy.ops.object, bind)(modifier=added.name)
            assert added.is_bound
        return added

    return add


def cage(skin: Any) -> Any:
    """Add a lattice modifier to a mesh; its lattice is at rest and deforms nothing."""
    lattice = in_scene(bpy.data.objects.new("Cage", bpy.data.lattices.new("Cage")))
    lattice.location, lattice.scale = (0.0, 0.0, 0.9), (2.0, 2.0, 2.0)
    return modifier("LATTICE", object=lattice)(skin)


def ball(skin: Any) -> Any:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1.5, location=(0.0, 0.0, 0.9))
    return modifier("SHRINKWRAP", target=bpy.context.object)(skin)


def node_group(*names: str) -> Any:
    """Geometry nodes in a row, from the input to the output."""
    group = bpy.data.node_groups.new("Group", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    nodes = [group.nodes.new(name) for name in ("NodeGroupInput", *names, "NodeGroupOutput")]
    for node, following in pairwise(nodes):
        ends = [
            next(socket for socket in sockets if socket.type == "GEOMETRY")
            for sockets in (node.outputs, following.inputs)
        ]
        group.links.new(*ends)
    return group


def nodes(*names: str) -> Callable[[Any], Any]:
    return lambda skin: modifier("NODES", node_group=node_group(*names))(skin)


def lifting(skin: Any) -> Any:
    group = node_group("GeometryNodeSetPosition")
    moved = next(node for node in group.nodes if node.bl_idname == "GeometryNodeSetPosition")
    moved.inputs["Offset"].default_value = (0.0, 0.0, 0.05)
    return modifier("NODES", node_group=group)(skin)


def stubble(skin: Any) -> Any:
    """Little cubes on the unchanged skin."""
    group = node_group()
    make = {
        name: group.nodes.new(f"GeometryNode{name}")
        for name in ("DistributePointsOnFaces", "MeshCube", "InstanceOnPoints", "RealizeInstances")
    }
    joined = group.nodes.new("GeometryNodeJoinGeometry")
    given, result = group.nodes["Group Input"], group.nodes["Group Output"]
    make["MeshCube"].inputs["Size"].default_value = (0.05, 0.05, 0.05)
    for one, socket, second, into in (
        (given, "Geometry", make["DistributePointsOnFaces"], "Mesh"),
        (make["DistributePointsOnFaces"], "Points", make["InstanceOnPoints"], "Points"),
        (make["MeshCube"], "Mesh", make["InstanceOnPoints"], "Instance"),
        (make["InstanceOnPoints"], "Instances", make["RealizeInstances"], "Geometry"),
        (given, "Geometry", joined, "Geometry"),
        (make["RealizeInstances"], "Geometry", joined, "Geometry"),
        (joined, "Geometry", result, "Geometry"),
    ):
        group.links.new(one.outputs[socket], second.inputs[into])
    return modifier("NODES", node_group=group)(skin)


def twice(skin: Any) -> Any:
    return modifier("ARMATURE", object=skin.parent)(skin)


STAYS = {
    "mask": mask,
    "outline": modifier("SOLIDIFY", thickness=0.002, offset=1.0),
    "thick inwards": modifier("SOLIDIFY", thickness=0.01, offset=-1.0),
    "weld": modifier("WELD"),
    "bevel by weight": modifier("BEVEL", limit_method="WEIGHT"),
    "triangulate": modifier("TRIANGULATE"),
    "subdivision": modifier("SUBSURF"),
    "multiresolution": modifier("MULTIRES"),
    "edge split": modifier("EDGE_SPLIT"),
    "weighted normal": modifier("WEIGHTED_NORMAL"),
    "data transfer": normals_of_another,
    "uv warp": modifier("UV_WARP"),
    "uv project": modifier("UV_PROJECT"),
    "decimate": modifier("DECIMATE", ratio=0.5),
    "mirror": modifier("MIRROR"),
    "array": modifier("ARRAY"),
    "displaced by nothing": modifier("DISPLACE", strength=0.0),
    "smoothed a little": modifier("SMOOTH", iterations=1),
    "cast by nothing": modifier("CAST", factor=0.0),
    "shade smooth": nodes("GeometryNodeSetShadeSmooth"),
    "store attribute": nodes("GeometryNodeStoreNamedAttribute"),
    "stubble": stubble,
    "frame beside": modifier("WIREFRAME", use_replace=False),
    "mesh deform, not bound": around("MESH_DEFORM", "object"),
    "surface deform, not bound": around("SURFACE_DEFORM", "target"),
}
"""Modifiers that leave the skin where the armature puts it."""

MOVES = {
    "half a shell outwards": modifier("SOLIDIFY", thickness=0.03, offset=0.0),
    "displace": modifier("DISPLACE", strength=0.02, mid_level=0.0),
    "smoothed away": modifier("SMOOTH", iterations=30),
    "lattice": cage,
    "mesh deform": around("MESH_DEFORM", "object", "meshdeform_bind"),
    "surface deform": around("SURFACE_DEFORM", "target", "surfacedeform_bind"),
    "shrinkwrap": ball,
    "cloth": modifier("CLOTH"),
    "wave": modifier("WAVE"),
    "set position": lifting,
    "wireframe": modifier("WIREFRAME"),
}
"""Modifiers that move it, or may at another time."""

MAKES_ANEW = {"mirror"}  # above the armature's a Mirror modifier belongs to the mesh


def datablocks() -> dict[str, int]:
    kinds = ("objects", "meshes", "armatures", "scenes", "shape_keys", "lattices")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def put_above_the_armature(skin: Any, added: Any) -> None:
    skin.modifiers.move(skin.modifiers.find(added.name), 0)


@pytest.mark.parametrize("where", ["below", "above"])
@pytest.mark.parametrize("name", STAYS)
def test_skin_that_stays_is_followed_by_its_bones(
    avatar: tuple[Any, Any], name: str, where: str
) -> None:
    body, skin = avatar
    added = STAYS[name](skin)
    if where == "above":
        put_above_the_armature(skin, added)
    before = datablocks()
    # Before 4.4 Join Geometry drops the vertex groups: an armature below it poses no vertex.
    if (name, where) == ("stubble", "above") and bpy.app.version < (4, 4):
        assert body_binding.surface_reason(body) == f"modifier '{added.name}' deforms it too"
        return
    assert body_binding.surface_reason(body) is None
    assert body_binding.warning_of(body) is None
    assert datablocks() == before
    assert "hfx_vertex" not in skin.data.attributes


@pytest.mark.parametrize("where", ["below", "above"])
@pytest.mark.parametrize("name", MOVES)
def test_skin_that_moves_is_followed_by_its_surface(
    avatar: tuple[Any, Any], name: str, where: str
) -> None:
    body, skin = avatar
    added = MOVES[name](skin)
    if where == "above":
        put_above_the_armature(skin, added)
    before = datablocks()
    assert body_binding.surface_reason(body) == f"modifier '{added.name}' deforms it too"
    assert datablocks() == before


def test_the_one_that_moves_the_skin_is_named(avatar: tuple[Any, Any]) -> None:
    body, skin = avatar
    mask(skin)
    modifier("SOLIDIFY", thickness=0.002, offset=1.0)(skin)
    modifier("DISPLACE", strength=0.02, mid_level=0.0)(skin)
    modifier("BEVEL", limit_method="WEIGHT")(skin)
    assert "'Displace'" in str(body_binding.surface_reason(body))
    skin.modifiers["Displace"].show_viewport = False
    assert body_binding.surface_reason(body) is None
    twice(skin)
    assert "several armature modifiers" in str(body_binding.surface_reason(body))


def test_settings_that_change_with_time_are_not_measured(avatar: tuple[Any, Any]) -> None:
    body, skin = avatar
    modifier("DISPLACE", strength=0.0)(skin)
    assert body_binding.surface_reason(body) is None
    skin.keyframe_insert('modifiers["Displace"].strength', frame=1)
    assert "'Displace'" in str(body_binding.surface_reason(body))


def add_key(skin: Any, name: str, distance: float) -> Any:
    if skin.data.shape_keys is None:
        skin.shape_key_add(name="Basis")
    key = skin.shape_key_add(name=name)
    for point, vertex in zip(key.data, skin.data.vertices, strict=True):
        point.co = vertex.co + distance * vertex.normal
    return key


def test_shape_keys_count_where_they_move_skin(avatar: tuple[Any, Any]) -> None:
    body, skin = avatar
    add_key(skin, "Nothing", 0.0).value = 1.0
    mask(skin)
    assert body_binding.surface_reason(body) is None
    fat = add_key(skin, "Fat", 0.02)
    fat.value = 0.0
    assert body_binding.surface_reason(body) is None  # not on
    fat.value = 1.0
    assert body_binding.surface_reason(body) == "shape keys deform it"
    fat.mute = True
    assert body_binding.surface_reason(body) is None
    fat.mute, fat.value = False, 0.0
    fat.driver_add("value")
    assert body_binding.surface_reason(body) == "shape keys deform it"  # the shape key may be on


def _bent(scene: Any, body: Any) -> None:
    arm = body.pose.bones["lowerarm01.L"]
    arm.rotation_mode = "XYZ"
    oracle.key(arm, "rotation_euler", [(1, (0, 0, 0)), (12, (0.3, 0.9, 0.4))])


def positions(scene: Any, kind: type) -> np.ndarray:
    evaluation = oracle.evaluate(scene, record=("positions",), rate_hz=10)
    assert isinstance(evaluation.reader.description.bodies[0].binding, kind)
    return np.asarray(evaluation.of("Felt", evaluation.reader.sample_indices[-1]).positions)


@pytest.fixture
def felt(scene: Any, avatar: tuple[Any, Any]) -> tuple[Any, Any]:
    scene.frame_start, scene.frame_end = 1, 12
    oracle.add_painted("Felt", "pressure", avatar[0])
    _bent(scene, avatar[0])
    return avatar


@pytest.mark.parametrize("name", ["mask", "outline", "weld", "subdivision", "shade smooth"])
def test_places_are_those_of_the_avatar_without_it(
    scene: Any, felt: tuple[Any, Any], name: str
) -> None:
    alone = positions(scene, SkinBinding)
    STAYS[name](felt[1])
    np.testing.assert_array_equal(positions(scene, SkinBinding), alone)


@pytest.mark.parametrize("name", ["outline", "array", "triangulate"])
def test_vertices_that_are_added_do_not_matter_to_a_surface(
    scene: Any, felt: tuple[Any, Any], name: str
) -> None:
    _, skin = felt
    skin.modifiers["Armature"].use_deform_preserve_volume = True
    alone = positions(scene, SurfaceBinding)
    added = STAYS[name](skin)
    for where in ("below", "above"):
        if where == "above":
            put_above_the_armature(skin, added)
        np.testing.assert_allclose(positions(scene, SurfaceBinding), alone, atol=2e-5)


@pytest.mark.parametrize("with_keys", [False, True])
def test_what_is_hidden_or_merged_is_held_by_the_skin_beside(
    scene: Any, felt: tuple[Any, Any], with_keys: bool
) -> None:
    _, skin = felt
    skin.modifiers["Armature"].use_deform_preserve_volume = True
    if with_keys:
        add_key(skin, "Fat", 0.02).value = 1.0
    alone = positions(scene, SurfaceBinding)
    mask(skin)
    actual = positions(scene, SurfaceBinding)
    off_m = np.linalg.norm(actual - alone, axis=1)
    assert off_m[alone[:, 2] > 0.13].max() < 1e-4  # where skin is left
    assert off_m.max() < 0.08  # held by the shank: about there
    if with_keys:
        return
    put_above_the_armature(skin, modifier("WELD")(skin))
    off_m = np.linalg.norm(positions(scene, SurfaceBinding) - alone, axis=1)
    assert np.quantile(off_m[alone[:, 2] > 0.13], 0.97) < 0.001  # lips, eyelids are merged


def test_a_mesh_of_which_nothing_is_left_is_refused(scene: Any, felt: tuple[Any, Any]) -> None:
    body, skin = felt
    modifier("MASK", vertex_group="head", threshold=1.0)(skin)
    body.hfx.follow = "SURFACE"
    with pytest.raises(body_binding.InputError, match="number of vertices from 12440 to 0"):
        positions(scene, SurfaceBinding)


def test_a_measurement_is_kept_until_something_changes(
    avatar: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    body, skin = avatar
    outline = modifier("SOLIDIFY", thickness=0.002, offset=1.0)(skin)
    measured: list[object] = []
    real = evaluated_skin.measure
    monkeypatch.setattr(evaluated_skin, "measure", lambda *a: measured.append(a) or real(*a))
    for _ in range(3):
        body_binding.surface_reason(body)
    assert len(measured) == 1 and body_binding.is_measured(body)
    outline.offset = -1.0
    assert not body_binding.is_measured(body)
    body_binding.surface_reason(body)
    assert len(measured) == 2
