# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimate the relief of a material's picture, while Blender goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy
from bpy.props import BoolProperty, FloatVectorProperty

from ...errors import InputError
from ..shared import HfxOperator

if TYPE_CHECKING:
    from ...authoring.surfaces.relief_estimation import ReliefEstimation

_PAUSE_S = 0.1


class HFX_OT_estimate_relief(HfxOperator):
    """Estimate relief and roughness from the picture of the material's base colour

    A photograph does not tell all: colours can be mistaken for relief. Esc cancels
    """

    bl_idname = "hfx.estimate_relief"
    bl_label = "Relief from Picture"

    size_mm: FloatVectorProperty(
        name="Size (mm)",
        description="Width and height of what the picture shows",
        size=2,
        min=1e-3,
        max=1e6,
        default=(100.0, 100.0),
    )
    tiles: BoolProperty(
        name="Tiles", description="The picture goes on at its opposite edge", default=True
    )

    # Without annotations, which Blender would take for properties.
    _is_invoked = False
    estimation = None
    _timer = None
    _owner = ""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        from ...authoring.surfaces import relief_estimation

        found = relief_estimation.picture_of(context.object)
        return cls.needs(found, "Select a mesh whose material has a picture as its base colour")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        from ...authoring.surfaces import surface_uv

        self._is_invoked = True
        if not self.properties.is_property_set("size_mm"):
            try:
                self.size_mm = surface_uv.tile_mm(context.object)
            except InputError:
                pass  # there is no UV map yet: the user says it
        return context.window_manager.invoke_props_dialog(self)  # type: ignore[no-any-return]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Estimate while a script waits; in a window while Blender goes on."""
        if not self._is_invoked or bpy.app.background:
            return super().execute(context)
        begun = self.reported(lambda: self.begin(context))
        return {"RUNNING_MODAL"} if begun == {"FINISHED"} else begun

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.surfaces import relief_estimation

        return relief_estimation.apply_estimate(context.object, self._started(context))

    def _started(self, context: bpy.types.Context) -> ReliefEstimation:
        from ...authoring.surfaces import relief_estimation

        picture = relief_estimation.picture_of(context.object)
        return relief_estimation.ReliefEstimation(picture, tuple(self.size_mm), self.tiles)

    def begin(self, context: bpy.types.Context) -> str:
        self.estimation = self._started(context)
        self._owner = context.object.name
        window_manager = context.window_manager
        self._timer = window_manager.event_timer_add(_PAUSE_S, window=context.window)
        window_manager.modal_handler_add(self)
        context.workspace.status_text_set("Estimating the relief. Esc: cancel")
        return ""

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait for the result; other actions go on."""
        assert self.estimation is not None
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"WARNING"}, "Cancelled: the surface is as it was")
            return {"CANCELLED"}
        if event.type != "TIMER" or self.estimation.is_running:
            return {"PASS_THROUGH"}
        estimation, self.estimation = self.estimation, None
        self.cancel(context)
        return self.reported(lambda: self._taken(context, estimation))

    def _taken(self, context: bpy.types.Context, estimation: ReliefEstimation) -> str:
        from ...authoring.surfaces import relief_estimation

        obj = context.scene.objects.get(self._owner)
        if obj is None:
            estimation.stop()
            raise InputError(f"'{self._owner}' is gone: its relief was not made.")
        return relief_estimation.apply_estimate(obj, estimation)

    def cancel(self, context: bpy.types.Context) -> None:
        """End the waiting, with a result or without."""
        if self.estimation is not None:
            self.estimation.stop()
            self.estimation = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
            context.workspace.status_text_set(None)
