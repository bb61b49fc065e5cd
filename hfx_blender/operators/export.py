# SPDX-License-Identifier: GPL-3.0-or-later
"""Exporting the scene from within Blender."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..authoring import effects
from ..errors import InputError
from ..printable import printable
from .long_work import LongOperator

if TYPE_CHECKING:
    from ..export_report import ExportReport

FORMAT_ITEMS = (
    ("track", "Haptic Track", "Everything that is felt, for any device (.hfxtrack)", 1 << 0),
    (
        "hjif",
        "MPEG HJIF",
        "Everything that is felt, in MPEG's haptics format, with .glb meshes",
        1 << 1,
    ),
    ("jsonl", "JSON Lines", "Everything that is felt, sample by sample, for game engines", 1 << 2),
    ("glb", "glTF Scene", "Bodies and moving volumes, with draft MPEG triggers (.glb)", 1 << 3),
    ("csv", "CSV", "Values of each device, a row for each sample", 1 << 4),
    ("npz", "NPZ Raster", "Values of each device, as NumPy arrays", 1 << 5),
    ("wav", "WAV", "Sound for vibration actuators, 16 bits", 1 << 6),
    ("wav24", "WAV, 24 Bits", "Sound for vibration actuators, 24 bits", 1 << 7),
    ("wavfloat", "WAV, Float", "Sound for vibration actuators, 32-bit floats", 1 << 8),
    ("ahap", "Apple AHAP", "Patterns for Core Haptics", 1 << 9),
    ("ahap-sqrt", "Apple AHAP, Square Roots", "Patterns with roots of amplitudes", 1 << 17),
    ("haptic", "Meta .haptic", "Clips for Meta's Haptics SDK", 1 << 10),
    ("he", "RichTap .he", "Patterns for RichTap phones, version 2", 1 << 11),
    ("he1", "RichTap .he 1", "Patterns for RichTap phones, version 1", 1 << 12),
    ("openharmony", "OpenHarmony", "Vibration patterns for OpenHarmony", 1 << 13),
    ("openxr", "OpenXR", "Parametric vibration for OpenXR controllers", 1 << 14),
    ("tact", "bHaptics .tact", "Projects for bHaptics vests and sleeves", 1 << 15),
    ("jsonl-compact", "JSON Lines, Compact", "The same as JSON Lines in less space", 1 << 16),
)
_RECORD_ITEMS = (
    ("positions", "Positions", "Position of each vertex", 1),
    ("velocities", "Velocities", "Velocity of each vertex", 2),
    ("depth", "Depth", "Depth of each vertex inside a volume", 4),
)
_NAMED = 3  # files that the message names


class HFX_OT_export(LongOperator, ExportHelper):
    """Record the scene's haptic track, and what its devices play, into a folder"""

    bl_idname = "hfx.export"
    bl_label = "Export Haptics"
    bl_options = {"REGISTER"}
    doing, doing_icon = "Exporting Haptics", "EXPORT"
    cancelled = "Export cancelled: nothing was written"

    filename_ext = ".hfxtrack"
    filter_glob: StringProperty(default="*.hfxtrack", options={"HIDDEN"})
    formats: EnumProperty(
        name="Formats",
        description="Formats to write; formats of devices are written for each device of the scene",
        items=FORMAT_ITEMS,
        options={"ENUM_FLAG"},
        default={"track", "csv"},
    )
    per_clip: BoolProperty(
        name="Each Clip by Itself",
        description="Separate files for each named clip, starting at time 0, instead of the "
        "whole timeline",
    )
    record: EnumProperty(
        name="Also Record",
        description="Additional data of each vertex in the track",
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

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._is_invoked = True
        return ExportHelper.invoke(self, context, event)  # type: ignore[no-any-return]

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        return self._reporting(self._steps_of(context))

    def _reporting(
        self, steps: Generator[float, None, ExportReport]
    ) -> Generator[float, None, str]:
        return self._told((yield from steps))

    def _steps_of(self, context: bpy.types.Context) -> Generator[float, None, ExportReport]:
        from ..export import ExportSettings, SceneExport
        from ..export_devices import formats_without, scene_devices
        from ..formats.registry import DEVICE_FORMATS

        scene = context.scene
        devices, missing = scene_devices(scene)
        # In the order of the list, whatever order a set has.
        formats = tuple(name for name, *_ in FORMAT_ITEMS if name in self.formats)
        formats = formats_without(missing, formats, devices)
        if not devices:
            if self.properties.is_property_set("formats") and set(formats) & set(DEVICE_FORMATS):
                raise InputError(
                    f"Scene '{scene.name}' has no devices: add one in its Haptics panel, or choose "
                    "formats that need no device."
                )
            formats = tuple(name for name in formats if name not in DEVICE_FORMATS)
        if not formats:
            raise InputError("Choose at least one format to export.")
        path = Path(bpy.path.abspath(self.filepath))
        if not self.filepath or path.is_dir():
            raise InputError(f"Choose a file to export to; '{self.filepath}' is not a file name.")
        settings = ExportSettings(
            formats,
            devices,
            missing=missing,
            full_precision=self.full_precision,
            record=tuple(name for name, *_ in _RECORD_ITEMS if name in self.record),
            per_clip=self.per_clip,
        )
        return SceneExport(scene, settings).steps(path.parent, path.stem)

    def _told(self, report: ExportReport) -> str:
        for warning in report.warnings:
            self.report({"WARNING"}, printable(warning))
        names = [each.name for each in report.files]
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        return f"Wrote {', '.join(names[:_NAMED])}{more} to {report.files[0].parent}"


register, unregister = bpy.utils.register_classes_factory((HFX_OT_export,))
