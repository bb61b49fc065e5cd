# SPDX-License-Identifier: GPL-3.0-or-later
"""Media for haptics: sound in sync with playback, videos, 360 degree pictures."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..authoring import media
from ..errors import InputError
from .shared import HfxOperator

_SOUNDS = "*.wav;*.mp3;*.flac;*.ogg;*.aac;*.m4a;*.opus"
_PICTURES = (".png", ".jpg", ".jpeg", ".exr", ".hdr")
_VIDEOS = "*.mp4;*.mov;*.mkv;*.avi;*.webm;" + ";".join(f"*{each}" for each in _PICTURES)


class HFX_OT_add_sound(HfxOperator, ImportHelper):
    """Add a sound at the current frame, and sync playback to audio"""

    bl_label = "Sound"

    filter_glob: StringProperty(default=_SOUNDS, options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        strip = media.add_sound(context.scene, Path(self.filepath), context.scene.frame_current)
        return f"'{strip.name}' plays from frame {strip.frame_final_start}"


class HFX_OT_add_video(HfxOperator, ImportHelper):
    """Show a video or a picture behind the scene; 360 degree pictures surround the scene.

    A video plays at its own rate from the current frame, with its sound
    """

    bl_label = "Video"

    filter_glob: StringProperty(default=_VIDEOS, options={"HIDDEN"})
    projection: EnumProperty(
        name="Projection",
        description="Projection of the picture",
        items=(
            ("FLAT", "Flat", "An image behind the body"),
            ("SPHERE", "360 Degrees", "Equirectangular, as the world around the body"),
        ),
    )
    with_sound: BoolProperty(
        name="Sound",
        description="Add the video's sound to the timeline, and sync playback to audio",
        default=True,
    )

    def work(self, context: bpy.types.Context) -> str:
        scene = context.scene
        path, start = Path(self.filepath), scene.frame_current
        if self.projection == "SPHERE":
            media.add_surroundings(scene, path, start)
            # Solid shading does not show the world.
            for area in context.screen.areas if context.screen is not None else ():
                if area.type == "VIEW_3D":
                    area.spaces.active.shading.type = "MATERIAL"
                    area.spaces.active.shading.use_scene_world = True
            shown = f"'{path.name}' is the world; seen in Material Preview and in renders"
        else:
            shown = f"'{media.add_screen(scene, path, start).name}' stands behind the body"
        if self.with_sound and path.suffix.lower() not in _PICTURES:
            try:
                media.add_sound(scene, path, start)
            except InputError:
                pass  # a video without sound
            else:
                shown += ", with its sound"
        return shown
