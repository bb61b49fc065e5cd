# SPDX-License-Identifier: GPL-3.0-or-later
"""Exporting the scene from within Blender."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..authoring import effects
from ..errors import InputError
from .shared import HfxOperator


class HFX_OT_export(HfxOperator, ExportHelper):
    """Record the scene's haptic track, and what its devices play, into a folder"""

    bl_idname = "hfx.export"
    bl_label = "Export Haptics"
    bl_options = {"REGISTER"}

    filename_ext = ".hfxtrack"
    filter_glob: StringProperty(default="*.hfxtrack", options={"HIDDEN"})
    full_precision: BoolProperty(
        name="Full Precision", description="Weights as 32-bit floats instead of 8 bits"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if effects.effects_of(context.scene):
            return True
        cls.poll_message_set("Add a haptic effect first")
        return False

    def work(self, context: bpy.types.Context) -> str:
        from ..export import ExportSettings, export_scene, scene_devices

        scene = context.scene
        devices = scene_devices(scene)
        formats = ("track", "csv") if devices else ("track",)
        path = Path(bpy.path.abspath(self.filepath))
        if not self.filepath or path.is_dir():
            raise InputError(f"Choose a file to export to; '{self.filepath}' names none.")
        context.window_manager.progress_begin(0, 1)
        try:
            report = export_scene(
                scene,
                path.parent,
                path.stem,
                ExportSettings(formats, devices, full_precision=self.full_precision),
                context.window_manager.progress_update,
            )
        finally:
            context.window_manager.progress_end()
        for warning in report.warnings:
            self.report({"WARNING"}, warning)
        return f"Wrote {len(report.files)} files to {path.parent}"


register, unregister = bpy.utils.register_classes_factory((HFX_OT_export,))
