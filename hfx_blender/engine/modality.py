# SPDX-License-Identifier: GPL-3.0-or-later
"""The four haptic modalities: their parameters, units and how effects combine.

Physical units everywhere: vibration m/s^2 (peak) and Hz, pressure kPa, temperature degrees
Celsius, wind m/s. What an effect does at a place is ``weight * level * parameter``; for
temperature that product scales the deviation from a neutral temperature.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from .arrays import F64


AMBIENT_NEUTRAL_C: Final = 24.0
"""Air that neither warms nor cools a clothed person at rest: neutral for ambient effects."""

CONTACT_NEUTRAL_C: Final = 33.0
"""Skin temperature at rest: neutral for touched objects.

HFX Studio's 30 degC area by a fire must warm, and a 30 degC object must cool (our reading of
Danieau et al. 2018, section 4.1), so one neutral temperature cannot serve both.
"""


@dataclass(frozen=True)
class Parameter:
    """Physical parameter of a modality."""

    name: str
    unit: str
    default: float
    minimum: float
    maximum: float


@dataclass(frozen=True)
class Modality:
    """Haptic modality: its perceptual model, and its parameters.

    ``strength`` names the parameter that the level scales: it is what a device turns up
    and down. The other parameters only describe.
    """

    name: str
    model: str  # modality of the perceptual model that it is felt on
    parameters: tuple[Parameter, ...]
    strength: str

    @cached_property
    def limits(self) -> F64:
        """The least and the largest value of each parameter, (2, P)."""
        import numpy as np  # Blender's start does not wait for it

        return np.array(
            [[p.minimum for p in self.parameters], [p.maximum for p in self.parameters]]
        )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def strength_parameter(self) -> Parameter:
        return next(each for each in self.parameters if each.name == self.strength)

    @cached_property
    def controls(self) -> tuple[Parameter, ...]:
        """Parameters that a device has and a file holds, the strength first.

        A direction is that of the volume.
        """
        return tuple(each for each in self.parameters if not each.name.startswith("direction_"))

    @property
    def is_silent_at_0(self) -> bool:
        """Silence at strength 0; a temperature has a neutral value instead."""
        return self.strength_parameter.minimum >= 0.0


MODALITIES: Final[dict[str, Modality]] = {
    modality.name: modality
    for modality in (
        Modality(
            "vibration",
            "vibration",
            (
                Parameter("amplitude_m_s2", "m/s^2", 10.0, 0.0, 1000.0),
                Parameter("frequency_hz", "Hz", 100.0, 0.1, 1000.0),
            ),
            strength="amplitude_m_s2",
        ),
        Modality(
            "pressure",
            "pressure",
            (Parameter("pressure_kpa", "kPa", 5.0, 0.0, 100.0),),
            strength="pressure_kpa",
        ),
        Modality(
            "temperature",
            "temperature",
            (Parameter("temperature_c", "degC", 30.0, -20.0, 60.0),),
            strength="temperature_c",
        ),
        Modality(
            "wind",
            "pressure",
            (
                Parameter("speed_m_s", "m/s", 5.0, 0.0, 60.0),
                Parameter("direction_x", "1", 0.0, -1.0, 1.0),
                Parameter("direction_y", "1", 0.0, -1.0, 1.0),
                Parameter("direction_z", "1", 1.0, -1.0, 1.0),
            ),
            strength="speed_m_s",
        ),
    )
}


def neutral_temperature_c(is_contact: bool) -> float:
    """Temperature without any effect, degrees Celsius."""
    return CONTACT_NEUTRAL_C if is_contact else AMBIENT_NEUTRAL_C


def combine_vibration(amplitudes: F64, frequencies_hz: F64) -> tuple[F64, F64]:
    """Amplitude and frequency of several vibrations at each place.

    Equal frequencies (within 1 Hz of the lowest of their group) are taken to be in phase and
    add; groups of unequal frequency add as powers. The frequency is that of the strongest group.

    Parameters
    ----------
    amplitudes : (n, ...) float64
        Peak acceleration of each of n vibrations at each place, m/s^2.
    frequencies_hz : (n, ...) float64
        Broadcast against ``amplitudes``.

    Returns
    -------
    amplitude : (...) float64
        m/s^2.
    frequency_hz : (...) float64
        The lowest of the strongest group; 0 where nothing vibrates.
    """
    import numpy as np

    frequencies = np.where(np.asarray(amplitudes) == 0.0, np.inf, frequencies_hz)  # silent: last
    amplitudes, places = np.broadcast_to(amplitudes, frequencies.shape), frequencies.shape[1:]
    if len(frequencies) > 1:
        order = np.argsort(frequencies, axis=0, kind="stable")
        frequencies = np.take_along_axis(frequencies, order, axis=0)
        amplitudes = np.take_along_axis(amplitudes, order, axis=0)
    group, power, strongest, frequency = np.zeros((4, *places))
    group_hz = np.full(places, -np.inf)
    for amplitude, each_hz in zip(amplitudes, frequencies, strict=True):
        begins = each_hz > group_hz + 1.0
        power = power + np.where(begins, group**2, 0.0)
        group = np.where(begins, 0.0, group) + amplitude
        group_hz = np.where(begins, each_hz, group_hz)
        frequency = np.where(group > strongest, group_hz, frequency)
        strongest = np.maximum(group, strongest)
    return np.sqrt(power + group**2), frequency


def combine_pressure(pressures_kpa: F64) -> F64:
    """Add pressures at one place: (n, ...) kPa of n effects to (...) kPa."""
    import numpy as np

    return np.asarray(np.sum(pressures_kpa, axis=0))


def combine_wind(speeds_m_s: F64, directions: F64) -> tuple[F64, F64]:
    """Add winds at one place as vectors.

    Parameters
    ----------
    speeds_m_s : (n, ...) float64
    directions : (n, ..., 3) float64
        Unit vectors, world space, the way that the air moves; broadcast against the speeds.

    Returns
    -------
    speed_m_s : (...) float64
    direction : (..., 3) float64
        Zero where the winds cancel.
    """
    import numpy as np

    velocity = np.sum(np.asarray(speeds_m_s)[..., None] * np.asarray(directions), axis=0)
    speed = np.linalg.norm(velocity, axis=-1)
    return speed, velocity / np.where(speed > 0.0, speed, 1.0)[..., None]


def combine_temperature(temperatures_c: F64, strengths: F64, neutrals_c: F64) -> F64:
    """Deviation from neutral of several effects at each place, degrees Celsius.

    Each of n effects, the first axis of all, contributes
    ``strength * (temperature - its own neutral)``; the sum (...) is the deviation that
    a device adds to its own neutral temperature.
    """
    import numpy as np

    return np.asarray(np.sum(strengths * (temperatures_c - neutrals_c), axis=0))
