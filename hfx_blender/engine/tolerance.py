# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerance: trade-off between speed and accuracy.

Determines the samples of each skin cell, the level of detail, and sub-steps in time.
"""

import math
import re
from dataclasses import dataclass
from typing import Final

from ..errors import UsageError


@dataclass(frozen=True)
class Tolerance:
    """Accepted error in space, time and strength.

    The edge of a contact is off by at most the smaller of ``spacing_share`` times the posed spacing
    of vertices, and ``distance_m`` scaled with the bones. 0 selects the finest samples, infinity no
    samples besides vertices.

    A weight lies between the exact weights of volumes with the surface moved inwards and outwards
    by this error, up to ``amplitude``. The begin of a contact is off by at most ``time_s``, one
    sample, and the time to approach by this error.
    """

    name: str
    time_s: float  # accepted time error of motion; without effect, as every sample is read
    spacing_share: float  # fraction of the distance between neighbouring vertices
    distance_m: float
    amplitude: float  # fraction of an actuator's full scale

    def __post_init__(self) -> None:
        for value in (self.time_s, self.spacing_share, self.distance_m, self.amplitude):
            if not value >= 0.0:
                raise ValueError(f"a tolerance must not be negative: {self}")

    def edge_m(self, spacing_m: float) -> float:
        """Largest error of the edge of a contact, metres, for a vertex spacing: the smaller of the
        share of the spacing and the distance."""
        return min(self.spacing_share * spacing_m, self.distance_m)


PREVIEW: Final = Tolerance("preview", 0.040, 1.0, math.inf, 0.20)
STANDARD: Final = Tolerance("standard", 0.010, 0.5, 0.005, 0.05)
EXACT: Final = Tolerance("exact", 0.0, 0.0, 0.0, 0.0)
PAPER: Final = Tolerance("paper", 0.0, math.inf, math.inf, math.inf)
"""HFX Studio's test: vertex inside or outside. Poses are exact."""

PRESETS: Final = {preset.name: preset for preset in (PREVIEW, STANDARD, EXACT, PAPER)}

_PART = re.compile(r"([0-9.eE+-]+)\s*(mm|ms|%)")
_ALLOWED = f"{', '.join(PRESETS)}, or values such as 5mm,10ms,5%"


def parse(text: str) -> Tolerance:
    """Parse a preset name, or values such as ``3mm,5ms`` or ``3mm,5ms,2%`` in any order; mm and ms
    are required, without % that of STANDARD applies. Raises UsageError: the text is neither."""
    name = text.strip().lower()
    if name in PRESETS:
        return PRESETS[name]
    # Each unit once; "1e999" is a number for Python, but infinite.
    values: dict[str, float] = {}
    for part in name.split(","):
        match = _PART.fullmatch(part.strip())
        try:
            value = float(match[1]) if match else math.nan
        except ValueError:
            value = math.nan
        if match is None or match[2] in values or not 0.0 <= value < math.inf:
            raise UsageError(f"tolerance '{text}': expected {_ALLOWED}")
        values[match[2]] = value
    if not {"mm", "ms"} <= set(values):
        raise UsageError(f"tolerance '{text}': expected both mm and ms: {_ALLOWED}")
    return Tolerance(
        name,
        values["ms"] / 1000.0,
        math.inf,
        values["mm"] / 1000.0,
        values.get("%", 100.0 * STANDARD.amplitude) / 100.0,
    )
