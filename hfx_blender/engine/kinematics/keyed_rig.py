# SPDX-License-Identifier: GPL-3.0-or-later
"""Armature whose bones follow only their keyed channels and their parents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from ..arrays import F64, I64
from .bone_hierarchy import Rig, rotations

ROTATION_CHANNELS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
"""Channels by rotation mode; the other modes are orders of Euler angles."""

_AT_ONCE: Final = 16
"""Times that are posed together: what they need between stays in the processor's cache."""


def rotation_channel(mode: str) -> str:
    """Name of the rotation channel of a bone or an object in one of Blender's rotation modes."""
    return ROTATION_CHANNELS.get(mode, "rotation_euler")


@dataclass(frozen=True, eq=False)
class KeyedRig:
    """Constant data of B bones that follow their keyed channels.

    Attributes
    ----------
    parents : tuple of int
        (B,) -1 for a root.
    rest : (B, 4, 4) float64
        Bone to armature space in the rest pose.
    local_location : tuple of bool
        (B,) See :class:`~hfx_blender.engine.kinematics.bone_hierarchy.Rig`.
    modes : tuple of str
        (B,) Rotation modes.
    connected : (n,) int64
        Bones whose location stays that of their parent's end.
    still : mapping
        By channel, its values (B, width) where nothing is keyed.
    places : mapping
        By channel, (3, n): column of the sampled values, bone, which of its numbers.
    """

    parents: tuple[int, ...]
    rest: F64
    local_location: tuple[bool, ...]
    modes: tuple[str, ...]
    connected: I64
    still: Mapping[str, F64]
    places: Mapping[str, I64]

    @cached_property
    def _rig(self) -> Rig:
        return Rig(self.parents, self.rest, self.local_location)

    @cached_property
    def _still(self) -> F64:
        """All values where nothing is keyed, channel after channel, (S,)."""
        return np.concatenate([np.zeros(0), *(each.ravel() for each in self.still.values())])

    @cached_property
    def _sources(self) -> dict[str, I64]:
        """By channel, which of the still values, or of the sampled ones after them, each is."""
        sources, first = {}, 0
        for name, still in self.still.items():
            sources[name] = np.arange(first, first + still.size)
            first += still.size
            if name in self.places:
                columns, bones, numbers = self.places[name]
                sources[name][bones * still.shape[1] + numbers] = len(self._still) + columns
        return sources

    def skinning(self, sampled: F64) -> F64:
        """Skinning matrices (T, B, 3, 4) of sampled values (T, C)."""
        if len(sampled) > _AT_ONCE:
            cuts = range(0, len(sampled), _AT_ONCE)
            return np.concatenate([self.skinning(sampled[k : k + _AT_ONCE]) for k in cuts])
        still = np.repeat(self._still[None], len(sampled), axis=0)
        known = np.concatenate([still, sampled], axis=1)
        values = {
            name: known.take(source, axis=1).reshape(len(sampled), len(self.parents), -1)
            for name, source in self._sources.items()
        }
        modes = dict.fromkeys(self.modes)
        if len(modes) == 1:
            (mode,) = modes
            turned = rotations(values[rotation_channel(mode)], mode)
        else:
            turned = np.zeros((len(sampled), len(self.parents), 3, 3))
            for mode in modes:
                mine = [k for k, other in enumerate(self.modes) if other == mode]
                turned[:, mine] = rotations(values[rotation_channel(mode)][:, mine], mode)
        values["location"][:, self.connected] = 0.0
        return self._rig.pose(values["location"], turned, values["scale"])
