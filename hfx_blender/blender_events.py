# SPDX-License-Identifier: GPL-3.0-or-later
"""Handlers and timers of ours in Blender."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import bpy

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


def call_soon(function: Callable[[], Any], delay_s: float = 0.0) -> None:
    """Call a function by a timer, unless it waits for that already."""
    if not bpy.app.timers.is_registered(function):
        bpy.app.timers.register(function, first_interval=delay_s)


def remove_timers(*functions: Callable[[], Any]) -> None:
    """Remove the timers of functions that wait for theirs."""
    for function in functions:
        if bpy.app.timers.is_registered(function):
            bpy.app.timers.unregister(function)
