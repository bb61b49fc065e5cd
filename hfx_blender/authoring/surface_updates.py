# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps follow their settings: made again a moment after the last edit, not at every one."""

from __future__ import annotations

import logging

import bpy

from ..errors import HfxError

DELAY_S = 0.3

_log = logging.getLogger(__name__)
_waiting: set[str] = set()  # objects


def request(obj: bpy.types.Object) -> None:
    """Make an object's maps soon, if it has some; timers never fire without a window."""
    from . import surfaces

    if not surfaces.is_surface(obj) or not obj.hfx.surface.made_of:
        return  # nothing was made yet: the first time is asked for
    _waiting.add(obj.name)
    if bpy.app.timers.is_registered(_make):
        bpy.app.timers.unregister(_make)
    bpy.app.timers.register(_make, first_interval=DELAY_S)


def _make() -> None:
    from . import surfaces

    waiting = sorted(_waiting)
    _waiting.clear()
    for name in waiting:
        obj = bpy.data.objects.get(name)
        if obj is None or not surfaces.is_surface(obj):
            continue
        try:
            surfaces.make(obj, anew=False)
        except HfxError:
            pass  # it is told beside the map
        except Exception as error:  # a timer that raises tells nobody
            _log.exception("surface '%s'", name)
            obj.hfx.surface.note = f"{type(error).__name__}: {error}"
            obj.hfx.surface.is_faulty = True
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "IMAGE_EDITOR"):
                area.tag_redraw()


def unregister() -> None:
    """Forget what was asked for."""
    _waiting.clear()
    if bpy.app.timers.is_registered(_make):
        bpy.app.timers.unregister(_make)
