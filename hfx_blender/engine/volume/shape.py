# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic volumes: interface of shapes, falloff of weight from core to boundary, and placement."""

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Any, Final, Protocol

import numpy as np

from ..arrays import F64, Bool, inverse_3x3


class Shape(Protocol):
    """A closed solid in *shape space*; points are (3, N) float64, one row for each axis. The
    boundary belongs to the solid. NaN points are outside and raise nothing."""

    @property
    def bounds(self) -> F64:
        """Axis-aligned box, (2, 3): lowest and highest corner, shape space."""

    def contains(self, points: F64) -> Bool:
        """Test points for being inside or on the boundary, (N,) bool."""

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """World-space distance of inner points to the boundary, (N,) metres. ``to_world`` is the
        (4, 4) placing matrix, finite. 0 outside and for NaN."""


class FalloffKind(StrEnum):
    """Profile of the weight from the boundary inwards."""

    NONE = "none"
    LINEAR = "linear"
    SMOOTH = "smooth"


@dataclass(frozen=True)
class Falloff:
    """Weight of 1 in the core, falling to 0 at the boundary. ``share`` is the part of the way from
    boundary to core over which the weight rises: 1 reaches 1 only at the core; 0, as kind NONE, is
    1 everywhere inside."""

    kind: FalloffKind = FalloffKind.NONE
    share: float = 1.0

    @property
    def is_flat(self) -> bool:
        """True for a weight of 1 everywhere inside: kind NONE or share 0."""
        return self.kind is FalloffKind.NONE or self.share <= 0.0

    @property
    def precision(self) -> type[np.floating[Any]]:
        """NumPy type of weights: float32 without falloff, to save memory, else float64."""
        return np.float32 if self.is_flat else np.float64

    def weight(self, rise: F64) -> F64:
        """Contact weights (N,) in 0..1 of inner points: linear or smoothstep up to ``share``.
        ``rise`` (N,) is each point's share of the way from the boundary (0) to the core (1)."""
        if self.is_flat:
            return np.ones_like(rise)
        t = np.clip(rise, 0.0, self.share) / self.share
        if self.kind is FalloffKind.SMOOTH:
            t = t * t * (3.0 - 2.0 * t)
        return t


FLATTEST: Final = 1e-6
"""Least reciprocal condition number, after equilibration, of a usable matrix. Blender computes
world matrices in float32, so a matrix flattened by a parent has rounding noise of about 1e-7 in
place of zeros. Below this limit noise and flatness are indistinguishable."""


def inverse_placement(matrices: F64) -> tuple[F64, Bool]:
    """Invert affine placing matrices (T, 4, 4), with a mask of the reliable inverses.

    Columns, then rows, are equilibrated by powers of two, which is exact. So units and unequal
    scales do not count as flatness; nearly coplanar axes do. The last row is taken as 0, 0, 0, 1.
    Returns inverses (T, 4, 4), NaN where not usable, so that every point is outside; and ``usable``
    (T,), False where the matrix is not finite, singular, or flatter than :data:`FLATTEST`.
    """
    matrices = np.asarray(matrices, np.float64)
    if len(matrices) and (matrices[1:] == matrices[0]).all():  # a still volume
        inverse, is_usable = _inverse_of_still(matrices[0].tobytes())
        return np.repeat(inverse, len(matrices), 0), np.repeat(is_usable, len(matrices))
    return _inverse_placement(matrices)


@lru_cache(maxsize=1024)
def _inverse_of_still(matrix: bytes) -> tuple[F64, Bool]:
    """Cached :func:`inverse_placement` (1, 4, 4) of the bytes of one matrix."""
    return _inverse_placement(np.frombuffer(matrix).reshape(1, 4, 4))


def _inverse_placement(matrices: F64) -> tuple[F64, Bool]:
    """:func:`inverse_placement` without the cache."""
    usable: Bool = np.isfinite(matrices[:, :3, :]).all(axis=(1, 2))
    linear = np.where(usable[:, None, None], matrices[:, :3, :3], 0.0)
    # Exponents that bring the largest entry of each column, then row, into [0.5, 1).
    columns = np.frexp(np.abs(linear).max(axis=1))[1]
    # Powers of two change exponents only, so that no digit is lost.
    balanced = np.ldexp(linear, -columns[:, None, :])
    rows = np.frexp(np.abs(balanced).max(axis=2))[1]
    balanced = np.ldexp(balanced, -rows[:, :, None])

    stretch = np.linalg.svd(balanced, compute_uv=False)
    usable &= stretch[:, 2] > FLATTEST * stretch[:, 0]
    balanced = np.where(usable[:, None, None], balanced, np.eye(3))

    inverses = np.full((len(matrices), 4, 4), np.nan)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        back = np.ldexp(inverse_3x3(balanced), -columns[:, :, None] - rows[:, None, :])
        offset = -np.einsum("tij,tj->ti", back, matrices[:, :3, 3])
    usable &= np.isfinite(back).all(axis=(1, 2)) & np.isfinite(offset).all(axis=1)
    inverses[usable, :3, :3] = back[usable]
    inverses[usable, :3, 3] = offset[usable]
    inverses[usable, 3] = (0.0, 0.0, 0.0, 1.0)
    return inverses, usable


def world_bounds(shape: Shape, matrices: F64) -> F64:
    """Axis-aligned world boxes (T, 2, 3) of a placed shape's bounds: lowest and highest corner, m.
    Never too small, rounding included; up to sqrt(3) times too long for a rotated sphere.
    ``matrices`` (T, 4, 4) are shape space to world; NaN where a matrix is not finite."""
    low, high = shape.bounds
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    with np.errstate(over="ignore", invalid="ignore"):
        linear, offset = matrices[:, :3, :3], matrices[:, :3, 3]
        centre = linear @ middle + offset
        reach = np.abs(linear) @ half
        largest = np.abs(linear) @ (np.abs(middle) + half) + np.abs(offset)
        # Eight roundings of the largest possible sum.
        reach = reach + 8.0 * np.finfo(np.float64).eps * largest
        bounds: F64 = np.stack([centre - reach, centre + reach], axis=1)
    bounds[~np.isfinite(bounds).all(axis=(1, 2))] = np.nan
    return bounds
