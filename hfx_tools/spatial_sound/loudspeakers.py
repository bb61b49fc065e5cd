# SPDX-License-Identifier: GPL-3.0-or-later
"""Loudspeaker layouts, and panning of sources by the rendering schemes of haptic devices.

Listener space has X to the front, Y to the left, Z up. Azimuth turns from the front to the left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.panning.constant_power import RingPanning, VectorBasePanning
from hfx_blender.errors import UsageError

from .hearing import Hearing

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
    """Layout at ear height, by azimuths in degrees."""
    return LoudspeakerLayout(name, azimuths, (0.0,) * len(azimuths))


_CORNER: Final = float(np.degrees(np.arctan(np.sqrt(0.5))))  # elevation of a cube's corners

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
    # The number before the angles, as a long text would take long to read.
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


Scheme = Literal["vbap", "ring"]
SCHEMES: Final[tuple[Scheme, ...]] = ("vbap", "ring")


class Panner:
    """Gains of loudspeakers for places around a listener.

    ``scheme``: vector-base amplitude panning, or constant power between neighbours on a flat ring.
    Raises UsageError for a scheme that does not fit the layout.
    """

    def __init__(
        self, layout: LoudspeakerLayout, hearing: Hearing, scheme: Scheme = "vbap"
    ) -> None:
        self._layout = layout
        self.hearing = hearing
        self._scheme: VectorBasePanning | RingPanning
        if scheme == "ring":
            if not layout.is_flat:
                raise UsageError(f"loudspeakers '{layout.name}': a ring must be flat; use vbap")
            self._scheme = RingPanning(np.radians(layout.azimuths_deg))
        else:
            try:
                self._scheme = VectorBasePanning(layout.directions)
            except ValueError:
                raise UsageError(
                    f"loudspeakers '{layout.name}': those that are not all at ear height must "
                    "surround more than a plane"
                ) from None

    def gains(self, places_m: F64) -> tuple[F64, F64]:
        """Gains of each loudspeaker for the dry part (n, C), and gain of the wet part (n,).

        Places (n, 3) are in listener space; a place that is not finite is silent. Near the head
        (within ``spread_m``) the sound spreads over all loudspeakers.
        """
        # A lost place is infinitely far away, and thus silent.
        known = np.isfinite(places_m).all(axis=1)
        places = np.where(known[:, None], places_m, 0.0)
        distances = np.where(known, np.linalg.norm(places, axis=1), np.inf)
        dry, wet = self.hearing.gains(distances)
        directions = places[:, :2] if self._layout.is_flat else places
        lengths = np.linalg.norm(directions, axis=1)
        if isinstance(self._scheme, RingPanning):
            panned = self._scheme.gains(np.arctan2(directions[:, 1], directions[:, 0])[:, None])
        else:
            panned = self._scheme.gains(directions)
        # A source passing through the head spreads, so that the sound does not jump to the
        # opposite side. Mixing powers keeps the loudness constant.
        share = np.clip(1.0 - lengths / self.hearing.spread_m, 0.0, 1.0)[:, None]
        power = (1.0 - share) * np.square(panned) + share * (1.0 / len(self._layout))
        return np.sqrt(power) * dry[:, None], wet
