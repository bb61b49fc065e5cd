# SPDX-License-Identifier: GPL-3.0-or-later
"""Copying of the facts of ``hfx doctor`` in Blender."""

import bpy

from .shared import HfxOperator


class HFX_OT_copy_system_information(HfxOperator):
    """Copy versions, libraries, ports, sound cards, folders and devices of this installation to \
the clipboard, without personal paths, for a report of a problem"""

    bl_label = "Copy System Information"
    bl_options = {"REGISTER"}

    def work(self, context: bpy.types.Context) -> str:
        from ..commands.doctor import as_text, system_information  # loads libraries

        context.window_manager.clipboard = as_text(system_information())
        return "Copied the system information"
