# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlay of effects in 3D viewports: wind arrows, dimmed volumes, and the legend of colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector

from ...authoring import volumes
from ...authoring.effects import effects, swarms
from ...blender.events import DrawHandlers
from ...blender.translation import translated
from ...engine.modality import MODALITIES

if TYPE_CHECKING:
    from ...engine.arrays import F32
    from ...engine.modality import Colour

_BEYOND = 1.25  # length of an arrow: the head is outside of the volume
_HEAD, _HEAD_WIDTH = 0.16, 0.06  # of the length
_DIMMED = 0.7  # opacity of the background's colour over the wires
_DIM_WIDTH = 3.0  # pixels: Blender's wire with its smoothed edge
_NEARER = 1e-5  # of the depth range: in front of the wire itself
_BAR, _ROW = 34.0, 17.0  # pixels of the legend


def wind_tip(effect: bpy.types.Object) -> Vector:
    """World-space end of the arrow that shows the direction of the air from an effect's origin: a
    quarter beyond a volume's boundary, or the end of an empty's own arrow."""
    # Volumes have meshes of wires; further effects are empties with arrows.
    is_mesh = effect.type == "MESH"
    boundary = max(corner[2] for corner in effect.bound_box) if is_mesh else 0.0
    height = _BEYOND * boundary if boundary > 0.0 else effect.empty_display_size
    return effect.matrix_world @ Vector((0.0, 0.0, height))


def is_windy(effect: bpy.types.Object) -> bool:
    """Test for an effect whose local Z axis is the direction of the air."""
    return effect.hfx.modality == "wind" and effect.hfx.kind in ("PAINTED", "VOLUME", "SPOT")


def arrow_lines(effect: bpy.types.Object) -> F32:
    """Ends (10, 3) of five world-space lines: the arrow's shaft and four lines of its head."""
    import numpy as np

    start, tip = effect.matrix_world.translation, wind_tip(effect)
    length = (tip - start).length
    turn = (tip - start).to_track_quat("Z", "Y").to_matrix()
    back, side = (1.0 - _HEAD) * length, _HEAD_WIDTH * length
    barbs = [(side, 0.0), (-side, 0.0), (0.0, side), (0.0, -side)]
    ends = [start, tip]
    for x, y in barbs:
        ends += [tip, start + turn @ Vector((x, y, back))]
    return np.array(ends, np.float32)


def off_volumes(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> list[bpy.types.Object]:
    """Volumes of a scene without effect at the current frame: muted, not solo, outside of their
    clips, or of intensity 0."""
    from ...reading.description.activation import activation_of

    listed = effects.effects_of(scene)
    muted = effects.muted_effects(listed)
    return [
        effect
        for effect in listed
        if effect.hfx.kind == "VOLUME"
        and (
            effect in muted
            or activation_of(effect).level(effect.evaluated_get(depsgraph).hfx) <= 0.0
        )
    ]


def wires_of(effect: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> F32:
    """World-space ends (2E, 3) of the edges of a volume's evaluated mesh; none in Edit Mode."""
    import numpy as np

    from ...blender import mesh_arrays

    evaluated = effect.evaluated_get(depsgraph)
    edges = mesh_arrays.values(evaluated.data.edges, "vertices", 2, np.int32)
    world = np.array(evaluated.matrix_world, np.float32)
    points = mesh_arrays.positions(evaluated.data) @ world[:3, :3].T + world[:3, 3]
    return points[edges.ravel()]


def legend(scene: bpy.types.Scene) -> list[tuple[str, str, Colour]]:
    """Labels of the modalities of a scene's effects, strengths of the full colours ("6 kPa") and
    colours; a temperature has two, for warmth and cold."""
    from ...engine.colouring import COLD, PALETTES

    palette = PALETTES[scene.hfx.palette]
    present = {effect.hfx.modality for effect in swarms.listed_effects(scene)}
    entries = []
    for name, modality in MODALITIES.items():
        full = f"{modality.full_colour:g} {modality.strength_parameter.symbol}"
        if name in present and modality.is_silent_at_0:
            entries.append((translated(modality.title), full, palette[name]))
        elif name in present:
            entries.append((translated("Warm"), f"+{full}", palette[name]))
            entries.append((translated("Cold"), f"-{full}", palette[COLD]))
    return entries


def _draw_in_scene() -> None:
    from .drawing import draw_lines

    context = bpy.context
    if context.space_data is None or not context.space_data.overlay.show_overlays:
        return
    depsgraph = context.evaluated_depsgraph_get()
    dimmed = off_volumes(context.scene, depsgraph)
    background = context.preferences.themes[0].view_3d.space.gradients.high_gradient
    nearer = Matrix.Identity(4)
    # Before Blender 5 wires of orthographic views are offset by the view's distance.
    view = context.region_data
    nearer[2][3] = -_NEARER * (1.0 if view.is_perspective else 1.0 + 2.0 * view.view_distance)
    with gpu.matrix.push_pop_projection():
        gpu.matrix.load_projection_matrix(nearer @ gpu.matrix.get_projection_matrix())
        for effect in effects.effects_of(context.scene):
            if not effect.visible_get():
                continue
            is_off = effect in dimmed
            if is_windy(effect):
                colour = volumes.effect_colour(effect.hfx)[:3]
                draw_lines(arrow_lines(effect), (*colour, 1.0 - is_off * _DIMMED), "LINES")
            if is_off and effect.type == "MESH":
                colour = (*background, _DIMMED)
                draw_lines(wires_of(effect, depsgraph), colour, "LINES", _DIM_WIDTH)


def _draw_legend() -> None:
    """Draw the legend of a visible preview at the lower right, in the first view of a quad view:
    for each modality a scale of colours from 0 to the full colour. None below the chart of values
    over time."""
    from . import drawing

    context, manager = bpy.context, bpy.context.window_manager
    is_first = context.region == next(r for r in context.area.regions if r.type == "WINDOW")
    if not (is_first and manager.hfx_preview and context.space_data.overlay.show_overlays):
        return
    entries = legend(context.scene)
    if not entries or manager.hfx_show_values:
        return
    scale = context.preferences.system.ui_scale
    blf.size(0, 11.0 * scale)
    bar, row = _BAR * scale, _ROW * scale
    _, right = drawing.free_part(context.area, context.region)
    # An open asset shelf lies over the lower edge.
    shelf = [part for part in context.area.regions if part.type.startswith("ASSET_SHELF")]
    bottom = drawing.MARGIN + sum(part.height for part in shelf if part.height > 1)
    left = right - max(blf.dimensions(0, full)[0] for _, full, _ in entries)
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    for number, (label, full, colour) in enumerate(reversed(entries)):
        low = bottom + number * row
        high, start = low + 0.6 * row, left - bar - 0.4 * row
        corners = [(start, low), (start + bar, low), (start, high), (start + bar, high)]
        content = {"pos": corners, "color": [(*colour, 0.0), (*colour, 1.0)] * 2}
        with drawing.card_state():
            batch_for_shader(shader, "TRI_STRIP", content).draw(shader)
        blf.color(0, *drawing.TEXT)
        # "0" shows that the number is the end of a scale, and no value of an effect.
        name = f"{label}  0"
        for x, text in ((start - 0.3 * row - blf.dimensions(0, name)[0], name), (left, full)):
            blf.position(0, x, low, 0)
            blf.draw(0, text)


_handlers = DrawHandlers(
    (bpy.types.SpaceView3D, _draw_in_scene, "POST_VIEW"),
    (bpy.types.SpaceView3D, _draw_legend, "POST_PIXEL"),
)
register, unregister = _handlers.register, _handlers.unregister
