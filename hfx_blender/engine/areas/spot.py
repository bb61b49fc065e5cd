# SPDX-License-Identifier: GPL-3.0-or-later
"""Spot: disc on the skin, optionally moving along a path, independent of the pose.

Mango's tactile animation object (Schneider et al., UIST 2015): position, radius, intensity, and
position 0..1 on a path. Points are in the rest space of the canonical body, equal for all avatars.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64
from ..body.model import PerceptualModel
from ..body.skin_distance import SkinDistances
from ..counters import Counters
from ..scene import EffectBlock, SpotArea
from ..volume.shape import Falloff

_LEAST: Final = 1e-3  # largest dropped weight; below half a step of the 8-bit weights of tracks


def lengths_along(path: F64) -> F64:
    """Path length (n,) from the first point to each point (n, 3), metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def places_on(path: F64, shares: F64) -> F64:
    """Points (T, 3) at fractions (T,) of a path's length, in its space; 0 is the start, 1 the end,
    clipped. ``path`` (n, 3) has n > 0 points; one point is a fixed place."""
    lengths = lengths_along(path)
    at = np.clip(shares, 0.0, 1.0) * lengths[-1]
    return np.stack([np.interp(at, lengths, path[:, axis]) for axis in range(3)], axis=1)


def half_radius_m(radius_m: float, falloff: Falloff) -> float:
    """Radius at which a disc's strength falls to half; the full radius without falloff."""
    return radius_m if falloff.is_flat else radius_m * (1.0 - 0.5 * falloff.share)


class SpotSkin:
    """Weights of a perceptual model's vertices under a disc on the skin. A vertex represents its
    cell of skin: a disc up to half way to the neighbours counts half. Discs smaller than cells act
    on the nearest vertices at full strength."""

    def __init__(self, model: PerceptualModel) -> None:
        self._model = model
        self._skin = SkinDistances(model.vertices, model.triangles)
        # Spacing of a regular triangular grid with the vertex's cell area.
        spacing = np.sqrt(model.areas_m2.astype(np.float64) * (2.0 / np.sqrt(3.0)))
        self._half_cell_m: F64 = 0.5 * spacing

    def weights(self, focus: F64, radius_m: float, falloff: Falloff) -> tuple[I32, F32]:
        """Vertices (n,), n > 0, ascending, and weights in (0, 1] of a disc.

        With the geodesic distance d, the radius r and half the spacing h at a vertex, the weight is
        ``(max(r, h) + h - d) / 2 h`` clipped to 0..1, times the falloff (rim to centre) at
        ``1 - (d - h) / r``. ``focus`` (3,) is in rest space, and moved to the nearest point of the
        model.
        """
        skin_place = self._skin.nearest(focus)
        largest = float(self._half_cell_m[skin_place.corners].max())
        reach = max(radius_m, largest) + 2.0 * largest
        vertices, distances = self._skin.around(skin_place, reach)
        half = self._half_cell_m[vertices]
        # Small discs are widened to the cell, so that their strength does not depend on the place.
        inner = np.maximum(radius_m, half)
        weights = np.clip((inner + half - distances) / (2.0 * half), 0.0, 1.0)
        weights = weights * falloff.weight(np.clip((inner + half - distances) / inner, 0.0, 1.0))
        significant = np.flatnonzero(weights > _LEAST)
        if not len(significant):  # a place far from all vertices of a coarse region
            return skin_place.corners[[int(np.argmax(skin_place.weights))]].astype(
                np.int32
            ), np.ones(1, "f4")
        return vertices[significant].astype(np.int32), weights[significant].astype(np.float32)

    def sets(self, focus: F32, radii_m: F64, falloff: Falloff) -> Iterator[tuple[I32, F32]]:
        """Yield vertices and weights at T positions, as :meth:`weights`. ``focus`` (T, 4): centre
        in rest space and radius, m, of which only the centre is used; ``radii_m`` is (T,)."""
        for k, (position, radius) in enumerate(zip(focus, radii_m.tolist(), strict=True)):
            # A still spot, such as between two keys of a constant path, is computed once.
            if not k or radius != radii_m[k - 1] or bool((position != focus[k - 1]).any()):
                weighted = self.weights(position[:3].astype(np.float64), radius, falloff)
            yield weighted


def focus_of(
    name: str, area: SpotArea, animated: EffectBlock, rows: I64, counters: Counters
) -> tuple[I64, F32]:
    """Rows, of ``rows``, at which a spot has finite position and radius, and the focus (n, 4):
    point in rest space and radius of half strength, metres. Warns of other rows."""
    assert animated.place is not None
    along, radii = animated.place[rows].T
    is_known = np.isfinite(along) & np.isfinite(radii)
    if not is_known.all():
        counters.warn(
            f"effect '{name}': its place or radius is not a finite number; it is silent there",
            int(np.count_nonzero(~is_known)),
        )
    places = places_on(area.path, along[is_known])
    half = [half_radius_m(max(r, 0.0), area.falloff) for r in radii[is_known].tolist()]
    return rows[is_known], np.column_stack((places, half)).astype(np.float32)
