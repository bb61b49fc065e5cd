# SPDX-License-Identifier: GPL-3.0-or-later
"""Baking of surfaces: the material's stated relief is baked, and a bake leaves no trace."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.surfaces import surface_baking
from hfx_blender.errors import InputError

SIZE = 0.2
WAVES = 3


@pytest.fixture
def plane(scene: Any) -> Any:
    bpy.ops.mesh.primitive_plane_add(size=SIZE)
    obj = bpy.context.object
    obj.data.materials.append(new_material("Wavy"))
    return obj


def new_material(name: str) -> Any:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    return material


def node(material: Any, kind: str) -> Any:
    return next(item for item in material.node_tree.nodes if item.type == kind)


def wave(material: Any, output: str = "UV") -> Any:
    """A socket with sin(2 pi WAVES u)."""
    tree = material.node_tree
    position = tree.nodes.new("ShaderNodeTexCoord")
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(position.outputs[output], split.inputs[0])
    many = tree.nodes.new("ShaderNodeMath")
    many.operation = "MULTIPLY"
    many.inputs[1].default_value = 2.0 * np.pi * WAVES
    tree.links.new(split.outputs[0], many.inputs[0])
    sine = tree.nodes.new("ShaderNodeMath")
    sine.operation = "SINE"
    tree.links.new(many.outputs[0], sine.inputs[0])
    return sine.outputs[0]


def bumpy(material: Any, distance: float = 0.001, strength: float = 0.5) -> Any:
    tree = material.node_tree
    bump = tree.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value = distance
    bump.inputs["Strength"].default_value = strength
    tree.links.new(wave(material), bump.inputs["Height"])
    tree.links.new(bump.outputs[0], node(material, "BSDF_PRINCIPLED").inputs["Normal"])
    return bump


def expected(texels: int, amplitude: float) -> np.ndarray:
    u = (np.arange(texels) + 0.5) / texels
    return amplitude * np.sin(2.0 * np.pi * WAVES * u)


def everything() -> list[str]:
    data = bpy.data
    kinds = (data.objects, data.meshes, data.materials, data.images, data.scenes, data.node_groups)
    names = [item.name_full for kind in kinds for item in kind]
    scene = bpy.context.scene
    names += [scene.render.engine, scene.name, str(bpy.context.object)]
    names += [obj.name for obj in bpy.context.selected_objects]
    for material in data.materials:
        names += [material.name, *(item.name for item in material.node_tree.nodes)]
        names.append(str(material.node_tree.nodes.active))
        names.append(str(len(material.node_tree.links)))
    return names


def test_bump_is_its_height_times_distance_and_strength(plane: Any) -> None:
    bumpy(plane.active_material)
    before = everything()
    baked = surface_baking.bake(plane, 64, 8)
    assert np.allclose(baked.heights_m, expected(64, 0.0005), atol=1e-6)
    assert baked.tile_mm == pytest.approx((1000 * SIZE, 1000 * SIZE))
    assert baked.covered.all() and baked.luminance is None and not baked.notes
    assert everything() == before


def test_an_inverted_bump_is_a_dent(plane: Any) -> None:
    bumpy(plane.active_material).invert = True
    assert np.allclose(surface_baking.bake(plane, 64, 4).heights_m, expected(64, -5e-4), atol=1e-6)


def test_displacement_is_added_and_the_objects_scale_counts(plane: Any) -> None:
    material = plane.active_material
    bumpy(material)
    tree = material.node_tree
    displacement = tree.nodes.new("ShaderNodeDisplacement")
    displacement.inputs["Scale"].default_value = 0.002
    displacement.inputs["Midlevel"].default_value = 0.0
    tree.links.new(wave(material), displacement.inputs["Height"])
    output = node(material, "OUTPUT_MATERIAL")
    tree.links.new(displacement.outputs[0], output.inputs["Displacement"])
    plane.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    baked = surface_baking.bake(plane, 64, 4)
    assert np.allclose(baked.heights_m, expected(64, 0.0005 + 0.004), atol=1e-5)
    assert baked.tile_mm[0] == pytest.approx(2000 * SIZE)


def test_units_of_the_scene_are_converted(plane: Any) -> None:
    bumpy(plane.active_material)
    bpy.context.scene.unit_settings.scale_length = 0.01
    baked = surface_baking.bake(plane, 64, 4)
    assert np.allclose(baked.heights_m, expected(64, 0.0005 * 0.01), atol=1e-8)
    assert baked.tile_mm[0] == pytest.approx(10 * SIZE)


def test_what_only_bends_the_normal_is_integrated(plane: Any) -> None:
    material = plane.active_material
    bumpy(material)
    tree, shader = material.node_tree, node(material, "BSDF_PRINCIPLED")
    mix = tree.nodes.new("ShaderNodeMixShader")
    for number in (1, 2):
        tree.links.new(shader.outputs[0], mix.inputs[number])
    tree.links.new(mix.outputs[0], node(material, "OUTPUT_MATERIAL").inputs["Surface"])
    # Texels are square, as of all surfaces: before 4.4 Cycles takes the slope of a Bump node over a
    # third of a texel's mean edge, which shifts the relief by half of that.
    heights = surface_baking.bake(plane, 128, 128).heights_m
    assert np.allclose(heights - heights.mean(), expected(128, 0.0005), atol=2.5e-5)


def test_roughness_is_baked_as_it_is(plane: Any) -> None:
    node(plane.active_material, "BSDF_PRINCIPLED").inputs["Roughness"].default_value = 0.3
    baked = surface_baking.bake(plane, 8, 8)
    assert np.allclose(baked.roughness, 0.3, atol=1e-4) and baked.luminance is not None


def test_each_slot_shows_its_own_material(scene: Any) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=1, size=SIZE)
    obj = bpy.context.object
    for name, roughness in (("A", 0.2), ("B", 0.8)):
        material = new_material(name)
        node(material, "BSDF_PRINCIPLED").inputs["Roughness"].default_value = roughness
        obj.data.materials.append(material)
    for polygon in obj.data.polygons:
        polygon.material_index = int(polygon.center.x > 0)
    roughness = surface_baking.bake(obj, 16, 4).roughness
    assert np.allclose(roughness[:, :8], 0.2, atol=1e-3)
    assert np.allclose(roughness[:, 8:], 0.8, atol=1e-3)


def test_materials_are_restored_if_a_later_one_cannot_be_rewired(
    scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.ops.mesh.primitive_cube_add(size=SIZE)
    obj = bpy.context.object
    for name in ("first", "second"):
        obj.data.materials.append(new_material(name))
    obj.data.polygons.foreach_set("material_index", [k % 2 for k in range(6)])
    rewired: list[Any] = []
    restored: list[Any] = []

    def emission(material: Any, _value: Any) -> Any:
        if rewired:
            raise InputError("no output node")
        rewired.append(material)
        return lambda: restored.append(material)

    monkeypatch.setattr(surface_baking.material_relief, "emission", emission)
    with pytest.raises(InputError, match="no output node"):
        surface_baking.bake(obj, 16, 16)
    assert restored == rewired
    assert len(rewired) == 1


def test_a_tiled_material_is_baked_as_one_tile(plane: Any) -> None:
    bumpy(plane.active_material)
    scale_uvs(plane, 4.0)
    before = everything()
    baked = surface_baking.bake(plane, 64, 8)
    assert np.allclose(baked.heights_m, expected(64, 0.0005), atol=1e-6)
    assert baked.tiles and baked.tile_mm[0] == pytest.approx(250 * SIZE)
    assert "beyond 0 to 1" in baked.notes[0]
    assert everything() == before


def test_the_rim_of_a_chart_is_no_step(plane: Any) -> None:
    """UVs covering a quarter of the map: the rim's height continues outside of the chart."""
    material = plane.active_material
    bumpy(material)
    lifted = material.node_tree.nodes.new("ShaderNodeDisplacement")
    lifted.inputs["Height"].default_value = 1.5
    lifted.inputs["Scale"].default_value = 0.01
    output = node(material, "OUTPUT_MATERIAL")
    material.node_tree.links.new(lifted.outputs[0], output.inputs["Displacement"])
    scale_uvs(plane, 0.5)
    baked = surface_baking.bake(plane, 128, 16)
    assert baked.covered.mean() == pytest.approx(0.25, abs=0.02)
    # The relief lies 10 mm high, so zeros outside of the chart would be a step of 10 mm.
    assert np.abs(np.diff(baked.heights_m, axis=1)).max() < 0.0002
    assert np.allclose(baked.heights_m, 0.01, atol=0.0006)


def scale_uvs(obj: Any, factor: float) -> None:
    layer = obj.data.uv_layers.active
    uv = np.zeros(len(obj.data.loops) * 2, np.float32)
    layer.uv.foreach_get("vector", uv)
    layer.uv.foreach_set("vector", uv * factor)


def remove_uvs(obj: Any) -> None:
    obj.data.uv_layers.remove(obj.data.uv_layers[0])


def overlap(obj: Any) -> None:
    bpy.ops.mesh.primitive_plane_add(size=SIZE, location=(1, 0, 0))
    second = bpy.context.object
    second.data.materials.append(obj.active_material)
    with bpy.context.temp_override(
        active_object=obj, selected_objects=[obj, second], selected_editable_objects=[obj, second]
    ):
        bpy.ops.object.join()
    wave(obj.active_material, "Object")


def unlink_output(obj: Any) -> None:
    tree = obj.active_material.node_tree
    tree.nodes.remove(node(obj.active_material, "OUTPUT_MATERIAL"))


def flatten(obj: Any) -> None:
    obj.scale = (0.0, 0.0, 0.0)


def shrink_uvs(obj: Any) -> None:
    scale_uvs(obj, 0.0)


def spoil_uvs(obj: Any) -> None:
    scale_uvs(obj, float("nan"))


def strip(obj: Any) -> None:
    obj.data.materials.clear()


def clear(obj: Any) -> None:
    obj.data.clear_geometry()


def beyond(obj: Any) -> None:
    scale_uvs(obj, 4.0)
    wave(obj.active_material, "Object")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (remove_uvs, "no UV map"),
        (shrink_uvs, "no area"),
        (spoil_uvs, "not numbers"),
        (overlap, "of its area twice"),
        (beyond, "Object coordinates"),
        (flatten, "no faces of any size"),
        (clear, "no faces of any size|no UV map"),
        (strip, "without a material"),
        (unlink_output, "no Material Output"),
    ],
)
def test_what_cannot_be_baked_is_told_and_leaves_no_trace(
    plane: Any, spoil: Any, message: str
) -> None:
    bumpy(plane.active_material)
    spoil(plane)
    bpy.context.view_layer.update()
    before = everything()
    with pytest.raises(InputError, match=message):
        surface_baking.bake(plane, 16, 16)
    assert everything() == before


@pytest.mark.parametrize("is_pinned", [False, True])
def test_image_editors_keep_their_images(plane: Any, is_pinned: bool) -> None:
    bumpy(plane.active_material)
    areas = bpy.context.window_manager.windows[0].screen.areas
    area = max(areas, key=lambda area: area.width * area.height)
    kind, area.type = area.type, "IMAGE_EDITOR"
    space = area.spaces.active
    space.image = bpy.data.images.new("Painted", 8, 8)
    space.use_image_pin = is_pinned
    surface_baking.bake(plane, 16, 16)
    shown, area.type = space.image, kind
    assert shown is not None and shown.name == "Painted"


def test_a_bake_is_refused_that_would_not_fit_into_memory(plane: Any) -> None:
    with pytest.raises(InputError, match="100000 x 8 texels"):
        surface_baking.bake(plane, 100_000, 8)


def test_modifiers_count(plane: Any) -> None:
    """Modifiers shape the baked surface: a subdivided plane has the same tile."""
    plane.modifiers.new("Finer", "SUBSURF").subdivision_type = "SIMPLE"
    bumpy(plane.active_material)
    bpy.context.view_layer.update()
    assert np.allclose(surface_baking.bake(plane, 64, 4).heights_m, expected(64, 5e-4), atol=1e-6)
