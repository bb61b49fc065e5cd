# SPDX-License-Identifier: GPL-3.0-or-later
"""Base class and text helper of the panels in the sidebar's HFX tab."""

from __future__ import annotations

import textwrap

import bpy


class HfxPanel:
    """Base of the panels in the HFX tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "HFX"


def draw_text(
    context: bpy.types.Context,
    layout: bpy.types.UILayout,
    text: str,
    icon: str = "NONE",
    reserved: int = 0,
) -> None:
    """Draw a sentence wrapped to the sidebar's width, less ``reserved`` letters, with 20 letters a
    line at least; the icon precedes the first line.
    """
    # Background mode has no region and no interface scale.
    width = 0 if context.region is None else context.region.width
    letters = int(width / (7.0 * (context.preferences.system.ui_scale or 1.0))) - 8 - reserved
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, max(letters, 20))):
        column.label(text=line, icon="BLANK1" if number and icon != "NONE" else icon)
