# SPDX-License-Identifier: GPL-3.0-or-later
"""Listener space: it moves and turns with a body's chest, as the belt's tracker does."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64, I64
from ..body.model import PerceptualModel
from ..body.parts import PARTS
from ..scene import PoseBlock, SkinBinding

# Rest space faces -Y, left is +X, up is +Z; the listener's front is X, left Y, up Z.
_FROM_REST: Final = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class Listener:
    """Listener on one body.

    Parameters
    ----------
    model : PerceptualModel
        Whose torso is the listener; the bone that moves most of it counts.
    """

    def __init__(self, binding: SkinBinding, model: PerceptualModel) -> None:
        fitted = binding.fitted.get(model.id)
        placed = model if fitted is None else fitted.of(model)
        torso = np.flatnonzero(placed.part == PARTS.index("torso"))
        weights = placed.weights
        shares = np.zeros(len(placed.bone_names))
        for vertex in torso.tolist():
            mine = slice(int(weights.offsets[vertex]), int(weights.offsets[vertex + 1]))
            np.add.at(shares, weights.bones[mine], weights.values[mine])
        self._bone = binding.bone_names.index(placed.bone_names[int(np.argmax(shares))])
        self._middle = placed.vertices[torso].astype(np.float64).mean(axis=0)

    def frames(self, pose: PoseBlock, rows: I64) -> F64:
        """World to listener space, (n, 4, 4), metres; only turned, never scaled."""
        assert pose.bones is not None
        posed = np.zeros((len(rows), 4, 4))
        posed[:, :3] = pose.bones[rows, self._bone]
        posed[:, 3, 3] = 1.0
        world = pose.to_world[rows] @ posed
        places = world[:, :3, :3] @ self._middle + world[:, :3, 3]
        u, _, vt = np.linalg.svd(world[:, :3, :3])
        turns = u @ vt
        frames = np.zeros((len(rows), 4, 4))
        frames[:, :3, :3] = _FROM_REST @ turns.transpose(0, 2, 1)
        frames[:, :3, 3] = -np.einsum("nij,nj->ni", frames[:, :3, :3], places)
        frames[:, 3, 3] = 1.0
        return frames
