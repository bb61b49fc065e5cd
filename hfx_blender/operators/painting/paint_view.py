# SPDX-License-Identifier: GPL-3.0-or-later
"""The 3D viewport during Weight Paint of a haptic area.

Only the perceptual model is visible, framed to the size of the viewport. A modal operator keeps the
brush's size on the skin, writes the body part under the mouse into the status bar, and finishes
painting when the user leaves Weight Paint. View and visibility are restored afterwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any, ClassVar

import blf
import bpy
from bpy.app.handlers import persistent
from idprop.types import IDPropertyGroup
from mathutils.bvhtree import BVHTree

from ...authoring import atlas_pictures, painting, volumes
from ...authoring.effects import effects
from ...blender import compat
from ...blender.events import DrawHandlers, add_handlers, call_soon, remove_handlers
from ...blender.translation import translated
from ...engine.body.parts import CENTRE, HEAD, SIDES
from ...playback.preview.preview import preview
from .. import framing

if TYPE_CHECKING:
    from ...engine.body.model import PerceptualModel

_HIDDEN = "hfx_hidden_to_paint"
"""ID property of the painted mesh: objects hidden during painting.

The property is saved with the file, and an undo of *Paint* removes it and shows the objects. A full
copy of the scene refers to the copied objects.
"""

_OPACITY = 0.8
"""Opacity of Weight Paint's colours: full colours would hide the shape."""

_LEAST_PIXELS, _MOST_PIXELS = 4.0, 500.0
_BRUSH_TEXELS = 3.0  # radius of the brush on an atlas picture
_GAP = 4.0  # pixels between two names on an atlas picture
_MISSED = "Nothing painted: the stroke lies outside of the charts"
FILL_TOOL = "hfx.fill_part_tool"
_FILL_HINT = "Click: fill the part     Ctrl Click: clear the part"

_UNPAINTED = (0.3, 0.3, 0.35, 1.0)  # colour of weight 0

_before: dict[int, tuple[list[dict[str, Any]], float]] = {}
"""Views and opacity before painting, by the viewport's pointer; for as long as Blender runs."""

_borrowed: dict[int, str] = {}  # earlier editors of areas that show a picture, by pointer
_halves: set[int] = set()  # pointers of Image Editors split from a viewport

_own_range: list[tuple[float, tuple[float, ...]]] = []
"""Positions and colours of the weight range in the preferences before painting; empty outside."""


def hide_others(context: bpy.types.Context, canvas: bpy.types.Object) -> None:
    """Hide all visible objects except the painted mesh and effects on bodies; the mesh stores the
    hidden objects."""
    # The NLA Editor leaves out hidden objects; effects on bodies are empties without a surface.
    others = [
        obj
        for obj in context.view_layer.objects
        if obj != canvas
        and obj.visible_get()
        and not (obj.hfx.role == "EFFECT" and obj.hfx.kind in effects.ON_A_BODY)
    ]
    for obj in others:
        obj.hide_set(True)
    canvas[_HIDDEN] = {str(number): obj for number, obj in enumerate(others)}


def hidden_by(canvas: bpy.types.Object) -> set[str]:
    """Full names of the objects hidden during painting, as far as they still exist."""
    # Earlier versions stored names, or marked the avatar's meshes.
    marked = {obj.name_full for obj in bpy.data.objects if obj.get(_HIDDEN) is True}
    stored = canvas.get(_HIDDEN, ())
    if isinstance(stored, IDPropertyGroup):
        stored = [obj.name_full for obj in stored.values() if obj is not None]
    return marked.union(stored)


def layers_of(canvas: bpy.types.Object) -> list[bpy.types.ViewLayer]:
    """View layers with the painted mesh: several after copying the scene."""
    layers = [layer for scene in bpy.data.scenes for layer in scene.view_layers]
    return [layer for layer in layers if canvas.name in layer.objects]


def show(layers: Iterable[bpy.types.ViewLayer], hidden: set[str]) -> None:
    """Show objects, given by full name, in view layers that have them."""
    for obj in [candidate for candidate in bpy.data.objects if candidate.name_full in hidden]:
        for layer in layers:
            with suppress(RuntimeError):  # not in this view layer
                obj.hide_set(False, view_layer=layer)


def enter(context: bpy.types.Context, canvas: bpy.types.Object) -> None:
    """Save views and opacity of the viewport, and make the colours paler; no effect without a
    viewport."""
    area = framing.viewport(context)
    if area is None:
        return
    overlay = area.spaces.active.overlay
    _before[area.as_pointer()] = framing.state(area), overlay.weight_paint_mode_opacity
    overlay.weight_paint_mode_opacity = _OPACITY
    effect = canvas[painting.PAINTED_EFFECT]
    set_weight_colours(volumes.effect_colour(effect.hfx, context.scene.hfx.palette))


def leave() -> None:
    """Restore opacity and views from before painting, in all workspaces, and close the Image Editor
    of *Paint in 2D*; a view turned during painting stays."""
    for screen in bpy.data.screens:  # includes other workspaces
        for area in screen.areas:
            view = _before.pop(area.as_pointer(), None)
            if view is not None and area.type == "VIEW_3D":
                framing.restore(area, view[0])
                area.spaces.active.overlay.weight_paint_mode_opacity = view[1]
    call_soon(_return_editors)  # later: the running operator needs the screen's context
    _before.clear()
    set_weight_colours(None)


def _return_editors(only_empty: bool = False) -> None:
    """Show the earlier editors of areas with a picture, and close those split from viewports, as
    far as they still are Image Editors. ``only_empty``: those whose picture is removed by undo."""
    for screen in bpy.data.screens:  # includes other workspaces
        for area in [area for area in screen.areas if area.type == "IMAGE_EDITOR"]:
            pointer = area.as_pointer()
            if only_empty and area.spaces.active.image is not None:
                continue
            if pointer in _borrowed:
                area.ui_type = _borrowed.pop(pointer)
            for window in bpy.context.window_manager.windows:
                if pointer in _halves and window.screen == screen:
                    _halves.remove(pointer)
                    with bpy.context.temp_override(window=window, area=area):
                        bpy.ops.screen.area_close()
    if not only_empty:
        _borrowed.clear()
        _halves.clear()


def _return_emptied() -> None:
    _return_editors(only_empty=True)


def set_weight_colours(colour: tuple[float, ...] | None) -> None:
    """Show weights from grey to an RGBA colour; None: as before. The colours are preferences of
    Blender, which stay unsaved; a weight range that the user has switched on is kept."""
    preferences = bpy.context.preferences
    view, is_dirty = preferences.view, preferences.is_dirty
    if (colour is None) != bool(_own_range) or (colour and view.use_weight_color_range):
        return
    elements = view.weight_color_range.elements
    saved = [(element.position, tuple(element.color)) for element in elements]
    shown = _own_range.copy() if colour is None else [(0.0, _UNPAINTED), (1.0, colour)]
    _own_range[:] = [] if colour is None else saved
    while len(elements) > 1:
        elements.remove(elements[-1])
    elements[0].position, elements[0].color = shown[0]
    for position, tint in shown[1:]:
        elements.new(position).color = tint
    # Last: only the switch updates the colours of the viewport.
    view.use_weight_color_range = colour is not None
    preferences.is_dirty = is_dirty


def show_picture(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show an image in Paint mode in an Image Editor, until painting ends in place of the Asset
    Browser or of a taller NLA Editor, or else in half of the viewport; paint with white. No effect
    without any of them."""
    areas = [area for area in context.screen.areas if area.type == "IMAGE_EDITOR"]
    others = [area for area in context.screen.areas if area.ui_type in ("ASSETS", "NLA_EDITOR")]
    others.sort(key=lambda area: -area.height)
    if not areas and others:
        _borrowed[others[0].as_pointer()] = others[0].ui_type
        others[0].type = "IMAGE_EDITOR"
        areas = others
    viewport = framing.viewport(context)
    if not areas and viewport is not None:
        with context.temp_override(area=viewport, region=framing.views(viewport)[-1]):
            bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
        areas = [context.screen.areas[-1]]
        areas[0].type = "IMAGE_EDITOR"
        _halves.add(areas[0].as_pointer())
    for area in areas[:1]:
        space = area.spaces.active
        space.image, space.ui_mode = image, "PAINT"
        call_soon(partial(_frame_picture, context.window, area), 0.2)


def _frame_picture(window: bpy.types.Window, area: bpy.types.Area) -> None:
    """View all of an Image Editor's image, and fit the brush to its texels; by a timer, after
    Blender has updated the sizes."""
    with suppress(AttributeError):  # before Blender 4.3 there is no shelf of brushes over the feet
        area.spaces.active.show_region_asset_shelf = False
    with bpy.context.temp_override(window=window, area=area, region=framing.views(area)[-1]):
        bpy.ops.image.view_all(fit_view=True)
        radius = max(_BRUSH_TEXELS * area.spaces.active.zoom[0], _LEAST_PIXELS)
        compat.paint_white(bpy.context, round(radius))


def _draw_names() -> None:
    """Name the charts of an atlas picture in the Image Editor, and state below the picture that the
    last stroke changed nothing."""
    from ...engine.body import model
    from ...playback.preview.drawing import TEXT, write

    context = bpy.context
    image, view = context.space_data.image, context.region.view2d
    if image is None or atlas_pictures.MODEL not in image:
        return
    size = 10.0 * context.preferences.system.ui_scale
    blf.size(0, size)
    blf.color(0, *TEXT)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.9)
    if atlas_pictures.is_missed():  # in place of names, which can fill the region
        x, y = view.view_to_region(0.0, 0.0, clip=False)
        blf.size(0, 1.4 * size)
        write(translated(_MISSED), max(x, size), max(y - 2.5 * size, size), context.region.width)
    else:
        painted = model.load_model(image[atlas_pictures.MODEL])
        for line, *place in _name_lines(painted, view, 1.2 * size):
            write(line, *place)
    blf.disable(0, blf.SHADOW)


def _name_lines(
    painted: PerceptualModel, view: bpy.types.View2D, height: float
) -> Iterator[tuple[str, float, float, float]]:
    """Yield lines of names, the lower left corner and the width of their room, pixels, without
    names that would cover others; ``height`` of a line."""
    taken: list[tuple[float, float, float, float]] = []
    for name, x, y, end in _chart_names(painted, view):
        lines = _lines(name, end - x)
        top = y + height * len(lines)
        if not any(x < e and left < end and y < t and low < top for left, low, e, t in taken):
            taken.append((x, y, end, top))
            for number, line in enumerate(reversed(lines)):
                yield line, x, y + height * number, end - x


def _chart_names(
    painted: PerceptualModel, view: bpy.types.View2D
) -> Iterator[tuple[str, float, float, float]]:
    """Yield names of charts, the lower left corner and the right end of their room, pixels. Two
    neighbouring charts without room for both names share the region's name without a side."""
    from ...engine.body import atlas

    cells, (width, height) = atlas.texels(painted.id)
    charts = list(atlas.charts(painted))
    corners = [cells[chart].min(axis=0).tolist() for _, chart in charts]
    places = []
    for (left, low), (right, row) in zip(corners, [*corners[1:], (0, -1)], strict=True):
        x, y = view.view_to_region(left / width, low / height, clip=False)
        # The room ends at the next chart of the row or at the edge.
        end, _ = view.view_to_region((right if row == low else width) / width, 0.0, clip=False)
        places.append((x, y, end - _GAP))
    rows = zip(charts, places, strict=True)
    for _, members in groupby(rows, lambda item: (item[0][0].id, item[1][1])):
        named = []
        for (region, chart), place in members:
            name = region.label if region.group == HEAD else part_name(painted, chart[0])
            named.append((translated(name), *place))
        if len(named) > 1 and any(len(_lines(name, end - x)) != 1 for name, x, _, end in named):
            _, x, y, _ = named[0]
            named = [(translated(region.label), x, y, named[-1][3])]
        yield from named


def _lines(name: str, width: float) -> list[str]:
    """Words of a name in lines of at most ``width`` pixels; no lines if a word is wider."""
    lines: list[str] = []
    for word in name.split():
        joined = f"{lines[-1]} {word}" if lines else word
        if lines and blf.dimensions(0, joined)[0] <= width:
            lines[-1] = joined
        else:
            lines.append(word)
    return lines if all(blf.dimensions(0, line)[0] <= width for line in lines) else []


class SceneBrush:
    """Brush with a constant ``radius`` on the skin, Blender's units.

    Weight Paint measures brushes in pixels. A radius changed by the user is converted to a new
    radius on the skin. ``least`` is the lower limit of the radius, the median distance of vertices:
    smaller brushes miss all vertices.
    """

    def __init__(self, radius: float, least: float) -> None:
        self.radius, self.least = radius, least
        self._pixels = 0

    def fit(self, context: bpy.types.Context, event: bpy.types.Event) -> None:
        """Set the brush's pixels for the view under the mouse, from the radius on the skin.

        Pixels changed since the last call are the user's: the radius follows these first. No effect
        for a pivot behind the viewer.
        """
        scale = _pixels_per_unit(context, event)
        if scale is None:
            return
        pixels = compat.brush_radius(context)
        if self._pixels and abs(pixels - self._pixels) > 1:  # the user's choice
            self.radius = pixels / scale
        radius = max(self.radius, self.least)
        fitted = round(min(max(radius * scale, _LEAST_PIXELS), _MOST_PIXELS))
        if fitted != pixels:
            compat.set_brush_radius(context, fitted)
        self._pixels = compat.brush_radius(context)


def _pixels_per_unit(context: bpy.types.Context, event: bpy.types.Event) -> float | None:
    """Pixels of one Blender unit at the pivot of the view; None without a viewport, or with the
    pivot behind the viewer."""
    area = framing.viewport(context)
    if area is None:
        return None
    region = framing.region_at(area, event.mouse_x, event.mouse_y)
    projection = region.data.perspective_matrix
    # Homogeneous coordinate of the pivot: 1 in orthographic views.
    depth = (projection @ region.data.view_location.to_4d()).w
    return projection[0].xyz.length * region.width / 2.0 / depth if depth > 0.0 else None


class HFX_OT_paint_status(bpy.types.Operator):
    """Show the body part under the mouse in the status bar while painting"""

    bl_idname = "hfx.paint_status"
    bl_label = "Name Body Parts"
    bl_options: ClassVar = {"INTERNAL"}

    _is_running: ClassVar = False
    _shown = ""
    _brush: SceneBrush
    _surface: BVHTree | None = None  # triangles of the canvas, None after Edit Mode
    _hidden: set[str]  # full names, to show objects after the mesh was deleted

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        canvas = painting.canvas_in(context)
        if canvas is None:
            return {"CANCELLED"}
        effect = canvas[painting.PAINTED_EFFECT]
        spacing = painting.spacing(canvas, effect)
        self._brush = SceneBrush(painting.brush_radius(canvas, effect), spacing)
        self._brush.fit(context, event)
        self._hidden = hidden_by(canvas)
        HFX_OT_paint_status._is_running = True
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        canvas = painting.canvas_in(context)
        if canvas is None:  # finished, undone or deleted
            # The mesh with the list of hidden objects is gone: the operator has kept their names.
            show([context.view_layer], self._hidden)
            return self._ended(context)
        if canvas != context.object or canvas.mode == "OBJECT":  # left by other means
            with suppress(RuntimeError):  # an edited mesh: Finish Painting reports the reason
                bpy.ops.hfx.paint_end("EXEC_DEFAULT", True)  # True: an undo step
            return self._ended(context)
        if event.type == "MOUSEMOVE":
            # Strokes do not move the surface: a ray cast on the canvas would build its tree anew.
            if canvas.mode == "EDIT":
                self._surface = None
            elif self._surface is None:
                self._surface = BVHTree.FromObject(canvas, context.evaluated_depsgraph_get())
            effect = canvas[painting.PAINTED_EFFECT]
            vertex = vertex_under(context, canvas, self._surface, event)
            if vertex is None:
                vertex = _vertex_on_picture(context, event)
            else:
                self._brush.least = painting.spacing(canvas, effect, vertex)
            name = "" if vertex is None else part_name(effects.model_of(effect), vertex)
            tool = context.workspace.tools.from_space_view3d_mode("PAINT_WEIGHT")
            hint = _FILL_HINT if tool is not None and tool.idname == FILL_TOOL else ""
            text = "     ".join(translated(part) for part in (name, hint) if part)
            if text != self._shown:
                self._shown = text
                context.workspace.status_text_set(text or None)
        is_press = (event.type, event.value) == ("LEFTMOUSE", "PRESS")
        if is_press:
            under_mouse = _picture_under(context, event)
            atlas_pictures.note_press(under_mouse[1] if under_mouse else None)
        if canvas.mode == "WEIGHT_PAINT":
            self._brush.fit(context, event)
        # All events pass on: strokes and navigation are Blender's.
        return {"PASS_THROUGH"}

    def _ended(self, context: bpy.types.Context) -> set[str]:
        HFX_OT_paint_status._is_running = False
        leave()
        context.workspace.status_text_set(None)
        return {"FINISHED", "PASS_THROUGH"}


def _resume() -> None:
    """Start the modal operator in a file saved while painting, and after an undo."""
    canvas = painting.canvas_in(bpy.context)
    if canvas is None or HFX_OT_paint_status._is_running or canvas.mode == "OBJECT":
        return
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        enter(bpy.context, canvas)
        bpy.ops.hfx.paint_status("INVOKE_DEFAULT")


@persistent
def _after_undo(*_: object) -> None:
    # By timers, when Blender has finished the undo.
    call_soon(_resume)
    call_soon(_return_emptied)


@persistent
def _after_loading(*_: object) -> None:
    _before.clear()  # views of the file before
    set_weight_colours(None)
    HFX_OT_paint_status._is_running = False  # opening a file ends modal operators
    call_soon(_resume)


def vertex_under(
    context: bpy.types.Context,
    canvas: bpy.types.Object,
    surface: BVHTree | None,
    event: bpy.types.Event,
) -> int | None:
    """First vertex of the canvas's triangle under the mouse, by the tree of the canvas; None
    outside of the body and without a tree."""
    for area in context.screen.areas:
        if area.type != "VIEW_3D" or surface is None:
            continue
        region = framing.region_at(area, event.mouse_x, event.mouse_y)
        if not framing.holds(region, event.mouse_x, event.mouse_y):
            continue
        origin, ray = framing.ray_at(region, event.mouse_x, event.mouse_y)
        to_local = canvas.matrix_world.inverted_safe()
        _, _, face, _ = surface.ray_cast(to_local @ origin, to_local.to_3x3() @ ray)
        # Modifiers may add faces that the mesh itself lacks.
        if face is None or face >= len(canvas.data.polygons):
            return None
        return int(canvas.data.polygons[face].vertices[0])
    return None


def _vertex_on_picture(context: bpy.types.Context, event: bpy.types.Event) -> int | None:
    """Vertex of the texel under the mouse, or of the next texel, on an atlas picture in an Image
    Editor; None elsewhere."""
    import numpy as np

    from ...engine.body import atlas

    under_mouse = _picture_under(context, event)
    if under_mouse is None:
        return None
    image, place = under_mouse
    cells, size = atlas.texels(image[atlas_pictures.MODEL])
    apart = abs((cells + 0.5) / size - place) * size
    vertex = int(np.argmin(apart.max(axis=1)))
    return vertex if apart[vertex].max() <= 1.5 else None


def _picture_under(
    context: bpy.types.Context, event: bpy.types.Event
) -> tuple[bpy.types.Image, tuple[float, float]] | None:
    """Atlas picture in the Image Editor under the mouse, and the place of the mouse, (0, 0) to
    (1, 1) on the picture; None elsewhere."""
    pictures = atlas_pictures.pictures()
    for area in context.screen.areas:
        image = area.spaces.active.image if area.type == "IMAGE_EDITOR" else None
        region = framing.views(area)[-1]
        x, y = event.mouse_x - region.x, event.mouse_y - region.y
        if image in pictures and framing.holds(region, event.mouse_x, event.mouse_y):
            return image, region.view2d.region_to_view(x, y)
    return None


def part_name(model: PerceptualModel, vertex: int) -> str:
    """Body part of a vertex, such as "Calves (left)"; empty for an unknown vertex."""
    from ...engine.body.regions import region_at

    if vertex >= len(model):
        return ""
    region, side = region_at(model, vertex), int(model.side[vertex])
    return region.label if side == CENTRE else f"{region.label} ({SIDES[side]})"


_names = DrawHandlers((bpy.types.SpaceImageEditor, _draw_names, "POST_PIXEL"))
_HANDLERS = {"undo_post": _after_undo, "redo_post": _after_undo, "load_post": _after_loading}


def register() -> None:
    _names.register()
    if not bpy.app.background:
        add_handlers(_HANDLERS)
        preview.on_scene_checked.append(_resume)  # back from another scene


def unregister() -> None:
    _names.unregister()
    set_weight_colours(None)
    remove_handlers(_HANDLERS)
    if _resume in preview.on_scene_checked:
        preview.on_scene_checked.remove(_resume)
