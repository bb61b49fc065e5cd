# SPDX-License-Identifier: GPL-3.0-or-later
"""Importing HJIF files as effects."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..authoring import effects
from ..errors import InputError
from ..printable import printable
from .shared import HfxOperator, active_body


class HFX_OT_import_hjif(HfxOperator, ImportHelper):
    """Add the channels of an MPEG HJIF file as painted effects, from the current frame on"""

    bl_idname = "hfx.import_hjif"
    bl_label = "Import Haptics"

    filename_ext = ".hjif"
    filter_glob: StringProperty(default="*.hjif", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return cls.needs(effects.bodies_of(context.scene), "Add or mark a haptic body first")

    def work(self, context: bpy.types.Context) -> str:
        from ..authoring import hjif_import

        bodies = effects.bodies_of(context.scene)
        active = active_body(context)
        if active not in bodies and len(bodies) > 1:
            raise InputError("Several haptic bodies: select the one that shall feel it.")
        body = active if active in bodies else bodies[0]
        frame = float(context.scene.frame_current)
        made, left_out, notes = hjif_import.import_hjif(
            context.scene, Path(self.filepath), body, frame
        )
        for each in [*notes, *(f"left out {each}" for each in left_out)]:
            self.report({"WARNING"}, printable(each[:1].upper() + each[1:]))
        if not made:
            raise InputError(f"{self.filepath}: has nothing that an effect could be.")
        return f"Added {len(made)} effects"


register, unregister = bpy.utils.register_classes_factory((HFX_OT_import_hjif,))
