# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerance: the one setting of speed against accuracy.

The engine chooses the cheapest way that keeps it: samples in each cell of skin, level of detail,
sub-steps in time.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from ..errors import UsageError


@dataclass(frozen=True)
class Tolerance:
    """Accepted error in space, in time and in strength.

    ``spacing_share`` and ``distance_m`` both bound where the edge of a contact may be found:
    the smaller of the share of the local spacing of vertices, as they are posed, and the distance,
    as bones scale it, counts. 0 asks for the finest that the engine has; infinity asks for nothing.

    A weight lies between the exact ones of volumes whose surface is that much farther in and that
    much farther out, up to ``amplitude``. A contact begins within ``time_s``, a sample, and the
    time that its approach takes for that distance.
    """

    name: str
    time_s: float  # by which motion may be early or late; every sample is read, so it never is
    spacing_share: float  # of the distance between neighbouring vertices
    distance_m: float
    amplitude: float  # at an actuator, share of its full scale

    def __post_init__(self) -> None:
        for value in (self.time_s, self.spacing_share, self.distance_m, self.amplitude):
            if not value >= 0.0:
                raise ValueError(f"a tolerance must not be negative: {self}")

    def edge_m(self, spacing_m: float) -> float:
        """Largest error of a contact's edge where vertices are ``spacing_m`` apart, metres."""
        return min(self.spacing_share * spacing_m, self.distance_m)


PREVIEW: Final = Tolerance("preview", 0.040, 1.0, math.inf, 0.20)
STANDARD: Final = Tolerance("standard", 0.010, 0.5, 0.005, 0.05)
EXACT: Final = Tolerance("exact", 0.0, 0.0, 0.0, 0.0)
PAPER: Final = Tolerance("paper", 0.0, math.inf, math.inf, math.inf)
"""HFX Studio's own test: a vertex is inside or not. Poses are exact."""

PRESETS: Final = {each.name: each for each in (PREVIEW, STANDARD, EXACT, PAPER)}

_PART = re.compile(r"([0-9.eE+-]+)\s*(mm|ms|%)")
_ALLOWED = f"{', '.join(PRESETS)}, or values such as 5mm,10ms,5%"


def parse(text: str) -> Tolerance:
    """Parse a tolerance: a preset's name, or values such as ``3mm,5ms`` or ``3mm,5ms,2%``.

    Raises
    ------
    UsageError
        The text is neither.
    """
    name = text.strip().lower()
    if name in PRESETS:
        return PRESETS[name]
    values: dict[str, float] = {}
    for part in name.split(","):
        found = _PART.fullmatch(part.strip())
        try:
            value = float(found[1]) if found else math.nan
        except ValueError:
            value = math.nan
        if found is None or found[2] in values or not 0.0 <= value < math.inf:
            raise UsageError(f"tolerance '{text}': expected {_ALLOWED}")
        values[found[2]] = value
    if not {"mm", "ms"} <= set(values):
        raise UsageError(f"tolerance '{text}': expected both mm and ms: {_ALLOWED}")
    return Tolerance(
        name,
        values["ms"] / 1000.0,
        math.inf,
        values["mm"] / 1000.0,
        values.get("%", 100.0 * STANDARD.amplitude) / 100.0,
    )
