# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic modalities: table of parameters, units, texts and colours.

Physical units: vibration m/s^2 (peak) and Hz, pressure kPa, temperature degrees Celsius, wind m/s.
The value of an effect at a place is ``weight * level * parameter``; for temperature this scales the
deviation from a neutral temperature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from .arrays import F64


AMBIENT_NEUTRAL_C: Final = 24.0
"""Air temperature neutral to a clothed person at rest; neutral for ambient effects."""

CONTACT_NEUTRAL_C: Final = 33.0
"""Skin temperature at rest; neutral for touched objects.

HFX Studio's 30 degC area near a fire must warm, and a 30 degC object must cool (our interpretation
of Danieau et al. 2018, section 4.1), so the neutral temperatures differ.
"""

MAX_TEMPERATURE_C: Final = 40.0
"""Highest temperature of all devices: conservative for skin, not a certified limit."""

Colour = tuple[float, float, float]
"""Linear RGB, 0..1."""


@dataclass(frozen=True)
class Parameter:
    """Physical parameter of a modality; wind directions have no property."""

    name: str
    unit: str
    default: float
    minimum: float
    maximum: float
    prop: str = ""  # property of Object.hfx; "" for a direction
    neutral: float = 0.0  # default neutral value of a device
    device_maximum: float = math.inf  # largest value of any device

    @property
    def symbol(self) -> str:
        """Unit for display, with "²" for "^2" and "°C" for "degC"."""
        return self.unit.replace("^2", "²").replace("degC", "°C")


@dataclass(frozen=True)
class Modality:
    """Facts of a haptic modality.

    ``strength`` is the parameter scaled by the level and driven by devices; other parameters
    describe. Effects at a place add, unless ``engine/rendering/conditioning/mixing.py`` has another
    rule.
    """

    name: str
    title: str
    description: str  # for menus
    devices: str  # device actuators, for menus
    model: str  # modality of the perceptual model
    parameters: tuple[Parameter, ...]
    strength: str
    combining: str  # combination of effects at a place, for the header of a track
    colour: Colour
    colour_blind: Colour  # Okabe and Ito, Color Universal Design (2008)
    full_colour: float  # strength of the full colour
    icon: str  # icon id of Blender
    hjif: str  # perception_modality of ISO/IEC 23090-31
    hjif_unit: str  # unit of full scale
    gltf: int = 5  # hapticModality of MPEG's glTF extension; 5: custom

    @cached_property
    def limits(self) -> F64:
        """Smallest and largest value of each parameter, (2, P)."""
        import numpy as np  # imported late for Blender's start

        # Row 0 clips from below, row 1 from above.
        return np.array(
            [[p.minimum for p in self.parameters], [p.maximum for p in self.parameters]]
        )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def strength_parameter(self) -> Parameter:
        """Parameter of the strength."""
        return next(p for p in self.parameters if p.name == self.strength)

    @cached_property
    def controls(self) -> tuple[Parameter, ...]:
        """Parameters with a property, in order, for devices and files; the strength is first."""
        return tuple(p for p in self.parameters if p.prop)

    @property
    def is_silent_at_0(self) -> bool:
        """True if the strength has no values below 0, so that 0 is silence; False for
        temperature."""
        return self.strength_parameter.minimum >= 0.0


MODALITIES: Final[dict[str, Modality]] = {
    modality.name: modality
    for modality in (
        Modality(
            "vibration",
            "Vibration",
            "Oscillation of the skin, with an amplitude and a frequency",
            "All that vibrate",
            "vibration",
            (
                Parameter("amplitude_m_s2", "m/s^2", 10.0, 0.0, 1000.0, "amplitude"),
                Parameter("frequency_hz", "Hz", 100.0, 0.1, 1000.0, "frequency", neutral=100.0),
            ),
            strength="amplitude_m_s2",
            combining="Amplitudes of equal frequency (within 1 Hz) add; "
            "unequal ones add as powers.",
            colour=(0.9, 0.05, 0.05),
            colour_blind=(0.835, 0.369, 0.0),
            full_colour=8.0,
            icon="FORCE_HARMONIC",
            hjif="Vibrotactile",
            hjif_unit="m/s^2",
            gltf=4,
        ),
        Modality(
            "pressure",
            "Pressure",
            "Static force on the skin",
            "All that press",
            "pressure",
            (Parameter("pressure_kpa", "kPa", 5.0, 0.0, 100.0, "pressure"),),
            strength="pressure_kpa",
            combining="Pressures at one place add.",
            colour=(0.05, 0.65, 0.08),
            colour_blind=(0.0, 0.620, 0.451),
            full_colour=6.0,
            icon="FULLSCREEN_EXIT",
            hjif="Pressure",
            hjif_unit="kPa",
        ),
        Modality(
            "temperature",
            "Temperature",
            "Warmth or cold of the air or of a touched object",
            "All temperature actuators",
            "temperature",
            (
                Parameter(
                    "temperature_c",
                    "degC",
                    30.0,
                    -20.0,
                    60.0,
                    "temperature",
                    neutral=AMBIENT_NEUTRAL_C,
                    device_maximum=MAX_TEMPERATURE_C,
                ),
            ),
            strength="temperature_c",
            combining="Deviations from each effect's own neutral temperature add.",
            colour=(0.08, 0.2, 0.95),
            colour_blind=(0.902, 0.624, 0.0),
            full_colour=6.0,  # from neutral
            icon="LIGHT_SUN",
            hjif="Temperature",
            hjif_unit="K from neutral",
            gltf=3,
        ),
        Modality(
            "wind",
            "Wind",
            "Moving air, along the effect's local Z axis",
            "All that blow",
            "pressure",
            (
                Parameter("speed_m_s", "m/s", 5.0, 0.0, 60.0, "wind_speed"),
                Parameter("direction_x", "1", 0.0, -1.0, 1.0),
                Parameter("direction_y", "1", 0.0, -1.0, 1.0),
                Parameter("direction_z", "1", 1.0, -1.0, 1.0),
            ),
            strength="speed_m_s",
            combining="Winds at one place add as vectors; world space, the way that the air moves.",
            colour=(0.1, 0.7, 0.75),  # not in the paper
            colour_blind=(0.337, 0.706, 0.914),
            full_colour=6.0,
            icon="FORCE_WIND",
            hjif="Wind",
            hjif_unit="m/s",
        ),
    )
}

MODALITY_ITEMS: Final = tuple((m.name, m.title, m.description) for m in MODALITIES.values())
"""Modalities as items of an enumeration property."""


def neutral_temperature_c(is_contact: bool) -> float:
    """Neutral temperature of contact or ambient effects, degrees Celsius."""
    return CONTACT_NEUTRAL_C if is_contact else AMBIENT_NEUTRAL_C
