# SPDX-License-Identifier: GPL-3.0-or-later
"""Values over time, computed at once."""

from __future__ import annotations

import bpy

from ..authoring.effects import effects
from ..playback.preview.preview import preview
from ..playback.timeline.timeline_recorder import recorder
from ..reading.stepped.reached import has_effects
from .shared import HfxOperator


class HFX_OT_update_values(HfxOperator):
    """Compute the values of effects and actuators over the timeline, stepping through its frames"""

    bl_idname = "hfx.update_values"
    bl_label = "Update Values"
    bl_options = {"REGISTER"}
    requires = (
        (
            lambda context: has_effects(context.scene) and effects.bodies_of(context.scene),
            "Add a body and effects first",
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        recorder.update_now(context.scene)
        preview.touch()
        return ""
