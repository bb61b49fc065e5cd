# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of a body's skin at one time, and placements between two samples.

Between samples the origin of an object moves straight, its axes rotate about the origin by the
shortest way and stretch evenly, like keys of location, rotation and scale. A matrix is a rotation
after a symmetric stretch (polar decomposition; Shoemake and Duff, "Matrix animation and polar
decomposition", 1992).
"""

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
    """World positions (3, V) of a model's vertices on a body at a row; a cached read-only array."""
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
    """Points (3, N) under an affine matrix (4, 4) or (3, 4), as a new array."""
    transformed: F64 = matrix[:3, :3] @ points + matrix[:3, 3:]
    return transformed


def by_bones(model: PerceptualModel, bone_names: tuple[str, ...], bones: F64) -> F64:
    """Linear blend skinning: positions (3, V) in armature space.

    A vertex is the sum of ``w_b M_b p`` over the bones b, with matrices ``M_b`` (3, 4) from the
    rest pose and weights ``w_b`` normalised to sum 1 (Magnenat-Thalmann et al.,
    "Joint-dependent local deformations for hand animation and object grasping", 1988; Blender's
    Armature modifier). A vertex without weights stays at rest. Raises ValueError: a bone with
    weights is missing from the pose.
    """
    weights, count = model.weights, len(model)
    owner = np.repeat(np.arange(count), np.diff(weights.offsets))
    number = {name: k for k, name in enumerate(bone_names)}
    bone = np.array([number.get(name, -1) for name in model.bone_names], np.int64)[weights.bones]
    if (bone < 0).any():
        missing = {model.bone_names[b] for b in weights.bones[bone < 0].tolist()}
        raise ValueError(f"bones missing from the pose: {sorted(missing)}")
    values = weights.values.astype(np.float64)
    total = np.bincount(owner, values, count)
    rest = model.vertices.astype(np.float64)
    contributions = np.einsum("nij,nj->ni", bones[bone, :, :3], rest[owner]) + bones[bone, :, 3]
    blended = np.stack([np.bincount(owner, values * part, count) for part in contributions.T])
    is_moved = total > 0.0
    points: F64 = np.where(is_moved, blended / np.where(is_moved, total, 1.0), rest.T)
    return points


def on_surface(anchors: SurfaceAnchors, surface: npt.NDArray[np.float32]) -> F64:
    """Positions (3, V) of V vertices anchored to triangles of an avatar's evaluated mesh (A, 3),
    same space: barycentric point plus the offset along the triangle's unit normal; none for a
    degenerate triangle."""
    corners = surface.astype(np.float64)[anchors.corners]  # (V, 3, 3): vertex, corner, coordinate
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(lengths > 0.0, lengths, 1.0)
    points: F64 = np.einsum("vci,vc->vi", corners, anchors.weights)
    return (points + normals * anchors.offset_m[:, None]).T


def placement_between(before: F64, after: F64, share: float) -> F64:
    """Placement (4, 4) at a fraction 0..1 of the time: origin and stretch linear, rotation by the
    shortest way at constant speed."""
    turn, stretch = _polar(before[:3, :3])
    turn_after, stretch_after = _polar(after[:3, :3])
    matrix = (1.0 - share) * before + share * after
    axis, angle = _axis_angle(turn_after @ turn.T)
    stretch = (1.0 - share) * stretch + share * stretch_after
    matrix[:3, :3] = _rotation(axis, share * angle) @ turn @ stretch
    return matrix


def is_rotating(before: F64, after: F64) -> bool:
    """Test for a rotation by more than 1e-9 radians between two placements (4, 4); stretch and
    translation do not count."""
    relative = _polar(after[:3, :3])[0] @ _polar(before[:3, :3])[0].T
    return bool((before[:3, :3] != after[:3, :3]).any() and _axis_angle(relative)[1] > 1e-9)


def _polar(linear: F64) -> tuple[F64, F64]:
    """Rotation and symmetric stretch (3, 3) each of a linear map, in this order of factors; a
    reflection is part of the stretch."""
    # With A = U S V^T, the rotation is U V^T and the stretch V S V^T.
    u, sizes, vt = np.linalg.svd(linear)
    sign = 1.0 if np.linalg.det(u @ vt) > 0.0 else -1.0
    return sign * u @ vt, sign * vt.T @ np.diag(sizes) @ vt


def _axis_angle(turn: F64) -> tuple[F64, float]:
    """Unit axis (3,) and angle (0..pi) of a rotation matrix; without rotation any axis and 0."""
    skew = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (np.trace(turn) - 1.0)
    if sine < 1e-6:  # no rotation or half a turn: R + 1 is twice the axis times its transpose
        both = turn + np.eye(3)
        skew = both[:, np.argmax(np.einsum("ij,ij->j", both, both))]
    axis: F64 = skew / np.linalg.norm(skew)
    return axis, float(np.arctan2(sine, cosine))


def _rotation(axis: F64, angle: float) -> F64:
    """Rotation matrix (3, 3) about a unit axis by an angle, radians (Rodrigues' formula)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: F64 = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return turn
