# SPDX-License-Identifier: GPL-3.0-or-later
"""Continuous collision detection: contacts between two samples, too fast for either to see.

Samples of skin move straight in the volume's own space, in as many steps as its turning asks for,
and each step is tested exactly (``continuous_collision.h``), so that no wall is too thin. Slow
motion is not looked at: what it hides between two samples is nearer to the boundary than the
tolerance.
"""

from __future__ import annotations

import numpy as np

from ..arrays import F64
from ..kinematics.motion import Motion
from ..volume.placing_matrix import inverse_placement


def drift_of(volume: tuple[F64, F64], body: tuple[F64, F64], steps: int) -> tuple[F64, F64]:
    """Relative motion, in a volume's space, of points that rest in a body's frame, in intervals.

    Parameters
    ----------
    volume, body : tuple of (n, 4, 4) float64
        Placing matrices before and after.
    steps : int
        Straight ones, of even length.

    Returns
    -------
    from_before, from_after : (steps + 1, n, 4, 4) float64
        Shape space at the start to the frame's later place; the same from the end.
    """
    volumes, bodies = Motion.between(*volume), Motion.between(*body)
    places = []
    for k in range(steps + 1):
        inverses, _ = inverse_placement(volumes.at(k / steps))
        places.append(inverses @ bodies.at(k / steps))
    path = np.stack(places)
    before, after = (inverse_placement(each)[0] @ volume[k] for k, each in enumerate(body))
    return path @ before, path @ after
