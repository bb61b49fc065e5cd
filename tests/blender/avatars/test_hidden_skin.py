# SPDX-License-Identifier: GPL-3.0-or-later
"""Geometry hidden by modifiers is no skin: helper geometry of MakeHuman's humans."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
import bmesh  # noqa: E402
from own_avatar import mark, opened  # noqa: E402

from hfx_blender.avatars import avatar_meshes, body_binding, stored_fits  # noqa: E402


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    return opened()


def add_helpers(skin: Any) -> None:
    """Shells 4 cm about the thighs, pieces of their own, in the vertex group "Helpers"."""
    mesh = bmesh.new()
    mesh.from_mesh(skin.data)
    weights = mesh.verts.layers.deform.verify()
    about = [face for face in mesh.faces if 0.55 < face.calc_center_median().z < 0.85]
    about = [face for face in about if abs(face.calc_center_median().x) < 0.3]
    copied = bmesh.ops.duplicate(mesh, geom=about)["geom"]
    group = skin.vertex_groups.new(name="Helpers").index
    mesh.normal_update()
    shell = [vertex for vertex in copied if isinstance(vertex, bmesh.types.BMVert)]
    moved = [(vertex, vertex.co + 0.04 * vertex.normal) for vertex in shell]
    for vertex, position in moved:
        vertex.co = position
        vertex[weights][group] = 1.0
    mesh.to_mesh(skin.data)
    mesh.free()


def mask(skin: Any) -> Any:
    hiding = skin.modifiers.new("Hide Helpers", "MASK")
    hiding.vertex_group, hiding.invert_vertex_group = "Helpers", True
    return hiding


def shown_in_renders_only(skin: Any) -> Any:
    hiding = mask(skin)
    hiding.show_render = False
    return hiding


def hidden_in_renders_only(skin: Any) -> Any:
    hiding = mask(skin)
    hiding.show_viewport = False
    return hiding


def above_the_armature(skin: Any) -> Any:
    hiding = mask(skin)
    skin.modifiers.move(len(skin.modifiers) - 1, 0)
    return hiding


def by_nodes(skin: Any) -> Any:
    group = bpy.data.node_groups.new("Hide", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    given, result = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    named = group.nodes.new("GeometryNodeInputNamedAttribute")
    named.data_type = "FLOAT"
    named.inputs["Name"].default_value = "Helpers"
    above = group.nodes.new("FunctionNodeCompare")
    above.inputs[1].default_value = 0.5
    deleting = group.nodes.new("GeometryNodeDeleteGeometry")
    group.links.new(given.outputs[0], deleting.inputs["Geometry"])
    group.links.new(named.outputs["Attribute"], above.inputs[0])
    group.links.new(above.outputs[0], deleting.inputs["Selection"])
    group.links.new(deleting.outputs[0], result.inputs[0])
    hiding = skin.modifiers.new("Hide", "NODES")
    hiding.node_group = group
    return hiding


HIDING = (
    *(mask, above_the_armature, shown_in_renders_only, hidden_in_renders_only),
    by_nodes,
)


@pytest.mark.parametrize("hide", HIDING)
def test_pieces_that_are_hidden_as_a_whole_are_not_read(anna: tuple[Any, Any], hide: Any) -> None:
    rig, skin = anna
    alone = avatar_meshes.read_mesh(rig, skin)
    add_helpers(skin)
    every = avatar_meshes.read_mesh(rig, skin)
    assert len(every.triangles) > len(alone.triangles) + 500
    hide(skin)
    actual = avatar_meshes.read_mesh(rig, skin)
    np.testing.assert_array_equal(actual.triangles, alone.triangles)
    assert len(actual.vertices) == len(every.vertices)


def test_the_fit_and_the_export_are_those_without_helpers(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    mark(rig, skin)
    before = np.asarray(stored_fits.fitted_model(rig, "hfx-pressure-1").vertices)
    add_helpers(skin)
    mask(skin)
    mark(rig, skin)
    after = np.asarray(stored_fits.fitted_model(rig, "hfx-pressure-1").vertices)
    assert np.linalg.norm(after - before, axis=1).max() < 1e-3
    assert body_binding.surface_reason(rig) is None


def test_skin_that_a_mask_hides_under_clothes_is_still_the_body(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    alone = avatar_meshes.read_mesh(rig, skin)
    group = skin.vertex_groups.new(name="Helpers")
    chest = [vertex.index for vertex in skin.data.vertices if 0.95 < vertex.co.z < 1.3]
    group.add(chest, 1.0, "REPLACE")
    mask(skin)
    actual = avatar_meshes.read_mesh(rig, skin)
    np.testing.assert_array_equal(actual.triangles, alone.triangles)
    bpy.context.view_layer.update()
    mark(rig, skin)
    assert body_binding.surface_reason(rig) is None


def test_shape_keys_that_are_always_on_make_the_shape_that_is_fitted_to(
    anna: tuple[Any, Any],
) -> None:
    rig, skin = anna
    skin.shape_key_add(name="Basis")
    fat, blink, off = (skin.shape_key_add(name=name) for name in ("Fat", "Blink", "Off"))
    shift = {fat: 0.01, blink: 0.03, off: 0.05}
    for key, distance in shift.items():
        for point, vertex in zip(key.data, skin.data.vertices, strict=True):
            point.co = vertex.co + distance * vertex.normal
    fat.value, blink.value, off.value, off.mute = 0.5, 0.0, 1.0, True
    blink.keyframe_insert("value", frame=1)
    rest = np.array([vertex.co for vertex in skin.data.vertices])
    normals = np.array([vertex.normal for vertex in skin.data.vertices])
    vertices = avatar_meshes.read_mesh(rig, skin).vertices
    np.testing.assert_allclose(vertices, rest + 0.005 * normals, atol=1e-5)
    mark(rig, skin)
    assert stored_fits.shape_of(rig, skin) == {"Fat": 0.5}
    assert body_binding.surface_reason(rig) == "shape keys deform it"  # blinks
    skin.data.shape_keys.animation_data_clear()
    assert body_binding.surface_reason(rig) is None
    fat.value = 1.0  # 5 mm away from the fitted skin
    assert body_binding.surface_reason(rig) == "shape keys deform it"
    fat.value = 0.0
    assert "not those that the body was fitted to" in str(body_binding.surface_reason(rig))
