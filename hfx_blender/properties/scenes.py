# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene properties stored in a .blend: ``Scene.hfx``, with devices, playback and export."""

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
        "Fast. Edges within the vertex spacing of the model, motion within 40 ms",
    ),
    ("STANDARD", "Standard", "Edges within 5 mm or half the vertex spacing, motion within 10 ms"),
    ("EXACT", "Exact", "Finest computation, at every sample"),
    ("PAPER", "Vertices Only", "Vertices count as inside or outside, at every sample"),
    ("CUSTOM", "Custom", "Own limits: millimetres of edges, milliseconds of motion"),
)
LIVE_SOURCES = (
    ("SCENE", "Scene", "The open scene, during playback, scrubbing and editing"),
    ("TRACK", "Track", "An exported or recorded track, without evaluating the scene"),
)
SCHEMES = (
    ("CONFIGURED", "As Configured", "Scheme of the device's configuration"),
    ("coverage", "Coverage", "Strongest sensation in each actuator's patch of skin"),
    ("nearest", "Nearest", "Nearest actuator only. Jumps halfway between two actuators"),
    ("barycentric", "Barycentric", "Panning between the three surrounding actuators of a flat pad"),
    ("surface", "Surface", "Panning between neighbours along the skin of the body"),
    ("ring", "Ring", "Equal-power panning between two neighbours of a belt"),
    ("line", "Line", "Equal-power panning between two neighbours of a strip"),
    ("vbap", "VBAP", "Panning between two or three neighbours by direction"),
    ("splat", "Splat", "All actuators, weighted by distance: soft and wide"),
    ("brush", "Tactile Brush", "Overlapping bursts along the skin, felt as continuous motion"),
    (
        "saltation",
        "Saltation",
        "Short taps of the nearest actuator, felt as hops between actuators",
    ),
)
"""Rendering schemes of a device in a scene."""

LIVE_TOLERANCES = (
    ("EXPORT", "As Exported", "Tolerance of exports for preview and playback"),
    ("PREVIEW", "Preview", "Faster and coarser. Exports keep their own tolerance"),
)
TIME_UNITS = (
    ("FRAMES", "Frames", "Times of clips in frames, as in the timeline"),
    ("SECONDS", "Seconds", "Times of clips in seconds. The scene's first frame is at 0 s"),
)

PALETTES = (
    ("PAPER", "Red, Green, Blue", "Vibration red, pressure green, temperature blue"),
    ("WARM_COLD", "Warm and Cold", "Vibration red, pressure green, warmth orange, cold blue"),
    ("COLOUR_BLIND", "Colour-Blind Safe", "Distinct colours for all common kinds of vision"),
    ("OWN", "My Colours", "Colours of the add-on preferences"),
)


def _update_live_source(
    self: "HfxSceneProperties | HfxDeviceName", context: bpy.types.Context
) -> None:
    self.id_data.update_tag()  # the preview shows actuators
    if self.id_data == context.scene:
        events.announce("live source")


def _update_live_track(self: "HfxSceneProperties", context: bpy.types.Context) -> None:
    events.announce("live track", self.id_data)
    _update_live_source(self, context)


def _tag_scene(self: "HfxSceneProperties", _context: bpy.types.Context) -> None:
    self.id_data.update_tag()  # the update reaches preview and live devices


def _update_mutes(self: "HfxDeviceName", context: bpy.types.Context) -> None:
    if self.id_data == context.scene:
        events.announce("live mutes", context.scene)


class HfxDeviceName(bpy.types.PropertyGroup):
    """Device of the user's registry, by name. The .blend stores no configuration."""

    is_muted: BoolProperty(
        name="Mute", description="Silence this device during live playback", update=_update_mutes
    )
    is_expanded: BoolProperty(
        name="Details",
        description="Show maker, placement and rendering scheme of the device",
        # Not animatable: a switch of the panel takes no keyframes.
        options=set(),
    )
    scheme: EnumProperty(
        name="Rendering",
        description="Rendering scheme: distribution of sensations among the actuators",
        items=SCHEMES,
        options=set(),
        update=_update_live_source,
    )
    body: PointerProperty(
        name="Worn By",
        description="Haptic body with this device during live playback. None: the first body",
        type=bpy.types.Object,
        poll=lambda _self, obj: obj.hfx.role == "BODY",
        update=_update_live_source,
    )
    is_exported: BoolProperty(
        name="Export", description="Include this device in exports", default=True, options=set()
    )
    gain: FloatProperty(
        name="Gain",
        description="Factor of all strengths during live playback, within the device's limits",
        default=1.0,
        min=0.0,
        max=2.0,
        subtype="FACTOR",
    )


class HfxSceneProperties(bpy.types.PropertyGroup):
    """Haptic settings of a scene."""

    devices: CollectionProperty(
        name="Devices", description="Devices of this scene, by name", type=HfxDeviceName
    )
    play_space: PointerProperty(
        name="Play Space",
        description="Object that fans, heaters and other stationary devices move with, as in a "
        "teleport. None: the world",
        type=bpy.types.Object,
    )
    live_source: EnumProperty(
        name="Devices Play",
        description="Source of the playback on connected devices",
        items=LIVE_SOURCES,
        options=set(),
        update=_update_live_source,
    )
    live_track: StringProperty(
        name="Track",
        description="Haptic track (.hfxtrack) for playback in step with the timeline. By default "
        "the last exported or recorded track",
        subtype="FILE_PATH",
        update=_update_live_track,
    )
    live_tolerance: EnumProperty(
        name="Tolerance",
        description="Tolerance of preview and live playback",
        items=LIVE_TOLERANCES,
        options=set(),
        update=_tag_scene,
    )
    rate: FloatProperty(
        name="Rate",
        description="Samples per second in exported tracks",
        default=100.0,
        min=1.0,
        max=10000.0,
        unit="NONE",
        options=set(),
    )
    tolerance: EnumProperty(
        name="Tolerance",
        description="Largest error of an export. A larger error is faster. A contact may start "
        "late by the error of motion plus the travel time through the error of the edge",
        items=TOLERANCES,
        default="STANDARD",
        options=set(),
    )
    equal_feel: BoolProperty(
        name="Equal Feel",
        description="Same strength above the detection threshold at all body parts and "
        "frequencies. Sensitive parts get less than the least sensitive part at 100 Hz",
        options=set(),
        update=_tag_scene,
    )
    adaptation: FloatProperty(
        name="Adaptation",
        description="Time constant with which skin gets used to a lasting effect: 300 s for "
        "vibration. 0 is off",
        min=0.0,
        max=3600.0,
        unit="TIME_ABSOLUTE",
        options=set(),
        update=_tag_scene,
    )
    persistence: FloatProperty(
        name="Persistence",
        description="Time constant with which a sensation fades after its end: 0.04 s for fast "
        "vibration, 0.1 s for slow vibration. 0 is off",
        min=0.0,
        max=60.0,
        unit="TIME_ABSOLUTE",
        options=set(),
        update=_tag_scene,
    )
    time_unit: EnumProperty(
        name="Times",
        description="Unit of the times of clips in every panel",
        items=TIME_UNITS,
        default="FRAMES",
        options=set(),
    )
    list_order: EnumProperty(
        name="Sort By",
        description="Order of the list of effects",
        items=(("NAME", "Name", "Name"), ("TIME", "Time", "Start of the first clip")),
        options=set(),
    )
    palette: EnumProperty(
        name="Colours",
        description="Colours of haptic sensations on the avatar",
        items=PALETTES,
        default="WARM_COLD",
    )
    preview_opacity: FloatProperty(
        name="Opacity",
        description="Opacity of the colours on the avatar",
        default=0.85,
        min=0.1,
        max=1.0,
        subtype="FACTOR",
    )
    tolerance_custom: StringProperty(
        name="Tolerance",
        description="Largest errors of edges, motion and (optional) strength: millimetres, "
        "milliseconds, percent of full scale. A contact may start late by the milliseconds plus "
        "the travel time through the millimetres",
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
