# SPDX-License-Identifier: GPL-3.0-or-later
"""Layout on its mount: flat, or bent to a cylinder with equal distances along the arcs.

The cylinder touches the mount's plane along the y axis; x is an arc length. Seen from outside, with
x to the right and y up, ``x_axis`` times ``y_axis`` points away from the body, so a cylinder with a
positive radius has its axis on the body's side.
"""

from typing import Final

import numpy as np

from ..arrays import F64
from .device_config import Mount

_TURN: Final = 2.0 * np.pi

_CLOSED_SPACINGS: Final = 3.0
"""Distance, in spacings, of the middle of an open gap from the nearest actuator. Gains fade out two
spacings from a layout, measured on skin, whose distances differ a little from the cylinder's."""


def place_on(mount: Mount, at_m: F64) -> F64:
    """Rest-space positions (n, 3) of layout coordinates (n, 2), metres; on a bent mount x is an arc
    length and may exceed a turn."""
    axes = np.array([mount.x_axis, mount.y_axis])
    radius = mount.bend_radius_m
    if radius is None:
        return np.asarray(np.array(mount.origin_m) + at_m @ axes)
    along, depth = radius * np.sin(at_m[:, 0] / radius), np.sin(0.5 * at_m[:, 0] / radius)
    flat = np.column_stack((along, at_m[:, 1])) @ axes
    inwards = -2.0 * radius * depth**2  # r (cos - 1), without the loss of digits
    return np.asarray(np.array(mount.origin_m) + flat + inwards[:, None] * np.cross(*axes))


def on_mount(mount: Mount, points: F64, seam_rad: float = np.pi) -> F64:
    """Layout coordinates (n, 2) of rest-space points (n, 3), metres. Points are projected straight
    onto a flat mount, radially onto a bent mount. There x is unrolled over the turn that ends at
    the angle ``seam_rad``; the origin is at angle 0."""
    axes = np.array([mount.x_axis, mount.y_axis])
    offsets = points - np.array(mount.origin_m)
    flat = np.asarray(offsets @ axes.T)
    radius = mount.bend_radius_m
    if radius is None:
        return flat
    # Distance from the cylinder's axis along the normal, and the angle about the axis.
    away = offsets @ np.cross(*axes) + radius
    angle = np.arctan2(np.sign(radius) * flat[:, 0], np.sign(radius) * away)
    flat[:, 0] = radius * (seam_rad - np.mod(seam_rad - angle, _TURN))
    return flat


class Pad:
    """Unrolled layout of actuators at ``centres`` (A, 3), rest space, m, about ``spacing_m`` apart.
    ``closed_m``: circumference of a layout that surrounds the cylinder, with both ends adjacent;
    None for a layout with two ends."""

    def __init__(self, mount: Mount, centres: F64, spacing_m: float) -> None:
        self._mount = mount
        self._seam_rad = np.pi
        self.closed_m: float | None = None
        radius = mount.bend_radius_m
        if radius is not None:
            angles = np.sort(on_mount(mount, centres)[:, 0] / radius)
            gaps = np.diff(angles, append=angles[0] + _TURN)
            # The seam lies in the middle of the widest gap, between no two neighbours.
            widest = int(np.argmax(gaps))
            self._seam_rad = float(np.mod(angles[widest] + 0.5 * gaps[widest], _TURN))
            half_gap_m = 2.0 * abs(radius) * np.sin(0.25 * gaps[widest])
            if half_gap_m < _CLOSED_SPACINGS * spacing_m:
                self.closed_m = _TURN * abs(radius)

    def at(self, points: F64) -> F64:
        """Layout coordinates (n, 2) of rest-space points (n, 3), metres."""
        return on_mount(self._mount, points, self._seam_rad)
