# SPDX-License-Identifier: GPL-3.0-or-later
"""Importing HJIF files as effects."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ...errors import InputError
from ...text import printable
from ..shared import OnBodyOperator, target_body


class HFX_OT_import_hjif(OnBodyOperator, ImportHelper):
    """Add the channels of an MPEG HJIF file as painted effects, from the current frame on"""

    bl_idname = "hfx.import_hjif"
    bl_label = "Import Haptics"

    filename_ext = ".hjif"
    filter_glob: StringProperty(default="*.hjif", options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.effects import hjif_import

        made, left_out, notes = hjif_import.import_hjif(
            context.scene,
            Path(self.filepath),
            target_body(context),
            float(context.scene.frame_current),
        )
        for each in [*notes, *(f"left out {each}" for each in left_out)]:
            self.report({"WARNING"}, printable(each[:1].upper() + each[1:]))
        if not made:
            raise InputError(f"{self.filepath}: has nothing that can become an effect.")
        return f"Added {len(made)} effects"
