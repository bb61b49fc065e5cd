# SPDX-License-Identifier: GPL-3.0-or-later
"""Left half of a ball of two parts, with a known skin."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from hfx_blender.engine.body.parts import CENTRE, LEFT, PARTS, RIGHT
from hfx_tools.body_building import left_skin, outer_skin

RADIUS_M = 0.15
SPACING_M = (0.016, 0.025)  # upper half, lower half


def ball() -> left_skin.LeftSkin:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]],
        np.int32,
    )
    mirror = np.array([4, 5, 6, 7, 0, 1, 2, 3], np.int32)
    medium = faces
    for _ in range(5):
        medium = faces
        operator, faces, mirror = outer_skin.subdivide(faces, mirror)
        corners = operator @ corners
    corners *= RADIUS_M / np.linalg.norm(corners, axis=1, keepdims=True)
    corners[mirror == np.arange(len(mirror)), 0] = 0.0
    dense = outer_skin.Skin(corners, faces, csr_array((len(corners), 1)), mirror)
    side = np.where(corners[:, 0] > 0.0, LEFT, RIGHT).astype(np.uint8)
    side[corners[:, 0] == 0.0] = CENTRE
    part = (corners[:, 2] < 0.0).astype(np.uint8)
    no_uv = np.zeros((0, 4, 2))
    skins = outer_skin.Skins(dense, dense, medium, no_uv, np.zeros(0, np.int32), 1.0, 0.0)
    return left_skin.left_of(skins, part, side)


def spacings() -> np.ndarray:
    table = np.full(len(PARTS), 0.02)
    table[:2] = SPACING_M
    return table
