# SPDX-License-Identifier: GPL-3.0-or-later
"""Exporting the scene from within Blender."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..authoring import effects
from ..errors import InputError
from .shared import HfxOperator

FORMAT_ITEMS = (
    ("track", "Haptic Track", "What is felt, for any device (.hfxtrack)", 1 << 0),
    (
        "hjif",
        "MPEG HJIF",
        "What is felt, in MPEG's haptics format, with .glb meshes",
        1 << 1,
    ),
    ("jsonl", "JSON Lines", "What is felt, sample by sample, for game engines", 1 << 2),
    ("glb", "glTF Scene", "Bodies and moving volumes, with draft MPEG triggers (.glb)", 1 << 3),
    ("csv", "CSV", "What each device plays, a row for each sample", 1 << 4),
    ("npz", "NPZ Raster", "What each device plays, as NumPy arrays", 1 << 5),
    ("wav", "WAV", "Sound for vibration actuators, 16 bits", 1 << 6),
    ("wav24", "WAV, 24 Bits", "Sound for vibration actuators, 24 bits", 1 << 7),
    ("wavfloat", "WAV, Float", "Sound for vibration actuators, 32-bit floats", 1 << 8),
    ("ahap", "Apple AHAP", "Patterns for Core Haptics", 1 << 9),
    ("haptic", "Meta .haptic", "Clips for Meta's Haptics SDK", 1 << 10),
    ("he", "RichTap .he", "Patterns for RichTap phones, version 2", 1 << 11),
    ("he1", "RichTap .he 1", "Patterns for RichTap phones, version 1", 1 << 12),
    ("openharmony", "OpenHarmony", "Vibration patterns for OpenHarmony", 1 << 13),
    ("openxr", "OpenXR", "Parametric vibration for OpenXR controllers", 1 << 14),
    ("tact", "bHaptics .tact", "Projects for bHaptics vests and sleeves", 1 << 15),
)
_RECORD_ITEMS = (
    ("positions", "Positions", "Where each vertex is", 1),
    ("velocities", "Velocities", "How each vertex moves", 2),
    ("depth", "Depth", "How deep each vertex is within a volume", 4),
)
_NAMED = 3  # files that the message names


class HFX_OT_export(HfxOperator, ExportHelper):
    """Record the scene's haptic track, and what its devices play, into a folder"""

    bl_idname = "hfx.export"
    bl_label = "Export Haptics"
    bl_options = {"REGISTER"}

    filename_ext = ".hfxtrack"
    filter_glob: StringProperty(default="*.hfxtrack", options={"HIDDEN"})
    formats: EnumProperty(
        name="Formats",
        description="Files that are written; those of devices, for each device of the scene",
        items=FORMAT_ITEMS,
        options={"ENUM_FLAG"},
        default={"track", "csv"},
    )
    per_clip: BoolProperty(
        name="Each Clip by Itself",
        description="Files for each named clip, from time 0, instead of the whole timeline",
    )
    record: EnumProperty(
        name="Also Record",
        description="What the track holds of each vertex besides",
        items=_RECORD_ITEMS,
        options={"ENUM_FLAG"},
        default=set(),
    )
    full_precision: BoolProperty(
        name="Full Precision", description="Weights as 32-bit floats instead of 8 bits"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return cls.needs(effects.effects_of(context.scene), "Add a haptic effect first")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.label(text="Formats")
        layout.column(align=True).prop(self, "formats")
        layout.prop(self, "per_clip")
        layout.label(text="Track")
        layout.prop(self, "full_precision")
        layout.column(align=True).prop(self, "record")

    def work(self, context: bpy.types.Context) -> str:
        from ..export import ExportSettings, export_scene, scene_devices
        from ..formats.registry import DEVICE_FORMATS

        scene = context.scene
        devices = scene_devices(scene)
        # In the order of the list, whatever order a set has.
        formats = tuple(name for name, *_ in FORMAT_ITEMS if name in self.formats)
        if not devices:
            if self.properties.is_property_set("formats") and set(formats) & set(DEVICE_FORMATS):
                raise InputError(
                    f"Scene '{scene.name}' has no devices: add one in its Haptics panel, or choose "
                    "formats of what is felt only."
                )
            formats = tuple(name for name in formats if name not in DEVICE_FORMATS)
        if not formats:
            raise InputError("Choose at least one format to export.")
        path = Path(bpy.path.abspath(self.filepath))
        if not self.filepath or path.is_dir():
            raise InputError(f"Choose a file to export to; '{self.filepath}' names none.")
        context.window_manager.progress_begin(0, 1)
        try:
            report = export_scene(
                scene,
                path.parent,
                path.stem,
                ExportSettings(
                    formats,
                    devices,
                    full_precision=self.full_precision,
                    record=tuple(name for name, *_ in _RECORD_ITEMS if name in self.record),
                    per_clip=self.per_clip,
                ),
                context.window_manager.progress_update,
            )
        finally:
            context.window_manager.progress_end()
        for warning in report.warnings:
            self.report({"WARNING"}, warning)
        names = [each.name for each in report.files]
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        return f"Wrote {', '.join(names[:_NAMED])}{more} to {path.parent}"


register, unregister = bpy.utils.register_classes_factory((HFX_OT_export,))
