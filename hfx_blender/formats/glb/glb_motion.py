# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion of glTF nodes: matrices as translation, rotation and scale, with keyframes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64, Bool
from .glb import TO_GLTF, Document

_TURN: Final = np.eye(4)
_TURN[:3, :3] = TO_GLTF


def to_gltf(matrices: F64) -> F64:
    """Convert matrices from a local space to our world, (T, 4, 4), to glTF's world."""
    return np.asarray(_TURN @ matrices)


def turned(matrices: F64) -> F64:
    """Convert transforms (T, 4, 4) within our space to glTF's space."""
    return np.asarray(_TURN @ matrices @ _TURN.T)


def move(document: Document, node: dict[str, Any], times_s: F64, placed: F64) -> Bool:
    """Add a node with matrices (T, 4, 4) at times, linear between; returns shear, (T,) bool.

    ``node`` gets the transform in place. Moving components become keyframes without shear. A node
    at rest keeps its matrix exactly and is never reported as sheared.
    """
    translations, rotations, scales, is_sheared = decomposed(placed)
    columns = {"translation": translations, "rotation": rotations, "scale": scales}
    moving = {path: column for path, column in columns.items() if _moves(column)}
    if not moving:
        node["matrix"] = placed[0].T.ravel().tolist()  # column by column
        is_sheared = np.zeros_like(is_sheared)
    else:
        node |= {path: column[0].tolist() for path, column in columns.items()}
    index = document.append("nodes", node)
    if moving:
        _animate(document, index, times_s, moving)
    return is_sheared


def _moves(column: F64) -> bool:
    """Test for a column that changes by more than 1e-7 of its magnitude."""
    return bool((np.ptp(column, axis=0) > 1e-7 * max(1.0, float(np.abs(column).max()))).any())


def decomposed(matrices: F64) -> tuple[F64, F64, F64, Bool]:
    """Translations (T, 3), quaternions x y z w (T, 4), scales (T, 3) and shear (T,) of matrices.

    Successive quaternions are on the same half sphere, so interpolation does not jump. Of a
    mirrored matrix the x scale is negative. Shear is True beyond 1e-4.
    """
    linear = matrices[:, :3, :3]
    scales = np.linalg.norm(linear, axis=1)
    scales[np.linalg.det(linear) < 0.0, 0] *= -1.0
    axes = linear / np.where(scales == 0.0, 1.0, scales)[:, None, :]
    products = axes.transpose(0, 2, 1) @ axes
    is_sheared = np.abs(products - np.eye(3)).max(axis=(1, 2)) > 1e-4
    left, _, right = np.linalg.svd(axes)  # the nearest rotation
    rotations = _quaternions(left @ right)
    flips = np.cumprod(np.where((rotations[1:] * rotations[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    rotations[1:] *= flips[:, None]
    return matrices[:, :3, 3], rotations, scales, is_sheared


def _quaternions(rotations: F64) -> F64:
    """Quaternions x, y, z, w of rotation matrices (T, 3, 3), w not negative.

    Largest eigenvector of a symmetric matrix (Bar-Itzhack, "New method for extracting the
    quaternion from a rotation matrix", 2000), stable for any rotation.
    """
    m = rotations
    xx, yy, zz = (m[:, k, k] for k in range(3))
    k = np.zeros((len(m), 4, 4))  # symmetric; eigh reads what is not above the diagonal
    k[:, 1, 0] = m[:, 1, 0] + m[:, 0, 1]
    k[:, 2, 0] = m[:, 2, 0] + m[:, 0, 2]
    k[:, 2, 1] = m[:, 2, 1] + m[:, 1, 2]
    k[:, 3, 0] = m[:, 2, 1] - m[:, 1, 2]
    k[:, 3, 1] = m[:, 0, 2] - m[:, 2, 0]
    k[:, 3, 2] = m[:, 1, 0] - m[:, 0, 1]
    diagonal = (xx - yy - zz, yy - xx - zz, zz - xx - yy, xx + yy + zz)
    k[:, range(4), range(4)] = np.stack(diagonal, axis=1)
    _, vectors = np.linalg.eigh(k)
    quaternions: F64 = vectors[:, :, -1]
    return quaternions * np.where(quaternions[:, 3:] < 0.0, -1.0, 1.0)


def _animate(document: Document, node: int, times_s: F64, columns: Mapping[str, F64]) -> None:
    """Add keyframes of a node to the scene's single animation."""
    values = np.hstack(list(columns.values()))
    # Keyframes within constant stretches are redundant; the ends of stretches are kept.
    keep = np.ones(len(times_s), np.bool_)
    keep[1:-1] = (values[1:-1] != values[:-2]).any(axis=1) | (values[1:-1] != values[2:]).any(
        axis=1
    )
    if "animations" not in document.json:
        document.append("animations", {"name": "Scene", "samplers": [], "channels": []})
    animation = document.json["animations"][0]
    clock = document.accessor(times_s[keep])
    for path, column in columns.items():
        output = document.accessor(column[keep])
        sampler = {"input": clock, "output": output, "interpolation": "LINEAR"}
        animation["samplers"].append(sampler)
        target = {"node": node, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})
