# SPDX-License-Identifier: GPL-3.0-or-later
"""What every operator shares: a fault of the user's is a report, never a traceback."""

from __future__ import annotations

import bpy

from ..errors import HfxError


class HfxOperator(bpy.types.Operator):
    """Base of the operators: ``work`` does it, :class:`HfxError` becomes an error report."""

    bl_options = {"REGISTER", "UNDO"}

    def work(self, context: bpy.types.Context) -> str:
        """Do it, and return what to report ("" for nothing)."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            message = self.work(context)
        except HfxError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if message:
            self.report({"INFO"}, message)
        return {"FINISHED"}


def select_only(context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Make an object the active and only selected one."""
    for other in context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    context.view_layer.objects.active = obj


def active_effect(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, if it is a haptic effect."""
    obj = context.object
    return obj if obj is not None and obj.hfx.role == "EFFECT" else None
