# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX: a haptic editor for full-body immersive experiences.

Importing this package imports no ``bpy``; :func:`register` does.
"""

from __future__ import annotations

from types import ModuleType

__version__ = "0.1.0"


def _modules() -> tuple[ModuleType, ...]:
    from . import handlers, operators, properties, ui

    return properties, operators, ui, handlers


def register() -> None:
    """Register everything with Blender."""
    for module in _modules():
        module.register()


def unregister() -> None:
    """Take everything back, in reverse order."""
    for module in reversed(_modules()):
        module.unregister()
