# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of a scene: metres of its lengths, frames of its seconds."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import bpy


def metres_of(scene: bpy.types.Scene) -> float:
    """Metres of a Blender unit; without a unit system one."""
    settings = scene.unit_settings
    return 1.0 if settings.system == "NONE" else float(settings.scale_length)


def fps_of(scene: bpy.types.Scene) -> float:
    """Played frames of a second."""
    return float(scene.render.fps / scene.render.fps_base)
