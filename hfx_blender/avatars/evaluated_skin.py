# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurement of an avatar's modifiers and shape keys, on copies in a scratch scene.

A copy of the mesh with all modifiers is evaluated in rest pose and in a second pose, and
compared with a copy that has a plain Armature modifier only.

The type of a modifier decides in a single case: a simulation, a cache file or a node that changes
with time cannot be measured at a single time (:data:`_CHANGING`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import bpy
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

from ..blender import mesh_arrays
from ..blender.scene_info import nodes_of
from ..engine.arrays import F64, I32, I64, ramp
from . import avatar_meshes, mesh_copies

_CHANGING: Final = {
    *("BUILD", "CLOTH", "DYNAMIC_PAINT", "EXPLODE", "FLUID", "MESH_CACHE", "MESH_SEQUENCE_CACHE"),
    *("OCEAN", "PARTICLE_INSTANCE", "SOFT_BODY", "SURFACE", "WAVE"),
}
"""Modifiers with an effect that depends on time."""

_CHANGING_NODES: Final = {
    *("GeometryNodeInputSceneTime", "GeometryNodeSimulationOutput", "GeometryNodeObjectInfo"),
    *("GeometryNodeCollectionInfo", "GeometryNodeInputActiveCamera", "GeometryNodeBake"),
}
"""Nodes that make a node group depend on time or on further objects."""

_TOLERANCE: Final = 6e-4
"""Distance beyond which a vertex deviates, as a share of the rig's size: 1 mm of a person."""

_SMOOTHED: Final = 0.5
"""Additional tolerance for coarse meshes, as a share of a vertex's distance from the mean of its
neighbours: subdivision and gentle smoothing stay between the two."""

_ELSEWHERE: Final = 1 / 2000
"""Largest share of deviating vertices: single vertices deviate at folds."""

_NEW_ELSEWHERE: Final = 0.05
"""Largest share of deviating vertices of a remeshed surface, as Remesh fills cavities."""

_BEND: Final = 0.6
"""Angle of each bone in the second pose, radians; the sign alternates down the hierarchy."""


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Positions of a mesh's own vertices as a function of the evaluated mesh. A hidden or merged
    vertex is attached to the nearest evaluated triangle."""

    count: int | None  # number of evaluated vertices; None if dependent on the pose
    corners: I32  # (A, 3) evaluated vertices
    weights: F64  # (A, 3) of the corners
    offsets: F64  # (A, 3) along the triangle's first edge, across the edge, along the normal
    is_steady: bool  # the corners are the same vertices in any pose

    def fits(self, count: int) -> bool:
        """Test for an evaluated mesh of ``count`` vertices that this map applies to."""
        is_same = count > self.corners.max() if self.count is None else count == self.count
        return self.is_steady and bool(is_same)

    def positions(self, points: np.ndarray) -> np.ndarray:
        """Positions (A, 3) float32 of the mesh's own vertices, from evaluated vertices (E, 3), in
        their space."""
        positions = points[self.corners[:, 0]].astype(np.float32)
        attached = np.flatnonzero(self.weights[:, 0] != 1.0)
        if len(attached):
            corners = points[self.corners[attached]].astype(np.float64)
            positions[attached] = np.einsum("nc,nci->ni", self.weights[attached], corners)
            positions[attached] += np.einsum("nk,nki->ni", self.offsets[attached], _frames(corners))
        return positions


@dataclass(frozen=True)
class SkinMeasurement:
    """Effect of a mesh's modifiers and shape keys besides the armature."""

    reason: str | None  # of a wrong pose by bones alone; None if bones suffice
    surface: SurfaceMap | None  # None if the mesh has no evaluated faces, or bones suffice


_known: dict[tuple[str, str], tuple[object, SkinMeasurement]] = {}


def valid_measurement(
    body: bpy.types.Object, mesh: bpy.types.Object, suspects: Mapping[str, str]
) -> SkinMeasurement | None:
    """Last measurement of a mesh; None if the mesh was edited afterwards, or never measured."""
    state, measured = _known.get((body.name_full, mesh.name_full), (None, None))
    return measured if state == _state(body, mesh, suspects) else None


def last_surface_map(body: bpy.types.Object, mesh: bpy.types.Object) -> SurfaceMap | None:
    """Surface map of the last measurement, possibly outdated; None if missing."""
    measured = _known.get((body.name_full, mesh.name_full))
    return None if measured is None else measured[1].surface


def drop_measurement(body: bpy.types.Object, mesh: bpy.types.Object) -> None:
    """Remove the stored measurement of a mesh, if any; the next measurement is a new one."""
    _known.pop((body.name_full, mesh.name_full), None)


def cached_measurement(
    body: bpy.types.Object,
    mesh: bpy.types.Object,
    suspects: Mapping[str, str],
    shape: Mapping[str, float],
) -> SkinMeasurement:
    """Measure a mesh, or return the last measurement if mesh and body are unchanged. ``suspects``
    are possible reasons against posing by bones alone, by the name of a modifier, or ``"place"``,
    ``"armature"``, ``"bones"``, ``"keys"``; ``shape`` the values of the shape keys at fitting."""
    measurement = valid_measurement(body, mesh, suspects)
    if measurement is None:
        measurement = measure(body, mesh, suspects, shape)
        _known[body.name_full, mesh.name_full] = _state(body, mesh, suspects), measurement
    return measurement


def _state(body: bpy.types.Object, mesh: bpy.types.Object, suspects: Mapping[str, str]) -> object:
    """Comparable value of vertices, suspects, modifiers, shape keys, bones and ``follow``."""
    places = mesh_arrays.values(mesh.data.vertices, "co", 3)
    keys = mesh.data.shape_keys
    moving = sorted(mesh_copies.animated_paths(mesh)), sorted(mesh_copies.animated_keys(mesh.data))
    # All RNA values, as any value may change the result; execution_time changes by itself.
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
) -> SkinMeasurement:
    """Measure suspected modifiers and shape keys on copies, without the cache.

    The reason is that of the first suspect that moves skin away from the bones' pose, or changes
    with time or with further objects; None if there is none. The surface map is made if there is a
    reason, or if the body follows the surface by choice. For parameters see
    :func:`cached_measurement`.
    """
    all_suspects = frozenset(suspects)
    with mesh_copies.scratch() as datablocks:
        copies = _Copies(datablocks, body, mesh, shape)
        # Cheapest test first: a changing modifier needs no evaluation.
        deforming = (
            name
            for name in suspects
            if name == "place"  # measured by the caller
            or _is_changing(mesh, name)
            or copies.deviates(frozenset({name}))
            or copies.depends_on_others(name)
        )
        name = next(deforming, None)
        # Suspects below the tolerance on their own may exceed the tolerance together.
        if name is None and len(suspects) > 1 and copies.deviates(all_suspects):
            name = next(iter(suspects))
        is_followed = name is not None or body.hfx.follow == "SURFACE"
        surface = copies.surface_map(all_suspects) if is_followed else None
        return SkinMeasurement(suspects.get(name or ""), surface)


def _is_changing(mesh: bpy.types.Object, name: str) -> bool:
    """Test that the modifier ``name`` is animated, of a simulation or cache type, or has nodes that
    depend on time; for "keys": animated absolute shape keys."""
    modifier = mesh.modifiers.get(name)
    if modifier is None:
        keys = mesh.data.shape_keys
        return name == "keys" and not keys.use_relative and bool(mesh_copies.animated_paths(keys))
    own = f'modifiers["{bpy.utils.escape_identifier(name)}"]'
    if any(path.startswith(own) for path in mesh_copies.animated_paths(mesh)):
        return True
    if modifier.type == "NODES":
        return any(node.bl_idname in _CHANGING_NODES for node in nodes_of(modifier.node_group))
    return modifier.type in _CHANGING


@dataclass(frozen=True, eq=False)
class _Evaluated:
    """Evaluated copies in a pose, local space of the mesh."""

    skinned: F64  # (A, 3) own vertices of the mesh, posed by the bones alone
    points: F64  # (E, 3) evaluated vertices with the enabled suspects
    numbers: I64  # (E,) own vertex of each evaluated vertex; -1 for a new vertex
    triangles: I32  # (F, 3)


class _Copies:
    """Two copies of mesh and armature: the first posed by bones only, the second fully."""

    def __init__(
        self,
        datablocks: list[bpy.types.ID],
        body: bpy.types.Object,
        mesh: bpy.types.Object,
        shape: Mapping[str, float],
    ) -> None:
        self._made, self._body, self._mesh, self._shape = datablocks, body, mesh, shape
        self._cache: dict[tuple[frozenset[str], float], _Evaluated] = {}
        # Numbers are added before the Mirror modifier, which copies numbers to the mirrored half.
        data = mesh_copies.with_vertex_numbers(mesh.data)
        rest = mesh_copies.at_rest(datablocks, mesh, data, shape)
        self._numbers = mesh_copies.original_vertices(rest)
        self._triangles = mesh_arrays.triangles(rest)
        self._edges = np.array([edge.vertices[:] for edge in rest.edges], np.int64).reshape(-1, 2)
        self._mirrors = [modifier.name for modifier in mesh_copies.mirrors_of(mesh)]
        self._rigs = [self._rig(), self._rig()]
        self._plain = mesh_copies.copy_into(datablocks, mesh, rest)
        self._plain.modifiers.clear()
        if avatar_meshes.bone_of(body, mesh) is None:
            self._plain.modifiers.new("Armature", "ARMATURE").object = self._rigs[0]
        self._full = mesh_copies.copy_into(datablocks, mesh, data)
        self._full.show_only_shape_key = mesh.show_only_shape_key
        # Modifiers refer to the user's body and mesh; the copies must refer to the other copy.
        for modifier in self._full.modifiers:
            for put, target in list(mesh_copies.objects_of(modifier)):
                if target in (body, mesh):
                    put(self._rigs[1] if target == body else self._full)
        # The tolerance scales with the rig, in the local space of the mesh.
        heads = np.array([bone.head_local for bone in body.data.bones], np.float64)
        size = np.ptp(heads, axis=0).max() if len(heads) > 1 else body.data.bones[0].length
        to_mesh = mesh.matrix_world.inverted_safe() @ body.matrix_world
        self._tolerance = _TOLERANCE * size * float(np.cbrt(abs(to_mesh.determinant())))

    def _rig(self) -> bpy.types.Object:
        data = self._body.data.copy()
        data.animation_data_clear()
        data.pose_position = "POSE"
        rig = mesh_copies.copy_into(self._made, self._body, data)
        # Constraints and bendy bones would pose the two rigs differently from matrix_basis alone.
        for bone in rig.pose.bones:
            for constraint in list(bone.constraints):
                bone.constraints.remove(constraint)
            bone.bone.bbone_segments = 1
        return rig

    def _enable(self, on: frozenset[str]) -> None:
        """Enable the given suspects on the full copy, and disable further suspects. Mirrors and the
        body's first Armature modifier, in plain form, stay enabled."""
        armatures = 0
        for modifier, own in zip(self._full.modifiers, self._mesh.modifiers, strict=True):
            is_enabled = own.name in on or own.name in self._mirrors
            # The first Armature modifier always stays, as the comparison is with bones; without the
            # suspect "armature" the mesh deforms like the plain copy.
            if own.type == "ARMATURE" and own.object == self._body and own.show_viewport:
                armatures += 1
                is_enabled = armatures == 1 or "armature" in on
                is_plain = "armature" not in on
                keeps_volume = own.use_deform_preserve_volume and not is_plain
                modifier.use_deform_preserve_volume = keeps_volume
                modifier.use_bone_envelopes = not is_plain and own.use_bone_envelopes
                modifier.use_vertex_groups = is_plain or own.use_vertex_groups
                modifier.vertex_group = "" if is_plain else own.vertex_group
            modifier.show_viewport = own.show_viewport and is_enabled
        for bone, own in zip(self._rigs[1].data.bones, self._body.data.bones, strict=True):
            bone.bbone_segments = own.bbone_segments if "bones" in on else 1
        keys, own_keys = self._full.data.shape_keys, self._mesh.data.shape_keys
        if keys is not None:
            moving = mesh_copies.animated_keys(self._mesh.data)
            for key, own in zip(keys.key_blocks, own_keys.key_blocks, strict=True):
                # An animated key may reach the maximum at any time.
                used = own.slider_max if own.name in moving else own.value
                key.mute = own.mute and "keys" in on
                key.value = used if "keys" in on else self._shape.get(own.name, 0.0)

    def _evaluated(self, on: frozenset[str], angle: float) -> _Evaluated:
        """Evaluate both copies with the suspects ``on`` and each bone turned by ``angle`` radians,
        with alternating sign down the hierarchy; 0 is the rest pose."""
        self._enable(on)
        for rig in self._rigs:
            for number, bone in enumerate(rig.pose.bones):
                # Alternating signs bend every joint; varying axes avoid rotations without any
                # effect.
                sign = 1 - 2 * (len(bone.bone.parent_recursive) % 2)
                axis = Vector((1.0, 0.5 + 0.1 * (number % 5), 0.3)).normalized()
                bone.matrix_basis = Matrix.Rotation(sign * angle, 4, axis)
        graph = mesh_copies.evaluated_graph(self._made)
        full = self._full.evaluated_get(graph).data
        return _Evaluated(
            mesh_arrays.points(self._plain.evaluated_get(graph).data),
            mesh_arrays.points(full),
            mesh_copies.original_vertices(full),
            mesh_arrays.triangles(full),
        )

    def deviates(self, on: frozenset[str]) -> bool:
        """Test for a deviation by the suspects ``on`` from the pose by bones alone, at rest or with
        all bones turned by 0.6 radians."""
        return any(self._has_deviation(self._cached(on, angle)) for angle in (0.0, _BEND))

    def _cached(self, on: frozenset[str], angle: float) -> _Evaluated:
        """Copies evaluated with suspects ``on`` at ``angle``; cached for the last ``on`` only."""
        if (on, angle) not in self._cache:
            self._cache = {key: posed for key, posed in self._cache.items() if key[0] == on}
            self._cache[on, angle] = self._evaluated(on, angle)
        return self._cache[on, angle]

    def _has_deviation(self, posed: _Evaluated) -> bool:
        """Test for more than 1/2000 of a mesh's vertices away from their pose by bones alone.

        Displacement towards the mean of a vertex's neighbours is not counted. The tolerance is
        0.06 % of the rig's size plus half of the distance from that mean. A vertex without an
        evaluated vertex does not count; with such vertices (merging), the distance from the skin
        must exceed the tolerance, too. On a wholly new mesh (Remesh): more than 5 % of the
        evaluated vertices farther from the skin than 0.06 % plus half the median edge.
        """
        # Own vertices without an evaluated match (-1) are not compared here.
        own = self._nearest_duplicates(posed)
        offset = posed.points[own] - posed.skinned if len(posed.points) else posed.skinned
        # Mean of each vertex's neighbours; the vertex itself without neighbours.
        starts, ends = np.concatenate((self._edges, self._edges[:, ::-1])).T
        counts = np.bincount(starts, minlength=len(own))
        columns = [np.bincount(starts, column[ends], len(own)) for column in posed.skinned.T]
        means = np.column_stack(columns) / np.maximum(counts, 1)[:, None]
        to_mean = np.where(counts[:, None] > 0, means, posed.skinned) - posed.skinned
        length = np.linalg.norm(to_mean, axis=1)
        # Smoothing moves a vertex towards the mean of the neighbours: that component is removed,
        # up to the mean itself, before the rest is compared with the tolerance.
        smoothing = np.einsum("vi,vi->v", offset, to_mean) / np.maximum(length, 1e-30) ** 2
        offset = offset - np.clip(smoothing, 0.0, 1.0)[:, None] * to_mean
        limit = self._tolerance + _SMOOTHED * length
        deviates = (own >= 0) & (np.linalg.norm(offset, axis=1) > limit)
        if deviates.any() and (own < 0).any():
            # Merging vertices slides their neighbours along the skin, which is no deviation.
            distance = self._off_skin(posed, posed.points[own[deviates]])
            deviates[deviates] = distance > limit[deviates]
        # Remesh: no vertex is traced, so distances to the bones-only surface are compared.
        elif not (own >= 0).any() and len(posed.triangles):  # a new mesh, with its own edge length
            corners = posed.points[posed.triangles]
            edge = np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2))
            distance = self._off_skin(posed, posed.points)
            return float((distance > self._tolerance + _SMOOTHED * edge).mean()) > _NEW_ELSEWHERE
        return np.count_nonzero(deviates) > _ELSEWHERE * len(own)

    def _off_skin(self, posed: _Evaluated, points: F64) -> F64:
        """Distances (n,) of ``points`` (n, 3) from the skin posed by bones alone, local space."""
        skin = BVHTree.FromPolygons(
            posed.skinned.tolist(), self._triangles.tolist(), all_triangles=True
        )
        return np.array([skin.find_nearest(point)[3] for point in points.tolist()])

    def _nearest_duplicates(self, posed: _Evaluated) -> I64:
        """Evaluated vertex (A,) of each own vertex, nearest of equal numbers; -1 without any."""
        # A Mirror modifier gives several own vertices the same number, and Solidify or Array
        # several evaluated vertices: list all pairs of equal numbers.
        order = np.argsort(self._numbers, kind="stable")
        traced = np.flatnonzero(posed.numbers >= 0)
        first_copy, last_copy = (
            np.searchsorted(self._numbers[order], posed.numbers[traced], side)
            for side in ("left", "right")
        )
        count = last_copy - first_copy
        copy_number, owner = ramp(count)
        evaluated = traced[owner]
        vertex = order[first_copy[owner] + copy_number]
        distance = np.linalg.norm(posed.points[evaluated] - posed.skinned[vertex], axis=1)
        # Rounded distances let the lower evaluated vertex win among coincident duplicates, in both
        # poses.
        ranked = np.lexsort((evaluated, np.round(distance / self._tolerance, 1), vertex))
        best = ranked[np.unique(vertex[ranked], return_index=True)[1]]
        matches = np.full(len(posed.skinned), -1, np.int64)
        matches[vertex[best]] = evaluated[best]
        return matches

    def depends_on_others(self, name: str) -> bool:
        """Test for a modifier whose result changes with place or shape of a referenced object. Each
        object but the copies of body and mesh is replaced by a moved, scaled copy for the test.
        False for a name without a modifier."""
        modifier = self._full.modifiers.get(name)
        copies = (self._rigs[1], self._full)
        references = [] if modifier is None else list(mesh_copies.objects_of(modifier))
        references = [(replace, target) for replace, target in references if target not in copies]
        for replace, target in references:
            before = self._cached(frozenset({name}), _BEND).points
            # A changed shape of the referenced object shows as well as a changed place.
            data = None if target.data is None else target.data.copy()
            if hasattr(data, "transform"):
                data.transform(Matrix.Diagonal((1.1, 1.2, 1.1, 1.0)))
            moved_copy = mesh_copies.copy_into(self._made, target, data)
            moved_copy.matrix_world = Matrix.Translation((0.05, 0.03, 0.02)) @ target.matrix_world
            replace(moved_copy)
            after = self._evaluated(frozenset({name}), _BEND).points
            replace(target)
            if before.shape != after.shape or np.abs(after - before).max() > self._tolerance:
                return True
        return False

    def surface_map(self, on: frozenset[str]) -> SurfaceMap | None:
        """Map from the evaluated mesh to the mesh's own vertices; None without evaluated faces."""
        rest, bent = (self._cached(on, angle) for angle in (0.0, _BEND))
        if not len(rest.triangles):
            return None
        own = self._nearest_duplicates(rest)
        corners = np.repeat(own[:, None], 3, axis=1).astype(np.int32)
        weights = np.tile((1.0, 0.0, 0.0), (len(own), 1))
        offsets = np.zeros((len(own), 3))
        # Unmatched vertices keep their offset from the nearest matched triangle, in the triangle's
        # axes.
        if (unmatched := np.flatnonzero(own < 0)).size:
            complete = self._triangles[(own[self._triangles] >= 0).all(axis=1)]
            points, triangles, evaluated = rest.skinned, complete, own
            if not len(complete):  # a new mesh
                points, triangles = rest.points, rest.triangles
                evaluated = np.arange(len(points))
            tree = BVHTree.FromPolygons(points.tolist(), triangles.tolist(), all_triangles=True)
            positions = rest.skinned[unmatched]
            nearest = triangles[[tree.find_nearest(point)[2] for point in positions.tolist()]]
            shape = points[nearest]
            corners[unmatched], weights[unmatched] = evaluated[nearest], 1.0 / 3.0
            offsets[unmatched] = np.einsum(
                "nki,ni->nk", _frames(shape), positions - shape.mean(axis=1)
            )
        # Two poses decide whether evaluated vertices keep their numbers, as the map needs.
        used = np.unique(corners)
        is_steady = used[-1] < len(bent.numbers) and np.array_equal(
            rest.numbers[used], bent.numbers[used]
        )
        count = len(rest.points) if len(rest.points) == len(bent.points) else None
        return SurfaceMap(count, corners, weights, offsets, bool(is_steady))


def _frames(corners: F64) -> F64:
    """Axes (n, 3, 3) of triangles ``corners`` (n, 3, 3): unit vectors along the first edge, across
    it in the plane, and normal; 0 if degenerate."""
    along = corners[:, 1] - corners[:, 0]
    normal = np.cross(along, corners[:, 2] - corners[:, 0])
    axes = np.stack((along, np.cross(normal, along), normal), axis=1)
    return axes / np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), 1e-30)
