# SPDX-License-Identifier: GPL-3.0-or-later
"""Drives live devices from Blender's handlers and timers, while a device is connected."""

from __future__ import annotations

import logging
from typing import Protocol

import bpy
from bpy.app.handlers import persistent

from ...blender.events import add_handlers, call_soon, remove_handlers, remove_timers
from ...errors import HfxError
from ...reading.stepped import stepping

BEAT_S = 0.05


class Listener(Protocol):
    """Interface of what follows the open scene."""

    @property
    def is_armed(self) -> bool: ...

    def touch(self) -> None: ...

    def forget(self) -> None: ...

    def describe(self, context: bpy.types.Context) -> None: ...

    def update(self, scene: bpy.types.Scene) -> None: ...

    def exchange_heartbeat(self) -> bool: ...

    def stop_all(self, reason: str) -> None: ...

    def fail(self, text: str) -> None: ...


_log = logging.getLogger(__name__)
_live: Listener | None = None
_is_describing = False


def listen(live: Listener) -> None:
    """Follow the open scene, and give signs of life."""
    global _live
    _live = live
    add_handlers(_HANDLERS)
    call_soon(_beat, BEAT_S, outlives_load=True)


def stop_listening() -> None:
    """Remove handlers and timers, as no device is connected any more."""
    remove_handlers(_HANDLERS)
    remove_timers(_beat, _describe)


def request_update() -> None:
    """Describe and send soon; not from within an update of Blender's."""
    call_soon(_describe)


def is_playing() -> bool:
    """Test for a playing animation, in which the next frames are known."""
    screen = bpy.context.screen
    return screen is not None and screen.is_animation_playing


def _describe() -> None:
    global _is_describing
    if _live is None:
        return
    if getattr(bpy.context, "scene", None) is None:  # at this moment
        _live.forget()
        return
    _is_describing = True
    try:
        _live.describe(bpy.context)
        _live.update(bpy.context.scene)
    except ReferenceError as error:  # something was deleted; the next change will describe it
        _log.info("live: %s", error)
        _live.forget()
    except HfxError as error:
        _live.fail(str(error))
    except Exception as error:
        _log.exception("live")
        _live.fail(f"{type(error).__name__}: {error}")
    finally:
        _is_describing = False


@persistent
def _on_change(scene: bpy.types.Scene, *_: object) -> None:
    if _live is None:
        return
    _live.touch()  # also while nothing plays: the next Play needs the change
    if _is_describing or not _live.is_armed or scene != bpy.context.scene:
        return
    if stepping.is_stepping() or bpy.app.is_job_running("RENDER"):
        return
    try:
        _live.update(scene)
    except (ReferenceError, HfxError) as error:
        _live.forget()
        _live.fail(str(error))
    except Exception as error:
        _log.exception("live")
        _live.fail(f"{type(error).__name__}: {error}")
    if not is_playing():
        request_update()  # something may have been added, painted or muted


@persistent
def _on_update(scene: bpy.types.Scene, *_: object) -> None:
    is_edit = _live is not None and not stepping.is_stepping()
    _on_change(scene)
    if is_edit and not _is_describing and is_playing():
        request_update()  # edits during playback are felt at once


@persistent
def _on_load(*_: object) -> None:
    _stop("another file was opened")


@persistent
def _on_undo(*_: object) -> None:
    _stop("stopped by an undo or redo")


def _stop(reason: str) -> None:
    if _live is not None:
        _live.stop_all(reason)
        _live.forget()


def _beat() -> float:
    if _live is not None:
        try:
            if _live.exchange_heartbeat():
                _redraw()
        except ReferenceError as error:  # something was deleted; the next change will describe it
            _log.info("live: %s", error)
            _live.forget()
        except Exception as error:  # a timer that raises is not called again
            _log.exception("live")
            _live.fail(f"{type(error).__name__}: {error}")
    return BEAT_S


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


_HANDLERS = {
    "frame_change_post": _on_change,
    "depsgraph_update_post": _on_update,
    "load_pre": _on_load,
    "undo_pre": _on_undo,
    "redo_pre": _on_undo,
}
