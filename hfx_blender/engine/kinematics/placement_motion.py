# SPDX-License-Identifier: GPL-3.0-or-later
"""Interpolation of placements between two samples.

The origin of an object moves straight, its axes turn about it by the shortest way and stretch
evenly: what keys of location, rotation and scale do between two frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import F64
from ..native import kinematics as native

_STILL: float = 1e-9  # radians; less is rounding
_FLAT: float = 1e-12  # of the largest stretch; less is rounding


@dataclass(frozen=True, eq=False)
class Motion:
    """Placing matrices that change, in ``n`` intervals from 0 to 1."""

    origins: F64  # (2, n, 3)
    stretches: F64  # (2, n, 3, 3) symmetric; before they are turned
    turns: F64  # (n, 3, 3) rotation at the start
    axes: F64  # (n, 3) of the rotation in between
    angles: F64  # (n,) radians, 0 to pi

    @classmethod
    def between(cls, before: F64, after: F64) -> Motion:
        """Interpolate between matrices (n, 4, 4) at both ends."""
        one, other = _polar(before[:, :3, :3]), _polar(after[:, :3, :3])
        axes, angles = _axis_angle(other[0] @ one[0].transpose(0, 2, 1))
        return cls(
            np.stack([before[:, :3, 3], after[:, :3, 3]]),
            np.stack([one[1], other[1]]),
            one[0],
            axes,
            angles,
        )

    def at(self, share: float) -> F64:
        """The matrices (n, 4, 4) at this share of the interval."""
        matrices = np.zeros((len(self.angles), 4, 4))
        stretch = self.stretches[0] + share * (self.stretches[1] - self.stretches[0])
        matrices[:, :3, :3] = _rotations(self.axes, share * self.angles) @ self.turns @ stretch
        matrices[:, :3, 3] = self.origins[0] + share * (self.origins[1] - self.origins[0])
        matrices[:, 3, 3] = 1.0
        return matrices


def largest_stretch(matrices: F64) -> F64:
    """Upper bound of the stretch of any direction by matrices (n, 3 or 4, 4), (n,)."""
    linear = matrices[:, :3, :3]
    gram = linear @ linear.transpose(0, 2, 1)
    stretch: F64 = np.sqrt(np.abs(gram).sum(axis=2).max(axis=1))
    return stretch


def longest_axis(linear: F64) -> F64:
    """Length of the longest axis under matrices (..., 3, 3), (...): a lower bound of their
    stretch."""
    longest: F64 = np.sqrt(np.square(linear).sum(axis=-2).max(axis=-1))
    return longest


def turned_by(before: F64, after: F64) -> F64:
    """Angles of rotation between placements (n, 4, 4), radians (n,); exactly 0 for no rotation."""
    return native.turns(before, after)


def _polar(linear: F64) -> tuple[F64, F64]:
    """Rotation and symmetric stretch, (n, 3, 3) each; a mirroring is in the stretch."""
    u, s, vt = np.linalg.svd(linear)
    sign = np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)[:, None, None]
    is_flat = s[:, 2:, None] <= _FLAT * s[:, :1, None]  # has no side that could be mirrored
    u[:, :, 2:] *= np.where(is_flat, sign, 1.0)
    sign = np.where(is_flat, 1.0, sign)
    turns = u @ vt
    stretches = (vt.transpose(0, 2, 1) * s[:, None, :]) @ vt
    return turns * sign, stretches * sign


def _axis_angle(turns: F64) -> tuple[F64, F64]:
    skew = 0.5 * np.stack(
        [
            turns[:, 2, 1] - turns[:, 1, 2],
            turns[:, 0, 2] - turns[:, 2, 0],
            turns[:, 1, 0] - turns[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(skew, axis=1)
    cosine = 0.5 * (np.trace(turns, axis1=1, axis2=2) - 1.0)
    angles = np.arctan2(sine, cosine)
    # Half a turn leaves no skew part: the axis is then a column of R + 1.
    both = turns + np.eye(3)
    column = np.argmax(np.einsum("nij,nij->nj", both, both), axis=1)
    half = np.take_along_axis(both, column[:, None, None], 2)[:, :, 0]
    axes = np.where((sine > 1e-6)[:, None] | (cosine > 0.0)[:, None], skew, half)
    length = np.linalg.norm(axes, axis=1)
    axes = np.where(length[:, None] > 0.0, axes, (1.0, 0.0, 0.0))
    axes = axes / np.where(length > 0.0, length, 1.0)[:, None]
    return axes, np.where(angles > _STILL, angles, 0.0)


def _rotations(axes: F64, angles: F64) -> F64:
    """Rodrigues' formula, (n, 3, 3)."""
    x, y, z = axes.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    rotations: F64 = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return rotations
