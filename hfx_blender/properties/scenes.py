# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of scenes that a .blend stores: ``Scene.hfx``, its devices, playing and exporting."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    PointerProperty,
    StringProperty,
)

from ..blender import events

TOLERANCES = (
    (
        "PREVIEW",
        "Preview",
        "Fast: edges within the spacing of the model's vertices, motion within 40 ms",
    ),
    (
        "STANDARD",
        "Standard",
        "Edges within 5 mm or half the vertices' spacing, motion within 10 ms",
    ),
    ("EXACT", "Exact", "The finest computation, at every sample"),
    ("PAPER", "Vertices Only", "A vertex is inside a volume or not, at every sample"),
    ("CUSTOM", "Custom", "Your own limits: millimetres of edges, milliseconds of motion"),
)
LIVE_SOURCES = (
    ("SCENE", "Scene", "What is felt in the scene, while you play, scrub and edit"),
    ("TRACK", "Track", "What was exported or recorded; the scene is not evaluated for it"),
)
SCHEMES = (
    ("CONFIGURED", "As Configured", "The scheme that the device's configuration names"),
    ("coverage", "Coverage", "The strongest sensation on each actuator's own patch of skin"),
    ("nearest", "Nearest", "The nearest actuator plays all; it jumps half way between two"),
    ("barycentric", "Barycentric", "Glides between the three actuators around it, on a flat pad"),
    ("surface", "Surface", "Glides between neighbours along the skin of the body"),
    ("ring", "Ring", "Glides between two neighbours round a belt, with equal power"),
    ("line", "Line", "Glides between two neighbours along a strip, with equal power"),
    ("vbap", "VBAP", "Glides between two or three neighbours by their directions"),
    ("splat", "Splat", "Each actuator plays more the nearer it is: soft and wide"),
)
"""Rendering schemes of a device in a scene, each in one line."""

LIVE_TOLERANCES = (
    ("EXPORT", "As Exported", "What is shown and played is what is exported"),
    ("PREVIEW", "Preview", "Faster, and coarser; exports keep their own tolerance"),
)
TIME_UNITS = (
    ("FRAMES", "Frames", "Times of clips in frames, as in the timeline"),
    ("SECONDS", "Seconds", "Times of clips in seconds; frame 0 is at 0 s, as in the timeline"),
)

PALETTES = (
    ("PAPER", "Red, Green, Blue", "Vibration red, pressure green, temperature blue"),
    ("WARM_COLD", "Warm and Cold", "The same, but warmth orange and cold blue"),
    ("COLOUR_BLIND", "Colour-Blind Safe", "Colours that all common kinds of vision tell apart"),
    ("OWN", "My Colours", "The colours in the preferences of this extension"),
)


def _follow_other(self: HfxSceneProperties | HfxDeviceName, context: bpy.types.Context) -> None:
    self.id_data.update_tag()  # the preview shows actuators
    if self.id_data == context.scene:
        events.announce("live source")


def _choose_track(self: HfxSceneProperties, context: bpy.types.Context) -> None:
    events.announce("live track", self.live_track)
    _follow_other(self, context)


def _remark_scene(self: HfxSceneProperties, _context: bpy.types.Context) -> None:
    self.id_data.update_tag()  # the preview and live devices look for changes then


def _turn_down(self: HfxDeviceName, context: bpy.types.Context) -> None:
    if self.id_data == context.scene:
        events.announce("live mutes", context.scene)


class HfxDeviceName(bpy.types.PropertyGroup):
    """A device of the user's registry, by name; a .blend never brings its configuration."""

    is_muted: BoolProperty(
        name="Mute", description="Silent while designing", default=False, update=_turn_down
    )
    is_expanded: BoolProperty(
        name="Details",
        description="Show the maker, the places and the rendering scheme of the device",
        default=False,
        options=set(),
    )
    scheme: EnumProperty(
        name="Rendering",
        description="Rendering scheme: how sensations are shared out among the actuators",
        items=SCHEMES,
        options=set(),
        update=_follow_other,
    )
    is_exported: BoolProperty(
        name="Export", description="Write the files of this device, too", default=True
    )
    gain: FloatProperty(
        name="Gain",
        description="Factor for all strengths while designing; the device's limits still apply",
        default=1.0,
        min=0.0,
        max=2.0,
        subtype="FACTOR",
    )


class HfxSceneProperties(bpy.types.PropertyGroup):
    """A scene's haptic settings."""

    devices: CollectionProperty(
        name="Devices", description="Devices that play this scene, by name", type=HfxDeviceName
    )
    play_space: PointerProperty(
        name="Play Space",
        description="Object in whose room fans, heaters and other devices stand; a teleport "
        "moves it. None: the world",
        type=bpy.types.Object,
    )
    live_source: EnumProperty(
        name="Devices Play",
        description="Source of what connected devices play",
        items=LIVE_SOURCES,
        options=set(),
        update=_follow_other,
    )
    live_track: StringProperty(
        name="Track",
        description="Haptic track that devices play in step with the timeline (.hfxtrack); the "
        "last one that was exported or recorded",
        subtype="FILE_PATH",
        update=_choose_track,
    )
    live_tolerance: EnumProperty(
        name="Tolerance",
        description="Tolerance of what is shown and played while you work",
        items=LIVE_TOLERANCES,
        options=set(),
        update=_remark_scene,
    )
    rate: FloatProperty(
        name="Rate",
        description="Samples a second in exported tracks",
        default=100.0,
        min=1.0,
        max=10000.0,
        unit="NONE",
    )
    tolerance: EnumProperty(
        name="Tolerance",
        description="Which error an export may have, to be fast. A contact may begin late by the "
        "error of motion plus the time that its approach takes for the error of the edge",
        items=TOLERANCES,
        default="STANDARD",
    )
    time_unit: EnumProperty(
        name="Times",
        description="Unit of the times of clips in every panel",
        items=TIME_UNITS,
        default="FRAMES",
    )
    palette: EnumProperty(
        name="Colours",
        description="Colours of the avatar where it feels something",
        items=PALETTES,
    )
    preview_opacity: FloatProperty(
        name="Opacity",
        description="Opacity of the colours over the avatar",
        default=0.85,
        min=0.1,
        max=1.0,
        subtype="FACTOR",
    )
    tolerance_custom: StringProperty(
        name="Tolerance",
        description="How far off edges of contacts, motion and strength may be: millimetres, "
        "milliseconds and, if you like, percent of full scale. A contact may begin late by the "
        "milliseconds plus the time that its approach takes for the millimetres",
        default="5mm,10ms,5%",
    )


_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (HfxDeviceName, HfxSceneProperties)
)


def register() -> None:
    _classes()
    bpy.types.Scene.hfx = PointerProperty(type=HfxSceneProperties)


def unregister() -> None:
    del bpy.types.Scene.hfx
    _unregister_classes()
