# SPDX-License-Identifier: GPL-3.0-or-later
"""A map at full strength everywhere gets a warning with the material and the setting to change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import pytest
from test_surface_baking import bumpy, new_material, node, wave

from hfx_blender.export.scene_export import ExportSettings, export_scene


@pytest.fixture
def plane(scene: Any) -> Any:
    bpy.ops.mesh.primitive_plane_add(size=0.2)
    obj = bpy.context.object
    obj.name = "Wall"
    obj.data.materials.append(new_material("Bricks"))
    return obj


def make(obj: Any, capfd: Any) -> str:
    """Message for the user."""
    bpy.ops.hfx.add_surface(source="MATERIAL")
    obj.hfx.surface.resolution = 64
    capfd.readouterr()
    bpy.ops.hfx.bake_surface()
    return "\n".join(line for line in capfd.readouterr().out.splitlines() if "Warning" in line)


def test_a_bump_of_a_metre_is_told_with_material_node_and_what_to_set(
    plane: Any, capfd: Any
) -> None:
    """Blender's Bump node makes heights of 1 m by itself until 4.3."""
    bump = bumpy(plane.data.materials[0], distance=1.0, strength=1.0)
    messages = make(plane, capfd)
    assert messages.count("Warning") == 1
    assert "'Wall'" in messages and "Bump node of material 'Bricks' has heights of 1 m" in messages
    assert "set its Distance" in messages and "0.001 m" in messages
    bump.inputs["Distance"].default_value = 0.001
    capfd.readouterr()
    bpy.ops.hfx.bake_surface()
    assert "Warning" not in capfd.readouterr().out, "what it says helps"
    assert plane.hfx.surface.warning == ""


def test_a_displacement_of_a_metre_is_told(plane: Any, capfd: Any) -> None:
    tree = plane.data.materials[0].node_tree
    displacement = tree.nodes.new("ShaderNodeDisplacement")
    displacement.inputs["Scale"].default_value = 1.0
    tree.links.new(wave(plane.data.materials[0]), displacement.inputs["Height"])
    tree.links.new(
        displacement.outputs[0], node(plane.data.materials[0], "OUTPUT_MATERIAL").inputs[2]
    )
    assert "Displacement node of material 'Bricks'" in make(plane, capfd)


def test_a_relief_that_can_be_felt_is_not_complained_of(plane: Any, capfd: Any) -> None:
    bumpy(plane.data.materials[0])
    assert make(plane, capfd) == "" and plane.hfx.surface.warning == ""


def test_a_steep_relief_of_small_nodes_is_told_without_blaming_one(plane: Any, capfd: Any) -> None:
    bumpy(plane.data.materials[0])
    make(plane, capfd)
    plane.hfx.surface.full_slope = 1e-3
    bpy.ops.hfx.bake_surface()
    assert "raise Full Slope" in plane.hfx.surface.warning
    assert "Bricks" not in plane.hfx.surface.warning


def test_an_export_notes_it(plane: Any, capfd: Any, tmp_path: Path) -> None:
    bumpy(plane.data.materials[0], distance=1.0, strength=1.0)
    make(plane, capfd)
    bpy.ops.hfx.add_avatar()
    scene = bpy.context.scene
    scene.frame_start = scene.frame_end = 1
    report = export_scene(scene, tmp_path, "a", ExportSettings())
    (note,) = (text for text in report.notes if "full strength" in text)
    assert "surface 'Wall'" in note and "Bricks" in note
