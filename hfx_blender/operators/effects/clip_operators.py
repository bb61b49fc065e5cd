# SPDX-License-Identifier: GPL-3.0-or-later
"""Clips on the timeline of an effect."""

from itertools import pairwise
from typing import ClassVar

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ...authoring import clips, drawn_fades, painting
from ...authoring.effects import effects, swarms
from ...blender.scene_info import animation_fps, frame_at, frames_per_shown_unit, shown_time
from ...blender.translation import translated
from ...errors import InputError
from ...text import shortened
from .. import framing, shared


class _OfEffect(shared.HfxOperator):
    requires = ((shared.active_effect, "Select a haptic effect"), shared.IS_EDITABLE)


TIMES = {
    "start": "Time at which the clip starts; seconds count from the scene's first frame",
    "end": "Time at which the clip ends; seconds count from the scene's first frame",
    "duration": "How long the effect is on",
    "fade_in": "Time to reach full strength",
    "fade_out": "Time to fall from full strength to nothing",
}
"""Times of a clip, with their descriptions."""


def label_of(time: str) -> str:
    """Label of a key of :data:`TIMES`: "Fade In" for "fade_in"."""
    return time.replace("_", " ").title()


def _seconds(time: str, default: float, least: float) -> FloatProperty:
    """Property of a time in seconds, a key of :data:`TIMES`; ``least`` is the lower limit."""
    return FloatProperty(
        name=label_of(time),
        description=TIMES[time],
        default=default,
        min=least,
        unit="TIME_ABSOLUTE",
    )


def _shown(time: str, **limits: float) -> FloatProperty:
    """Property, in the scene's time unit, of the operator's start frame or a length in seconds."""
    # Stored values do not depend on the scene's unit, so that scripts and redo mean the same time.

    def shown(operator: bpy.types.Operator) -> float:
        scene, value = bpy.context.scene, float(getattr(operator, time))
        if time == "start":
            return shown_time(scene, value)
        return value * animation_fps(scene) / frames_per_shown_unit(scene)

    def store(operator: bpy.types.Operator, value: float) -> None:
        scene = bpy.context.scene
        if time == "start":
            setattr(operator, time, frame_at(scene, value))
        else:
            setattr(operator, time, value * frames_per_shown_unit(scene) / animation_fps(scene))

    return FloatProperty(
        name=label_of(time),
        description=TIMES[time],
        options={"SKIP_SAVE", "HIDDEN"},
        get=shown,
        set=store,
        **limits,
    )


class _ClipOperator(_OfEffect):
    """Base of operators that add a clip. Stored are a frame and seconds, shown the scene's unit."""

    adds_clips = True
    bl_options = {"REGISTER", "UNDO", "PRESET"}
    requires = (
        (
            lambda context: shared.painted_effect(context) or shared.active_effect(context),
            "Select a haptic effect",
        ),
        shared.IS_EDITABLE,
    )
    last_field: ClassVar[str]
    """Property of the subclass that the dialog shows last."""

    start: FloatProperty(
        name="Start Frame",
        description="Frame at which the clip starts; below 0: the current frame",
        default=-1.0,
        min=-1.0,
        options={"SKIP_SAVE"},
    )
    duration: _seconds("duration", 1.0, 0.001)
    fade_in: _seconds("fade_in", 0.0, 0.0)
    fade_out: _seconds("fade_out", 0.0, 0.0)

    shown_start: _shown("start")
    shown_duration: _shown("duration", min=0.001)
    shown_fade_in: _shown("fade_in", min=0.0)
    shown_fade_out: _shown("fade_out", min=0.0)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        unit = "frames" if context.scene.hfx.time_unit == "FRAMES" else "s"
        for name in ("start", "duration", "fade_in", "fade_out"):
            layout.prop(self, f"shown_{name}", text=translated(f"{label_of(name)} ({unit})"))
        layout.prop(self, self.last_field)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("start"):
            self.start = context.scene.frame_current  # shown in Adjust Last Operation
        return framing.execute_with_room(self, context)

    def effect(self, context: bpy.types.Context) -> bpy.types.Object:
        """Effect of the clip, painted or active; painting is finished first."""
        if painting.canvas_in(context) is not None:
            bpy.ops.hfx.paint_end()
        return shared.active_effect(context)

    def span(self, context: bpy.types.Context) -> dict[str, float]:
        """Start, end and fades of the clip in frames of the scene, as arguments of
        ``clips.add_clip``."""
        fps = animation_fps(context.scene)
        start = self.start if self.start >= 0 else float(context.scene.frame_current)
        return {
            "frame_start": start,
            "frame_end": start + self.duration * fps,
            "fade_in": self.fade_in * fps,
            "fade_out": self.fade_out * fps,
        }


class HFX_OT_add_clip(_ClipOperator):
    """Add a clip from the current frame on, with fades"""

    bl_label = "Add Clip"

    last_field = "name"

    name: StringProperty(
        name="Name", description="Name of the clip on the timeline", default="Clip"
    )

    def work(self, context: bpy.types.Context) -> None:
        clips.add_clip(self.effect(context), name=self.name, **self.span(context))


class HFX_OT_add_heartbeat(_ClipOperator):
    """Add a heartbeat from the current frame on; fades apply to the clip, not to each beat"""

    bl_label = "Add Heartbeat"

    last_field = "beats_per_minute"

    duration: _seconds("duration", 2.0, 0.001)  # two beats at least, at rest
    beats_per_minute: FloatProperty(
        name="Beats per Minute",
        description="Rate of the heart; at rest it is 60 to 100",
        default=72.0,
        min=6.0,
        max=1200.0,
    )

    def work(self, context: bpy.types.Context) -> None:
        clips.add_heartbeat(
            self.effect(context), beats_per_minute=self.beats_per_minute, **self.span(context)
        )


def draw_clip_buttons(layout: bpy.types.UILayout, prefix: str = "") -> None:
    """Draw the buttons that add a clip and a heartbeat; a prefix replaces "Add" in the labels."""
    for operator, icon in ((HFX_OT_add_clip, "NLA"), (HFX_OT_add_heartbeat, "HEART")):
        text = operator.bl_label.replace("Add", prefix) if prefix else operator.bl_label
        layout.operator(operator.bl_idname, text=translated(text), icon=icon)


class HFX_OT_extend_scene(shared.HfxOperator):
    """Extend the scene's frame range to include all clips"""

    bl_label = "Extend the Scene"

    which: EnumProperty(
        name="Effects",
        description="Effects whose clips shall lie within the scene",
        items=(
            ("ACTIVE", "Active", "The active effect"),
            ("ALL", "All", "All effects of the scene"),
        ),
        options={"SKIP_SAVE"},
    )

    def work(self, context: bpy.types.Context) -> str:
        scene, active = context.scene, shared.active_effect(context)
        listed = swarms.listed_effects(scene)
        if self.which == "ACTIVE":
            listed = [active] if active is not None else []
        before = scene.frame_start, scene.frame_end
        still = ", ".join(shortened(clips.extend_scene(scene, listed), 5))
        advice = f"A scene begins at frame 0 or later. Move the clip: {still}" if still else ""
        if advice and before == (scene.frame_start, scene.frame_end):
            raise InputError(f"{advice}.")
        extent = f"Frame range of the scene: {scene.frame_start} to {scene.frame_end}"
        return f"{extent}. {advice}" if advice else extent


class HFX_OT_remove_clip(_OfEffect):
    """Remove a clip from the timeline; an effect without clips is always on"""

    bl_label = "Remove Clip"

    name: StringProperty(name="Name", description="The clip's name")

    def work(self, context: bpy.types.Context) -> None:
        clips.remove_clip(shared.active_effect(context), self.name)


class HFX_OT_draw_fades(_OfEffect):
    """Give the clip's strength a curve, to be drawn in the Graph or NLA editor"""

    bl_label = "Draw Fades as Curve"

    name: StringProperty(name="Name", description="The clip's name")

    def work(self, context: bpy.types.Context) -> str:
        effect = shared.active_effect(context)
        for _, strip in clips.strips_of(effect):
            if strip.name == self.name:
                drawn_fades.draw(effect, strip)
                return f"Edit 'Influence' of '{strip.name}' in the Graph or NLA editor"
        raise InputError(f"Effect '{effect.name}' has no clip '{self.name}'.")


def join_tracks() -> None:
    """Move selected clips of tracks "NlaTrack" to the neighbouring track of their effect with room
    for all of them: Blender adds a track for clips duplicated in an NLA Editor. No effect without
    an NLA Editor, and while another operator runs."""
    context = bpy.context
    windows = context.window_manager.windows
    editors = [(w, a) for w in windows for a in w.screen.areas if a.type == "NLA_EDITOR"]
    if not editors or any(len(window.modal_operators) for window in windows):
        return
    window, area = editors[0]
    for effect in swarms.listed_effects(context.scene):
        data = effect.animation_data
        tracks = [] if data is None or effects.is_locked(effect) else [*data.nla_tracks]
        for lower, upper in pairwise(tracks):
            added, own = (lower, upper) if lower.name.startswith("NlaTrack") else (upper, lower)
            moved = [*added.strips]
            if (
                added.name.startswith("NlaTrack")
                and all(strip.select for strip in moved)
                and all(clips.has_room(own, s.frame_start, s.frame_end) for s in moved)
            ):
                clips.deselect_all((effect,))  # the operator moves all selected strips
                region = framing.views(area)[-1]
                with context.temp_override(window=window, area=area, region=region):
                    (bpy.ops.nla.move_up if own == upper else bpy.ops.nla.move_down)()
                if not added.strips:
                    data.nla_tracks.remove(added)
                break


class HFX_OT_copy_clips(_OfEffect):
    """Copy the clips of the active effect to the other selected effects"""

    bl_label = "Copy Clips to Selected"
    requires = (*_OfEffect.requires[:1], shared.ARE_TARGETS_EDITABLE)
    adds_clips = True

    def work(self, context: bpy.types.Context) -> str:
        source = shared.active_effect(context)
        others = [o for o in context.selected_objects if o != source and o.hfx.role == "EFFECT"]
        if not others:
            raise InputError("Select the target effects first, and this effect last.")
        count = sum(clips.copy_clips(source, effect) for effect in others)
        return f"Clips added: {count}"
