# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic modalities: table of parameters, units, texts and colours.

Physical units: vibration m/s^2 (peak) and Hz, pressure kPa, temperature degrees Celsius, wind m/s.
The value of an effect at a place is ``weight * level * parameter``; for temperature this scales the
deviation from a neutral temperature.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from .arrays import F64


AMBIENT_NEUTRAL_C: Final = 24.0
"""Air temperature neutral to a clothed person at rest; neutral for ambient effects."""

CONTACT_NEUTRAL_C: Final = 33.0
"""Skin temperature at rest; neutral for touched objects.

HFX Studio's 30 degC area near a fire must warm, and a 30 degC object must cool (our interpretation
of Danieau et al. 2018, section 4.1), so the neutral temperatures differ.
"""

Colour = tuple[float, float, float]  # linear RGB, 0..1


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
    """Facts of a haptic modality. ``strength`` is the parameter scaled by the level and driven by
    devices; other parameters describe. Effects at a place add, unless
    ``engine/rendering/conditioning/mixing.py`` has another rule."""

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
        """True if the strength is never below 0, so that 0 is silence; False for temperature."""
        return self.strength_parameter.minimum >= 0.0


def _entry(name: str, members: dict[str, Any]) -> Modality:
    """Modality of a table of ``modalities.toml``: arrays are tuples."""
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in members.items()}
    values["parameters"] = tuple(Parameter(**parameter) for parameter in members["parameters"])
    return Modality(name, **values)


MODALITIES: Final[dict[str, Modality]] = {
    name: _entry(name, members)
    for name, members in tomllib.loads(
        Path(__file__).with_name("modalities.toml").read_text(encoding="utf-8")
    ).items()
}
"""Modalities by name, in the order of menus; a table each in ``modalities.toml``."""

MODALITY_ITEMS: Final = tuple((m.name, m.title, m.description) for m in MODALITIES.values())
"""Modalities as items of an enumeration property."""


def neutral_temperature_c(is_contact: bool) -> float:
    """Neutral temperature of contact or ambient effects, degrees Celsius."""
    return CONTACT_NEUTRAL_C if is_contact else AMBIENT_NEUTRAL_C
