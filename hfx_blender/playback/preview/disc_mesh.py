# SPDX-License-Identifier: GPL-3.0-or-later
"""The flat shape of actuators: a disc with a rim, and a ring around it for its glow."""

from __future__ import annotations

import numpy as np

from ...engine.arrays import F32, I32

CORNERS = 12
RINGS = 4
"""Number of rings: edge of the disc, edge of its rim, and both edges of its glow."""


def discs(count: int) -> tuple[F32, I32]:
    """Corners (P, 4) and triangles (F, 3) of some discs.

    Of a corner there are cosine and sine of where it is, its ring (0 in the middle, else
    1..:data:`RINGS`), and which disc it belongs to.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    one = np.zeros((1 + RINGS * CORNERS, 4), np.float32)
    one[1:, 0] = np.tile(np.cos(angles), RINGS)
    one[1:, 1] = np.tile(np.sin(angles), RINGS)
    one[1:, 2] = np.repeat(np.arange(1, RINGS + 1), CORNERS)
    corners = np.tile(one, (count, 1, 1))
    corners[:, :, 3] = np.arange(count)[:, None]
    firsts = np.arange(count, dtype=np.int32) * len(one)
    return corners.reshape(-1, 4), (_one_disc() + firsts[:, None, None]).reshape(-1, 3)


def _one_disc() -> I32:
    found = []
    for k in range(CORNERS):
        here, after = 1 + k, 1 + (k + 1) % CORNERS
        found.append((0, here, after))
        for ring in range(0, RINGS, 2):
            a, b = here + ring * CORNERS, after + ring * CORNERS
            c, d = a + CORNERS, b + CORNERS
            found += [(a, c, b), (b, c, d)]
    return np.array(found, np.int32)
