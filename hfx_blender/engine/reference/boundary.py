# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest place of a volume's boundary to places inside, as it is in the world.

A convex volume is where each of its supporting planes says it is. The distance of a place inside to
the plane with the normal w is ``H(w) - w . x``, H the volume's support function (Schneider, "Convex
Bodies: The Brunn-Minkowski Theory", section 1.7), and the depth is the least of these over all w.
Under a placing matrix A a plane with the normal w gets the normal ``A^-T w``: so in the world the
distance is ``(H(w) - w . x) / |A^-T w|``, H and x still in shape space.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import F64
from ..volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ..volume.mesh import MeshVolume
from ..volume.shape import Shape
from .pose import moved
from .shapes import contains, nearest_on_triangles

_STARTS: Final = 256  # directions that are tried first
_KEPT: Final = 4  # of them, from which the least is searched
_ROUNDS: Final = 16  # each halves the step, so that its square is rounding in the end


def nearest(shape: Shape, points: F64, to_world: F64) -> tuple[F64, F64, F64]:
    """Nearest places of the boundary, outward unit normals there, and distances.

    Parameters
    ----------
    shape : Shape
    points : (3, N) float64
        Inside, shape space.
    to_world : (4, 4) float64
        Placing matrix.

    Returns
    -------
    places, normals : (3, N) float64
        World space. Where several places are equally near, one of them.
    depths : (N,) float64
        Metres; 0 for points outside.
    """
    world, inside = moved(to_world, points), contains(shape, points)
    if isinstance(shape, MeshVolume):
        corners = moved(to_world, shape.corners.reshape(-1, 3).T).T.reshape(-1, 3, 3)
        places, squared = nearest_on_triangles(corners, world)
        depths = np.sqrt(squared)
        normals = (places - world) / np.where(depths > 0.0, depths, 1.0)
    else:
        directions = _nearest_plane(shape, points, to_world)
        normals = np.linalg.inv(to_world[:3, :3]).T @ directions
        normals /= np.linalg.norm(normals, axis=0)
        depths = np.maximum(_distances(shape, points, to_world, directions), 0.0)
        places = world + normals * depths
    return places, normals, np.where(inside, depths, 0.0)


def support(shape: Shape, directions: F64) -> F64:
    """Largest ``w . x`` of any x in a convex shape, for directions w (3, ...)."""
    x, y, z = np.abs(directions)
    if isinstance(shape, Cuboid):
        return np.asarray(x + y + z)
    if isinstance(shape, Cylinder):
        return np.asarray(np.hypot(x, y) + z)
    assert isinstance(shape, Sphere | Capsule)
    half = shape.half_segment if isinstance(shape, Capsule) else 0.0
    return np.asarray(np.sqrt(x * x + y * y + z * z) + half * z)


def _distances(shape: Shape, points: F64, to_world: F64, directions: F64) -> F64:
    """World distances of points (3, N) to the planes with normals ``directions`` (3, N, ...)."""
    stretched = np.tensordot(np.linalg.inv(to_world[:3, :3]).T, directions, 1)
    more = directions.ndim - points.ndim
    along = (directions * points.reshape(*points.shape, *[1] * more)).sum(axis=0)
    found: F64 = (support(shape, directions) - along) / np.sqrt(np.square(stretched).sum(axis=0))
    return found


def _nearest_plane(shape: Shape, points: F64, to_world: F64) -> F64:
    """Normals (3, N) of the nearest supporting planes, shape space.

    H has kinks at faces, where the least may lie: along the axes for a cuboid and for caps, all
    round for the side of a cylinder or capsule. Elsewhere it is smooth.
    """
    count, candidates = points.shape[1], []
    if isinstance(shape, Cuboid | Cylinder):
        faces = np.concatenate([np.eye(3), -np.eye(3)], axis=1)
        faces = faces if isinstance(shape, Cuboid) else faces[:, [2, 5]]
        candidates.append(np.repeat(faces[:, None], count, axis=1))
    if isinstance(shape, Cylinder | Capsule):
        angles = 2.0 * np.pi * np.arange(_STARTS) / _STARTS
        round_z = np.stack([np.cos(angles), np.sin(angles), np.zeros(_STARTS)])
        candidates.append(_searched(shape, points, to_world, round_z, is_flat=True))
    if isinstance(shape, Sphere | Capsule):
        candidates.append(_searched(shape, points, to_world, _directions(), is_flat=False))
    every = np.concatenate(candidates, axis=2)
    best = _distances(shape, points, to_world, every).argmin(axis=1)
    found: F64 = every[:, np.arange(count), best]
    return found


def _directions() -> F64:
    """Directions spread evenly over the sphere along a spiral (Vogel, 1979), (3, S)."""
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_STARTS)
    height = 1.0 - (2.0 * np.arange(_STARTS) + 1.0) / _STARTS
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height])


def _searched(shape: Shape, points: F64, to_world: F64, starts: F64, *, is_flat: bool) -> F64:
    """Local minima (3, N, K) near the best starts: from each one, steps across it that shrink.

    Starts are taken evenly in shape space and evenly in the world, where the shape may be a needle.
    """
    in_world = to_world[:3, :3].T @ starts
    if is_flat:  # seen along the axis
        in_world = np.linalg.svd(np.linalg.inv(to_world[:3, :3])[:2].T, full_matrices=False)
        in_world = np.linalg.inv(np.diag(in_world[1]) @ in_world[2]) @ starts[:2]
        in_world = np.concatenate([in_world, np.zeros((1, _STARTS))])
    starts = np.concatenate([starts, in_world / np.linalg.norm(in_world, axis=0)], axis=1)
    every = np.repeat(starts[:, None], points.shape[1], axis=1)
    order = np.argsort(_distances(shape, points, to_world, every), axis=1)[:, :_KEPT]
    here = starts[:, order]  # (3, N, K)
    step = 4.0 / np.sqrt(_STARTS)
    for _ in range(_ROUNDS):
        step *= 0.5
        for _ in range(2):
            here = _moved_to_least(shape, points, to_world, here, step, is_flat)
    return here


def _moved_to_least(
    shape: Shape, points: F64, to_world: F64, here: F64, step: float, is_flat: bool
) -> F64:
    """Best of some directions (3, N, K) and of those a step aside from them."""
    axis = np.zeros_like(here)
    axis[2] = 1.0
    if not is_flat:
        steep = np.abs(here[2]) > 0.9
        axis[0, steep], axis[2, steep] = 1.0, 0.0
    one = np.cross(axis, here, axis=0)
    one /= np.linalg.norm(one, axis=0)
    aside = [one] if is_flat else [one, np.cross(here, one, axis=0)]
    tried = [here, *(here + sign * step * each for each in aside for sign in (1.0, -1.0))]
    tried = [each / np.linalg.norm(each, axis=0) for each in tried]
    found = np.stack([_distances(shape, points, to_world, each) for each in tried])
    best = found.argmin(axis=0)
    chosen: F64 = np.take_along_axis(np.stack(tried), best[None, None], 0)[0]
    return chosen
