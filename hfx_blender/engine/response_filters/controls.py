# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of filters of a contact response, and the keyframable controls."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class FilterKind(StrEnum):
    """Input of a filter."""

    DISTANCE = "distance"  # distance from the volume's centre or axis
    SPEED = "speed"  # relative speed of skin and volume
    IMPACT = "impact"  # time since the touch began
    PROXIMITY = "proximity"  # nearness before contact
    SINE = "sine"  # sine in time or space


class About(StrEnum):
    """Reference of a filter's distances; TIME for a sine in time."""

    CENTRE = "centre"  # the volume's origin
    AXIS = "axis"  # the volume's local Z axis
    TIME = "time"


class Operation(StrEnum):
    """Operation that combines a filter's value with the result of the filters above."""

    MULTIPLY = "multiply"
    ADD = "add"
    MAXIMUM = "maximum"


@dataclass(frozen=True)
class Control:
    """Keyframable parameter of a filter, with default and range."""

    name: str
    unit: str
    default: float
    minimum: float
    maximum: float


_INFLUENCE: Final = Control("influence", "1", 1.0, 0.0, 1.0)

CONTROLS: Final[dict[FilterKind, tuple[Control, ...]]] = {
    FilterKind.DISTANCE: (
        _INFLUENCE,
        Control("near_m", "m", 0.0, 0.0, 1000.0),
        Control("far_m", "m", 0.5, 0.0, 1000.0),
        Control("near_value", "1", 1.0, 0.0, 1.0),
        Control("far_value", "1", 0.0, 0.0, 1.0),
    ),
    FilterKind.SPEED: (
        _INFLUENCE,
        Control("still_m_s", "m/s", 0.0, 0.0, 100.0),
        Control("full_m_s", "m/s", 1.0, 1e-3, 100.0),
    ),
    FilterKind.IMPACT: (
        _INFLUENCE,
        Control("attack_s", "s", 0.0, 0.0, 10.0),
        Control("decay_s", "s", 0.15, 1e-3, 10.0),
        Control("full_m_s", "m/s", 1.0, 1e-3, 100.0),
    ),
    FilterKind.PROXIMITY: (
        _INFLUENCE,
        Control("range_m", "m", 0.1, 0.0, 10.0),
        Control("exponent", "1", 1.0, 0.1, 10.0),
    ),
    FilterKind.SINE: (
        _INFLUENCE,
        Control("cycles", "1/s or m", 2.0, 0.0, 1000.0),  # frequency, or wavelength in space
        Control("depth", "1", 1.0, 0.0, 1.0),
        Control("phase", "turns", 0.0, -1000.0, 1000.0),
    ),
}
"""Controls of each filter kind, in the order of a block's columns."""

WIDTH: Final = max(len(controls) for controls in CONTROLS.values())
"""Number of control columns of each filter in a block."""


@dataclass(frozen=True)
class Filter:
    """Constant settings of one filter of a stack."""

    kind: FilterKind
    operation: Operation = Operation.MULTIPLY
    about: About = About.CENTRE
    rings_s: float = 0.0  # upper bound of an impact's duration, for all values of the controls

    @property
    def is_in_space(self) -> bool:
        """True for filters with a separate value for each vertex: distance, and sine about centre
        or axis."""
        in_space = self.kind is FilterKind.SINE and self.about is not About.TIME
        return in_space or self.kind is FilterKind.DISTANCE
