# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of contact response filters: ``Object.hfx.response``."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ..authoring.responses import KINDS
from ..engine.response_filters.controls import CONTROLS, FilterKind

_OVERRIDABLE = {"override": {"LIBRARY_OVERRIDABLE"}}

OPERATIONS = (
    ("multiply", "Multiply", "Multiply the result of the filters above"),
    ("add", "Add", "Add to the result of the filters above"),
    ("maximum", "Maximum", "Maximum of this and the result of the filters above"),
)
ABOUT_WHAT = (
    ("centre", "Centre", "The volume's origin"),
    ("axis", "Axis", "The volume's local Z axis"),
)
DOMAINS = (("time", "Time", "Seconds since the scene's first frame"), *ABOUT_WHAT)


def _control(kind: str, control: str, label: str, tip: str, **options: object) -> FloatProperty:
    """Overridable float property with a filter control's default and range; lengths up to 1e6."""
    control_info = {info.name: info for info in CONTROLS[FilterKind(kind)]}[control]
    return FloatProperty(
        name=label,
        description=tip,
        default=control_info.default,
        min=control_info.minimum,
        max=1e6
        if options.get("unit") == "LENGTH"
        else control_info.maximum,  # Blender's units, not metres
        **_OVERRIDABLE,
        **options,
    )


class HfxResponseFilter(bpy.types.PropertyGroup):
    """Contact response filter with the controls of all kinds. Lengths are in Blender units."""

    kind: EnumProperty(
        name="Kind", description="Function of the filter", items=KINDS, default="impact"
    )
    operation: EnumProperty(
        name="Operation",
        description="Operation with the result of the filters above",
        items=OPERATIONS,
    )
    about: EnumProperty(name="From", description="Reference of the measurement", items=ABOUT_WHAT)
    domain: EnumProperty(name="Over", description="Variable of the sine", items=DOMAINS)
    is_muted: BoolProperty(name="Mute", description="Leave this filter out")

    influence: _control(
        "speed", "influence", "Influence", "Influence of this filter", subtype="FACTOR"
    )
    near: _control(
        "distance", "near_m", "Near", "Largest distance of the first value", unit="LENGTH"
    )
    far: _control(
        "distance", "far_m", "Far", "Smallest distance of the second value", unit="LENGTH"
    )
    near_value: _control(
        "distance", "near_value", "Value Near", "Strength at the near end", subtype="FACTOR"
    )
    far_value: _control(
        "distance", "far_value", "Value Far", "Strength at the far end", subtype="FACTOR"
    )
    still_speed: _control(
        "speed", "still_m_s", "Still (m/s)", "Largest relative speed without a sensation"
    )
    full_speed: _control(
        "speed", "full_m_s", "Full (m/s)", "Smallest relative speed of full strength"
    )
    attack: _control("impact", "attack_s", "Attack (s)", "Time constant of the rise")
    decay: _control(
        "impact", "decay_s", "Decay (s)", "Time constant of the decay. A short decay feels stiff"
    )
    reach: _control(
        "proximity", "range_m", "Range", "Distance of the first sensation", unit="LENGTH"
    )
    exponent: _control("proximity", "exponent", "Exponent", "1: linear rise. Above 1: late rise")
    frequency: _control("sine", "cycles", "Frequency (Hz)", "Oscillations per second")
    wavelength: FloatProperty(
        name="Wavelength",
        description="Wavelength",
        default=0.1,
        min=1e-4,
        max=1000.0,
        unit="LENGTH",
        **_OVERRIDABLE,
    )
    depth: _control(
        "sine",
        "depth",
        "Depth",
        "Amplitude: strength oscillates between 1 and 1 - depth",
        subtype="FACTOR",
    )
    phase: _control("sine", "phase", "Phase (turns)", "Phase at the start")
