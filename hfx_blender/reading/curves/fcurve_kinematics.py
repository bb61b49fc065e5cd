# SPDX-License-Identifier: GPL-3.0-or-later
"""Kinematics of objects and bones from F-curves, without stepping a scene.

Plain motion only: actions, NLA clips, parents. Other causes raise :class:`NotModelledError`.
"""

import re
from collections.abc import Callable, Mapping

import bpy
import numpy as np

from ...blender import compat
from ...engine.arrays import F64, I64
from ...engine.kinematics.bone_hierarchy import KeyedRig, rotation_channel, rotations, transforms
from .animation_curves import AnimatedValues, NotModelledError

_POSE = "pose.bones["
BONE_PATH = re.compile(r'pose\.bones\["((?:[^"\\]|\\.)*)"\]\.(\w+)$')
WIDTHS = {
    **{"location": 3, "scale": 3},
    **{"rotation_quaternion": 4, "rotation_euler": 3, "rotation_axis_angle": 4},
    **{"delta_location": 3, "delta_scale": 3},
    **{"delta_rotation_quaternion": 4, "delta_rotation_euler": 3},
}
"""Numbers of components of the transform properties."""

_HARMLESS = re.compile(
    r'(hfx\.|hide_|color$|show_|display_|\["|pose\.bones\[".*"\](\["|\.bbone_)|lock_)'
)
"""Animated paths without influence on motion."""


def rest_value(path: str, index: int) -> float:
    """Value of component ``index`` of a transform property without a playing strip: scale 1,
    quaternion (1, 0, 0, 0), axis-angle (0, 0, 1, 0), else 0."""
    name = path.rpartition(".")[2]
    if name.endswith("scale"):
        return 1.0
    if name.endswith("rotation_quaternion"):
        return 1.0 if index == 0 else 0.0
    if name.endswith("rotation_axis_angle"):
        return 1.0 if index == 2 else 0.0
    return 0.0


class Parents:
    """Cache of parent objects and rigs, shared by all children."""

    def __init__(self) -> None:
        self._objects: dict[bpy.types.Object, PlainObject] = {}
        self._rigs: dict[bpy.types.Object, PlainRig] = {}

    def object(self, obj: bpy.types.Object) -> "PlainObject":
        """Kinematics of an object, made at the first request; raises NotModelledError."""
        if obj not in self._objects:
            self._objects[obj] = PlainObject(obj, parents=self)
        return self._objects[obj]

    def rig(self, obj: bpy.types.Object) -> "PlainRig":
        """Kinematics of an armature, made at the first request; raises NotModelledError."""
        if obj not in self._rigs:
            self._rigs[obj] = PlainRig(obj, self)
        return self._rigs[obj]


class _LastResult:
    """Cache of the last result, valid for the identical frames array."""

    # All children of a parent are asked for the same array in turn, so identity suffices.
    def __init__(self, work: Callable[[F64], F64]) -> None:
        self._work = work
        self._last: tuple[F64, F64] | None = None

    def __call__(self, frames: F64) -> F64:
        if self._last is None or self._last[0] is not frames:
            self._last = frames, self._work(frames)
        return self._last[1]


class PlainObject:
    """Object with a world matrix defined by F-curves of its own and of the parents. ``default(path,
    index)`` is the value of a property without a playing strip; ``parents`` a shared cache. Raises
    NotModelledError if another cause moves the object."""

    def __init__(
        self,
        obj: bpy.types.Object,
        default: Callable[[str, int], float] = rest_value,
        parents: Parents | None = None,
    ) -> None:
        if any(not constraint.mute for constraint in obj.constraints):
            raise NotModelledError(f"'{obj.name}' has constraints")
        if obj.rigid_body is not None or obj.soft_body is not None:
            raise NotModelledError(f"physics moves '{obj.name}'")
        self.obj = obj
        self._mode = obj.rotation_mode
        self._still = {name: np.array(getattr(obj, name), np.float64) for name in WIDTHS}
        self.values = AnimatedValues(obj, default, lambda path: not path.startswith(_POSE))
        for path, _ in self.values.columns:
            if path not in WIDTHS and not _HARMLESS.match(path):
                raise NotModelledError(f"'{path}' of '{obj.name}' is animated")
        self._parent: PlainObject | None = None
        self._bone: str | None = None
        self._rig: PlainRig | None = None
        self._along_bone = 0.0
        self._parent_inverse = np.array(obj.matrix_parent_inverse, np.float64)
        self._kept_world = _LastResult(self.world)
        if obj.parent is not None:
            self._read_parent(obj, parents or Parents())

    def _read_parent(self, obj: bpy.types.Object, parents: Parents) -> None:
        """Set the parent object, or parent bone with the armature. Raises NotModelledError for a
        missing bone, for other parent types (lattice, armature deform, vertices), and for a curve,
        which moves its children along its path by animation of its own data."""
        if obj.parent_type == "OBJECT" and obj.parent.type != "CURVE":
            self._parent = parents.object(obj.parent)
        elif obj.parent_type == "BONE" and obj.parent.type == "ARMATURE":
            self._rig = parents.rig(obj.parent)
            self._parent = self._rig.body
            self._bone = obj.parent_bone
            self._along_bone = compat.place_along_parent_bone(obj)
            if self._bone not in obj.parent.data.bones:
                raise NotModelledError(f"'{obj.name}' has a bone as parent that does not exist")
        else:
            raise NotModelledError(f"'{obj.name}' hangs on more than the place of its parent")

    def world(self, frames: F64, sampled: F64 | None = None) -> F64:
        """World matrices (T, 4, 4) in Blender units at animation frames (T,), parents included.
        ``sampled`` (T, C) are this object's values there, if known."""
        if sampled is None:
            sampled = self.values.sample(frames)
        # An object without own curves has the same local matrix at all times.
        moves = any(path in WIDTHS for path, _ in self.values.columns)
        own = self._own(sampled if moves else sampled[:1])
        own = np.broadcast_to(own, (len(frames), 4, 4)).copy()
        if self._parent is None:
            return own
        # Blender's order: parent, seat on the bone, inverse of the parent at the time of parenting.
        above = self._parent._kept_world(frames)
        if self._rig is not None and self._bone is not None:
            above = above @ self._rig.places_on_bone(self._bone, self._along_bone, frames)
        return above @ self._parent_inverse @ own

    @property
    def key_frames(self) -> F64:
        """Ascending unique animation frames (k,) of keys of the object, the parents and, on a bone,
        all bones."""
        above = () if self._parent is None else self._parent.key_frames
        bones = () if self._rig is None else self._rig.key_frames
        return np.unique(np.concatenate([self.values.key_frames, above, bones]))

    def _own(self, sampled: F64) -> F64:
        """Local matrices (T, 4, 4) from sampled values (T, C): location plus delta, delta rotation
        times rotation, scale times delta scale. Axis-angle has no delta rotation."""
        mode = self._mode

        def of(name: str) -> F64:
            """Values (T, width) of a property, (1, width) if no component has a curve; components
            without a curve keep the value at construction."""
            still = self._still[name]
            columns = [self.values.columns.get((name, index)) for index in range(len(still))]
            is_still = all(column is None for column in columns)
            values = np.repeat(still[None], 1 if is_still else len(sampled), axis=0)
            for index, column in enumerate(columns):
                if column is not None:
                    values[:, index] = sampled[:, column]
            return values

        # Blender applies delta rotations after the rotation, in the parent's axes.
        turned = rotations(of(rotation_channel(mode)), mode)
        if mode == "QUATERNION":
            turned = rotations(of("delta_rotation_quaternion"), mode) @ turned
        elif mode != "AXIS_ANGLE":
            turned = rotations(of("delta_rotation_euler"), mode) @ turned
        places = np.broadcast_to(of("location") + of("delta_location"), (len(sampled), 3))
        return transforms(places, turned, of("scale") * of("delta_scale"))


class PlainRig:
    """Armature with bones defined by the parents and F-curves; raises NotModelledError for bone
    constraints, partial inheritance, or a rest position."""

    def __init__(self, obj: bpy.types.Object, parents: Parents | None = None) -> None:
        self.body = (parents or Parents()).object(obj)
        _refuse_other_poses(obj)
        self._names = [bone.name for bone in obj.pose.bones]
        index = {name: k for k, name in enumerate(self._names)}
        data = obj.data
        bones = [data.bones[name] for name in self._names]
        # foreach_get gives all bones of the armature in its own order, columns first; the pose may
        # have another order.
        matrices = np.empty((len(data.bones), 4, 4), np.float32)
        data.bones.foreach_get("matrix_local", matrices.ravel())
        order = [data.bones.find(name) for name in self._names]
        rest = np.array(matrices[order].transpose(0, 2, 1), np.float64, order="C")
        self._lengths = {bone.name: bone.length for bone in bones}
        self._relative = {bone.name for bone in bones if bone.use_relative_parent}
        modes = [bone.rotation_mode for bone in obj.pose.bones]
        still: dict[str, F64] = {}
        for name in dict.fromkeys((*map(rotation_channel, modes), "location", "scale")):
            flat = np.zeros(len(self._names) * WIDTHS[name], np.float32)
            obj.pose.bones.foreach_get(name, flat)
            still[name] = flat.reshape(len(self._names), -1).astype(np.float64)
        self._values = AnimatedValues(obj, rest_value, lambda path: path.startswith(_POSE))
        places = _channel_places(obj, self._values.columns, index)
        self.keyed = KeyedRig(
            tuple(-1 if bone.parent is None else index[bone.parent.name] for bone in bones),
            rest,
            tuple(bone.use_local_location for bone in bones),
            tuple(modes),
            np.flatnonzero([b.use_connect and b.parent is not None for b in bones]),
            still,
            {name: places[name] for name in still if name in places},
        )
        self._kept_pose = _LastResult(self.pose)

    @property
    def key_frames(self) -> F64:
        """Ascending animation frames (k,) of keys of the bones."""
        return self._values.key_frames

    @property
    def bone_count(self) -> int:
        """Number of bones."""
        return len(self._names)

    def sample(self, frames: F64) -> tuple[F64, F64]:
        """World matrices (T, 4, 4) of the armature in Blender units, and skinning matrices (T, B,
        3, 4), at animation frames (T,)."""
        return self.body.world(frames), self.pose(frames)

    def pose(self, frames: F64) -> F64:
        """Skinning matrices (T, B, 3, 4), rest pose to pose in armature space, at animation frames
        (T,)."""
        return self.keyed.skinning(self._values.sample(frames))

    def places_on_bone(self, bone: str, along: float, frames: F64) -> F64:
        """Matrices (T, 4, 4), child space of a bone to armature space, at animation frames (T,).
        ``along`` is the position along the bone: 0 head, 1 tail. With Relative Parenting the
        skinning matrix."""
        k = self._names.index(bone)
        seat = np.zeros((len(frames), 4, 4))
        seat[:, :3] = self._kept_pose(frames)[:, k]
        seat[:, 3, 3] = 1.0
        if bone in self._relative:
            return seat
        # Children hang on the posed bone, at its tail unless the parent uses the head.
        seat = seat @ self.keyed.rest[k]
        # The Y axis of a bone points from head to tail.
        seat[:, :3, 3] += seat[:, :3, 1] * along * self._lengths[bone]
        return seat


def _refuse_other_poses(obj: bpy.types.Object) -> None:
    """Raise NotModelledError for an armature in rest position or with an action or drivers of the
    data, and for bones with unmuted constraints or partial inheritance."""
    data = obj.data
    if data.pose_position != "POSE":
        raise NotModelledError(f"'{obj.name}' shows its rest position")
    if data.animation_data is not None and (
        data.animation_data.action is not None or len(data.animation_data.drivers)
    ):
        raise NotModelledError(f"the armature of '{obj.name}' is animated itself")
    for posed in obj.pose.bones:
        bone = data.bones[posed.name]
        if any(not constraint.mute for constraint in posed.constraints):
            raise NotModelledError(f"bone '{bone.name}' of '{obj.name}' has constraints")
        if not bone.use_inherit_rotation or bone.inherit_scale != "FULL":
            raise NotModelledError(
                f"bone '{bone.name}' of '{obj.name}' inherits only part of its parent's pose"
            )


def _channel_places(
    obj: bpy.types.Object, columns: Mapping[tuple[str, int], int], bones: Mapping[str, int]
) -> dict[str, I64]:
    """Sampled columns by channel name, each (3, n): column, bone index and component. ``columns``
    are column numbers by (path, component), ``bones`` bone indices by name; unknown bones are left
    out. Raises NotModelledError for an animated rotation mode and other properties moving bones."""
    entries: dict[str, list[tuple[int, int, int]]] = {}
    for (path, number), column in columns.items():
        match = BONE_PATH.match(path)
        if match is None:
            if not _HARMLESS.match(path):
                raise NotModelledError(f"'{path}' of '{obj.name}' is animated")
            continue
        # Curves of bones that do not exist, as after renaming, move nothing.
        name = bpy.utils.unescape_identifier(match[1])
        # A changing mode would change the rotation channel that counts.
        if match[2] == "rotation_mode":
            raise NotModelledError(f"'{path}' of '{obj.name}' is animated")
        if name in bones:
            entries.setdefault(match[2], []).append((column, bones[name], number))
    return {name: np.array(rows).T for name, rows in entries.items()}
