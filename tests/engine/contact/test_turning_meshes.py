# SPDX-License-Identifier: GPL-3.0-or-later
"""Fast rotating meshes: all swept skin has contacts, with little skin examined."""

from __future__ import annotations

import numpy as np
import pytest
from coverage_synthetic import SIDE_M, evaluated, placed, sheet

from hfx_blender.engine.volume.mesh import MeshVolume

STEPS = 24
LONG, WIDE, THIN = 0.5 * SIDE_M, 0.01, 0.005
"""Half of a blade's size, metres; it lies in the sheet's plane and turns in it."""

TURNS = (72, 120, 175, 180)


def _blade() -> MeshVolume:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = [[a, b, c] for a, b, c, _ in faces] + [[a, c, d] for a, _, c, d in faces]
    return MeshVolume(corners * (LONG, WIDE, THIN), np.array(triangles, np.int32), "blade")


def _turned(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("turn", TURNS)
def test_all_skin_swept_by_a_blade_has_contacts(turn: float) -> None:
    """The blade starts above the sheet's plane, without contacts, and comes down to the sheet."""
    skin, angle, at = sheet(STEPS), np.radians(turn), np.array([0.02, -0.01, 0.0])
    above = at + np.array([0.0, 0.0, 2 * THIN])
    matrices = np.stack([placed(1.0, above), placed(1.0, at, _turned(angle))])
    weights, _, _ = evaluated(skin, _blade(), matrices)
    assert not weights[0].any()
    nearest = np.full(len(skin), np.inf)
    for share in np.linspace(0.0, 1.0, 2001):
        centre = at + np.array([0.0, 0.0, 2 * THIN * (1 - share)])
        local = (skin.vertices - centre) @ _turned(share * angle)
        outside = (np.abs(local) - (LONG, WIDE, THIN)).max(axis=1)
        nearest = np.minimum(nearest, outside)
    spacing = SIDE_M / STEPS
    assert (nearest < -5e-4).any() and (nearest > spacing).any()
    if turn != 180:  # half a turn may go either way round
        assert weights[1, nearest < -5e-4].all()
        assert not weights[1, nearest > 1.5 * spacing].any()
    else:
        assert np.count_nonzero(weights[1]) >= np.count_nonzero(nearest < -5e-4)


@pytest.mark.parametrize("turn", TURNS)
def test_skin_outside_the_disc_of_a_blade_is_skipped(turn: float) -> None:
    matrices = np.stack(
        [placed(1.0, (0, 0, 0.4 * LONG), _turned(a)) for a in (0, np.radians(turn))]
    )
    _, _, engine = evaluated(sheet(STEPS), _blade(), matrices)
    assert engine.counters.vertices_posed == 0
