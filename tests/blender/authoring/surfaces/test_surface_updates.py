# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps follow their sources: an edit of a material is noticed, and baked or reported."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring.surfaces import surface_updates, surfaces


@pytest.fixture
def plane(scene: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Any]:
    """A plane of 10 cm with a bumpy noise material, and baked maps."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "user"))
    bpy.ops.mesh.primitive_plane_add(size=0.1)
    obj = bpy.context.object
    material = bpy.data.materials.new("Bumpy")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    noise, bump = nodes.new("ShaderNodeTexNoise"), nodes.new("ShaderNodeBump")
    ramp = nodes.new("ShaderNodeValToRGB")
    noise.name, bump.name, ramp.name = "Noise", "Bump", "Ramp"
    bump.inputs["Distance"].default_value = 0.001
    links.new(noise.outputs[0], ramp.inputs[0])
    links.new(ramp.outputs[0], bump.inputs["Height"])
    shader = next(node for node in nodes if node.bl_idname == "ShaderNodeBsdfPrincipled")
    links.new(bump.outputs[0], shader.inputs["Normal"])
    obj.data.materials.append(material)
    obj.hfx.surface.resolution = 32
    bpy.ops.hfx.add_surface(source="MATERIAL")
    assert not obj.hfx.surface.is_faulty, obj.hfx.surface.note
    yield obj
    for known in (surface_updates.shown_s, surfaces.bake_s, surface_updates.painted_images):
        known.clear()
    for work in (surface_updates.make_waiting, surface_updates.bake_outdated):
        if bpy.app.timers.is_registered(work):
            bpy.app.timers.unregister(work)


def _nodes(obj: Any) -> Any:
    return obj.active_material.node_tree.nodes


def _another_value(obj: Any) -> None:
    _nodes(obj)["Noise"].inputs["Scale"].default_value = 40.0


def _another_ramp(obj: Any) -> None:
    _nodes(obj)["Ramp"].color_ramp.elements[0].position = 0.4


def _another_choice(obj: Any) -> None:
    _nodes(obj)["Bump"].invert = True


def _no_link(obj: Any) -> None:
    links = obj.active_material.node_tree.links
    links.remove(next(link for link in links if link.to_node.name == "Bump"))


def _muted(obj: Any) -> None:
    _nodes(obj)["Bump"].mute = True


def _another_material(obj: Any) -> None:
    obj.active_material = bpy.data.materials.new("Other")


def _in_a_group(obj: Any) -> None:
    group = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    node = _nodes(obj).new("ShaderNodeGroup")
    node.node_tree = group
    surfaces.make_maps(obj)
    assert not surface_updates.has_edited_material(obj)
    group.nodes.new("ShaderNodeValue").outputs[0].default_value = 3.0


@pytest.mark.parametrize(
    "edit",
    [
        _another_value,
        _another_ramp,
        _another_choice,
        _no_link,
        _muted,
        _another_material,
        _in_a_group,
    ],
)
def test_an_edit_of_the_material_is_told(plane: Any, edit: Callable[[Any], None]) -> None:
    assert surface_updates.check() == [] and not plane.hfx.surface.is_outdated
    edit(plane)
    assert surface_updates.check() == [plane] and plane.hfx.surface.is_outdated
    bpy.ops.hfx.bake_surface()
    assert surface_updates.check() == [] and not plane.hfx.surface.is_outdated


def test_where_nodes_are_drawn_and_undone_edits_are_of_no_matter(plane: Any) -> None:
    noise = _nodes(plane)["Noise"]
    noise.location, noise.label, noise.width = (300.0, 20.0), "Here", 222.0
    assert surface_updates.check() == []
    before = noise.inputs["Scale"].default_value
    noise.inputs["Scale"].default_value = 40.0
    assert surface_updates.check() == [plane]
    noise.inputs["Scale"].default_value = before
    assert surface_updates.check() == [] and not plane.hfx.surface.is_outdated


def test_a_material_that_bakes_quickly_is_baked_while_its_maps_are_shown(plane: Any) -> None:
    before = surfaces.field_of(plane).heights_m
    surfaces.bake_s[plane.name] = 0.2
    _another_value(plane)
    surface_updates.bake_outdated()
    assert plane.hfx.surface.is_outdated  # no update check runs
    surface_updates.on_shown(plane)
    surface_updates.bake_outdated()
    assert not plane.hfx.surface.is_outdated
    assert np.abs(surfaces.field_of(plane).heights_m - before).max() > 1e-5


def test_a_material_that_bakes_slowly_is_told_to_be_out_of_date(plane: Any) -> None:
    surfaces.bake_s[plane.name] = surface_updates.QUICK_S + 1.0
    _another_value(plane)
    surface_updates.on_shown(plane)
    surface_updates.bake_outdated()
    assert plane.hfx.surface.is_outdated


def test_nothing_is_baked_while_it_is_edited(plane: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    surfaces.bake_s[plane.name] = 0.2
    surface_updates.on_shown(plane)
    _another_value(plane)
    monkeypatch.setattr(surface_updates, "last_edit_s", [time.monotonic()])
    again = surface_updates.bake_outdated()
    assert again is not None and 0.0 < again <= surface_updates.BAKE_DELAY_S
    assert not plane.hfx.surface.is_outdated


def test_an_image_that_is_painted_on_is_noticed(plane: Any) -> None:
    image = bpy.data.images.new("Paint", 8, 8)
    texture = _nodes(plane).new("ShaderNodeTexImage")
    texture.image = image
    surfaces.make_maps(plane)
    assert surface_updates.images_of(plane) == {image}
    surface_updates.painted_images.add(image.name_full)
    assert surface_updates.check() == [plane]
    assert surface_updates.check() == [plane]  # until the next bake
    surfaces.make_maps(plane)
    assert surface_updates.check() == []


def test_what_an_older_file_was_made_of_is_not_known_and_not_told(plane: Any) -> None:
    plane.hfx.surface.material_state = ""
    _another_value(plane)
    assert surface_updates.check() == []


@pytest.fixture
def updates(registered: Any) -> Iterator[list[tuple[bool, bool]]]:
    """Updates since the start: material, node tree or image; image."""
    messages: list[tuple[bool, bool]] = []

    def on_update(_scene: Any, graph: Any) -> None:
        messages.append((surface_updates.is_material_update(graph), graph.id_type_updated("IMAGE")))
        surface_updates.note_painted(graph)

    bpy.app.handlers.depsgraph_update_post.append(on_update)
    yield messages
    bpy.app.handlers.depsgraph_update_post.remove(on_update)


def _paint(image: Any, value: float) -> None:
    """Change a pixel as a brush does: Blender marks the image as unsaved, and tags it."""
    image.pixels[0] = value
    image.update()
    image.update_tag()
    bpy.context.view_layer.update()


def test_blender_tells_of_edits_of_materials_and_images(plane: Any, updates: Any) -> None:
    image = bpy.data.images.new("Paint", 8, 8)
    texture = _nodes(plane).new("ShaderNodeTexImage")
    texture.image = image
    bpy.context.view_layer.update()
    surfaces.make_maps(plane)
    bpy.context.view_layer.update()
    updates.clear()
    plane.location.x += 1.0
    bpy.context.view_layer.update()
    assert updates and not any(matters for matters, _ in updates)
    _another_value(plane)
    bpy.context.view_layer.update()
    assert updates[-1][0]
    surfaces.make_maps(plane)
    assert surface_updates.check() == []
    _paint(image, 0.5)
    assert updates[-1] == (True, True) and surface_updates.check() == [plane]


def test_strokes_on_an_image_that_the_graph_lacks_are_noticed(
    plane: Any, updates: Any, tmp_path: Path
) -> None:
    picture, other = bpy.data.images.new("Heights", 8, 8), bpy.data.images.new("Other", 8, 8)
    settings = plane.hfx.surface
    settings.source, settings.image_kind, settings.image = "IMAGE", "HEIGHT", picture
    surfaces.make_maps(plane)
    plane.hide_viewport = True  # in all versions, the graph has no objects hidden like this
    bpy.context.view_layer.update()
    for value in (0.5, 0.25):
        _paint(picture, value)
        assert surface_updates.check() == [plane]
        assert surface_updates.check() == []
    _paint(other, 0.5)  # used by no surface
    assert surface_updates.check() == []
    picture.filepath_raw, picture.file_format = str(tmp_path / "heights.png"), "PNG"
    picture.save()
    picture.update_tag()
    bpy.context.view_layer.update()
    surface_updates.check()  # eight bits of the file
    copy = picture.copy()  # a file changed by another program
    copy.filepath_raw = str(tmp_path / "heights.png")
    copy.pixels[0] = 1.0
    copy.save()
    picture.reload()
    bpy.context.view_layer.update()
    assert not picture.is_dirty and surface_updates.check() == [plane]


def test_an_image_without_pixels_is_no_painted_image(plane: Any, updates: Any) -> None:
    settings, gone = plane.hfx.surface, bpy.data.images.new("Gone", 8, 8)
    settings.source, settings.image_kind, settings.image = "IMAGE", "HEIGHT", gone
    surfaces.make_maps(plane)
    gone.source, gone.filepath = "FILE", "//missing.png"
    surface_updates.painted_images.add("")
    assert surface_updates.check() == []
