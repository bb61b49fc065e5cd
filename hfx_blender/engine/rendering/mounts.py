# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout on its mount: flat, or bent to a cylinder on which distances along the curve are kept.

The cylinder touches the mount's plane along its y axis; x is an arc's length. Seen from outside,
with x to the right and y up, ``x_axis`` times ``y_axis`` leads out of the body, so the cylinder of
a positive radius has its axis on the body's side.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64
from .device_config import Mount

_TURN: Final = 2.0 * np.pi

_CLOSED_SPACINGS: Final = 3.0
"""A gap opposite to the layout is open if its middle is this many spacings from any actuator.

What is felt is faded out two spacings from a layout, measured on skin, which is a bit nearer than
the cylinder or farther.
"""


def place_on(mount: Mount, at_m: F64) -> F64:
    """Rest-space places (n, 3) of the layout's own coordinates (n, 2), metres."""
    axes = np.array([mount.x_axis, mount.y_axis])
    radius = mount.bend_radius_m
    if radius is None:
        return np.asarray(np.array(mount.origin_m) + at_m @ axes)
    along, depth = radius * np.sin(at_m[:, 0] / radius), np.sin(0.5 * at_m[:, 0] / radius)
    flat = np.column_stack((along, at_m[:, 1])) @ axes
    inwards = -2.0 * radius * depth**2  # r (cos - 1), without the loss of digits
    return np.asarray(np.array(mount.origin_m) + flat + inwards[:, None] * np.cross(*axes))


def on_mount(mount: Mount, points: F64, seam_rad: float = np.pi) -> F64:
    """The layout's own coordinates (n, 2) of rest-space points (n, 3), metres.

    What is off the mount's plane counts where it is straight below or above it; on a bent mount,
    as seen from the cylinder's axis. There x is unrolled from one turn before the angle
    ``seam_rad`` up to it; the origin is at angle 0.
    """
    axes = np.array([mount.x_axis, mount.y_axis])
    offsets = points - np.array(mount.origin_m)
    flat = np.asarray(offsets @ axes.T)
    radius = mount.bend_radius_m
    if radius is None:
        return flat
    away = offsets @ np.cross(*axes) + radius
    angle = np.arctan2(np.sign(radius) * flat[:, 0], np.sign(radius) * away)
    flat[:, 0] = radius * (seam_rad - np.mod(seam_rad - angle, _TURN))
    return flat


class Pad:
    """The unrolled layout of some actuators.

    Parameters
    ----------
    centres : (A, 3) float64
        Of the actuators, rest space, metres.
    spacing_m : float
        Between neighbouring actuators.

    Attributes
    ----------
    closed_m : float or None
        The circumference, if the layout goes all the way round, so that both of its ends are
        neighbours; None: it has two ends.
    """

    def __init__(self, mount: Mount, centres: F64, spacing_m: float) -> None:
        self._mount = mount
        self._seam_rad = np.pi
        self.closed_m: float | None = None
        radius = mount.bend_radius_m
        if radius is not None:
            angles = np.sort(on_mount(mount, centres)[:, 0] / radius)
            gaps = np.diff(angles, append=angles[0] + _TURN)
            widest = int(np.argmax(gaps))
            self._seam_rad = float(np.mod(angles[widest] + 0.5 * gaps[widest], _TURN))
            half_gap_m = 2.0 * abs(radius) * np.sin(0.25 * gaps[widest])
            if half_gap_m < _CLOSED_SPACINGS * spacing_m:
                self.closed_m = _TURN * abs(radius)

    def at(self, points: F64) -> F64:
        """The layout's own coordinates (n, 2) of rest-space points (n, 3), metres."""
        return on_mount(self._mount, points, self._seam_rad)
