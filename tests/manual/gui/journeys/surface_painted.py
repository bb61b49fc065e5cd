# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint a texture in the Image Editor: the surface's maps and the export follow the strokes.

A warm sphere touches the painted board at the same time: both are felt.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import bpy
import hands
import numpy as np

LAST = 24  # frames
BESIDE = 0.2  # metres of the board's way, left and right of the chest
STROKES = 5
BEFORE_CHEST = (0.0, -0.12, 1.25)


def steps(h: Any) -> Iterator[float]:
    h.show_files_inside()
    yield from hands.empty_scene(h)
    set_up(h)
    yield from h.move(*h.xy(h.region(), 0.5, 0.5))
    yield from h.key("KP_1", "KP_Decimal")
    yield 1.0
    with h.context():
        bpy.ops.hfx.add_surface(source="MATERIAL")
    yield 3.0
    h.check(not surface().is_faulty, "its maps are made")
    h.check(np.ptp(pixels_of(surface().intensity_image)) == 0.0, "of an even texture")
    h.undo_push()

    with h.context():
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.4)
    yield 1.0
    area = min((a for a in h.window.screen.areas if a.type == "VIEW_3D"), key=lambda a: a.x)
    area.type = "IMAGE_EDITOR"
    editor = area.spaces.active
    editor.image, editor.mode = bpy.data.images["Texture"], "PAINT"
    yield 1.0
    region = h.region("WINDOW", "IMAGE_EDITOR")
    with h.context("IMAGE_EDITOR"):
        bpy.ops.image.view_all(fit_view=True)
    settings = bpy.context.tool_settings.image_paint
    brush_colour(settings, (1.0, 1.0, 1.0))
    brush_size(settings, 20)
    yield 1.0
    yield from paint(h, region)
    h.shot("1_painted.png")
    h.check(is_painted(), "strokes are on the texture")
    yield from h.until(lambda: surface().is_outdated or is_bumpy(), "they are noticed", 30)
    yield 3.0
    h.shot("2_followed.png")
    h.check(editor.image == bpy.data.images["Texture"], "the editor shows the texture")
    count = STROKES  # undo steps
    if surface().is_outdated:  # baking took too long for an automatic bake
        count += 1
        yield from h.press_button("HFX_OT_bake_surface")
        yield 1.0
    h.check(is_bumpy(), "and are on the map")
    yield from h.move(*h.xy(region, 0.5, 0.5))
    yield from undo_and_redo(h, count)
    for _ in range(count):
        yield from h.key("ctrl+z")
    yield 3.0
    h.shot("3_undone.png")
    if surface().is_outdated:  # the button ends the redo
        yield from h.press_button("HFX_OT_bake_surface")
        yield 1.0
    h.check(not is_bumpy(), "Ctrl+Z of the strokes makes the map even")
    yield from paint(h, region)
    yield from h.until(lambda: surface().is_outdated or is_bumpy(), "new ones are noticed", 30)
    yield 3.0
    if surface().is_outdated:
        yield from h.press_button("HFX_OT_bake_surface")
        yield 1.0
    h.check(is_bumpy(), "and are on the map, too")
    yield from warm_and_export(h)


def paint(h: Any, region: bpy.types.Region) -> Iterator[float]:
    """Draw upright strokes beside each other."""
    for k in range(STROKES):
        x = 0.2 + 0.6 * k / (STROKES - 1)
        yield from h.drag([h.xy(region, x, 0.3 + 0.04 * step) for step in range(11)], step=0.03)
    yield 1.0


def undo_and_redo(h: Any, count: int) -> Iterator[float]:
    """Undo and redo ``count`` steps. A bake by the button in between would end the redo."""
    for _ in range(count):
        yield from h.key("ctrl+z")
    yield from h.until(lambda: not is_painted(), "Ctrl+Z takes the strokes back", 30)
    yield 3.0
    for _ in range(count):
        yield from h.key("ctrl+shift+z")
    yield from h.until(is_painted, "redo paints them again", 30)
    yield from h.until(lambda: surface().is_outdated or is_bumpy(), "redo is noticed", 30)
    yield 3.0


def warm_and_export(h: Any) -> Iterator[float]:
    """Let a warm sphere touch board and body, look at both, and export."""
    with h.context():
        bpy.ops.hfx.add_volume(shape="SPHERE", modality="temperature")
    sphere = hands.effect("temperature")
    sphere.location, sphere.hfx.radius = BEFORE_CHEST, 0.12
    h.undo_push()
    yield from hands.go_to(h, LAST // 2)
    yield 3.0
    h.shot("4_warm.png")
    with h.context():
        bpy.ops.hfx.export("EXEC_DEFAULT", filepath=str(h.out / "board.hfxtrack"))
    report = h.out / "board.report.json"
    yield from h.until(report.exists, "the export is written", 120)
    yield 1.0
    h.shot("5_exported.png")
    felt = [item["effect"] for item in json.loads(report.read_text(encoding="utf-8"))["felt"]]
    h.check(sorted(felt) == ["Board", "Heat Sphere"], f"felt are {', '.join(felt)}")


def set_up(h: Any) -> None:
    """A board with an even texture, moving across the avatar's chest."""
    with h.context():
        bpy.ops.hfx.add_avatar()
        bpy.ops.mesh.primitive_plane_add(
            size=0.5, location=BEFORE_CHEST, rotation=(np.pi / 2, 0.0, 0.0)
        )
    board = bpy.context.object
    board.name = "Board"
    bpy.context.scene.frame_end = LAST
    material = bpy.data.materials.new("Painted")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, bump = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeBump")
    texture.image = bpy.data.images.new("Texture", 256, 256)
    bump.inputs["Distance"].default_value = 0.001  # metres; a new one's was 1 in older Blenders
    links.new(texture.outputs["Color"], bump.inputs["Height"])
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    board.data.materials.append(material)
    nodes.active = texture
    board.hfx.surface.resolution = 128
    for frame, x in ((LAST, BESIDE), (1, -BESIDE)):  # the first frame last: it is shown
        board.location.x = x
        board.keyframe_insert("location", frame=frame)
    h.undo_push()


def brush_colour(settings: Any, colour: tuple[float, float, float]) -> None:
    """Set the colour of painting, of the brush and of settings shared by brushes."""
    unified = getattr(settings, "unified_paint_settings", None)
    if unified is None:  # before Blender 5.0
        unified = bpy.context.tool_settings.unified_paint_settings
    unified.color = settings.brush.color = colour


def brush_size(settings: Any, size: int) -> None:
    unified = getattr(settings, "unified_paint_settings", None)
    if unified is None:
        unified = bpy.context.tool_settings.unified_paint_settings
    unified.size = settings.brush.size = size


def surface() -> Any:
    """Surface settings of the object *Board*. Undo replaces them, so call again afterwards."""
    return bpy.data.objects["Board"].hfx.surface


def is_painted() -> bool:
    return bool(np.ptp(pixels_of(bpy.data.images["Texture"])) > 0.9)


def is_bumpy() -> bool:
    return bool(np.ptp(pixels_of(surface().intensity_image)) > 0.1)


def pixels_of(image: bpy.types.Image) -> np.ndarray:
    """Red of each pixel."""
    pixels = np.zeros(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return pixels[::4]
