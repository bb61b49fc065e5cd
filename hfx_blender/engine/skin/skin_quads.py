# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance of skin from its samples in the quads of its triangles."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64

ROUNDING: Final = 1e-9


def squares_of(along: F64, across: F64) -> F64:
    """Squared lengths of the edges (3, Q) of triangles, and their product in between, (3, Q)."""
    return np.stack([_dot(along, along), _dot(along, across), _dot(across, across)])


def steps_within(places: F64, squares: F64, distance: F64) -> F64:
    """Number of parts along each side of quads, so that each part is near its sample.

    No place of a part is farther from the sample in its middle than the distance. Parts are
    skewed where a pose stretches the triangle; it does so by one matrix, so that the lengths of
    its edges and their product tell all.

    Parameters
    ----------
    places : (4, Q) float64
        Of :attr:`.skin_table.SkinTable.quads`.
    squares : (3, Q) float64
        Of :func:`squares_of`, in any pose.
    distance : (Q,) float64
        In the same units.

    Returns
    -------
    (Q,) float64
        Whole numbers from 1, or infinity; not a number where a length is none.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.ceil(diagonals(places, squares, np.inf) / (2.0 * distance) - ROUNDING)
        steps = np.ceil(diagonals(places, squares, most) / (2.0 * distance) - ROUNDING)
    return np.maximum(steps, 1.0)


def diagonals(places: F64, squares: F64, steps: F64 | float) -> F64:
    """The longest diagonal of any part of quads divided so, times the steps, (Q,).

    The place for (s, t) is linear in either, so that the way from a part's sample to its corner
    is half a step times the sum, or the difference, of both derivatives halfway there. Over the
    whole quad these are longest at its corners; halfway places are a quarter of a step inside.
    """
    edge, other, inner, inner_2 = places
    most = 1.0 - 0.5 / np.maximum(steps, 1.0)
    longest = np.zeros(squares.shape[1])
    for one, two in (
        (edge * most + inner * (1.0 - most), other * most + inner_2 * (1.0 - most)),
        (inner * (1.0 + most) - edge * most, inner_2 * (1.0 + most) - other * most),
        (edge * (1.0 - most) + inner * most, inner_2 * most - other * (1.0 + most)),
        (edge * (1.0 + most) - inner * most, -other * (1.0 - most) - inner_2 * most),
    ):
        squared = one * one * squares[0] + 2.0 * one * two * squares[1] + two * two * squares[2]
        longest = np.maximum(longest, squared)
    found: F64 = np.sqrt(longest)
    return found


def _dot(one: F64, other: F64) -> F64:
    product: F64 = np.einsum("ij,ij->j", one, other)
    return product
