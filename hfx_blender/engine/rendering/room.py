# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices in the room: the skin within their reach at each time.

Danieau et al. (VRST 2018): "grounded devices" stay in place while the user walks. Their places are
in a play space, an object of the scene; teleporting moves that object.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ...errors import InputError
from ..arrays import F64, I64, Bool, affine_inverse
from ..samples import SampleRun
from .device_config import Actuator, DeviceConfig, RoomPlace

SETTING: Final = "play_space"
"""Key of a track's settings: ``[[index, 12 numbers], ...]``, the pose of the play space from each
sample index on, as rows of a 3 x 4 matrix to world space, metres."""


class PlaySpace:
    """Poses of the play space over the samples of a track. ``indices`` (n,) are ascending samples;
    a pose holds until the next, the first also before. ``matrices`` (n, 4, 4): play space to world,
    m."""

    def __init__(self, indices: I64, matrices: F64) -> None:
        self._indices = indices
        self._inverses = affine_inverse(matrices)

    @classmethod
    def of_settings(cls, settings: Mapping[str, Any]) -> "PlaySpace":
        """Play space of a track's settings; the world itself without an entry. Raises InputError
        for a malformed entry, or an unusable pose."""
        content = settings.get(SETTING)
        if content is None:
            return cls(np.zeros(1, np.int64), np.eye(4)[None])
        try:
            indices = np.array([pose[0] for pose in content], np.int64)
            rows = np.array([pose[1] for pose in content], np.float64).reshape(-1, 3, 4)
        except (TypeError, ValueError, IndexError, OverflowError):
            raise InputError(f"The track's {SETTING} is not a list of poses.") from None
        # A setting stores the upper three rows of each matrix.
        last = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(rows), 1, 4))
        matrices = np.concatenate([rows, last], axis=1)
        is_right = len(rows) > 0 and np.isfinite(rows).all() and (np.diff(indices) > 0).all()
        if not is_right or (np.abs(np.linalg.det(matrices)) < 1e-12).any():
            raise InputError(f"The track's {SETTING} holds an unusable pose.")
        return cls(indices, matrices)

    @staticmethod
    def as_setting(matrices: F64) -> list[list[Any]]:
        """Encode poses at all samples (T, 4, 4) as a setting; successive equal poses once."""
        # A play space moves only when the user teleports, so few poses remain.
        changes = np.ones(len(matrices), np.bool_)
        changes[1:] = (matrices[1:] != matrices[:-1]).any(axis=(1, 2))
        return [[int(k), matrices[k, :3].ravel().tolist()] for k in np.flatnonzero(changes)]

    def move(self, matrix: F64) -> None:
        """Replace all poses, for a renderer of moments; an unusable pose is ignored."""
        if np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 1e-12:
            self._indices, self._inverses = np.zeros(1, np.int64), affine_inverse(matrix[None])

    def pose(self, index: int) -> F64:
        """Play space to world, (4, 4), at sample ``index``."""
        entry = max(int(np.searchsorted(self._indices, index, side="right")) - 1, 0)
        return affine_inverse(self._inverses[entry][None])[0]

    def local(self, run: SampleRun) -> F64:
        """Positions of a run's entries in the play space at their samples, (total, 3), m."""
        assert run.positions is not None
        entry = np.searchsorted(self._indices, run.indices, side="right") - 1
        inverse = self._inverses[np.maximum(entry, 0)]
        inverse = np.repeat(inverse, run.sizes, axis=0)
        points = run.positions.astype(np.float64)
        return np.einsum("nij,nj->ni", inverse[:, :3, :3], points) + inverse[:, :3, 3]


def has_place(actuator: Actuator) -> bool:
    """Test whether an actuator stands at a known position of the room, as a fan does."""
    return isinstance(actuator.place, RoomPlace) and actuator.place.at_m is not None


def needs_positions(devices: Sequence[DeviceConfig]) -> bool:
    """Test for any actuator with a position in the room, which needs the positions of samples."""
    return any(has_place(actuator) for device in devices for actuator in device.actuators)


def reaches(place: RoomPlace, points: F64) -> Bool:
    """Test points (n, 3) of the play space for being in range and cone of a place, (n,) bool. NaN
    is out of reach; a place without a position reaches all points."""
    if place.at_m is None:
        return np.ones(len(points), np.bool_)
    way = points - np.array(place.at_m)
    distance = np.linalg.norm(way, axis=1)
    inside: Bool = distance <= place.range_m  # False for NaN
    if place.aim is not None:
        # Cosines instead of angles; the margin keeps points on the edge of a cone inside.
        along = way @ np.array(place.aim)
        inside &= along >= np.cos(np.radians(place.cone_deg / 2.0)) * distance - 1e-12
    return inside


def room_gains(place: RoomPlace, on_parts: Bool, run: SampleRun, points: F64) -> F64:
    """Gain (n,) of an actuator in the room for each sample: largest weight in reach, or 0.
    ``on_parts`` (V,) are the vertices on the parts of the place; ``points`` (total, 3) the entries'
    positions in the play space. The run has a vertex set for each sample."""
    weights = np.where(on_parts[run.vertices] & reaches(place, points), run.weights, 0.0)
    gains = np.zeros(len(run))
    filled = np.flatnonzero(run.sizes > 0)  # reduceat has no identity for an empty sample
    if len(filled):
        gains[filled] = np.maximum.reduceat(weights, run.offsets[:-1][filled])
    return gains
