# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's avatar for retargeting: mesh, weights, bones, and checks of the mesh."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64, I64
from ..body.model import SkinWeights
from ..body.rigs.rig import RigBone, upwards
from ..volume.mesh_topology import winding_groups

# Smallest fraction of the surface of a large connected piece (hand, shoe, sleeve)
_LARGE_PIECE: Final = 0.01
# Smallest total fraction of large pieces; the rest may be eyes, lashes, buttons
_LARGE_PIECES: Final = 0.5
_PINCHED_EDGES: Final = 0.01  # largest fraction of edges with more than two triangles
# Largest fraction of duplicate faces (both sides of lashes and eyelids)
_DOUBLED_FACES: Final = 0.1
# Negative fraction of a mesh's volume that means inside out; about 0 for open sheets
_INSIDE_OUT: Final = 0.1
# Smallest fraction of the surface facing inwards for which single faces are flipped
_TURNED: Final = 0.02
# Largest distance of a vertex from the middle, by the median distance; welding is by the whole size
_STRAY: Final = 1000.0
_UNSKINNED: Final = 0.2  # largest fraction of vertices without a weight


@dataclass(frozen=True, eq=False)
class TargetAvatar:
    """Avatar in the rest space and unit of its own armature."""

    vertices: F64  # (A, 3)
    triangles: I64  # (F, 3) counter-clockwise seen from outside
    weights: SkinWeights  # rows may be empty
    bone_names: tuple[str, ...]  # bones of the weights
    bones: tuple[RigBone, ...]  # all bones of the armature, same space as the vertices
    metres: float = 1.0  # metres per unit


def check(target: TargetAvatar, name: str) -> str | None:
    """Fault of a mesh without a continuous surface (stray vertices, many pieces, non-manifold
    edges), or None. Raises InputError: the mesh has no faces, no size, non-finite coordinates, or
    mostly unweighted vertices."""
    if not len(target.triangles):
        raise InputError(f"Avatar '{name}' has no faces that a body could be fitted to.")
    if not np.isfinite(target.vertices).all():
        vertex = int(np.flatnonzero(~np.isfinite(target.vertices).all(axis=1))[0])
        raise InputError(f"Avatar '{name}': the place of vertex {vertex} is not a finite number.")
    from trimesh import Trimesh, geometry, grouping

    areas = areas_of(target.vertices, target.triangles)
    if not (np.isfinite(target.metres) and target.metres > 0.0 and areas.sum() > 0.0):
        raise InputError(f"Avatar '{name}' has no size: its scale is zero, or all faces are flat.")
    used = np.unique(target.triangles)
    unweighted = np.count_nonzero(np.diff(target.weights.offsets)[used] == 0)
    if unweighted > _UNSKINNED * len(used):
        raise InputError(
            f"Avatar '{name}': {unweighted} of its {len(used)} vertices follow no bone of the "
            "armature; parent it to the armature with weights first."
        )
    away = np.abs(target.vertices - np.median(target.vertices, axis=0)).max(axis=1)
    if away.max() > _STRAY * np.median(away):
        vertex, far = int(away.argmax()), away.max() * target.metres
        return f"vertex {vertex} of '{name}' lies {far:.3g} m away from the middle of the mesh"
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
    # Doubled faces (two-sided lashes) are counted once, unless the whole mesh is doubled.
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
    """Flip inward faces; return the target and the flipped fraction of the surface, 0..1. Flips all
    faces of a mesh of negative volume, and inward faces of pieces of mixed winding."""
    areas = areas_of(target.vertices, target.triangles)
    if not areas.sum() > 0.0:
        return target, 0.0
    # A closed mesh of outward faces has positive volume; open sheets enclose about none.
    whole = _volumes(target, areas, np.zeros(len(areas), np.int64))
    is_inside_out = whole.sum() < -_INSIDE_OUT * np.abs(whole).sum()
    oriented = replace(target, triangles=target.triangles[:, ::-1]) if is_inside_out else target
    inwards = _wound_inwards(oriented, areas)
    if areas[inwards].sum() > _TURNED * areas.sum():
        triangles = np.where(inwards[:, None], oriented.triangles[:, ::-1], oriented.triangles)
        # Faces flipped twice are as before.
        return replace(target, triangles=triangles), float(
            areas[inwards != is_inside_out].sum() / areas.sum()
        )
    return oriented, float(is_inside_out)


def _wound_inwards(target: TargetAvatar, areas: F64) -> npt.NDArray[np.bool_]:
    """Mask (F,) of triangles pointing inwards, in connected pieces with both windings only."""
    labels = winding_groups(weld(target.vertices)[target.triangles])
    piece = labels.min(axis=0)
    is_turned = labels[0] != piece
    is_mixed = np.bincount(piece, is_turned) * np.bincount(piece, ~is_turned) > 0
    # A piece with a negative volume points inwards.
    volumes = np.bincount(piece, _volumes(target, areas, piece) * np.where(is_turned, -1.0, 1.0))
    return np.asarray((is_turned ^ (volumes < 0.0)[piece]) & is_mixed[piece])


def _volumes(target: TargetAvatar, areas: F64, piece: I64) -> F64:
    """Six times the signed volume (F,) of each triangle's tetrahedron with its piece's centroid;
    positive if it faces away. ``piece`` (F,) numbers the pieces."""
    corners = target.vertices[target.triangles]
    weight = np.maximum(np.bincount(piece, areas), 1e-300)
    middles = [np.bincount(piece, areas * column) / weight for column in corners.mean(axis=1).T]
    a, b, c = np.moveaxis(corners - np.column_stack(middles)[piece][:, None], 1, 0)
    return np.einsum("fi,fi->f", a, np.cross(b, c))


def weld(points: F64) -> I64:
    """Index (N,) of the first point with equal coordinates, to a millionth of the size (imported
    meshes are split at seams)."""
    from trimesh.grouping import unique_rows

    size = float(np.ptp(points, axis=0).max()) or 1.0
    first, group = unique_rows(points / size, digits=6)
    return np.asarray(first[group])


def connected_pieces(triangles: I64) -> I64:
    """Number (F,) of the connected piece of each triangle, from 0; pieces share no vertex."""
    from trimesh.geometry import faces_to_edges
    from trimesh.graph import connected_component_labels

    labels = connected_component_labels(faces_to_edges(triangles), int(triangles.max()) + 1)
    return np.unique(labels[triangles[:, 0]], return_inverse=True)[1].ravel().astype(np.int64)


def areas_of(points: F64, triangles: I64) -> F64:
    """Area (F,) of each triangle, in the squared unit of ``points``."""
    from trimesh.triangles import area

    return np.asarray(area(points[triangles]))


def vertex_areas(points: F64, triangles: I64) -> F64:
    """Area (V,) of each vertex: a third of all its triangles; 0 without any."""
    thirds = np.repeat(areas_of(points, triangles) / 3.0, 3)
    return np.bincount(triangles.ravel(), thirds, minlength=len(points)).astype(np.float64)


def weight_matrix(weights: SkinWeights, bones: int) -> Any:
    """Skin weights of V vertices as a sparse matrix (V, bones)."""
    from scipy.sparse import csr_array

    shape = (len(weights.offsets) - 1, bones)
    return csr_array(
        (weights.values.astype(np.float64), weights.bones, weights.offsets), shape=shape
    )


def group_shares(weights: SkinWeights, group_of: I64, groups: int) -> F64:
    """Skin weights (V, groups) summed by groups of bones; rows sum to 1 or are 0. ``group_of`` (B,)
    is the group of each bone, -1 for none."""
    is_of_group = group_of[:, None] == np.arange(groups)
    shares = np.asarray(weight_matrix(weights, len(group_of)) @ is_of_group.astype(np.float64))
    sums = shares.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(shares, sums, out=np.zeros_like(shares), where=sums > 0.0))


def with_ancestors(parents: Mapping[str, str | None], names: Iterable[str]) -> set[str]:
    """Bones and all their ancestors."""
    return {bone for name in names for bone in upwards(parents, name)}


def owners_of(target: TargetAvatar, canonical: Mapping[str, str]) -> list[str | None]:
    """Canonical bone of each bone in ``target.bone_names``; ``canonical`` maps bones of the rig.
    Bones without mapping (twists, helpers) take the nearest mapped ancestor; ancestors of mapped
    bones take the root; None for bones outside of the body's hierarchy."""
    parents = {bone.name: bone.parent for bone in target.bones}
    ancestors = with_ancestors(parents, canonical)
    owners: list[str | None] = []
    for name in target.bone_names:
        mapped = next((bone for bone in upwards(parents, name) if bone in canonical), None)
        if mapped is not None:
            owners.append(canonical[mapped])
        else:
            owners.append("root" if name in ancestors else None)
    return owners
