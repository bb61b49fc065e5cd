# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user sees: menus, panels, and the command line inside an installed Blender."""

from __future__ import annotations

from types import ModuleType

from .. import registration


def _modules() -> tuple[ModuleType, ...]:
    from . import (
        blender_command,
        body_panel,
        effects_panel,
        live_panel,
        menus,
        paint_panel,
        panels,
        volume_gizmo,
    )

    return (
        menus,
        effects_panel,
        panels,
        paint_panel,
        body_panel,
        volume_gizmo,
        live_panel,
        blender_command,
    )


register, unregister = registration.of_modules(_modules)
