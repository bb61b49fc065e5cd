# SPDX-License-Identifier: GPL-3.0-or-later
"""Attack, decay and release of AHAP's continuous events.

Source: developer.apple.com, CHHapticEvent.ParameterID. A sustained event rises during the attack
time, stays, and falls during the release time after the event's duration. Without sustain, an event
falls during the decay time after the attack.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ..signals.curves import Curve
from ..signals.signals import joined_times

RAMPS: Final = ("AttackTime", "DecayTime", "ReleaseTime", "Sustained")
_LONGEST_S: Final = 60.0
_PARTS: Final = 4  # straight pieces for the product of two ramps


def envelope(parameters: Mapping[str, float], start_s: float, end_s: float) -> Curve | None:
    """Shape of an event, 0 to 1, to the end of the release; None for a constant event.

    Times of ``parameters`` are clipped to 0..60 s; an attack beyond ``end_s`` stops at its level
    there. Sustained (at least 0.5, or without attack and decay): release after ``end_s``; otherwise
    decay after the attack, then 0 until ``end_s``.
    """
    attack, decay, release = (
        min(max(float(parameters.get(name, 0.0)), 0.0), _LONGEST_S) for name in RAMPS[:3]
    )
    is_sustained = float(parameters.get("Sustained", 1.0)) >= 0.5 or attack + decay <= 0.0
    if end_s <= start_s or (is_sustained and attack + release <= 0.0):
        return None
    # An attack longer than the event is cut off at the level reached.
    top = min(start_s + attack, end_s)
    level = (top - start_s) / attack if attack > 0.0 else 1.0
    points = [(start_s, 0.0)] if attack > 0.0 else []
    points.append((top, level))
    if is_sustained:
        points.append((end_s, level))
        if release > 0.0:
            points.append((end_s + release, 0.0))
    else:
        if decay > 0.0:
            points.append((top + decay, 0.0))
        points.append((max(points[-1][0], end_s), 0.0))
    times, values = np.array(points, np.float64).T
    return Curve(times, values)


def product(shape: Curve, control: Curve, level: float) -> Curve:
    """Curve of ``level`` times shape times control from the shape's first to its last time.

    Exact at four points per interval between keyframes of both, straight in between.
    """
    start, end = float(shape.times_s[0]), float(shape.times_s[-1])
    knots = joined_times([shape, control], start, end)
    times = np.interp(
        np.arange(_PARTS * (len(knots) - 1) + 1) / _PARTS, np.arange(len(knots)), knots
    )
    return Curve(times, level * shape.at(times) * control.at(times))
