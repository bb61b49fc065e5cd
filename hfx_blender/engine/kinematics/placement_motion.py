# SPDX-License-Identifier: GPL-3.0-or-later
"""Interpolation of placements between two samples.

The origin moves straight; axes rotate about it by the smallest angle and stretch linearly, like
keyed location, rotation and scale between two frames.
"""

from dataclasses import dataclass

import numpy as np

from ..arrays import F64
from ..native.library import loaded

_STILL: float = 1e-9  # radians, below is rounding
_FLAT: float = 1e-12  # fraction of the largest stretch, below is rounding


@dataclass(frozen=True, eq=False)
class Motion:
    """Interpolated placing matrices over ``n`` intervals, parameter 0 to 1."""

    origins: F64  # (2, n, 3)
    stretches: F64  # (2, n, 3, 3) symmetric, applied before the rotation
    turns: F64  # (n, 3, 3) rotation at the start
    axes: F64  # (n, 3) of the rotation over the interval
    angles: F64  # (n,) radians, 0 to pi

    @classmethod
    def between(cls, before: F64, after: F64) -> "Motion":
        """Motion from matrices (n, 4, 4) at the start and at the end, as a turn, a stretch and a
        shift."""
        # Rotation and stretch are interpolated apart, so that no axis shrinks on the way.
        start, end = _polar(before[:, :3, :3]), _polar(after[:, :3, :3])
        axes, angles = _axis_angle(end[0] @ start[0].transpose(0, 2, 1))
        return cls(
            np.stack([before[:, :3, 3], after[:, :3, 3]]),
            np.stack([start[1], end[1]]),
            start[0],
            axes,
            angles,
        )

    def at(self, share: float) -> F64:
        """Matrices (n, 4, 4) at a fraction 0..1 of the interval: place and stretch linear, turn at
        constant speed."""
        matrices = np.zeros((len(self.angles), 4, 4))
        stretch = self.stretches[0] + share * (self.stretches[1] - self.stretches[0])
        # Rodrigues' formula: the part of the turn about each axis.
        x, y, z = self.axes.T
        zero = np.zeros_like(x)
        cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
        angles = (share * self.angles)[:, None, None]
        turn = np.eye(3) + np.sin(angles) * cross + (1.0 - np.cos(angles)) * (cross @ cross)
        matrices[:, :3, :3] = turn @ self.turns @ stretch
        matrices[:, :3, 3] = self.origins[0] + share * (self.origins[1] - self.origins[0])
        matrices[:, 3, 3] = 1.0
        return matrices


def largest_stretch(matrices: F64) -> F64:
    """Upper bound (n,) of the stretch of any direction by matrices (n, 3 or 4, 4)."""
    linear = matrices[:, :3, :3]
    # The largest row sum bounds the largest eigenvalue (Gershgorin); its root bounds the stretch.
    gram = linear @ linear.transpose(0, 2, 1)
    return np.asarray(np.sqrt(np.abs(gram).sum(axis=2).max(axis=1)))


def longest_axis(linear: F64) -> F64:
    """Length (...,) of the longest axis under matrices (..., 3, 3): lower bound of the stretch."""
    return np.asarray(np.sqrt(np.square(linear).sum(axis=-2).max(axis=-1)))


def turned_by(before: F64, after: F64) -> F64:
    """Rotation angles (n,) between placements (n, 4, 4), radians; exactly 0 without rotation. Needs
    the compiled library."""
    assert before.shape == after.shape == (len(before), 4, 4)
    angles = np.empty(len(before))
    loaded().hfx_turns(len(angles), before, after, angles)
    return angles


def _polar(linear: F64) -> tuple[F64, F64]:
    """Rotation and symmetric stretch (n, 3, 3 each) with product rotation @ stretch; the stretch
    includes mirroring, unless flat."""
    u, s, vt = np.linalg.svd(linear)
    sign = np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)[:, None, None]
    # A flattened shape cannot be mirrored: the sign goes to the vanishing axis instead.
    is_flat = s[:, 2:, None] <= _FLAT * s[:, :1, None]
    u[:, :, 2:] *= np.where(is_flat, sign, 1.0)
    sign = np.where(is_flat, 1.0, sign)
    rotations = u @ vt
    stretches = (vt.transpose(0, 2, 1) * s[:, None, :]) @ vt
    return rotations * sign, stretches * sign


def _axis_angle(turns: F64) -> tuple[F64, F64]:
    """Unit axes (n, 3) and angles (n,), radians, of rotations (n, 3, 3); axis X and angle 0 for no
    rotation."""
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
    # The skew part vanishes at half a turn; there the columns of R + 1 are along the axis.
    shifted = turns + np.eye(3)
    column = np.argmax(np.einsum("nij,nij->nj", shifted, shifted), axis=1)
    half = np.take_along_axis(shifted, column[:, None, None], 2)[:, :, 0]
    axes = np.where((sine > 1e-6)[:, None] | (cosine > 0.0)[:, None], skew, half)
    length = np.linalg.norm(axes, axis=1)
    axes = np.where(length[:, None] > 0.0, axes, (1.0, 0.0, 0.0))
    axes = axes / np.where(length > 0.0, length, 1.0)[:, None]
    return axes, np.where(angles > _STILL, angles, 0.0)
