# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices in the room: the skin that they can reach at each time.

Danieau et al. (VRST 2018): "grounded devices" stand where they are while the user walks. Their
places are those of a play space, which an object of the scene stands for; a teleport moves it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ...errors import InputError
from ..arrays import F64, I64, Bool
from ..matmul import affine_inverse
from ..samples import SampleRun
from .device_config import Actuator, DeviceConfig, RoomPlace

SETTING: Final = "play_space"
"""Key of a track's settings: ``[[index, 12 numbers], ...]``, where the play space is from each
sample on; rows of a 3 x 4 matrix from its metres to the world's."""


class PlaySpace:
    """Poses of the play space at the samples of a track.

    Parameters
    ----------
    indices : (n,) int64
        Ascending; it is there from this sample on, and before the first one as there.
    matrices : (n, 4, 4) float64
        Play space to world, metres.
    """

    def __init__(self, indices: I64, matrices: F64) -> None:
        self._indices = indices
        self._inverses = affine_inverse(matrices)

    @classmethod
    def of_settings(cls, settings: Mapping[str, Any]) -> PlaySpace:
        """Play space of a track; the world itself if it has none.

        Raises
        ------
        InputError
            It is not one.
        """
        content = settings.get(SETTING)
        if content is None:
            return cls(np.zeros(1, np.int64), np.eye(4)[None])
        try:
            indices = np.array([each[0] for each in content], np.int64)
            rows = np.array([each[1] for each in content], np.float64).reshape(-1, 3, 4)
        except (TypeError, ValueError, IndexError, OverflowError):
            raise InputError(f"The track's {SETTING} is not a list of poses.") from None
        last = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(rows), 1, 4))
        matrices = np.concatenate([rows, last], axis=1)
        is_right = len(rows) > 0 and np.isfinite(rows).all() and (np.diff(indices) > 0).all()
        if not is_right or (np.abs(np.linalg.det(matrices)) < 1e-12).any():
            raise InputError(f"The track's {SETTING} holds a pose that is none.")
        return cls(indices, matrices)

    @staticmethod
    def as_setting(matrices: F64) -> list[list[Any]]:
        """Encode poses at all samples (T, 4, 4) as a setting; unchanged ones are written once."""
        changes = np.ones(len(matrices), np.bool_)
        changes[1:] = (matrices[1:] != matrices[:-1]).any(axis=(1, 2))
        return [[int(k), matrices[k, :3].ravel().tolist()] for k in np.flatnonzero(changes)]

    def move(self, matrix: F64) -> None:
        """Set the pose from now on, for a renderer of moments; an unusable pose is ignored."""
        if np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 1e-12:
            self._indices, self._inverses = np.zeros(1, np.int64), affine_inverse(matrix[None])

    def pose(self, index: int) -> F64:
        """Play space to world at a sample, (4, 4)."""
        place = max(int(np.searchsorted(self._indices, index, side="right")) - 1, 0)
        return affine_inverse(self._inverses[place][None])[0]

    def local(self, run: SampleRun) -> F64:
        """Positions of a run's entries in the play space, (total, 3)."""
        assert run.positions is not None
        place = np.searchsorted(self._indices, run.indices, side="right") - 1
        inverse = self._inverses[np.maximum(place, 0)]
        inverse = np.repeat(inverse, run.sizes, axis=0)
        points = run.positions.astype(np.float64)
        return np.einsum("nij,nj->ni", inverse[:, :3, :3], points) + inverse[:, :3, 3]


def has_place(actuator: Actuator) -> bool:
    """Test for an actuator with a place in the room, which may be out of reach."""
    return isinstance(actuator.place, RoomPlace) and actuator.place.at_m is not None


def needs_positions(devices: Sequence[DeviceConfig]) -> bool:
    """Test for devices that need the positions of samples."""
    return any(has_place(actuator) for device in devices for actuator in device.actuators)


def reaches(place: RoomPlace, points: F64) -> Bool:
    """Test points (n, 3) of the play space for being in an actuator's range and cone."""
    if place.at_m is None:
        return np.ones(len(points), np.bool_)
    way = points - np.array(place.at_m)
    distance = np.linalg.norm(way, axis=1)
    found: Bool = distance <= place.range_m  # False for NaN
    if place.aim is not None:
        along = way @ np.array(place.aim)
        found &= along >= np.cos(np.radians(place.cone_deg / 2.0)) * distance - 1e-12
    return found


def room_gains(place: RoomPlace, on_parts: Bool, run: SampleRun, points: F64) -> F64:
    """Gain of an actuator in the room for each sample of a run, (n,).

    The strongest weight on skin that it reaches counts.

    Parameters
    ----------
    on_parts : (V,) bool
        Vertices of the run's model on parts that it is meant for.
    run : SampleRun
        With a vertex set for each sample.
    points : (total, 3) float64
        Of the entries, in the play space.
    """
    weights = np.where(on_parts[run.vertices] & reaches(place, points), run.weights, 0.0)
    found = np.zeros(len(run))
    filled = np.flatnonzero(run.sizes > 0)
    if len(filled):
        found[filled] = np.maximum.reduceat(weights, run.offsets[:-1][filled])
    return found
