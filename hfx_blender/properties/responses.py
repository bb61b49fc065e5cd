# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of a contact response, stored in a .blend: ``Object.hfx.response``, its filters."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty

from ..authoring.responses.responses import KINDS
from ..engine.response_filters.controls import CONTROLS, FilterKind

_OVERRIDABLE = {"override": {"LIBRARY_OVERRIDABLE"}}

OPERATIONS = (
    ("multiply", "Multiply", "Multiply the result of the filters above"),
    ("add", "Add", "Add to the result of the filters above"),
    ("maximum", "Maximum", "The larger of this and the result of the filters above"),
)
ABOUT_WHAT = (
    ("centre", "Centre", "The volume's origin"),
    ("axis", "Axis", "The volume's local Z axis"),
)
DOMAINS = (("time", "Time", "Seconds since the scene's first frame"), *ABOUT_WHAT)


def _control(kind: str, control: str, label: str, tip: str, **options: object) -> FloatProperty:
    """A property with the range and the default that the engine states for a control."""
    found = {each.name: each for each in CONTROLS[FilterKind(kind)]}[control]
    return FloatProperty(
        name=label,
        description=tip,
        default=found.default,
        min=found.minimum,
        max=1e6 if options.get("unit") == "LENGTH" else found.maximum,  # the engine's are metres
        **_OVERRIDABLE,
        **options,
    )


class HfxResponseFilter(bpy.types.PropertyGroup):
    """Filter of a contact response with the controls of all kinds. Lengths are in
    Blender's units.
    """

    kind: EnumProperty(
        name="Kind",
        description="Function of the filter",
        items=KINDS,
        default="impact",
    )
    operation: EnumProperty(
        name="Operation",
        description="Operation with the result of the filters above",
        items=OPERATIONS,
    )
    about: EnumProperty(
        name="From",
        description="Property of the touch that is used",
        items=ABOUT_WHAT,
    )
    domain: EnumProperty(name="Over", description="Variable of the sine", items=DOMAINS)
    is_muted: BoolProperty(name="Mute", description="Leave this filter out")

    influence: _control(
        "speed", "influence", "Influence", "Influence of this filter", subtype="FACTOR"
    )
    near: _control(
        "distance", "near_m", "Near", "Distance up to which the first value applies", unit="LENGTH"
    )
    far: _control(
        "distance", "far_m", "Far", "Distance from which the second value applies", unit="LENGTH"
    )
    near_value: _control(
        "distance", "near_value", "Value Near", "Strength at the near end", subtype="FACTOR"
    )
    far_value: _control(
        "distance", "far_value", "Value Far", "Strength at the far end", subtype="FACTOR"
    )
    still_speed: _control(
        "speed", "still_m_s", "Still (m/s)", "Nothing is felt up to this relative speed"
    )
    full_speed: _control(
        "speed", "full_m_s", "Full (m/s)", "Full strength at this relative speed and above"
    )
    attack: _control("impact", "attack_s", "Attack (s)", "Time constant of the rise")
    decay: _control(
        "impact", "decay_s", "Decay (s)", "Time constant of the decay: short feels stiff"
    )
    reach: _control(
        "proximity", "range_m", "Range", "Distance at which it begins to be felt", unit="LENGTH"
    )
    exponent: _control("proximity", "exponent", "Exponent", "1 rises linearly, more rises later")
    frequency: _control("sine", "cycles", "Frequency (Hz)", "Swings a second")
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
        "sine", "depth", "Depth", "Strength oscillates between 1 and 1 minus this", subtype="FACTOR"
    )
    phase: _control("sine", "phase", "Phase (turns)", "Phase at the start")
