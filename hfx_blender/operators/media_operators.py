# SPDX-License-Identifier: GPL-3.0-or-later
"""Media for haptics: sound in sync with playback, videos, 360 degree pictures."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy_extras.io_utils import ImportHelper

from ..authoring import media
from ..blender import compat
from ..blender.scene_info import animation_fps, fps_of
from ..errors import InputError
from .painting import paint
from .shared import HfxOperator, ImportOperator, OnBodyOperator, active_effect, draw_wrapped

if TYPE_CHECKING:
    from ..formats.sound.sound_analysis import SoundSettings

_SOUNDS = "*.wav;*.mp3;*.flac;*.ogg;*.aac;*.m4a;*.opus"
_PICTURES = (".png", ".jpg", ".jpeg", ".exr", ".hdr")
_LINE = 36  # letters in a line of the dialog
_VIDEOS = "*.mp4;*.mov;*.mkv;*.avi;*.webm;" + ";".join(f"*{each}" for each in _PICTURES)


class HFX_OT_add_sound(HfxOperator, ImportHelper):
    """Add a sound at the current frame, and sync playback to audio"""

    bl_label = "Sound"

    filter_glob: bpy.props.StringProperty(default=_SOUNDS, options={"HIDDEN"})

    def work(self, context: bpy.types.Context) -> str:
        strip = media.add_sound(context.scene, Path(self.filepath), context.scene.frame_current)
        return f"'{strip.name}' plays from frame {strip.frame_final_start}"


class HFX_OT_add_video(HfxOperator, ImportHelper):
    """Show a video or a picture behind the scene; 360 degree pictures surround the scene.

    A video plays at its own rate from the current frame, with its sound
    """

    bl_label = "Video"

    filter_glob: bpy.props.StringProperty(default=_VIDEOS, options={"HIDDEN"})
    projection: bpy.props.EnumProperty(
        name="Projection",
        description="Projection of the picture",
        items=(
            ("FLAT", "Flat", "An image behind the body"),
            ("SPHERE", "360 Degrees", "Equirectangular, as the world around the body"),
        ),
    )
    with_sound: bpy.props.BoolProperty(
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


def active_sound(context: bpy.types.Context) -> bpy.types.SoundStrip | None:
    """Active strip of the scene's sequencer if a sound; otherwise None."""
    editor = context.scene.sequence_editor
    strip = None if editor is None else editor.active_strip
    return strip if strip is not None and strip.type == "SOUND" else None


class HFX_OT_feel_sound(ImportOperator, OnBodyOperator):
    """Add a vibration that follows a sound: its loudness, its pitch, and its beats as pulses"""

    bl_label = "Feel This Sound"
    adds_clips = True

    filter_glob: bpy.props.StringProperty(default=_SOUNDS, options={"HIDDEN"})
    strip: bpy.props.StringProperty(
        name="Strip",
        description="Sound strip of the sequencer; empty: a file",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    place: bpy.props.EnumProperty(
        name="Place",
        description="Where the sound is felt",
        items=(
            ("PART", "Body Part", "A new effect on a body part"),
            ("POINT", "Point on the Skin", "A new effect on a disc in the middle of the back"),
            ("EFFECT", "Active Effect", "A clip of the active effect"),
        ),
    )
    part: bpy.props.EnumProperty(
        name="Part",
        description="Body part, or saved area",
        items=paint.part_items,
        translation_context="HFX",
    )
    strength: bpy.props.FloatProperty(
        name="Strength",
        description="Level of the loudest moment, a share of the effect's amplitude",
        subtype="FACTOR",
        default=1.0,
        min=0.01,
        max=1.0,
    )
    smoothing: bpy.props.FloatProperty(
        name="Smoothing (s)",
        description="Length of the window that smooths the loudness",
        default=0.012,
        min=0.002,
        max=1.0,
        precision=3,
    )
    threshold: bpy.props.FloatProperty(
        name="Threshold (dB)",
        description="Silence below this level, relative to the loudest moment",
        default=-40.0,
        min=-80.0,
        max=0.0,
    )
    band: bpy.props.FloatVectorProperty(
        name="Sound (Hz)",
        description="Lowest and highest frequency of the sound that is followed",
        size=2,
        default=(20.0, 8000.0),
        min=10.0,
        max=24_000.0,
    )
    frequencies: bpy.props.FloatVectorProperty(
        name="Vibration (Hz)",
        description="Frequencies of the vibration for the lowest and highest sound",
        size=2,
        default=(65.0, 300.0),
        min=1.0,
        max=1000.0,
    )

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        names = ("strength", "smoothing", "threshold", "band", "frequencies")
        for name in ("place", *(("part",) if self.place == "PART" else ()), *names):
            layout.prop(self, name)
        with suppress(InputError):
            settings, ends = self._settings(), (*self.band, *self.frequencies)
            at = min(max(100.0, ends[0]), ends[1])
            draw_wrapped(
                layout.column(align=True),
                "Pitch of {:g} to {:g} Hz is felt as {:g} to {:g} Hz, by its logarithm: "
                "{:g} Hz as {:.0f} Hz".format(*ends, at, settings.vibration_hz(at)),
                _LINE,
                "INFO",
            )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.strip:
            return context.window_manager.invoke_props_dialog(self)
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str:
        from ..authoring.effects import hjif_import
        from ..formats.sound.sound_analysis import followed

        scene = context.scene
        name, start = Path(self.filepath).stem, float(scene.frame_current)
        if self.strip:
            strip = compat.strips(scene.sequence_editor).get(self.strip)
            if strip is None or strip.type != "SOUND":
                raise InputError(f"The sequencer has no sound strip '{self.strip}'.")
            samples, rate = media.sound_of(strip)
            # Strips lie at played frames, clips at frames of the animation.
            name = strip.name
            start = strip.frame_final_start * animation_fps(scene) / fps_of(scene)
        else:
            samples, rate = media.sound_of(Path(self.filepath))
        signal = followed([samples], rate, name, self._settings())
        # The pulse of a beat, and the envelope as it rises, add up to its strength.
        added = (
            replace(
                beat, amplitude=max(beat.amplitude - signal.amplitude.at(beat.time_s + 0.01), 0.0)
            )
            for beat in signal.transients
        )
        signal = hjif_import.with_pulses(replace(signal, transients=tuple(added)))
        if signal.is_silent:
            raise InputError(f"'{name}' is silent.")
        effect = self._effect(context, name)
        is_vibration = effect.hfx.modality == "vibration"
        pitch = signal.frequency_hz if is_vibration else None
        hjif_import.add_envelope_clip(effect, name, signal.amplitude, pitch, start, scene)
        return f"'{effect.name}' follows '{name}'"

    def _settings(self) -> SoundSettings:
        """Settings of the dialog. Raises InputError for a descending range of frequencies."""
        from ..formats.signals.signals import FrequencyRange
        from ..formats.sound.sound_analysis import SoundSettings

        try:
            return SoundSettings(
                self.strength,
                self.smoothing,
                tuple(self.band),
                self.threshold,
                FrequencyRange(*self.frequencies),
            )
        except ValueError as error:
            raise InputError("Each second frequency must exceed the first one.") from error

    def _effect(self, context: bpy.types.Context, name: str) -> bpy.types.Object:
        """Active or new effect by ``place``; a new effect becomes the only selected object."""
        effect = active_effect(context)
        if self.place == "POINT":
            bpy.ops.hfx.add_spot(modality="vibration", name=name)
        elif self.place == "PART":
            bpy.ops.hfx.add_on_part(modality="vibration", part=self.part)
            active_effect(context).name = name
        elif effect is None:
            raise InputError("Select a haptic effect first.")
        return active_effect(context)
