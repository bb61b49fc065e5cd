# SPDX-License-Identifier: GPL-3.0-or-later
"""An avatar's mesh in Edit Mode: its vertices are read as before the mode began."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from hfx_blender.avatars import avatar_meshes  # noqa: E402
from hfx_blender.blender import mesh_arrays  # noqa: E402


def test_the_mesh_of_an_avatar_is_read_in_edit_mode(scene):
    """Blender takes the attribute "position" away from a mesh that is edited."""
    bpy.ops.hfx.add_avatar()
    body = bpy.context.object
    skin = body.hfx.avatar
    at_rest, triangles = avatar_meshes.rest_surface(body, skin, {})
    bpy.context.view_layer.objects.active = skin
    skin.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        assert "position" not in skin.data.attributes
        points, same = avatar_meshes.rest_surface(body, skin, {})
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(points, at_rest)
    np.testing.assert_array_equal(same, triangles)


def test_a_mesh_without_vertices_has_no_positions():
    mesh = bpy.data.meshes.new("empty")
    assert mesh_arrays.positions(mesh).shape == (0, 3)
    bpy.data.meshes.remove(mesh)
