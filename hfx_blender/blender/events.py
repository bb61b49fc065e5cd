# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender handlers and timers of the add-on, events between packages, and redrawing."""

import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

import bpy

_UNDO_S = 0.5
_changed_s = 0.0
_listeners: dict[str, Callable[..., None]] = {}  # by event

Handlers = Mapping[str, Callable[..., None]]
"""Functions by the name of their list in ``bpy.app.handlers``."""


def add_handlers(handlers: Handlers, first: Collection[str] = ()) -> None:
    """Add handlers at the end of ``bpy.app.handlers``, or at the begin of lists in ``first``."""
    for name, handler in handlers.items():
        installed = getattr(bpy.app.handlers, name)
        if handler not in installed:
            installed.insert(0 if name in first else len(installed), handler)


def remove_handlers(handlers: Handlers) -> None:
    """Remove handlers from ``bpy.app.handlers``; handlers that are not installed are ignored."""
    for name, handler in handlers.items():
        installed = getattr(bpy.app.handlers, name)
        if handler in installed:
            installed.remove(handler)


class DrawHandlers:
    """Draw functions in the main regions of editors, while registered; none in background mode.

    An entry is a type of space, a function without arguments, and the stage of drawing:
    ``POST_VIEW`` in the scene's space, ``POST_PIXEL`` in pixels of the region.
    """

    def __init__(self, *entries: tuple[type[bpy.types.Space], Callable[[], None], str]) -> None:
        self._entries = entries
        self._added: list[tuple[type[bpy.types.Space], object]] = []

    def register(self) -> None:
        for space, function, stage in () if bpy.app.background else self._entries:
            self._added.append((space, space.draw_handler_add(function, (), "WINDOW", stage)))

    def unregister(self) -> None:
        for space, handle in self._added:
            space.draw_handler_remove(handle, "WINDOW")
        self._added.clear()


def call_soon(
    function: Callable[[], Any], delay_s: float = 0.0, *, outlives_load: bool = False
) -> None:
    """Call a function once by a timer, unless a timer for it is pending. The function may return
    seconds until the next call, as Blender's timers; equal methods count as the same function. With
    ``outlives_load`` the timer stays when a file is loaded."""
    if is_waiting(function):
        return
    # Blender does not report the end of a timer.
    for ended in [timed for timed in _timers if not is_waiting(timed)]:
        del _timers[ended]
    bpy.app.timers.register(function, first_interval=delay_s, persistent=outlives_load)
    _timers[function] = function, outlives_load


def is_waiting(function: Callable[[], Any]) -> bool:
    """Test that :func:`call_soon` has a pending timer for the function or an equal method."""
    # Blender compares identities, and each access to a bound method creates a new object.
    registered, _ = _timers.get(function, (function, False))
    return bpy.app.timers.is_registered(registered)


def push_undo_soon() -> None:
    """Add an undo step half a second after the last call. For properties of the window manager that
    change the scene, as Blender adds no step there. Nothing happens in background mode."""
    global _changed_s
    _changed_s = time.monotonic()
    if not bpy.app.background:
        call_soon(_push_undo, _UNDO_S)


def _push_undo() -> float | None:
    # Each change postpones the undo step, so that a drag is a single step. A timer has no window,
    # and Blender pushes an undo step in a window only.
    wait = _changed_s + _UNDO_S - time.monotonic()
    if wait > 0.0 or is_painting():
        return max(wait, 0.1)
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        bpy.ops.ed.undo_push(message="Haptic Effects")
    return None


def is_painting(operator: str = "PAINT_OT_") -> bool:
    """Test for a running stroke of a brush, by the begin of an operator's id. An undo step in the
    middle of a stroke on an image crashes Blender at the end of the stroke."""
    windows = bpy.context.window_manager.windows
    running = [modal.bl_idname for window in windows for modal in window.modal_operators]
    return any(name.startswith(operator) for name in running)


def listen(event: str, function: Callable[..., None]) -> None:
    """Set the function that :func:`announce` calls for an event; an event has a single function."""
    _listeners[event] = function


def stop_listening(*events: str) -> None:
    """Remove the functions of events, if set."""
    for event in events:
        _listeners.pop(event, None)


def announce(event: str, *arguments: Any) -> None:
    """Call the function set for an event by :func:`listen`, if any."""
    if event in _listeners:
        _listeners[event](*arguments)


def redraw(*kinds: str) -> None:
    """Redraw all areas of the given types, such as ``VIEW_3D``, with their sidebars."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                area.tag_redraw()


def remove_timers(*functions: Callable[[], Any]) -> None:
    """Cancel the timers of functions; functions without a pending timer are ignored."""
    for function in functions:
        if is_waiting(function):
            bpy.app.timers.unregister(_timers.pop(function, (function, False))[0])


_timers: dict[Callable[[], Any], tuple[Callable[[], Any], bool]] = {}
"""Registered objects of timed functions, with True if they outlive loading a file."""


@bpy.app.handlers.persistent
def _before_loading(*_: object) -> None:
    """Remove timers that do not outlive loading a file. Blender itself only marks timers for
    removal, and the Python module 4.5 hangs at exit if marked timers remain."""
    remove_timers(*[timed for timed, (_, outlives_load) in _timers.items() if not outlives_load])


def register() -> None:
    add_handlers({"load_pre": _before_loading})


def unregister() -> None:
    remove_handlers({"load_pre": _before_loading})
    _before_loading()
