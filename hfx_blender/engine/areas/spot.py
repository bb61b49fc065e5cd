# SPDX-License-Identifier: GPL-3.0-or-later
"""Spot: a disc on the skin that may move along a path, independent of the pose.

Mango's tactile animation object (Schneider et al., UIST 2015) on a body: position, radius,
intensity, and a position of 0..1 along an optional path. Places are in the rest space of the
canonical body, so that a spot is the same on every avatar.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64
from ..body.model import PerceptualModel
from ..body.skin_distance import SkinDistances
from ..counters import Counters
from ..scene import EffectBlock, SpotArea
from ..volume.shape import Falloff

_LEAST: Final = 1e-3
"""Weights up to this are dropped: below half of the resolution of a track's 8 bits."""


def lengths_along(path: F64) -> F64:
    """Lengths from the first of a path's points (n, 3) to each of them, (n,) metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def places_on(path: F64, shares: F64) -> F64:
    """Places (T, 3) at shares (T,) of a path's length; equal steps are equal lengths on the skin.

    Parameters
    ----------
    path : (n, 3) float64
        n > 0 points; one point is a place that does not move.
    shares : (T,) float64
        0 is its beginning, 1 its end; cut to these.
    """
    lengths = lengths_along(path)
    at = np.clip(shares, 0.0, 1.0) * lengths[-1]
    return np.stack([np.interp(at, lengths, path[:, axis]) for axis in range(3)], axis=1)


def half_radius_m(radius_m: float, falloff: Falloff) -> float:
    """Radius at which the strength of a disc is half of its full strength, or ends."""
    return radius_m if falloff.is_flat else radius_m * (1.0 - 0.5 * falloff.share)


@dataclass(frozen=True, eq=False)
class SpotSets:
    """Vertex sets of T times, as in a :class:`~hfx_blender.engine.samples.SampleRun`."""

    sets: I64  # (T,)
    offsets: I64  # (m + 1,)
    vertices: I32  # (total,)
    weights: F32  # (total,)


class SpotSkin:
    """Coverage of one perceptual model's vertices by a disc on the skin.

    A vertex stands for its cell of skin: what covers half of the way to the neighbours counts
    half. A disc smaller than the cells is felt between the nearest vertices, as strong as ever.
    """

    def __init__(self, model: PerceptualModel) -> None:
        self._model = model
        self._skin = SkinDistances(model.vertices, model.triangles)
        # Vertices stand about as far apart as the sides of their equal triangles are long.
        spacing = np.sqrt(model.areas_m2.astype(np.float64) * (2.0 / np.sqrt(3.0)))
        self._half_cell_m: F64 = 0.5 * spacing

    def weights(self, focus: F64, radius_m: float, falloff: Falloff) -> tuple[I32, F32]:
        """Vertices (n,), n > 0, ascending, and their weights in (0, 1].

        With the way d along the skin, the radius r and half the spacing h at a vertex, the
        weight is ``(max(r, h) + h - d) / 2 h`` in 0..1, times the falloff at ``1 - (d - h) / r``.

        Parameters
        ----------
        focus : (3,) float64
            The disc's centre, rest space; the nearest place on the model is meant.
        falloff : Falloff
            From the rim to the centre.
        """
        place = self._skin.nearest(focus)
        largest = float(self._half_cell_m[place.corners].max())
        reach = max(radius_m, largest) + 2.0 * largest
        vertices, distances = self._skin.around(place, reach)
        half = self._half_cell_m[vertices]
        inner = np.maximum(radius_m, half)
        weights = np.clip((inner + half - distances) / (2.0 * half), 0.0, 1.0)
        weights = weights * falloff.weight(np.clip((inner + half - distances) / inner, 0.0, 1.0))
        kept = np.flatnonzero(weights > _LEAST)
        if not len(kept):  # between vertices that are farther apart than their cells suggest
            return place.corners[[int(np.argmax(place.weights))]].astype(np.int32), np.ones(1, "f4")
        return vertices[kept].astype(np.int32), weights[kept].astype(np.float32)

    def sets(self, focus: F32, radii_m: F64, falloff: Falloff, own_sets: bool) -> SpotSets:
        """Vertex sets for T focus places; equal successive ones are stored once, unless each has
        its own.

        Parameters
        ----------
        focus : (T, 4) float32
            See :class:`~hfx_blender.engine.samples.SampleRun`.
        radii_m : (T,) float64
        """
        which = np.zeros(len(focus), np.int64)
        found: list[tuple[I32, F32]] = []
        for k, (place, radius) in enumerate(zip(focus, radii_m.tolist(), strict=True)):
            if k and radius == radii_m[k - 1] and bool((place == focus[k - 1]).all()):
                if own_sets:
                    found.append(found[-1])
            else:
                found.append(self.weights(place[:3].astype(np.float64), radius, falloff))
            which[k] = len(found) - 1
        sizes = [len(ids) for ids, _ in found]
        return SpotSets(
            which,
            np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            np.concatenate([np.zeros(0, np.int32), *(ids for ids, _ in found)]),
            np.concatenate([np.zeros(0, np.float32), *(weights for _, weights in found)]),
        )


def focus_of(
    name: str, area: SpotArea, animated: EffectBlock, rows: I64, counters: Counters
) -> tuple[I64, F32]:
    """Rows at which a spot is somewhere, and its focus there, (n, 4)."""
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
