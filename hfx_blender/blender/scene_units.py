# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of a scene: metres of its lengths, frames of its seconds and of the times it shows."""

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


def frames_per_shown_unit(scene: bpy.types.Scene) -> float:
    """Frames of the unit that times of clips are shown in: 1, or those of a second."""
    return 1.0 if scene.hfx.time_unit == "FRAMES" else fps_of(scene)
