# SPDX-License-Identifier: GPL-3.0-or-later
"""Registering a package's modules with Blender, in order, and taking them back in reverse."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType


def of_modules(
    modules: Callable[[], tuple[ModuleType, ...]],
) -> tuple[Callable[[], None], Callable[[], None]]:
    """``register`` and ``unregister`` for modules that have both.

    Parameters
    ----------
    modules : callable
        Imports them and returns them in order; called no earlier than ``register`` is, so that
        importing the package imports no ``bpy``.
    """

    def register() -> None:
        for module in modules():
            module.register()

    def unregister() -> None:
        for module in reversed(modules()):
            module.unregister()

    return register, unregister
