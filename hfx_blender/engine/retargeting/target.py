# SPDX-License-Identifier: GPL-3.0-or-later
"""Avatar of a user, for retargeting: its mesh, its bones, and checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64, I64
from ..body.model import SkinWeights

_LARGE_PIECE: Final = 0.01
"""Share of the skin from which a connected piece counts: a hand, a shoe, a sleeve."""

_LARGE_PIECES: Final = 0.5
"""Share of the skin that such pieces must have together: eyes, lashes, buttons may be the rest."""

_PINCHED_EDGES: Final = 0.01
"""Share of edges that may have more than two triangles."""

_DOUBLED_FACES: Final = 0.1
"""Share of faces that may lie there twice: both sides of lashes and eyelids."""

_INSIDE_OUT: Final = 0.1
"""Share of a mesh's volume that must be negative: an open sheet encloses about none."""

_TURNED: Final = 0.02
"""Share of a mesh's surface from which single faces that look inwards are turned."""

_UNSKINNED: Final = 0.2
"""Share of vertices that may have no weight of any bone."""


class Bone(Protocol):
    """Bone of a user's rig, at rest."""

    @property
    def name(self) -> str: ...
    @property
    def parent(self) -> str | None: ...
    @property
    def head(self) -> npt.ArrayLike: ...
    @property
    def tail(self) -> npt.ArrayLike: ...


class RigMapping(Protocol):
    """Mapping from canonical bones to the bones of a rig."""

    @property
    def bones(self) -> Mapping[str, str]:
        """Canonical bone -> its counterpart."""

    @property
    def fallbacks(self) -> Mapping[str, str]:
        """Canonical bone without counterpart -> the rig's bone that it follows."""


@dataclass(frozen=True, eq=False)
class TargetAvatar:
    """An avatar in the rest space of its own armature, in that armature's own unit."""

    vertices: F64  # (A, 3)
    triangles: I64  # (F, 3) counter-clockwise seen from outside
    weights: SkinWeights  # rows may be empty where no bone moves a vertex
    bone_names: tuple[str, ...]  # that the weights name
    bones: tuple[Bone, ...]  # all of the armature's, same space as the vertices
    metres: float = 1.0  # length of one unit


def check(target: TargetAvatar, name: str) -> str | None:
    """Refuse a mesh that no body can be fitted to; tell of one whose surface cannot be followed.

    Returns
    -------
    str or None
        Why it is no surface: it is in many pieces, or several sheets meet at its edges.

    Raises
    ------
    InputError
        It has no faces, holds something else than numbers, has no size or is not skinned.
    """
    if not len(target.triangles):
        raise InputError(f"Avatar '{name}' has no faces that a body could be fitted to.")
    if not np.isfinite(target.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(target.vertices).all(axis=1))[0])
        raise InputError(f"Avatar '{name}': the place of vertex {bad} is not a finite number.")
    from trimesh import Trimesh, geometry, grouping

    areas = areas_of(target.vertices, target.triangles)
    if not (np.isfinite(target.metres) and target.metres > 0.0 and areas.sum() > 0.0):
        raise InputError(f"Avatar '{name}' has no size: its scale is zero, or all faces are flat.")
    used = np.unique(target.triangles)
    bare = np.count_nonzero(np.diff(target.weights.offsets)[used] == 0)
    if bare > _UNSKINNED * len(used):
        raise InputError(
            f"Avatar '{name}': {bare} of its {len(used)} vertices follow no bone of the armature; "
            "parent it to the armature with weights first."
        )
    welded = weld(target.vertices)[target.triangles]
    pieces = connected_pieces(welded)
    shares = np.bincount(pieces, areas) / areas.sum()
    large = shares[shares >= _LARGE_PIECE].sum()
    if large < _LARGE_PIECES:
        return (
            f"'{name}' is in {len(shares)} pieces, of which the largest is only "
            f"{100 * shares.max():.2g} % of the surface (pieces of {100 * _LARGE_PIECE:.0f} % "
            f"must make {100 * _LARGE_PIECES:.0f} % at least)"
        )
    single = welded[Trimesh(target.vertices, welded, process=False).unique_faces()]
    if len(single) < (1.0 - _DOUBLED_FACES) * len(welded):
        single = welded
    ends = np.sort(geometry.faces_to_edges(single))
    ends = ends[ends[:, 0] != ends[:, 1]]
    counts = np.bincount(grouping.unique_rows(ends)[1])
    pinched = int(np.count_nonzero(counts > 2))
    if pinched > _PINCHED_EDGES * len(counts):
        return (
            f"'{name}' is not a surface: at {pinched} of its {len(counts)} edges more than two "
            "faces meet (non-manifold)"
        )
    return None


def faced_out(target: TargetAvatar) -> tuple[TargetAvatar, float]:
    """Turn faces that look inwards: those of pieces wound both ways, or all of a mesh that encloses
    a negative volume. Returns the share of the surface that was turned, 0..1, as well.
    """
    areas = areas_of(target.vertices, target.triangles)
    if not areas.sum() > 0.0:
        return target, 0.0
    whole = _volumes(target, areas, np.zeros(len(areas), np.int64))
    is_whole = whole.sum() < -_INSIDE_OUT * np.abs(whole).sum()
    found = replace(target, triangles=target.triangles[:, ::-1]) if is_whole else target
    inwards = _wound_inwards(found, areas)
    if areas[inwards].sum() > _TURNED * areas.sum():
        triangles = np.where(inwards[:, None], found.triangles[:, ::-1], found.triangles)
        return replace(target, triangles=triangles), float(
            areas[inwards != is_whole].sum() / areas.sum()
        )
    return found, float(is_whole)


def _wound_inwards(target: TargetAvatar, areas: F64) -> npt.NDArray[np.bool_]:
    """Find triangles (F,) that look inwards in connected pieces that are wound both ways."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    triangles, count = weld(target.vertices)[target.triangles], len(target.triangles)
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    forward = starts < ends
    edge = np.minimum(starts, ends) * len(target.vertices) + np.maximum(starts, ends)
    order = np.argsort(edge, kind="stable")
    first, uses = np.unique(edge[order], return_index=True, return_counts=True)[1:]
    one, other = (order[first[uses == 2] + k] for k in (0, 1))
    # A triangle is two nodes, as it is and turned; nodes are linked where the windings agree.
    against = np.where(forward[one] == forward[other], count, 0)
    rows = np.concatenate((one // 3, one // 3 + count))
    columns = np.concatenate((other // 3 + against, other // 3 + count - against))
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * count, 2 * count))
    labels = connected_components(graph, directed=False)[1].reshape(2, count)
    piece = labels.min(axis=0)
    turned = labels[0] != piece
    mixed = np.bincount(piece, turned) * np.bincount(piece, ~turned) > 0
    volumes = np.bincount(piece, _volumes(target, areas, piece) * np.where(turned, -1.0, 1.0))
    found: npt.NDArray[np.bool_] = (turned ^ (volumes < 0.0)[piece]) & mixed[piece]
    return found


def _volumes(target: TargetAvatar, areas: F64, piece: I64) -> F64:
    """Volume (F,), six times, of each triangle with the middle of its piece."""
    corners = target.vertices[target.triangles]
    weight = np.maximum(np.bincount(piece, areas), 1e-300)
    middles = [np.bincount(piece, areas * each) / weight for each in corners.mean(axis=1).T]
    a, b, c = np.moveaxis(corners - np.column_stack(middles)[piece][:, None], 1, 0)
    return np.einsum("fi,fi->f", a, np.cross(b, c))


def weld(points: F64) -> I64:
    """Index of the first point at the same place (many imported meshes are split at seams)."""
    from trimesh.grouping import unique_rows

    size = float(np.ptp(points, axis=0).max()) or 1.0
    first, place = unique_rows(points / size, digits=6)
    found: I64 = first[place]
    return found


def connected_pieces(triangles: I64) -> I64:
    """Connected piece of each triangle, numbered from 0."""
    from trimesh.geometry import faces_to_edges
    from trimesh.graph import connected_component_labels

    labels = connected_component_labels(faces_to_edges(triangles), int(triangles.max()) + 1)
    return np.unique(labels[triangles[:, 0]], return_inverse=True)[1].ravel().astype(np.int64)


def areas_of(points: F64, triangles: I64) -> F64:
    """Area of each triangle."""
    from trimesh.triangles import area

    found: F64 = area(points[triangles])
    return found


def group_shares(weights: SkinWeights, group_of: I64, groups: int) -> F64:
    """Skin weight of each vertex for groups of bones, (V, groups); rows sum to 1 or are 0.

    Parameters
    ----------
    group_of : (B,) int64
        Group of each bone; -1: none.
    """
    count = len(weights.offsets) - 1
    owners = np.repeat(np.arange(count), np.diff(weights.offsets))
    group = group_of[weights.bones]
    known = group >= 0
    flat = np.bincount(
        owners[known] * groups + group[known], weights.values[known], minlength=count * groups
    )
    shares = flat.reshape(count, groups)
    sums = shares.sum(axis=1, keepdims=True)
    found: F64 = np.divide(shares, sums, out=np.zeros_like(shares), where=sums > 0.0)
    return found


def owners_of(target: TargetAvatar, canonical: Mapping[str, str]) -> list[str | None]:
    """Canonical bone that stands for each bone of the weights.

    A bone that is not mapped (twist, helper) belongs to the nearest mapped bone above it, one
    that the mapped bones hang on to the root. None: it hangs loose, and says nothing.

    Parameters
    ----------
    canonical : mapping of the rig's bone to the canonical bone that it really is
    """
    parents = {bone.name: bone.parent for bone in target.bones}

    def upwards(name: str) -> Iterator[str]:
        at: str | None = name
        seen: set[str] = set()
        while at is not None and at not in seen:
            yield at
            seen.add(at)
            at = parents.get(at)

    carrying = {above for name in canonical for above in upwards(name)}
    found: list[str | None] = []
    for name in target.bone_names:
        mapped = next((at for at in upwards(name) if at in canonical), None)
        if mapped is not None:
            found.append(canonical[mapped])
        else:
            found.append("root" if name in carrying else None)
    return found
