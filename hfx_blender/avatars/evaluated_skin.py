# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurement of an avatar's modifiers and shape keys on copies, in a scene of their own.

A copy of the mesh is evaluated with all of its modifiers, at rest and in a second pose, and
compared with a copy that has one plain Armature modifier.

Types of modifiers decide in one case only: the effect of a simulation, or of a file or node that
changes with time, cannot be measured at one time (:data:`_CHANGING`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import bpy
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

from ..blender import mesh_arrays
from ..engine.arrays import F64, I32, I64
from . import avatar_meshes, mesh_copies

_CHANGING: Final = {
    *("BUILD", "CLOTH", "DYNAMIC_PAINT", "EXPLODE", "FLUID", "MESH_CACHE", "MESH_SEQUENCE_CACHE"),
    *("OCEAN", "PARTICLE_INSTANCE", "SOFT_BODY", "SURFACE", "WAVE"),
}
"""Modifiers whose effect depends on time, and shows at one time only by chance."""

_CHANGING_NODES: Final = {
    *("GeometryNodeInputSceneTime", "GeometryNodeSimulationOutput", "GeometryNodeObjectInfo"),
    *("GeometryNodeCollectionInfo", "GeometryNodeInputActiveCamera", "GeometryNodeBake"),
}
"""Nodes that bring time, or other objects, into the result of a node group."""

_TOLERANCE: Final = 6e-4
"""Distance at which a vertex is elsewhere, as a share of the rig's size: 1 mm of a person."""

_SMOOTHED: Final = 0.5
"""Further tolerance where a mesh is coarse, as a share of a vertex's distance from the middle of
its neighbours: subdivision and gentle smoothing stay between the two."""

_ELSEWHERE: Final = 1 / 2000
"""Share of vertices that may be elsewhere: single ones, where a mesh is folded or pinched."""

_NEW_ELSEWHERE: Final = 0.05
"""The same of a mesh that is built anew (Remesh), which fills cavities."""

_BEND: Final = 0.6
"""Angle of each bone in the second pose, radians; alternately to and fro down the hierarchy."""


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Places of a mesh's own vertices on its evaluated mesh.

    A vertex that is hidden or merged is held by the nearest evaluated triangle.
    """

    count: int | None  # number of evaluated vertices, if it does not depend on the pose
    corners: I32  # (A, 3) evaluated vertices
    weights: F64  # (A, 3) of the corners
    beside: F64  # (A, 3) offset along the triangle's first edge, across it and its normal
    is_steady: bool  # the corners are the same in any pose

    def fits(self, count: int) -> bool:
        """Test for an evaluated mesh of so many vertices that the map is of."""
        is_same = count > self.corners.max() if self.count is None else count == self.count
        return self.is_steady and bool(is_same)

    def places(self, points: np.ndarray) -> np.ndarray:
        """Places (A, 3) of the mesh's own vertices, from the evaluated ones (E, 3)."""
        found = points[self.corners[:, 0]].astype(np.float32)
        held = np.flatnonzero(self.weights[:, 0] != 1.0)
        if len(held):
            corners = points[self.corners[held]].astype(np.float64)
            found[held] = np.einsum("nc,nci->ni", self.weights[held], corners)
            found[held] += np.einsum("nk,nki->ni", self.beside[held], _frames(corners))
        return found


@dataclass(frozen=True)
class Measured:
    """Effect of what is on a mesh beside its armature."""

    reason: str | None  # why bones alone pose it wrongly; None if they do not
    surface: SurfaceMap | None  # None: nothing is left of the mesh, or it is not followed


_known: dict[tuple[str, str], tuple[object, Measured]] = {}


def known(
    body: bpy.types.Object, mesh: bpy.types.Object, suspects: Mapping[str, str]
) -> Measured | None:
    """Last measurement of a mesh; None if it was edited since, or was never measured."""
    state, measured = _known.get((body.name_full, mesh.name_full), (None, None))
    return measured if state == _state(body, mesh, suspects) else None


def latest(body: bpy.types.Object, mesh: bpy.types.Object) -> SurfaceMap | None:
    """Map that was measured last for a mesh; None where all vertices are its own."""
    measured = _known.get((body.name_full, mesh.name_full))
    return None if measured is None else measured[1].surface


def forget(body: bpy.types.Object, mesh: bpy.types.Object) -> None:
    """Drop what was measured of a mesh."""
    _known.pop((body.name_full, mesh.name_full), None)


def measured(
    body: bpy.types.Object,
    mesh: bpy.types.Object,
    suspects: Mapping[str, str],
    shape: Mapping[str, float],
) -> Measured:
    """Measure what poses a mesh beside the bones of its armature.

    Parameters
    ----------
    suspects : mapping of str
        Reasons that bones alone may not do: by the name of a modifier, or ``"armature"``,
        ``"bones"``, ``"keys"``.
    shape : mapping of str
        Values of the shape keys with which the mesh was fitted to.
    """
    found = known(body, mesh, suspects)
    if found is None:
        found = measure(body, mesh, suspects, shape)
        _known[body.name_full, mesh.name_full] = _state(body, mesh, suspects), found
    return found


def _state(body: bpy.types.Object, mesh: bpy.types.Object, suspects: Mapping[str, str]) -> object:
    """Settings that a measurement depends on, to be compared."""
    places = mesh_arrays.values(mesh.data.vertices, "co", 3)
    keys = mesh.data.shape_keys
    moving = sorted(mesh_copies.animated(mesh)), sorted(mesh_copies.animated_keys(mesh.data))
    settings = [
        [
            str(getattr(modifier, prop.identifier))
            for prop in modifier.bl_rna.properties
            if prop.type not in ("COLLECTION", "STRING") and prop.identifier != "execution_time"
        ]
        for modifier in mesh.modifiers
    ]
    values = [] if keys is None else [(k.name, k.value, k.mute) for k in keys.key_blocks]
    bends = [(bone.bbone_segments, bone.use_deform) for bone in body.data.bones]
    return hash(places.tobytes()), dict(suspects), settings, values, bends, moving, body.hfx.follow


def measure(
    body: bpy.types.Object,
    mesh: bpy.types.Object,
    suspects: Mapping[str, str],
    shape: Mapping[str, float],
) -> Measured:
    every = frozenset(suspects)
    with mesh_copies.scratch() as made:
        copies = _Copies(made, body, mesh, shape)
        deforming = (
            name
            for name in suspects
            if _is_changing(mesh, name)
            or copies.deviates(frozenset({name}))
            or copies.depends_on_others(name)
        )
        name = next(deforming, None)
        if name is None and len(suspects) > 1 and copies.deviates(every):
            name = next(iter(suspects))
        is_followed = name is not None or body.hfx.follow == "SURFACE"
        surface = copies.surface_map(every) if is_followed else None
        return Measured(suspects.get(name or ""), surface)


def _is_changing(mesh: bpy.types.Object, name: str) -> bool:
    """Test for an effect that cannot be measured, as it is another one at other times."""
    modifier = mesh.modifiers.get(name)
    if modifier is None:
        keys = mesh.data.shape_keys
        return name == "keys" and not keys.use_relative and bool(mesh_copies.animated(keys))
    own = f'modifiers["{bpy.utils.escape_identifier(name)}"]'
    if any(path.startswith(own) for path in mesh_copies.animated(mesh)):
        return True
    if modifier.type == "NODES":
        return any(node.bl_idname in _CHANGING_NODES for node in _nodes_of(modifier.node_group))
    return modifier.type in _CHANGING


def _nodes_of(group: Any, seen: set[str] | None = None) -> Iterator[Any]:
    """All nodes of a node group, and of the groups in it."""
    seen = set() if seen is None else seen
    if group is None or group.name_full in seen:
        return
    seen.add(group.name_full)
    for node in group.nodes:
        yield node
        if getattr(node, "node_tree", None) is not None:
            yield from _nodes_of(node.node_tree, seen)


@dataclass(frozen=True, eq=False)
class _Evaluated:
    """Copies in one pose, local space of the mesh."""

    skinned: F64  # (A, 3) where the bones alone put the mesh's own vertices
    points: F64  # (E, 3) with all that is switched on
    numbers: I64  # (E,) own vertex that each is, -1: a new one
    triangles: I32  # (F, 3)


class _Copies:
    """Copies of a mesh and its armature: one that only bones pose, and one with all modifiers."""

    def __init__(
        self,
        made: list[bpy.types.ID],
        body: bpy.types.Object,
        mesh: bpy.types.Object,
        shape: Mapping[str, float],
    ) -> None:
        self._made, self._body, self._mesh, self._shape = made, body, mesh, shape
        self._done: dict[tuple[frozenset[str], float], _Evaluated] = {}
        data = mesh_copies.numbered(mesh.data)
        rest = mesh_copies.at_rest(made, mesh, data, shape)
        self._numbers = mesh_copies.numbers_of(rest)
        self._triangles = mesh_arrays.triangles(rest)
        self._edges = np.array([edge.vertices[:] for edge in rest.edges], np.int64).reshape(-1, 2)
        self._mirrors = [modifier.name for modifier in mesh_copies.mirrors_of(mesh)]
        self._rigs = [self._rig(), self._rig()]
        self._plain = mesh_copies.copy_in(made, mesh, rest)
        self._plain.modifiers.clear()
        if avatar_meshes.bone_of(body, mesh) is None:
            self._plain.modifiers.new("Armature", "ARMATURE").object = self._rigs[0]
        self._full = mesh_copies.copy_in(made, mesh, data)
        self._full.show_only_shape_key = mesh.show_only_shape_key
        for modifier in self._full.modifiers:
            for put, target in list(mesh_copies.objects_of(modifier)):
                if target in (body, mesh):
                    put(self._rigs[1] if target == body else self._full)
        heads = np.array([bone.head_local for bone in body.data.bones], np.float64)
        size = np.ptp(heads, axis=0).max() if len(heads) > 1 else body.data.bones[0].length
        to_mesh = mesh.matrix_world.inverted_safe() @ body.matrix_world
        self._tolerance = _TOLERANCE * size * float(np.cbrt(abs(to_mesh.determinant())))

    def _rig(self) -> bpy.types.Object:
        data = self._body.data.copy()
        data.animation_data_clear()
        data.pose_position = "POSE"
        rig = mesh_copies.copy_in(self._made, self._body, data)
        for bone in rig.pose.bones:
            for constraint in list(bone.constraints):
                bone.constraints.remove(constraint)
            bone.bone.bbone_segments = 1
        return rig

    def _switch(self, on: frozenset[str]) -> None:
        """Enable those of the suspected effects that are named, and what is not suspected."""
        armatures = 0
        for modifier, own in zip(self._full.modifiers, self._mesh.modifiers, strict=True):
            wanted = own.name in on or own.name in self._mirrors
            if own.type == "ARMATURE" and own.object == self._body and own.show_viewport:
                armatures += 1
                wanted = armatures == 1 or "armature" in on
                is_plain = "armature" not in on
                modifier.use_deform_preserve_volume = (
                    not is_plain and own.use_deform_preserve_volume
                )
                modifier.use_bone_envelopes = not is_plain and own.use_bone_envelopes
                modifier.use_vertex_groups = is_plain or own.use_vertex_groups
                modifier.vertex_group = "" if is_plain else own.vertex_group
            modifier.show_viewport = own.show_viewport and wanted
        for bone, own in zip(self._rigs[1].data.bones, self._body.data.bones, strict=True):
            bone.bbone_segments = own.bbone_segments if "bones" in on else 1
        keys, own_keys = self._full.data.shape_keys, self._mesh.data.shape_keys
        if keys is not None:
            moving = mesh_copies.animated_keys(self._mesh.data)
            for key, own in zip(keys.key_blocks, own_keys.key_blocks, strict=True):
                used = own.slider_max if own.name in moving else own.value
                key.mute = own.mute and "keys" in on
                key.value = used if "keys" in on else self._shape.get(own.name, 0.0)

    def _evaluated(self, on: frozenset[str], angle: float) -> _Evaluated:
        """Copies at rest, or with each bone turned by an angle, to and fro down the hierarchy."""
        self._switch(on)
        for rig in self._rigs:
            for number, bone in enumerate(rig.pose.bones):
                sign = 1 - 2 * (len(bone.bone.parent_recursive) % 2)
                axis = Vector((1.0, 0.5 + 0.1 * (number % 5), 0.3)).normalized()
                bone.matrix_basis = Matrix.Rotation(sign * angle, 4, axis)
        graph = mesh_copies.updated(self._made)
        full = self._full.evaluated_get(graph).data
        return _Evaluated(
            mesh_arrays.points(self._plain.evaluated_get(graph).data),
            mesh_arrays.points(full),
            mesh_copies.numbers_of(full),
            mesh_arrays.triangles(full),
        )

    def deviates(self, on: frozenset[str]) -> bool:
        """Test for skin that is elsewhere than the bones alone put it, at rest or posed."""
        return any(self._is_elsewhere(self._once(on, angle)) for angle in (0.0, _BEND))

    def _once(self, on: frozenset[str], angle: float) -> _Evaluated:
        """Copies in a pose, evaluated once."""
        if (on, angle) not in self._done:
            self._done = {key: done for key, done in self._done.items() if key[0] == on}
            self._done[on, angle] = self._evaluated(on, angle)
        return self._done[on, angle]

    def _is_elsewhere(self, posed: _Evaluated) -> bool:
        own = self._matched(posed)
        way = posed.points[own] - posed.skinned if len(posed.points) else posed.skinned
        middle = self._middles(posed.skinned) - posed.skinned
        length = np.linalg.norm(middle, axis=1)
        # Smoothing moves a vertex towards the middle of its neighbours.
        share = np.einsum("vi,vi->v", way, middle) / np.maximum(length, 1e-30) ** 2
        way = way - np.clip(share, 0.0, 1.0)[:, None] * middle
        limit = self._tolerance + _SMOOTHED * length
        is_elsewhere = (own >= 0) & (np.linalg.norm(way, axis=1) > limit)
        if is_elsewhere.any() and (own < 0).any():
            # Where vertices were merged, the others may have moved along the skin.
            off = self._off_skin(posed, posed.points[own[is_elsewhere]])
            is_elsewhere[is_elsewhere] = off > limit[is_elsewhere]
        elif not (own >= 0).any() and len(posed.triangles):  # a new mesh, as fine as its edges
            corners = posed.points[posed.triangles]
            edge = np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))
            off = self._off_skin(posed, posed.points)
            return float((off > self._tolerance + _SMOOTHED * edge).mean()) > _NEW_ELSEWHERE
        return np.count_nonzero(is_elsewhere) > _ELSEWHERE * len(own)

    def _off_skin(self, posed: _Evaluated, points: F64) -> F64:
        """Distance of points from the skin where the bones alone put it."""
        skin = BVHTree.FromPolygons(
            posed.skinned.tolist(), self._triangles.tolist(), all_triangles=True
        )
        return np.array([skin.find_nearest(point)[3] for point in points.tolist()])

    def _middles(self, points: F64) -> F64:
        """Mean of the neighbours of each vertex."""
        starts = np.concatenate((self._edges[:, 0], self._edges[:, 1]))
        ends = np.concatenate((self._edges[:, 1], self._edges[:, 0]))
        counts = np.bincount(starts, minlength=len(points))
        sums = [np.bincount(starts, points[ends, k], minlength=len(points)) for k in range(3)]
        means = np.column_stack(sums) / np.maximum(counts, 1)[:, None]
        return np.where(counts[:, None] > 0, means, points)

    def _matched(self, posed: _Evaluated) -> I64:
        """Evaluated vertex (A,) of each of the mesh's own, the nearest of its duplicates; -1:
        none.
        """
        order = np.argsort(self._numbers, kind="stable")
        known = np.flatnonzero(posed.numbers >= 0)
        first, last = (
            np.searchsorted(self._numbers[order], posed.numbers[known], side)
            for side in ("left", "right")
        )
        count = last - first
        evaluated = np.repeat(known, count)
        within = np.arange(len(evaluated)) - np.repeat(np.cumsum(count) - count, count)
        vertex = order[np.repeat(first, count) + within]
        far = np.linalg.norm(posed.points[evaluated] - posed.skinned[vertex], axis=1)
        ranked = np.lexsort((evaluated, np.round(far / self._tolerance, 1), vertex))
        best = ranked[np.unique(vertex[ranked], return_index=True)[1]]
        found = np.full(len(posed.skinned), -1, np.int64)
        found[vertex[best]] = evaluated[best]
        return found

    def depends_on_others(self, name: str) -> bool:
        """Test for a modifier that moves skin where another object is moved or changes."""
        modifier = self._full.modifiers.get(name)
        copies = (self._rigs[1], self._full)
        others = [] if modifier is None else list(mesh_copies.objects_of(modifier))
        others = [(put, target) for put, target in others if target not in copies]
        if not others:
            return False
        before = self._once(frozenset({name}), _BEND).points
        for put, target in others:
            data = None if target.data is None else target.data.copy()
            if hasattr(data, "transform"):
                data.transform(Matrix.Diagonal((1.1, 1.2, 1.1, 1.0)))
            changed = mesh_copies.copy_in(self._made, target, data)
            changed.matrix_world = Matrix.Translation((0.05, 0.03, 0.02)) @ target.matrix_world
            put(changed)
            after = self._evaluated(frozenset({name}), _BEND).points
            put(target)
            if before.shape != after.shape or np.abs(after - before).max() > self._tolerance:
                return True
        return False

    def surface_map(self, on: frozenset[str]) -> SurfaceMap | None:
        """Map from the evaluated mesh to the mesh's own vertices."""
        rest, bent = (self._once(on, angle) for angle in (0.0, _BEND))
        if not len(rest.triangles):
            return None
        own = self._matched(rest)
        corners = np.repeat(own[:, None], 3, axis=1).astype(np.int32)
        weights = np.tile((1.0, 0.0, 0.0), (len(own), 1))
        beside = np.zeros((len(own), 3))
        if (lost := np.flatnonzero(own < 0)).size:
            left = self._triangles[(own[self._triangles] >= 0).all(axis=1)]
            points, triangles, evaluated = rest.skinned, left, own
            if not len(left):  # a new mesh
                points, triangles = rest.points, rest.triangles
                evaluated = np.arange(len(points))
            tree = BVHTree.FromPolygons(points.tolist(), triangles.tolist(), all_triangles=True)
            places = rest.skinned[lost]
            nearest = triangles[[tree.find_nearest(place)[2] for place in places.tolist()]]
            shape = points[nearest]
            corners[lost], weights[lost] = evaluated[nearest], 1.0 / 3.0
            beside[lost] = np.einsum("nki,ni->nk", _frames(shape), places - shape.mean(axis=1))
        used = np.unique(corners)
        is_steady = used[-1] < len(bent.numbers) and np.array_equal(
            rest.numbers[used], bent.numbers[used]
        )
        count = len(rest.points) if len(rest.points) == len(bent.points) else None
        return SurfaceMap(count, corners, weights, beside, bool(is_steady))


def _frames(corners: F64) -> F64:
    """Unit vectors (n, 3, 3) along the first edge of triangles, across it, and normal to them."""
    along = corners[:, 1] - corners[:, 0]
    normal = np.cross(along, corners[:, 2] - corners[:, 0])
    axes = np.stack((along, np.cross(normal, along), normal), axis=1)
    return axes / np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), 1e-30)
