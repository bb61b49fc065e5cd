# SPDX-License-Identifier: GPL-3.0-or-later
"""Handlers and timers of ours in Blender, and redrawing."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import bpy

_UNDO_S = 0.5
_changed_s = 0.0
_listeners: dict[str, Callable[..., None]] = {}  # by event

Handlers = Mapping[str, Callable[..., None]]
"""Functions by the names of their lists in ``bpy.app.handlers``."""


def add_handlers(handlers: Handlers) -> None:
    """Append handlers that are not there yet."""
    for name, handler in handlers.items():
        there = getattr(bpy.app.handlers, name)
        if handler not in there:
            there.append(handler)


def remove_handlers(handlers: Handlers) -> None:
    """Remove handlers that are there."""
    for name, handler in handlers.items():
        there = getattr(bpy.app.handlers, name)
        if handler in there:
            there.remove(handler)


def call_soon(
    function: Callable[[], Any], delay_s: float = 0.0, *, outlives_load: bool = False
) -> None:
    """Call a function by a timer, unless it waits for that already.

    Parameters
    ----------
    function : callable
        A method, too: methods of one object are the same if they are equal.
    delay_s : float
    outlives_load : bool
        Call it even if a file is loaded before.
    """
    if is_waiting(function):
        return
    for ended in [each for each in _timers if not is_waiting(each)]:
        del _timers[ended]
    bpy.app.timers.register(function, first_interval=delay_s, persistent=outlives_load)
    _timers[function] = function, outlives_load


def is_waiting(function: Callable[[], Any]) -> bool:
    """Test for a function that a timer is to call."""
    # Blender knows the very object that was registered; a method is another one each time.
    registered, _ = _timers.get(function, (function, False))
    return bpy.app.timers.is_registered(registered)


def push_undo_soon() -> None:
    """Make an undo step once a value is no longer changed.

    For properties of the window manager that change the scene: Blender makes none for these.
    """
    global _changed_s
    _changed_s = time.monotonic()
    if not bpy.app.background:
        call_soon(_push_undo, _UNDO_S)


def _push_undo() -> float | None:
    wait = _changed_s + _UNDO_S - time.monotonic()
    if wait > 0.0:
        return wait
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window):
        bpy.ops.ed.undo_push(message="Haptic Effects")
    return None


def listen(event: str, function: Callable[..., None]) -> None:
    """Call a function whenever :func:`announce` names the event; one function an event."""
    _listeners[event] = function


def stop_listening(*events: str) -> None:
    """Remove the functions of events."""
    for event in events:
        _listeners.pop(event, None)


def announce(event: str, *arguments: Any) -> None:
    """Call the function that listens to an event, if there is one."""
    if event in _listeners:
        _listeners[event](*arguments)


def redraw(*kinds: str) -> None:
    """Have all areas of these types, such as ``VIEW_3D``, drawn again, their sidebars too."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in kinds:
                area.tag_redraw()


def remove_timers(*functions: Callable[[], Any]) -> None:
    """Remove the timers of functions that wait for theirs."""
    for function in functions:
        if is_waiting(function):
            bpy.app.timers.unregister(_timers.pop(function, (function, False))[0])


_timers: dict[Callable[[], Any], tuple[Callable[[], Any], bool]] = {}
"""Functions that were given to timers, as they were registered; whether they outlive a load."""


@bpy.app.handlers.persistent
def _before_loading(*_: object) -> None:
    """Remove timers: Blender only marks them, and its Python module 4.5 hangs at exit over those
    that it marked and never came to remove.
    """
    remove_timers(*[each for each, (_, outlives_load) in _timers.items() if not outlives_load])


def register() -> None:
    add_handlers({"load_pre": _before_loading})


def unregister() -> None:
    remove_handlers({"load_pre": _before_loading})
    _before_loading()
