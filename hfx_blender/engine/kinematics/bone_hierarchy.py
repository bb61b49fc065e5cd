# SPDX-License-Identifier: GPL-3.0-or-later
"""Forward kinematics over blocks of times: channels of bones and objects to matrices.

Blender's conventions: column vectors, quaternions (w, x, y, z), radians; Euler order ``XYZ``
rotates about X first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from ..arrays import F64, I64, affine_inverse
from ..native.library import f64, library

ROTATION_CHANNELS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
"""Rotation mode to channel; all other modes are Euler orders."""

# Number of times posed together; intermediate arrays fit the processor's cache
_TIMES_PER_BATCH: Final = 16


def rotation_channel(mode: str) -> str:
    """Name of the rotation property in a rotation mode: "rotation_euler" for all Euler orders."""
    return ROTATION_CHANNELS.get(mode, "rotation_euler")


def from_quaternions(quaternions: F64) -> F64:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) of any length. Length 0 gives half a
    turn about X, as in Blender."""
    if (native := library()) is not None:
        rotations = np.empty((*quaternions.shape[:-1], 3, 3))
        native.hfx_from_quaternions(rotations.size // 9, quaternions, rotations)
        return rotations
    lengths = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    unit = np.where(lengths > 0.0, quaternions, [0.0, 1.0, 0.0, 0.0])
    unit = unit / np.where(lengths > 0.0, lengths, 1.0)
    w, x, y, z = np.moveaxis(unit, -1, 0)
    turned = np.empty((3, 3, *w.shape))  # elements first: each is one contiguous array
    turned[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    turned[0, 1] = 2.0 * (x * y - w * z)
    turned[0, 2] = 2.0 * (x * z + w * y)
    turned[1, 0] = 2.0 * (x * y + w * z)
    turned[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    turned[1, 2] = 2.0 * (y * z - w * x)
    turned[2, 0] = 2.0 * (x * z - w * y)
    turned[2, 1] = 2.0 * (y * z + w * x)
    turned[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return np.moveaxis(turned, (0, 1), (-2, -1))


def from_eulers(angles: F64, order: str) -> F64:
    """Rotation matrices (..., 3, 3) of angles (..., 3), radians, about X, Y, Z; the first letter of
    an order such as "XYZ" turns first."""
    turned: F64 | None = None
    for name in order:
        axis = "XYZ".index(name)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        cos, sin = np.cos(angles[..., axis]), np.sin(angles[..., axis])
        single = np.zeros((*cos.shape, 3, 3))
        single[..., axis, axis] = 1.0
        single[..., i, i] = single[..., j, j] = cos
        single[..., i, j] = -sin
        single[..., j, i] = sin
        # With column vectors, later turns multiply from the left.
        turned = single if turned is None else single @ turned
    assert turned is not None
    return turned


def rotations(values: F64, mode: str) -> F64:
    """Rotation matrices (..., 3, 3) of channel values in a rotation mode: quaternions (..., 4),
    (angle in radians, x, y, z) with an axis of any length, or Euler angles (..., 3)."""
    if mode == "QUATERNION":
        return from_quaternions(values)
    if mode != "AXIS_ANGLE":
        return from_eulers(values, mode)
    half = values[..., :1] / 2
    lengths = np.linalg.norm(values[..., 1:], axis=-1, keepdims=True)
    axis = values[..., 1:] / np.where(lengths > 0.0, lengths, 1.0)
    unit = np.concatenate([np.cos(half), np.sin(half) * axis], axis=-1)
    # An axis without length gives no rotation.
    return from_quaternions(np.where(lengths > 0.0, unit, [1.0, 0.0, 0.0, 0.0]))


def transforms(locations: F64, turned: F64, scales: F64) -> F64:
    """Location @ rotation @ scale (..., 4, 4) of (..., 3), (..., 3, 3) and (..., 3)."""
    matrices = np.zeros((*locations.shape[:-1], 4, 4))
    matrices[..., :3, :3] = turned * scales[..., None, :]
    matrices[..., :3, 3] = locations
    matrices[..., 3, 3] = 1.0
    return matrices


class BoneHierarchy:
    """Bones with parents, without constraints.

    ``parents`` (B,) are -1 for roots, in any order; ``rest`` (B, 4, 4) is bone to armature space in
    rest pose. ``local_location`` (B,) is True for locations along the bone's rest axes; otherwise
    along the axes of the parent, or of the armature.
    """

    def __init__(self, parents: Sequence[int], rest: F64, local_location: Sequence[bool]) -> None:
        self._parents = np.array(parents, np.int64)
        self._rest: F64 = f64(rest[:, :3])
        self._inverse: F64 = f64(affine_inverse(rest)[:, :3])
        self._other_axes = [
            (bone, rest[parents[bone], :3, :3] if parents[bone] >= 0 else np.eye(3))
            for bone in np.flatnonzero(~np.asarray(local_location, np.bool_)).tolist()
        ]
        depth = np.zeros(len(parents), np.int64)
        for bone in range(len(parents)):
            ancestor = parents[bone]
            while ancestor >= 0:
                depth[bone] += 1
                ancestor = parents[ancestor]
        # Bones sorted by depth: each level is a slice, and parents precede children.
        self._order = np.argsort(depth, kind="stable")
        sorted_index = np.argsort(self._order)
        firsts = np.searchsorted(depth[self._order], np.arange(1, depth.max(initial=0) + 2))
        self._levels = [
            (slice(first, last), sorted_index[[parents[bone] for bone in self._order[first:last]]])
            for first, last in pairwise(firsts.tolist())
        ]

    def pose(self, locations: F64, turned: F64, scales: F64) -> F64:
        """Skinning matrices (T, B, 3, 4): rest to posed armature space.

        With rest matrix R, channels B and result S: S = S_parent R B R^-1, which is Blender's pose
        matrix (parent's pose, offset, channels) times R^-1. Channels are ``locations`` and
        ``scales`` (T, B, 3) and rotations ``turned`` (T, B, 3, 3).
        """
        native = library()
        if native is not None and not self._other_axes:
            skinning = np.empty((*locations.shape[:2], 3, 4))
            constants = self._order, self._parents, self._rest, self._inverse
            channels_of = locations, turned, scales
            native.hfx_rig_pose(*locations.shape[:2], *constants, *channels_of, skinning)
            return skinning
        channels = transforms(locations, turned, scales)[..., :3, :]
        # Locations along other axes are added after the change of basis.
        for bone, _ in self._other_axes:
            channels[:, bone, :, 3] = 0.0
        moved = _product(_product(self._rest, channels), self._inverse)
        for bone, axes in self._other_axes:
            moved[:, bone, :, 3] += (axes @ locations[:, bone].T).T
        posed = moved[:, self._order]
        # S = S_parent (R B R^-1), level by level, since parents are posed before.
        for level, above in self._levels:
            posed[:, level] = _product(posed[:, above], posed[:, level])
        moved[:, self._order] = posed
        return moved


def _product(first: F64, second: F64) -> F64:
    """Products first @ second of affine matrices (..., 3, 4), whose last row is not stored."""
    parts: list[F64] = [first[..., k, None] * second[..., k, None, :] for k in range(3)]
    product = parts[0] + parts[1] + parts[2]
    product[..., 3] += first[..., 3]
    return product


@dataclass(frozen=True, eq=False)
class KeyedRig:
    """Constant data of bones with keyed channels."""

    parents: tuple[int, ...]  # (B,) -1 for a root
    rest: F64  # (B, 4, 4) bone to armature space in rest pose
    local_location: tuple[bool, ...]  # (B,) see BoneHierarchy
    modes: tuple[str, ...]  # (B,) rotation modes
    connected: I64  # (n,) bones with location 0, connected to the parent's tail
    still: Mapping[str, F64]  # channel -> unkeyed values (B, width)
    places: Mapping[str, I64]  # channel -> (3, n) column of the sampled values, bone, component

    @cached_property
    def _rig(self) -> BoneHierarchy:
        return BoneHierarchy(self.parents, self.rest, self.local_location)

    @cached_property
    def _still(self) -> F64:
        """Unkeyed values (S,) of all channels, concatenated in the order of ``still``."""
        return np.concatenate([np.zeros(0), *(values.ravel() for values in self.still.values())])

    @cached_property
    def _sources(self) -> dict[str, I64]:
        """Channel to indices (B * width,) into the S unkeyed values followed by the sampled
        values."""
        sources, first = {}, 0
        for name, still in self.still.items():
            sources[name] = np.arange(first, first + still.size)
            first += still.size
            if name in self.places:
                columns, bones, numbers = self.places[name]
                # Sampled columns follow the unkeyed values in one array, so one take serves all.
                sources[name][bones * still.shape[1] + numbers] = len(self._still) + columns
        return sources

    def skinning(self, sampled: F64) -> F64:
        """Skinning matrices (T, B, 3, 4), rest to posed armature space, of sampled values (T, C);
        unkeyed components from ``still``, locations of connected bones 0."""
        if len(sampled) > _TIMES_PER_BATCH:
            cuts = range(0, len(sampled), _TIMES_PER_BATCH)
            return np.concatenate([self.skinning(sampled[k : k + _TIMES_PER_BATCH]) for k in cuts])
        unkeyed = np.repeat(self._still[None], len(sampled), axis=0)
        sources = np.concatenate([unkeyed, sampled], axis=1)
        values = {
            name: sources.take(source, axis=1).reshape(len(sampled), len(self.parents), -1)
            for name, source in self._sources.items()
        }
        modes = dict.fromkeys(self.modes)
        if len(modes) == 1:
            (mode,) = modes
            turned = rotations(values[rotation_channel(mode)], mode)
        else:
            turned = np.zeros((len(sampled), len(self.parents), 3, 3))
            for mode in modes:
                bones = [k for k, bone_mode in enumerate(self.modes) if bone_mode == mode]
                turned[:, bones] = rotations(values[rotation_channel(mode)][:, bones], mode)
        # Blender ignores the locations of connected bones.
        values["location"][:, self.connected] = 0.0
        return self._rig.pose(values["location"], turned, values["scale"])
