# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh volume: the closed surface of another object, decimated where a tolerance allows."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib.util import find_spec
from typing import Any, Final, Self

import numpy as np

from ...errors import InputError
from ..arrays import F64, I32, I64, Bool
from ..native.library import structure
from .mesh_distance import TriangleTree
from .mesh_inside import InsideGrid
from .mesh_topology import closed_surface, decimated, merged
from .shape import Shape

MANY_FACES: Final = 50_000
"""Number of faces from which decimation costs less than depth searches in the full mesh."""

DECIMATION_SHARE: Final = 1.0 / 8.0
"""Share of the accepted error of a contact's edge that decimation may use up."""

_CORE_TOLERANCE: Final = 0.005  # of the largest depth
_CORE_CANDIDATES: Final = 64  # cells subdivided in each round
_CORE_ROUNDS: Final = 24
_EQUAL: Final = 1e-9  # difference of equal depths, share of the largest
_FLATTEST: Final = 1e-12  # least extent over largest
_BOX_CORNERS: Final = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)])
_BOX_TRIANGLES: Final = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ],
    np.int32,
)
_STEPS_IN_OCTAVE: Final = 2.0  # coarse steps of bounds, so that a turning volume keeps its mesh
_SLACK: Final = 1e-12  # rounding error of a tree's boxes, share of the largest coordinate
_SIMILAR: Final = 1e-9  # relative difference of scales that count as uniform


@dataclass(frozen=True, eq=False)
class MeshVolume:
    """Closed triangle mesh; points with a non-zero winding number are inside.

    Small holes are closed and wrongly oriented faces flipped, see
    :func:`mesh_topology.closed_surface`. A hollow (inner shell facing inwards) is outside,
    overlapping shells are inside, mirrored and inside-out meshes are valid. Points within rounding
    of the surface may count for either side. Immutable, with cached search structures. Raises
    InputError: the mesh is empty, flat, not finite, wide open or not orientable. Raises ValueError:
    arrays have wrong shapes or indices.
    """

    vertices: F64  # (V, 3) shape space
    triangles: I32  # (F, 3)
    name: str  # of the object, for messages
    note: str = field(init=False, default="")  # repairs and missing packages, for the user
    _vertices: F64 = field(init=False, repr=False)  # merged
    _triangles: I32 = field(init=False, repr=False)  # of merged vertices, consistently oriented

    def __post_init__(self) -> None:
        vertices, triangles = np.asarray(self.vertices, np.float64), np.asarray(self.triangles)
        if vertices.shape[1:] != (3,) or triangles.shape[1:] != (3,):
            raise ValueError(
                f"expected vertices (V, 3) and triangles (F, 3), "
                f"got {vertices.shape} and {triangles.shape}"
            )
        if not triangles.size:
            raise InputError(f"'{self.name}' has no faces. A mesh volume needs a closed mesh.")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError(f"triangles: expected indices below {len(vertices)}")
        broken = np.count_nonzero(~np.isfinite(vertices[np.unique(triangles)]).all(axis=1))
        if broken:
            raise InputError(
                f"'{self.name}' has {broken} vertices whose coordinates are not finite numbers."
            )
        vertices, triangles = merged(vertices, triangles)
        extent = np.ptp(vertices, axis=0) if len(vertices) else np.zeros(3)
        if not (len(triangles) and extent.min() > _FLATTEST * extent.max()):
            raise InputError(f"'{self.name}' is flat. A mesh volume needs a mesh with an inside.")
        vertices, triangles, note = closed_surface(vertices, triangles, self.name)
        object.__setattr__(self, "_vertices", vertices)
        object.__setattr__(self, "_triangles", triangles)
        if len(triangles) >= MANY_FACES and find_spec("fast_simplification") is None:
            slower = (
                f"'{self.name}' has {len(triangles)} faces. Its contacts take longer, because "
                f"fast-simplification is not installed"
            )
            note = "; ".join(filter(None, (note, slower)))
        object.__setattr__(self, "note", note)

    @classmethod
    def box(cls, bounds: F64, name: str) -> Self:
        """Box with corners ``bounds`` (2, 3), possibly flat, for a mesh out of reach of skin.
        Without the checks and repairs of a mesh."""
        volume = object.__new__(cls)
        corners = bounds[_BOX_CORNERS, np.arange(3)]
        values = {"vertices": corners, "triangles": _BOX_TRIANGLES, "name": name, "note": ""}
        values |= {"_vertices": corners, "_triangles": _BOX_TRIANGLES}
        for key, value in values.items():
            object.__setattr__(volume, key, value)
        return volume

    @property
    def corners(self) -> F64:
        """Corners of the closed surface's triangles, (F, 3, 3): triangle, corner, axis."""
        return np.asarray(self._vertices[self._triangles])

    @property
    def is_fine(self) -> bool:
        """True from 50,000 triangles on, where decimation pays."""
        return len(self._triangles) >= MANY_FACES

    def within(self, bound: float) -> "MeshVolume":
        """Volume of fewer faces whose surface is within ``bound``, or this volume; cached.
        ``bound`` is in shape space; see :func:`.mesh_topology.decimated`."""
        if bound not in self._fewer:
            self._fewer[bound] = self

            def to_surface(places: F64) -> F64:
                return self.surface_distance_m(places, np.eye(3))

            try:
                surface = decimated(self._vertices, self._triangles, bound, to_surface)
                fewer = self if surface is None else type(self)(*surface, self.name)
                # A note means that decimation broke the surface, and the repair changed the mesh.
                self._fewer[bound] = self if fewer.note else fewer
            except (ImportError, InputError):
                pass  # fast-simplification has no wheel for some platforms; or a broken surface
        return self._fewer[bound]

    @cached_property
    def _fewer(self) -> "dict[float, MeshVolume]":
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """State to pickle: fields only, as cached members may hold addresses of this process."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @cached_property
    def bounds(self) -> F64:
        return np.stack([self._vertices.min(axis=0), self._vertices.max(axis=0)])

    def contains(self, points: F64) -> Bool:
        return self.grid.contains(points)

    def depth_m(self, points: F64, to_world: F64) -> F64:
        """Distance (N,) to the nearest triangle, m, 0 outside; see :meth:`Shape.depth_m`."""
        depths = np.zeros(points.shape[1])
        inside = np.flatnonzero(self.contains(points))
        if len(inside):
            depths[inside] = self.surface_distance_m(points[:, inside], to_world[:3, :3])
        return depths

    def surface_distance_m(self, points: F64, linear: F64) -> F64:
        """Distance (N,) of points (3, N), shape space, to the surface under a linear map (3, 3).
        Unsigned, so positive inside too; in the unit of the mapped space."""
        about = points - self._middle[:, None]
        stretch = np.linalg.svd(linear, compute_uv=False)
        if stretch[0] - stretch[2] <= _SIMILAR * stretch[0]:
            # Uniform scaling needs no tree of its own: distances scale with it.
            return np.asarray(stretch[1] * self.tree.distances(about))
        # Only the tree of the last linear map is cached: a still volume has one for all rows.
        key = linear.tobytes()
        if key not in self._placed_trees:
            self._placed_trees.clear()
            self._placed_trees[key] = self.tree.placed(linear)
        return self._placed_trees[key].distances(linear @ about)

    def compiled(self, with_depth: bool = False) -> Any:
        """Mesh for the library, which must exist, as ``hfx_mesh``; cached. The radius of the core
        (largest inscribed ball) is 0 without ``with_depth``."""
        if with_depth not in self._compiled:
            # The grid is in shape space, the tree moved by -middle: distances keep all digits.
            slack = _SLACK * float(np.abs(self.tree.corners).max())
            depth = self.core_radius if with_depth else 0.0
            self._compiled[with_depth] = structure("hfx_mesh")(
                self.grid.compiled, self.tree.compiled, self._middle, slack, depth
            )
        return self._compiled[with_depth]

    @cached_property
    def _compiled(self) -> dict[bool, Any]:
        return {}

    @cached_property
    def _placed_trees(self) -> dict[bytes, TriangleTree]:
        return {}

    # Built on first use: many volumes are never reached, and few have a falloff.

    @cached_property
    def grid(self) -> InsideGrid:
        return InsideGrid(self._vertices, self._triangles)

    @cached_property
    def _middle(self) -> F64:
        return np.asarray(self.bounds.mean(axis=0))

    @cached_property
    def tree(self) -> TriangleTree:
        # Relative to the middle, so that a mesh far from the origin keeps all digits.
        return TriangleTree((self._vertices - self._middle)[self._triangles])

    @cached_property
    def core_radius(self) -> float:
        """Radius of the largest inscribed ball, shape space, within half a percent.

        Branch and bound over cells: depth, negative outside, changes by at most the distance
        between two points, which bounds it within a cell. Only the most promising cells of a round
        are subdivided; a plate, where all depths are equal, would need too many.
        """
        low, high = self.bounds
        extent = high - low
        counts = np.clip(np.ceil(8.0 * extent / extent.max()), 2, 8).astype(np.int64)
        half = (0.5 * extent / counts)[:, None]
        centres = low[:, None] + half * (2 * np.indices(counts).reshape(3, -1) + 1)
        corners = 2 * np.indices((2, 2, 2)).reshape(3, 1, 8) - 1
        best = 0.0
        for _ in range(_CORE_ROUNDS):
            reach = float(np.sqrt(np.sum(half**2)))
            # Depths below best - reach cannot lead to a deeper place, so these need not be exact.
            depths = self.tree.distances_beyond(
                centres - self._middle[:, None], max(best - reach, 0.0), 0.5 * _CORE_TOLERANCE
            )
            depths[~self.contains(centres)] *= -1.0
            best = max(best, float(depths.max()))
            promising = np.flatnonzero(depths + reach > best * (1.0 + _CORE_TOLERANCE))
            if not len(promising) or reach < _CORE_TOLERANCE * best:
                break
            # Depths that differ by rounding rank equally, so that all machines choose the same.
            rank = np.rint(depths[promising] / (_EQUAL * max(best, reach)))
            order = np.argsort(-rank, kind="stable")[:_CORE_CANDIDATES]
            chosen = centres[:, promising[order]]
            half = half / 2.0
            centres = (chosen[:, :, None] + half[:, :, None] * corners).reshape(3, -1)
        return best


def of_fewer_faces(
    shapes: tuple[Shape, ...], which: I64, matrices: F64, bounds_m: F64
) -> tuple[tuple[Shape, ...], I32]:
    """Replace fine meshes by decimated meshes within a bound, row by row.

    A row's result depends on this row only, so that a part of a scene gives the same contacts.
    ``which`` (n,) is the index into ``shapes`` of each row; ``matrices`` (n, 4, 4) are shape space
    to world; ``bounds_m`` (n,) the largest change of the surface in the world, 0 to keep the shape.
    Returns the shapes in use without duplicates, and the index (n,) of each row into them.
    """
    linear = matrices[:, :3, :3]
    is_fine = np.isfinite(linear).all(axis=(1, 2)) & (bounds_m > 0.0)
    is_fine &= np.array([isinstance(s, MeshVolume) and s.is_fine for s in shapes])[which]
    stretches = np.ones(len(which))
    stretches[is_fine] = np.linalg.norm(linear[is_fine], 2, axis=(1, 2))
    is_fine &= stretches > 0.0
    steps = np.zeros(len(which), np.int64)
    allowed = bounds_m[is_fine] / stretches[is_fine]
    # Bounds are rounded down to steps of half an octave, so that few meshes are made.
    steps[is_fine] = np.floor(_STEPS_IN_OCTAVE * np.log2(allowed)).astype(np.int64)
    keys = np.stack([which, is_fine, steps], axis=1)
    used: list[Shape] = []
    index = np.zeros(len(which), np.int32)
    for number, is_replaced, step in np.unique(keys, axis=0).tolist():
        shape = shapes[number]
        if is_replaced and isinstance(shape, MeshVolume):
            shape = shape.within(2.0 ** (step / _STEPS_IN_OCTAVE))
        if shape not in used:  # meshes compare by identity
            used.append(shape)
        index[(keys == (number, is_replaced, step)).all(axis=1)] = used.index(shape)
    return tuple(used), index
