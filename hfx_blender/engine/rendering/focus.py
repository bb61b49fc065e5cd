# SPDX-License-Identifier: GPL-3.0-or-later
"""Panning of a spot on a device: it is rendered at its own place, not at the nearest vertices.

Schneider et al., UIST 2015: the virtual actuator's own place is rendered, so that it glides.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F32, F64
from ..body.model import PerceptualModel
from ..body.skin_distance import SkinDistances
from .schemes import PannedLayout

_RINGS: Final = ((0.5, 6), (1.0, 12))
"""Sample rings of a disc larger than the gaps between actuators: radius, places."""


class FocusPanning:
    """Gains of A actuators for spots anywhere on one model.

    A disc up to as wide as the gaps between actuators is a phantom sensation at its centre. What
    is wider drives each actuator as the strongest of the phantom sensations within it.

    Parameters
    ----------
    is_mirrored : bool
        The layout is written for the other side of the body.
    """

    def __init__(self, layout: PannedLayout, model: PerceptualModel, *, is_mirrored: bool) -> None:
        self._layout = layout
        self._skin = SkinDistances(model.vertices, model.triangles)
        self._normals = model.normals.astype(np.float64)
        self._fade = np.zeros(len(model))
        self._fade[layout.vertices] = layout.fade
        self._side = -1.0 if is_mirrored else 1.0

    def gains(self, focus: F32) -> F64:
        """Gain of each actuator, (n, A) in 0..1.

        Parameters
        ----------
        focus : (n, 4) float32
            See :class:`~hfx_blender.engine.samples.SampleRun`.
        """
        known, which = np.unique(focus.astype(np.float64), axis=0, return_inverse=True)
        places = known[:, :3] * [self._side, 1.0, 1.0]
        beyond_m = known[:, 3] - 0.5 * self._layout.spacing_m
        fades, gains = np.zeros(len(known)), self._layout.at(places)
        for k, place in enumerate(places):
            on_skin = self._skin.nearest(place)
            fades[k] = on_skin.weights @ self._fade[on_skin.corners]
            if beyond_m[k] > 0.0 and fades[k] > 0.0:
                normal = on_skin.weights @ self._normals[on_skin.corners]
                disc = _disc(place, normal, float(beyond_m[k]))
                gains[k] = np.maximum(gains[k], self._layout.at(disc).max(axis=0))
        found: F64 = np.clip(gains * fades[:, None], 0.0, 1.0)[which.ravel()]
        return found


def _disc(centre: F64, normal: F64, radius_m: float) -> F64:
    """Places (m, 3) on rings about a centre, in the plane across a normal."""
    lengths = np.linalg.svd(normal[None] / max(float(np.linalg.norm(normal)), 1e-12))[2]
    one, other = lengths[1], lengths[2]
    found = []
    for share, count in _RINGS:
        angle = np.arange(count) * (2.0 * np.pi / count)
        ring = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), other)
        found.append(centre + share * radius_m * ring)
    return np.concatenate(found)
