# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of a body's skin at one time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..arrays import F64
from ..body.model import PerceptualModel
from ..scene import PoseBlock, SkinBinding, SurfaceAnchors, SurfaceBinding


@lru_cache(maxsize=80)
def world_points(
    model: PerceptualModel, binding: SkinBinding | SurfaceBinding, pose: PoseBlock, row: int
) -> F64:
    """World positions of all vertices of a model on a body at one row of its pose, (3, V); kept,
    and not to be changed."""
    if isinstance(binding, SkinBinding):
        assert pose.bones is not None
        fitted = binding.fitted.get(model.id)
        placed = model if fitted is None else fitted.of(model)
        local = by_bones(placed, binding.bone_names, pose.bones[row])
    else:
        assert pose.surface is not None
        local = on_surface(binding.anchors[model.id], pose.surface[row])
    points = moved(pose.to_world[row], local)
    points.flags.writeable = False
    return points


def moved(matrix: F64, points: F64) -> F64:
    """Points (3, N) under an affine matrix (4, 4) or (3, 4)."""
    there: F64 = matrix[:3, :3] @ points + matrix[:3, 3:]
    return there


def by_bones(model: PerceptualModel, bone_names: tuple[str, ...], bones: F64) -> F64:
    """Linear blend skinning, (3, V) in the armature's space.

    A vertex is where its bones take it, each by its matrix (3, 4) from the rest pose, weighted:
    the sum of ``w_b M_b p`` over its bones b, the weights ``w_b`` made to sum to 1
    (Magnenat-Thalmann et al., "Joint-dependent local deformations for hand animation and object
    grasping", 1988; Blender's Armature modifier). A vertex that no bone moves stays at rest.

    Raises
    ------
    ValueError
        A bone that moves something is missing.
    """
    weights, count = model.weights, len(model)
    owner = np.repeat(np.arange(count), np.diff(weights.offsets))
    number = {name: k for k, name in enumerate(bone_names)}
    bone = np.array([number.get(name, -1) for name in model.bone_names], np.int64)[weights.bones]
    if (bone < 0).any():
        missing = {model.bone_names[each] for each in weights.bones[bone < 0].tolist()}
        raise ValueError(f"bones missing from the pose: {sorted(missing)}")
    values = weights.values.astype(np.float64)
    total = np.bincount(owner, values, count)
    rest = model.vertices.astype(np.float64)
    each = np.einsum("nij,nj->ni", bones[bone, :, :3], rest[owner]) + bones[bone, :, 3]
    blended = np.stack([np.bincount(owner, values * part, count) for part in each.T])
    is_moved = total > 0.0
    points: F64 = np.where(is_moved, blended / np.where(is_moved, total, 1.0), rest.T)
    return points


def on_surface(anchors: SurfaceAnchors, surface: npt.NDArray[np.float32]) -> F64:
    """Vertices that ride on the triangles of an avatar's evaluated mesh (A, 3), (3, V).

    Each keeps its barycentric place in its triangle, and its height above it along the unit normal.
    """
    corners = surface.astype(np.float64)[anchors.corners]  # (V, 3, 3): vertex, corner, coordinate
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    points: F64 = np.einsum("vci,vc->vi", corners, anchors.weights)
    return (points + normals * anchors.offset_m[:, None]).T
