# SPDX-License-Identifier: GPL-3.0-or-later
"""User interface: menus, panels and gizmos."""

from __future__ import annotations

from types import ModuleType

from ..blender import registration


def _modules() -> tuple[ModuleType, ...]:
    from ..operators.paths import path_overlay
    from . import asset_library, menus, next_step
    from .gizmos import spot_gizmo, volume_gizmo
    from .panels import (
        body_panel,
        clip_rows,
        effect_list,
        effect_panel,
        effects_panel,
        generation_panel,
        live_panel,
        media_panel,
        paint_panel,
        path_panel,
        response_panel,
        surface_panel,
        values_panel,
    )

    return (
        menus,
        effect_list,
        clip_rows,
        effects_panel,
        effect_panel,
        path_panel,
        path_overlay,
        surface_panel,
        generation_panel,
        response_panel,
        paint_panel,
        body_panel,
        next_step,
        volume_gizmo,
        spot_gizmo,
        values_panel,
        live_panel,
        media_panel,
        asset_library,
    )


register, unregister = registration.of_modules(_modules)
