# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of skin: the part of a triangle that belongs to one of its corners, and its bulge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import F64, I32
from ..body.model import PerceptualModel

ROUNDING: Final = 1e-9
_BULGE_LIMIT: Final = 0.25  # of a triangle's size; more is a crease, not a curve


def closeness(areas_m2: npt.NDArray[np.float32]) -> F64:
    """Reciprocal spacing of vertices with these areas, up to a constant factor."""
    return (1.0 / np.sqrt(np.maximum(areas_m2, 1e-12))).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Quads:
    """The quads at the first corners of triangles; see :class:`.skin_table.SkinTable`."""

    places: F64  # (4, Q)
    areas: F64  # (3, Q) square metres
    total: F64  # (Q,) square metres
    reaches: F64  # (Q,) greatest share of the way to the other corners
    means: F64  # (Q,) the same on average
    bulges: F64  # (3, Q)
    sizes: F64  # (Q,) metres: square root of twice the triangle's area
    squares: F64  # (3, Q) of its edges from the first corner, see :func:`squares_of`

    @classmethod
    def of(cls, surface: PerceptualModel, ring: I32) -> Quads:
        corners = ring.T
        points, normals = (
            [np.ascontiguousarray(each[corner].T, np.float64) for corner in corners]
            for each in (surface.vertices, surface.normals)
        )
        one, two, three = (closeness(surface.areas_m2[corner]) for corner in corners)
        along, across = points[1] - points[0], points[2] - points[0]
        cross = _cross(along, across)
        doubled = np.sqrt(_dot(cross, cross))
        sizes = np.sqrt(doubled)

        whole = one + two + three
        places = np.stack([two / (one + two), three / (one + three), two / whole, three / whole])
        # The place for (s, t) is s (1 - t) a + (1 - s) t b + s t c: its area is linear in both.
        edge, other, inner, inner_2 = places
        twist, twist_2 = inner - edge, inner_2 - other
        areas = np.stack([edge * other, edge * twist_2, twist * other]) * doubled

        # Of that place's a + b and c, times the area there, over all s and t.
        whole_area = areas[0] + 0.5 * areas[1] + 0.5 * areas[2]
        means = (
            edge * (areas[0] / 4.0 + areas[1] / 6.0 + areas[2] / 12.0)
            + other * (areas[0] / 4.0 + areas[1] / 12.0 + areas[2] / 6.0)
            + (inner + inner_2) * (areas[0] / 4.0 + areas[1] / 6.0 + areas[2] / 6.0)
        )
        means = np.divide(means, whole_area, out=np.zeros_like(means), where=whole_area > 0.0)

        # A quadratic patch over the triangle, half of what Phong tessellation gives (Boubekeur
        # and Alexa, 2008): a chord of a circle and a triangle on a sphere then have their true
        # sagitta, to second order.
        with np.errstate(divide="ignore", invalid="ignore"):
            upright = [each * (_dot(each, cross) / doubled) for each in normals]
            bulges = 0.5 * np.stack(
                [
                    _dot(along, upright[1] - upright[0]),
                    _dot(across, upright[2] - upright[0]),
                    _dot(across - along, upright[2] - upright[1]),
                ]
            )
            bulges = bulges / sizes
        bulges[~np.isfinite(bulges)] = 0.0
        bulges = np.clip(bulges, -_BULGE_LIMIT, _BULGE_LIMIT)
        return cls(
            places,
            areas,
            whole_area,
            np.maximum(np.maximum(edge, other), inner + inner_2),
            means,
            bulges,
            sizes,
            squares_of(along, across),
        )


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
        Of :class:`Quads`.
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


def _cross(one: F64, other: F64) -> F64:
    return np.stack(
        [
            one[1] * other[2] - one[2] * other[1],
            one[2] * other[0] - one[0] * other[2],
            one[0] * other[1] - one[1] * other[0],
        ]
    )
