# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools that drag out an effect: its place and size by the drag, and their registration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bl_ui.space_toolsystem_common import ToolSelectPanelHelper
from mathutils import Vector

from hfx_blender.operators.effects.drag_operator import depth_of
from hfx_blender.ui import toolbar
from release import tool_icons


def drag(kind: str, start: Any, end: Any, **settings: Any) -> Any:
    bpy.ops.hfx.drag_effect(kind=kind, start=start, end=end, **settings)
    bpy.context.view_layer.update()
    return bpy.context.object


def test_a_sphere_reaches_from_its_centre_to_the_end(scene: Any) -> None:
    ball = drag("SPHERE", (1.0, 2.0, 3.0), (1.0, 2.3, 3.4), modality="pressure")
    assert (ball.hfx.modality, ball.hfx.shape) == ("pressure", "SPHERE")
    assert tuple(ball.matrix_world.translation) == pytest.approx((1.0, 2.0, 3.0))
    assert ball.hfx.radius == pytest.approx(0.5)
    assert drag("SPHERE", (0, 0, 0), (0, 0, 0)).hfx.radius == 0.5, "a click has the default size"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_box_has_the_dragged_base_and_the_height_to_either_side(scene: Any, axis: int) -> None:
    lengths, middle, end = [2.0, 4.0, 6.0], [1.0, -2.0, 3.0], [2.0, -4.0, 6.0]
    lengths[axis], middle[axis], end[axis] = 1.0, -0.5, 0.0
    box = drag("CUBOID", (0, 0, 0), end, height=-1.0)
    assert tuple(box.hfx.size) == pytest.approx(lengths)
    assert tuple(box.location) == pytest.approx(middle)


def test_a_wind_blows_along_the_drag_and_spans_it(scene: Any) -> None:
    wind = drag("WIND", (-1.0, 0.0, 1.0), (2.0, 0.0, 1.0), modality="pressure")
    assert wind.hfx.modality == "wind"
    assert tuple(wind.matrix_world.translation) == pytest.approx((0.5, 0.0, 1.0))
    assert tuple(wind.matrix_world.col[2].to_3d()) == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    assert wind.hfx.size[2] == pytest.approx(3.0)


def test_a_point_lies_on_the_body_that_was_hit(scene: Any) -> None:
    with pytest.raises(RuntimeError, match="Add an avatar"):
        drag("SPOT", (0, 0, 0), (0, 0, 0.1))
    assert not len(scene.objects)
    bpy.ops.hfx.add_avatar()
    chest = Vector((0.03, -0.12, 1.25))
    point = drag("SPOT", chest, chest + Vector((0.05, 0.0, 0.0)), modality="wind")
    assert point.hfx.modality == "vibration", "a point has no wind"
    assert point.hfx.radius == pytest.approx(0.05)
    assert np.linalg.norm(point.matrix_world.translation - chest) < 0.04


def test_a_drag_beside_all_objects_is_as_deep_as_the_next_body(scene: Any) -> None:
    scene.cursor.location = (0.0, 5.0, 0.0)
    toward = Vector((0.0, 1.0, 0.0))
    beside = Vector((1.0, -9.0, 1.0))
    assert depth_of(bpy.context, beside, toward) == scene.cursor.location
    bpy.ops.hfx.add_avatar()
    bpy.context.object.location = (0.0, 0.0, 0.0)
    bpy.ops.hfx.add_avatar()
    bpy.context.object.location = (9.0, 2.0, 0.0)
    bpy.context.view_layer.update()
    # The avatar is 1.7 m high, and stands on its origin.
    for x, y in ((1.0, 0.0), (8.0, 2.0)):
        middle = depth_of(bpy.context, Vector((x, -9.0, 1.0)), toward)
        assert middle.y == pytest.approx(y, abs=0.15)
        assert middle.z == pytest.approx(0.85, abs=0.15)


def test_the_tools_are_in_the_toolbar_of_object_mode(scene: Any) -> None:
    panel = ToolSelectPanelHelper._tool_class_from_space_type("VIEW_3D")
    flat = panel._tools_flatten(panel.tools_from_context(bpy.context, "OBJECT"))
    names = [tool.idname for tool in flat if tool is not None]
    own = [f"hfx.drag_{kind}" for kind in ("sphere", "cuboid", "spot", "wind")]
    assert [name for name in names if name.startswith("hfx.")] == own
    toolbar.unregister()
    toolbar.register()
    flat = panel._tools_flatten(panel.tools_from_context(bpy.context, "OBJECT"))
    again = [tool.idname for tool in flat if tool is not None]
    assert again == names, "registered once"


def test_the_icons_of_the_tools_are_read_by_blender() -> None:
    for tool in toolbar._TOOLS:
        file = Path(f"{tool.bl_icon}.dat")
        content = file.read_bytes()
        # Three corners of two bytes, and three colours of four bytes, for each triangle.
        assert content[:4] == b"VCO\0" and (len(content) - 8) % 18 == 0
        assert content == tool_icons.icon(file.stem), "drawn by this script"
        assert bpy.app.icons.new_triangles_from_file(str(file)) > 0
