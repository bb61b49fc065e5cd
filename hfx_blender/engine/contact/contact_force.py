# SPDX-License-Identifier: GPL-3.0-or-later
"""Forces of volumes and surfaces on skin inside: Kelvin-Voigt contact with Coulomb friction.

Penalty method of haptic rendering: a spring and a damper side by side (K. L. Johnson, "Contact
Mechanics", 1985, section 6.4) push a vertex out along the normal of the nearest boundary point, and
friction opposes its motion along the boundary. With the depth d, the velocity v of the skin
relative to the object, and the outward normal n::

    normal   = max(0, stiffness d - damping v.n)        no adhesion
    friction = -min(1, |t| / 1 mm/s) friction normal t / |t|,  t = v - (v.n) n
"""

from typing import Final

import numpy as np

from ..arrays import F32, F64, I32, I64
from ..response_filters.controls import ContactLaw
from ..scene import EffectBlock, HapticSurface, PoseBlock
from ..skin.cell_coverage import BodySkin
from ..texture.contact_path import ContactPaths
from ..volume.mesh_distance import NearestPlaces
from ..volume.nearest_surface import nearest_surface
from .contact_query import Contacts

_STRAIGHT: Final = 0.99  # least cosine between the way to a nearest place and the normal there
_SLIDING_M_S: Final = 1e-3
"""Speed of full friction; below, friction is proportional to the speed and cannot chatter."""


def contact_forces(
    law: ContactLaw,
    animated: EffectBlock,
    hits: Contacts,
    skin: BodySkin,
    pose: PoseBlock,
    steps_s: F64,
) -> F32:
    """Forces on the skin (total, 3) of a volume's contacts with details, world space, newtons,
    times the level of the effect. ``steps_s`` (T,): time since the row before, over which
    velocities are backward differences; 0 where the volume was off, or the pose unknown: no
    velocity."""
    assert animated.matrices is not None and hits.details is not None
    forces = np.zeros((3, len(hits.vertices)))
    for row, start, stop in zip(hits.rows.tolist(), hits.offsets, hits.offsets[1:], strict=False):
        part = slice(int(start), int(stop))
        places, matrix = hits.details.places[:, part], animated.matrices[row]
        shape = animated.shapes[int(animated.shapes_at(np.array([row]))[0])]
        _, normals = nearest_surface(shape, places, matrix)
        # The point of the volume at the place of contact moves with the volume.
        turned = matrix - animated.matrices[row - 1]
        carried = turned[:3, :3] @ places + turned[:3, 3:]
        velocities = _velocities(hits.vertices[part], skin, pose, row, carried, steps_s[row])
        pushed = force(law, shape.depth_m(places, matrix), velocities, normals)
        forces[:, part] = min(max(float(animated.levels[row]), 0.0), 1.0) * pushed
    return np.ascontiguousarray(forces.T, np.float32)


def surface_forces(
    surface: HapticSurface,
    animated: EffectBlock,
    paths: ContactPaths,
    rows: I64,
    skin: BodySkin,
    pose: PoseBlock,
    steps_s: F64,
) -> F32:
    """Forces on the skin (contacts, 3) of a surface, as :func:`contact_forces`; 0 for carried
    contacts, and in front of the surface. ``rows`` (n,) are the times of the paths. Depth is the
    way from the triangle, against its normal."""
    assert surface.law is not None and animated.matrices is not None
    forces = np.zeros((3, len(paths)))
    for k in np.unique(paths.time[paths.carried :]).tolist():
        part, row = np.flatnonzero(paths.time == k), int(rows[k])
        ids, weights = paths.ids[part].astype(np.int32), paths.weights[part]
        triangle, corners = paths.triangle[part], _corners(surface, animated, row)
        points = skin.vertices.points(ids, pose, row, pose.to_world[row])
        depths, normals = _depths(surface, animated, row, triangle, weights, points)
        before = _corners(surface, animated, row - 1)[triangle]
        carried = np.einsum("nk,nkc->cn", weights, corners[triangle] - before)
        velocities = _velocities(ids, skin, pose, row, carried, steps_s[row])
        pushed = np.where(depths > 0.0, force(surface.law, depths, velocities, normals), 0.0)
        forces[:, part] = min(max(float(animated.levels[row]), 0.0), 1.0) * pushed
    return np.ascontiguousarray(forces.T, np.float32)


def is_deep(
    surface: HapticSurface, animated: EffectBlock, row: int, points: F64, places: NearestPlaces
) -> bool:
    """Test for a point (n, 3), in world space, behind a surface and beyond its reach.

    ``places`` are the nearest places of all n points. A point beside the surface does not count:
    the way to its place at the boundary is oblique.
    """
    depths, _ = _depths(surface, animated, row, places.triangle, places.weights, points.T)
    is_behind = depths >= _STRAIGHT * places.distance
    return bool((is_behind & (places.distance > surface.reach_m)).any())


def _depths(
    surface: HapticSurface,
    animated: EffectBlock,
    row: int,
    triangle: I64,
    weights: F64,
    points: F64,
) -> tuple[F64, F64]:
    """Depths (n,) of points (3, n) behind their triangles, 0 in front, and normals (3, n)."""
    assert animated.matrices is not None
    corners = _corners(surface, animated, row)
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # A mirrored object turns its triangles, but not its outside.
    facing *= np.sign(np.linalg.det(animated.matrices[row, :3, :3]))
    means = np.zeros((int(surface.triangles.max()) + 1, 3))
    for corner in surface.triangles.T:
        np.add.at(means, corner, facing)
    offsets = points - np.einsum("nk,nkc->cn", weights, corners[triangle])
    normals = facing[triangle].T / np.linalg.norm(facing[triangle], axis=1)
    depths = np.maximum(-np.einsum("in,in->n", offsets, normals), 0.0)
    # At an edge the normal of one triangle cannot tell the sides, the mean at its ends can.
    mean = np.einsum("nk,nkc->cn", weights, means[surface.triangles[triangle]])
    depths[np.einsum("in,in->n", offsets, mean) >= 0.0] = 0.0
    return depths, normals


def _corners(surface: HapticSurface, animated: EffectBlock, row: int) -> F64:
    """Corners (F, 3, 3) of a surface's triangles at a row, world space."""
    assert animated.matrices is not None and animated.vertices is not None
    matrix, vertices = animated.matrices[row], animated.vertices
    points = vertices[row if len(vertices) > 1 else 0] @ matrix[:3, :3].T + matrix[:3, 3]
    return np.asarray(points[surface.triangles])


def _velocities(
    ids: I32, skin: BodySkin, pose: PoseBlock, row: int, carried: F64, step_s: float
) -> F64:
    """Velocities (3, N) of vertices relative to touched points, which moved by ``carried`` (3, N)
    since the row before; 0 without a step."""
    if not step_s > 0.0:
        return np.zeros_like(carried)
    now, before = (skin.vertices.points(ids, pose, k, pose.to_world[k]) for k in (row, row - 1))
    return np.asarray((now - before - carried) / step_s)


def force(law: ContactLaw, depths_m: F64, velocities: F64, normals: F64) -> F64:
    """Forces on points (3, N), newtons, from depths (N,), velocities relative to the volume (3, N)
    in m/s and outward unit normals (3, N)."""
    outward = np.einsum("in,in->n", velocities, normals)
    pushed = np.maximum(law.stiffness_n_m * depths_m - law.damping_n_s_m * outward, 0.0)
    along = velocities - outward * normals
    # Division by at least the sliding speed gives both branches of the friction.
    speeds = np.maximum(np.sqrt(np.einsum("in,in->n", along, along)), _SLIDING_M_S)
    return np.asarray(pushed * (normals - law.friction * along / speeds))
