# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX workspace: viewport with the HFX tab, sensations, clips, timeline; the start-up file."""

import time
from collections.abc import Iterator
from contextlib import suppress
from functools import partial

import bpy
from mathutils import Quaternion

from ..authoring.effects import effects
from ..avatars import avatar_meshes
from ..blender.events import Handlers, add_handlers, call_soon, remove_handlers
from . import framing
from .effects.asset_browser import LIBRARY_NAME
from .shared import HfxOperator

NAME = "HFX"
TAB = "HFX"

_LEFT_SHARE = 0.4  # of the window's width, for clips and timeline
_TIMELINE_SHARE = 0.34  # of the window's height: nine rows at 1280 x 720
_TALL = 900  # window's height for a timeline below all, pixels at an interface scale of 1
_LOW_SHARE = 0.18  # of the height, for that timeline: five rows
_CLIPS_SHARE = 0.6  # of the remaining height
_LEAST_FRAMES = 24.0  # of the NLA editor's view
_FROM_THE_FRONT = Quaternion((0.743, 0.646, 0.114, 0.131))  # a little from above and aside
_AGAIN_S = 0.01
_DRAWN_S = 0.5
_PATIENCE_S = 30.0


def _has_window(context: bpy.types.Context) -> bool:
    return context.window is not None and not bpy.app.background


class HFX_OT_workspace(HfxOperator):
    """Go to the HFX workspace: viewport with the HFX tab, sensations, NLA editor for clips,
    timeline. The workspace is added if missing"""

    bl_label = "HFX Workspace"
    bl_options = {"REGISTER"}
    requires = ((_has_window, "There is no window"),)

    def work(self, context: bpy.types.Context) -> str:
        workspace = bpy.data.workspaces.get(NAME)
        if workspace is not None:
            context.window.workspace = workspace
            return ""
        before = set(bpy.data.workspaces)
        bpy.ops.workspace.duplicate()
        # The operator returns no workspace: found by comparison.
        (added,) = set(bpy.data.workspaces) - before
        added.name = NAME
        # Blender shows the workspace after this operator: arrange its areas by a timer.
        steps, until = _arranging(context.window, added), time.monotonic() + _PATIENCE_S

        def arrange() -> float | None:
            return _AGAIN_S if not next(steps, True) and time.monotonic() < until else None

        call_soon(arrange)
        return ""


class HFX_OT_new_file(HfxOperator):
    """Begin a new file for haptics: the built-in avatar in the HFX workspace. Blender asks first \
whether to save the present file"""

    bl_label = "Haptics"
    bl_options = {"REGISTER"}
    requires = ((_has_window, "There is no window"),)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        call_soon(partial(load_empty_file, "INVOKE_DEFAULT"))
        return {"FINISHED"}

    def work(self, context: bpy.types.Context) -> None:
        # Loading a file ends the calling operator: load by a timer, after it.
        call_soon(load_empty_file)


def load_empty_file(how: str = "EXEC_DEFAULT") -> None:
    """Load Blender's start-up file; the cube is replaced by the avatar after loading.

    "INVOKE_DEFAULT" asks about unsaved changes, as *File > New > General* does. Blender gives no
    sign of *Cancel*: the next drawing of the menu of new files ends the wait for a loaded file.
    """
    add_handlers(_AWAITED)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.wm.read_homefile(how, app_template="", use_empty=False)


@bpy.app.handlers.persistent
def replace_cube_by_avatar(_file: str) -> None:
    """Replace the meshes of Blender's start-up file by the avatar, and go to the HFX workspace.

    No effect after loading another file; the handler removes itself. Blender pushes the first undo
    step after this handler: undo does not restore the cube.
    """
    remove_handlers(_AWAITED)
    if bpy.data.filepath:  # another file was opened instead
        return
    for obj in [o for o in bpy.context.scene.objects if o.type == "MESH"]:
        bpy.data.objects.remove(obj)
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.hfx.add_avatar()
    # Persistent: the end of loading would remove the timer.
    call_soon(_go_to_workspace, outlives_load=True)


_AWAITED: Handlers = {"load_post": replace_cube_by_avatar}


def _go_to_workspace() -> None:
    window, is_saved = bpy.context.window_manager.windows[0], NAME in bpy.data.workspaces
    with bpy.context.temp_override(window=window):
        bpy.ops.hfx.workspace()
    if is_saved:  # in the start-up file: its areas stay as they are
        call_soon(partial(_frame_bodies, window), _DRAWN_S)


def _frame_bodies(window: bpy.types.Window) -> None:
    """Frame the haptic bodies from the front; no effect without any or after closing the window."""
    with suppress(ReferenceError), bpy.context.temp_override(window=window):
        context = bpy.context
        bodies, viewport = effects.bodies_of(context.scene), framing.viewport(context)
        if bodies and viewport is not None and context.mode == "OBJECT":
            viewport.spaces.active.region_3d.view_rotation = _FROM_THE_FRONT
            meshes = [mesh for body in bodies for mesh in avatar_meshes.meshes_of(body)]
            framing.frame(context, [*bodies, *meshes])


def _arranging(window: bpy.types.Window, workspace: bpy.types.WorkSpace) -> Iterator[bool]:
    """Arrange the areas of a window once it shows a workspace; yields False before each step, as
    Blender updates sizes and tabs at the next drawing.

    Three steps in successive drawings, during which all areas are editors that draw quickly. The
    viewport with the HFX tab is high, so that list, area and clips of an effect are in view
    together. Left of it are the Asset Browser with the sensations and the NLA editor. The timeline
    is below all, where its header has room for Blender's buttons; in a low window it is below the
    NLA editor alone. Ends early if the window is closed, or another file opened.
    """
    with suppress(ReferenceError):
        while window.workspace != workspace:
            yield False
        areas = window.screen.areas
        viewports = [area for area in areas if area.type == "VIEW_3D"]
        viewport = max(viewports or areas, key=lambda area: area.width * area.height)
        viewport.type = "NLA_EDITOR"
        # An area closes into a neighbour with a whole common edge: others close later.
        while any(_close(window, area) for area in areas if area != viewport):
            pass
        is_tall = window.height >= _TALL * bpy.context.preferences.system.ui_scale
        if is_tall:
            timeline, viewport = _split(window, viewport, "HORIZONTAL", _LOW_SHARE)
        left, viewport = _split(window, viewport, "VERTICAL", _LEFT_SHARE)
        yield False  # Blender splits no area without a size
        if not is_tall:
            timeline, left = _split(window, left, "HORIZONTAL", _TIMELINE_SHARE)
        clips, browser = _split(window, left, "HORIZONTAL", _CLIPS_SHARE)
        yield False
        viewport.type, timeline.ui_type, browser.ui_type = "VIEW_3D", "TIMELINE", "ASSETS"
        viewport.spaces.active.show_region_ui = True
        viewport.spaces.active.show_region_tool_header = False  # room for the tab
        clips.spaces.active.show_region_ui = False
        clips.spaces.active.dopesheet.show_missing_nla = False  # rows without clips
        if hasattr(timeline.spaces.active, "show_region_channels"):
            timeline.spaces.active.show_region_channels = False
        timeline.show_menus = False  # room for the buttons of playback
        yield False
        while not _show_tab(viewport):
            yield False
        _frame_clips(window, clips)
        _frame_bodies(window)
        while browser.spaces.active.params is None:  # until its first drawing
            yield False
        browser.spaces.active.show_region_toolbar = False
        with suppress(TypeError):  # an installation without the library
            browser.spaces.active.params.asset_library_reference = LIBRARY_NAME


def _close(window: bpy.types.Window, area: bpy.types.Area) -> bool:
    """Close an area; returns False if it has no neighbour with a whole common edge."""
    with bpy.context.temp_override(window=window, screen=window.screen, area=area):
        return "FINISHED" in bpy.ops.screen.area_close()


def _split(
    window: bpy.types.Window, area: bpy.types.Area, direction: str, share: float
) -> list[bpy.types.Area]:
    """Split an area into the left and right, or lower and upper one; ``share`` is that of the
    first."""
    before = {each.as_pointer() for each in window.screen.areas}
    with bpy.context.temp_override(window=window, screen=window.screen, area=area):
        bpy.ops.screen.area_split(direction=direction, factor=share)
    (added,) = (each for each in window.screen.areas if each.as_pointer() not in before)
    # Positions are updated at the next drawing. Blender adds the smaller part.
    return [added, area] if share <= 0.5 else [area, added]


def _frame_clips(window: bpy.types.Window, editor: bpy.types.Area) -> None:
    """Frame all clips in an NLA editor; no effect if the user has closed the area."""
    with suppress(ReferenceError, StopIteration, RuntimeError):
        region = next(region for region in editor.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=editor, region=region):
            bpy.ops.nla.view_all()
            first, last = (region.view2d.region_to_view(x, 0)[0] for x in (0, region.width))
            if last - first < _LEAST_FRAMES:  # a ruler of parts of a frame has no numbers
                bpy.ops.view2d.zoom(deltax=0.5 * (last - first - _LEAST_FRAMES))


def _show_tab(viewport: bpy.types.Area) -> bool:
    """Show the HFX tab of a viewport's sidebar; False before the first drawing of the sidebar."""
    sidebar = next((region for region in viewport.regions if region.type == "UI"), None)
    if sidebar is None or sidebar.width <= 1:  # framing needs its width
        return False
    try:
        sidebar.active_panel_category = TAB
    except (TypeError, AttributeError):  # no tabs before the first drawing
        return False
    viewport.tag_redraw()
    return True


def draw_new_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    end_wait(self, context)
    # Blender's own menu entries leave EXEC_DEFAULT set, which would skip the question.
    self.layout.operator_context = "INVOKE_DEFAULT"
    self.layout.operator(HFX_OT_new_file.bl_idname, icon="VIEW_PAN")  # a hand


def end_wait(_self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    remove_handlers(_AWAITED)


def _draw_window_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator(HFX_OT_workspace.bl_idname, icon="WORKSPACE")


ENTRIES = {
    "TOPBAR_MT_window": _draw_window_menu,
    "TOPBAR_MT_file_new": draw_new_menu,  # also of Ctrl+N
    "TOPBAR_MT_file": end_wait,  # Defaults > Load Factory Settings begins a file, too
    "WM_MT_splash": end_wait,
}


def register() -> None:
    for name, entry in ENTRIES.items():
        getattr(bpy.types, name).append(entry)


def unregister() -> None:
    for name, entry in ENTRIES.items():
        getattr(bpy.types, name).remove(entry)
    remove_handlers(_AWAITED)
