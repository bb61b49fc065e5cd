# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sees: menus, panels, and the command line inside an installed Blender."""

from __future__ import annotations

from types import ModuleType


def _modules() -> tuple[ModuleType, ...]:
    from . import blender_command, menus, panels

    return menus, panels, blender_command


def register() -> None:
    for module in _modules():
        module.register()


def unregister() -> None:
    for module in reversed(_modules()):
        module.unregister()
