# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that record the scene: a track for live devices, and values over time."""

from __future__ import annotations

import shutil
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ...authoring.effects import effects, swarms
from ...blender.events import push_undo_soon
from ...playback.live.live import live
from ...playback.preview.preview import preview
from ...playback.timeline.timeline_recorder import recorder
from ...processes import blender_session
from ...reading.stepped.reached import has_effects
from ..shared import HfxOperator, StepwiseExport, is_in_view_layer

if TYPE_CHECKING:
    from ...export.report import ExportReport


# Folder of the last recording, in Blender's temporary folder of this session.
_recorded: list[Path] = []


class HFX_OT_record_track(StepwiseExport):
    """Record the whole timeline for connected devices. The devices then play the recording in sync
    with the timeline, without evaluating the scene

    The track is kept until Blender quits; export to keep a track
    """

    bl_label = "Record Track"

    def export_steps(self, context: bpy.types.Context) -> Generator[float, None, ExportReport]:
        from ...engine.rendering.room import needs_positions
        from ...export.scene_export import ExportSettings, SceneExport
        from ...reading.description.scene_settings import scene_devices

        devices, _ = scene_devices(context.scene)
        record = ("positions",) if needs_positions(devices) else ()
        settings = ExportSettings(("track",), record=record)
        # Stepping blocks Blender: devices stop now, instead of by a missing heartbeat.
        live.stop_all("a track is recorded")
        # Closes the track of an earlier recording, whose folder is removed below.
        live.tracks.forget()
        while _recorded:
            shutil.rmtree(_recorded.pop(), ignore_errors=True)
        folder = blender_session.new_temporary_folder("hfx_recorded_")
        _recorded.append(folder)
        return SceneExport(context.scene, settings).steps(folder, "recorded")

    def finished(self, context: bpy.types.Context, report: ExportReport) -> str:
        from ...engine.track import SUFFIX

        track = next(file for file in report.files if file.suffix == SUFFIX)
        live.tracks.select_written(context.scene, str(track))
        context.scene.hfx.live_source = "TRACK"
        push_undo_soon()
        return "Recorded: press Play under Live Devices, then play the timeline"


class HFX_OT_hide_meshes(HfxOperator):
    """Hide meshes and other shapes without a haptic role, for faster playback. Alt H shows hidden
    objects"""

    bl_label = "Hide Other Meshes"

    def work(self, context: bpy.types.Context) -> str:
        # Bodies with avatars and children, and effects with their emitters stay visible.
        listed = swarms.listed_effects(context.scene)
        needed = {o for effect in listed for o in swarms.objects_showing(context.scene, effect)}
        for body in effects.bodies_of(context.scene):
            needed |= {body, body.hfx.avatar, *(part.mesh for part in body.hfx.avatar_parts)}
            needed |= set(body.children_recursive)
        count = 0
        for obj in context.visible_objects:
            is_shape = obj.type in ("MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "VOLUME")
            is_shape |= obj.type in ("POINTCLOUD", "GREASEPENCIL", "GPENCIL")
            if is_shape and obj not in needed and is_in_view_layer(context, obj):
                obj.hide_set(True)
                count += 1
        return f"{count} hidden; Alt H shows them again"


class HFX_OT_update_values(HfxOperator):
    """Compute the values of effects and actuators on all frames of the timeline"""

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
        preview.invalidate()
        return ""
