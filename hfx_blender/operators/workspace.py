# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX workspace: viewport with the HFX tab, NLA editor for clips, timeline; the start-up file."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import bpy
from mathutils import Quaternion

from ..blender.events import Handlers, add_handlers, call_soon, remove_handlers
from . import framing
from .shared import HfxOperator

NAME = "HFX"
TAB = "HFX"

_NLA_SHARE = 0.4  # of the viewport's height: five effects at 1280 x 800, two rows each
_FROM_THE_FRONT = Quaternion((0.743, 0.646, 0.114, 0.131))  # a little from above and aside
_AGAIN_S = 0.05
_DRAWN_S = 0.5
_PATIENCE_S = 30.0


def _has_window(context: bpy.types.Context) -> bool:
    return context.window is not None and not bpy.app.background


class HFX_OT_workspace(HfxOperator):
    """Go to the HFX workspace: viewport with the HFX tab, NLA editor for clips, timeline. The
    workspace is added if missing"""

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
        _retry(partial(_arrange_when_shown, context.window, added))
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
    call_soon(_go_to_workspace, _AGAIN_S, outlives_load=True)


_AWAITED: Handlers = {"load_post": replace_cube_by_avatar}


def _go_to_workspace() -> None:
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.hfx.workspace()
    call_soon(_frame_avatar, 2.0 * _AGAIN_S)


def _frame_avatar() -> float | None:
    """Timer: frame the selected avatar from the front, once the HFX workspace is active."""
    window = bpy.context.window_manager.windows[0]
    if window.workspace.name != NAME:
        return _AGAIN_S
    with bpy.context.temp_override(window=window):
        area = framing.viewport(bpy.context)
        area.spaces.active.region_3d.view_rotation = _FROM_THE_FRONT
        framing.frame(bpy.context, bpy.context.selected_objects)
    return None


def _retry(step: Callable[[], bool]) -> None:
    """Call ``step`` by a timer until it returns True, or for 30 s at most."""
    until = time.monotonic() + _PATIENCE_S

    def retry() -> float | None:
        return None if step() or time.monotonic() >= until else _AGAIN_S

    call_soon(retry, _AGAIN_S)


def _arrange_when_shown(window: bpy.types.Window, workspace: bpy.types.WorkSpace) -> bool:
    """Arrange a window that shows a workspace; False if it shows another workspace yet."""
    try:
        if window.workspace != workspace:
            return False
        _arrange(window)
    except ReferenceError:  # the window was closed, or another file opened
        pass
    return True


def _arrange(window: bpy.types.Window) -> None:
    """Arrange a window's areas: largest viewport with the HFX tab; NLA editor below, if missing."""
    areas = window.screen.areas
    viewports = [area for area in areas if area.type == "VIEW_3D"]
    viewport = max(viewports or areas, key=lambda area: area.width * area.height)
    viewport.type = "VIEW_3D"
    if not any(area.type == "NLA_EDITOR" for area in areas):
        before = {area.as_pointer() for area in areas}
        with bpy.context.temp_override(window=window, screen=window.screen, area=viewport):
            bpy.ops.screen.area_split(direction="HORIZONTAL", factor=_NLA_SHARE)
        for area in areas:
            if area.as_pointer() not in before:
                lower, upper = sorted((area, viewport), key=lambda each: each.y)
                lower.type, upper.type = "NLA_EDITOR", "VIEW_3D"
                lower.spaces.active.show_region_ui = False
                lower.spaces.active.dopesheet.show_missing_nla = False  # rows without clips
                # By a timer: Blender sizes the editor at the next drawing.
                call_soon(partial(_frame_clips, window, lower), _DRAWN_S)
    viewport = max((a for a in areas if a.type == "VIEW_3D"), key=lambda a: a.width * a.height)
    viewport.spaces.active.show_region_ui = True
    _retry(partial(_show_tab, viewport))


def _frame_clips(window: bpy.types.Window, editor: bpy.types.Area) -> None:
    """Frame all clips in an NLA editor; no effect if the user has closed the area."""
    with suppress(ReferenceError, StopIteration, RuntimeError):
        region = next(region for region in editor.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=editor, region=region):
            bpy.ops.nla.view_all()


def _show_tab(viewport: bpy.types.Area) -> bool:
    """Show the HFX tab of a viewport's sidebar; False before the first drawing of the sidebar."""
    try:
        sidebar = next(region for region in viewport.regions if region.type == "UI")
        # A sidebar has no tabs before its first drawing.
        sidebar.active_panel_category = TAB
        viewport.tag_redraw()
    except (TypeError, AttributeError):
        return False
    except (ReferenceError, StopIteration):  # the viewport was closed
        pass
    return True


def draw_new_menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    end_wait(self, context)
    # Blender's own menu entries leave EXEC_DEFAULT set, which would skip the question.
    self.layout.operator_context = "INVOKE_DEFAULT"
    self.layout.operator(HFX_OT_new_file.bl_idname, icon="VIEW_PAN")  # a hand


def end_wait(_self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    remove_handlers(_AWAITED)


def _window_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.operator(HFX_OT_workspace.bl_idname, icon="WORKSPACE")


ENTRIES = {
    "TOPBAR_MT_window": _window_menu,
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
