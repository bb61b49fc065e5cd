# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances stored in a scene: for exports, and for preview and live output."""

from __future__ import annotations

import bpy

from ...blender.stored_values import bad_values
from ...engine.tolerance import PREVIEW, Tolerance, parse
from ...errors import InputError, UsageError


def scene_tolerance(scene: bpy.types.Scene) -> Tolerance:
    """Read the export tolerance of a scene.

    Raises
    ------
    InputError
        The stored value is no tolerance.
    """
    for bad in bad_values(scene):
        if bad.path in ("tolerance", "tolerance_custom"):
            raise InputError(f"Scene '{scene.name}': {bad}.")
    if scene.hfx.tolerance != "CUSTOM":
        return parse(scene.hfx.tolerance)
    try:
        return parse(scene.hfx.tolerance_custom)
    except UsageError as error:
        raise InputError(f"Scene '{scene.name}': {error}.") from error


def live_tolerance(scene: bpy.types.Scene) -> Tolerance:
    """Read the tolerance of the preview and of live devices.

    Raises
    ------
    InputError
        The stored value is no tolerance.
    """
    return PREVIEW if scene.hfx.live_tolerance == "PREVIEW" else scene_tolerance(scene)
