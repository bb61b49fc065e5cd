# SPDX-License-Identifier: GPL-3.0-or-later
"""Loudspeaker layouts: direction of each channel from the listener.

Listener space has X to the front, Y to the left, Z up. Azimuth turns from the front to the left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...errors import UsageError
from ..arrays import F64

MAX_LOUDSPEAKERS: Final = 64
_SHOWN: Final = 60  # largest number of characters of a layout in messages


@dataclass(frozen=True)
class LoudspeakerLayout:
    """Directions of loudspeakers around a listener, in the order of channels."""

    name: str
    azimuths_deg: tuple[float, ...]
    elevations_deg: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.azimuths_deg)

    @property
    def is_flat(self) -> bool:
        """True for loudspeakers at ear height only (all elevations 0)."""
        return not any(self.elevations_deg)

    @property
    def directions(self) -> F64:
        """Unit vectors towards the loudspeakers, (C, 2) for a flat layout, else (C, 3)."""
        turn, rise = np.radians(self.azimuths_deg), np.radians(self.elevations_deg)
        vectors = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
        return np.ascontiguousarray(vectors[: 2 if self.is_flat else 3].T)


def _flat(name: str, *azimuths: float) -> LoudspeakerLayout:
    return LoudspeakerLayout(name, azimuths, (0.0,) * len(azimuths))


_CORNER = float(np.degrees(np.arctan(np.sqrt(0.5))))

LAYOUTS: Final = {
    layout.name: layout
    for layout in (
        _flat("stereo", 30.0, -30.0),
        _flat("quad", 45.0, -45.0, 135.0, -135.0),
        _flat("5.0", 30.0, -30.0, 0.0, 110.0, -110.0),
        _flat("7.0", 30.0, -30.0, 0.0, 90.0, -90.0, 150.0, -150.0),
        _flat("ring8", *(45.0 * k for k in range(8))),
        LoudspeakerLayout(
            "cube8", (45.0, -45.0, 135.0, -135.0) * 2, (-_CORNER,) * 4 + (_CORNER,) * 4
        ),
    )
}
"""Layouts by name; channels in the usual order: left, right, centre, side and back pairs."""


def parse(text: str) -> LoudspeakerLayout:
    """Layout of a name, or of azimuths in degrees, each with an optional elevation after a colon.

    Raises UsageError for another text, angles out of range, fewer than 2 or more than 64
    loudspeakers, or all at one place.
    """
    if text in LAYOUTS:
        return LAYOUTS[text]
    allowed = f"{', '.join(LAYOUTS)}, or angles such as 30,-30,110:20,-110:20"
    parts = text.split(",")
    if len(parts) > MAX_LOUDSPEAKERS:
        raise UsageError(f"{len(parts)} loudspeakers: expected 2 to {MAX_LOUDSPEAKERS} of them")
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
    azimuths, elevations = [], []
    for part in parts:
        azimuth, _, elevation = part.partition(":")
        try:
            turn, rise = float(azimuth), float(elevation or 0.0)
        except ValueError:
            raise UsageError(f"loudspeakers '{shown}': expected {allowed}") from None
        if not (-360.0 <= turn <= 360.0 and -90.0 <= rise <= 90.0):
            raise UsageError(
                f"loudspeakers '{shown}': {part[:_SHOWN]} is out of range; expected an azimuth "
                "of -360 to 360 and an elevation of -90 to 90 degrees"
            )
        azimuths.append(turn)
        elevations.append(rise)
    layout = LoudspeakerLayout(text, tuple(azimuths), tuple(elevations))
    if len(layout) < 2:
        raise UsageError(f"loudspeakers '{shown}': expected 2 to {MAX_LOUDSPEAKERS} of them")
    if not np.ptp(layout.directions, axis=0).any():
        raise UsageError(f"loudspeakers '{shown}': all of them are at one place")
    return layout
