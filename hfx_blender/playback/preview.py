# SPDX-License-Identifier: GPL-3.0-or-later
"""Preview: avatars are coloured in the viewport by what is felt now.

Nothing is stored in the user's meshes: colours are laid over them while the viewport is drawn,
and are worked out only if something moved since they were.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

from ..errors import HfxError

if TYPE_CHECKING:
    from .preview_layers import Layer, Preview

_log = logging.getLogger(__name__)

_is_describing = False
_preview: Preview | None = None
_draw_handle: object | None = None


def preview() -> Preview:
    """The one preview; made when it is first needed, for Blender's start not to wait for it."""
    global _preview
    if _preview is None:
        from .preview_layers import Preview

        _preview = Preview()
    return _preview


def touch() -> None:
    """Something moved; colours are worked out when they are drawn next."""
    if _preview is not None:
        _preview.touch()


def forget() -> None:
    """Work everything out anew: another file, or an undo."""
    if _preview is not None:
        _preview.forget()


@persistent
def _on_change(*_: object) -> None:
    if not _is_describing and bpy.context.window_manager.hfx_preview:
        touch()
        if not bpy.app.timers.is_registered(_describe):
            # Not from here: describing evaluates the view layer, which would call this again.
            bpy.app.timers.register(_describe, first_interval=0.0)


@persistent
def _on_load(*_: object) -> None:
    forget()
    _on_change()


def _describe() -> None:
    global _is_describing
    _is_describing = True
    try:
        before = preview().fault
        preview().describe(bpy.context)
        if preview().fault and preview().fault != before:
            _log.info("preview: %s", preview().fault)
    except (ReferenceError, AttributeError, HfxError):  # no scene at this moment
        forget()
    finally:
        _is_describing = False
    _redraw()


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _switched(_self: object, _context: bpy.types.Context) -> None:
    _on_load()
    _redraw()


def _draw() -> None:
    if not bpy.context.window_manager.hfx_preview:
        return
    space = bpy.context.space_data
    if space is None or not space.overlay.show_overlays:
        return
    draw_layers(preview().layers(bpy.context.scene.hfx.palette))


def draw_layers(layers: list[Layer]) -> None:
    """Draw colours into the 3D view that is being drawn."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.face_culling_set("BACK")
    for layer in layers:
        content = {"pos": layer.positions, "color": layer.colours}
        batch_for_shader(shader, "TRIS", content, indices=layer.triangles).draw(shader)
    gpu.state.face_culling_set("NONE")
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


_CHANGES = ("frame_change_post", "depsgraph_update_post")
_LOADS = ("load_post", "undo_post", "redo_post")


def register() -> None:
    global _draw_handle
    bpy.types.WindowManager.hfx_preview = bpy.props.BoolProperty(
        name="Show What Is Felt",
        description="Colour the avatar in the viewport by what it feels",
        default=True,
        update=_switched,
    )
    if not bpy.app.background:  # nothing is drawn there, and exports step through time
        for name in _CHANGES:
            getattr(bpy.app.handlers, name).append(_on_change)
        for name in _LOADS:
            getattr(bpy.app.handlers, name).append(_on_load)
        _draw_handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    global _draw_handle
    if _draw_handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_draw_handle, "WINDOW")
        _draw_handle = None
        for name in _LOADS:
            getattr(bpy.app.handlers, name).remove(_on_load)
        for name in _CHANGES:
            getattr(bpy.app.handlers, name).remove(_on_change)
    if bpy.app.timers.is_registered(_describe):
        bpy.app.timers.unregister(_describe)
    del bpy.types.WindowManager.hfx_preview
    forget()
