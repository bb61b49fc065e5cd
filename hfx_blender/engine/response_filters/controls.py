# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinds of filters of a contact response, and the keyframable controls."""

import tomllib
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
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
    FilterKind(kind): (_INFLUENCE, *(Control(name, **facts) for name, facts in controls.items()))
    for kind, controls in tomllib.loads(
        Path(__file__).with_name("controls.toml").read_text(encoding="utf-8")
    ).items()
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


@dataclass(frozen=True)
class ContactLaw:
    """Coefficients of :func:`..contact.contact_force.force`: spring, damper and friction."""

    stiffness_n_m: float
    damping_n_s_m: float
    friction: float  # Coulomb coefficient
