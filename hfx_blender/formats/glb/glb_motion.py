# SPDX-License-Identifier: GPL-3.0-or-later
"""Motion of glTF nodes: matrices as translation, rotation and scale, and their keyframes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ...engine.arrays import F64, Bool
from .glb import TO_GLTF, Document

_TURN: Final = np.eye(4)
_TURN[:3, :3] = TO_GLTF


def to_gltf(matrices: F64) -> F64:
    """Placing matrices from their own space to our world, (T, 4, 4), to glTF's world."""
    return np.asarray(_TURN @ matrices)


def turned(matrices: F64) -> F64:
    """Transforms (T, 4, 4) of our space as those of glTF's space."""
    return np.asarray(_TURN @ matrices @ _TURN.T)


def move(document: Document, node: dict[str, Any], times_s: F64, placed: F64) -> Bool:
    """Add a node that has these matrices (T, 4, 4) at these times, linear in between.

    ``node`` gets its transform and is added; what of it moves is in the scene's animation.

    Returns
    -------
    (T,) bool
        Sheared: a moving node cannot be. A resting one keeps its matrix as it is.
    """
    translations, rotations, scales, is_sheared = decomposed(placed)
    columns = {"translation": translations, "rotation": rotations, "scale": scales}
    moving = {path: each for path, each in columns.items() if _moves(each)}
    if not moving:
        node["matrix"] = placed[0].T.ravel().tolist()  # column by column
        is_sheared = np.zeros_like(is_sheared)
    else:
        node |= {path: each[0].tolist() for path, each in columns.items()}
    index = document.append("nodes", node)
    if moving:
        _animate(document, index, times_s, moving)
    return is_sheared


def _moves(column: F64) -> bool:
    return bool((np.ptp(column, axis=0) > 1e-7 * max(1.0, float(np.abs(column).max()))).any())


def decomposed(matrices: F64) -> tuple[F64, F64, F64, Bool]:
    """Translations (T, 3), rotations (T, 4) x y z w without jumps, scales (T, 3), sheared (T,)."""
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
    """Quaternions x, y, z, w of rotation matrices (T, 3, 3), by the eigenvector."""
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
    found: F64 = vectors[:, :, -1]
    return found * np.where(found[:, 3:] < 0.0, -1.0, 1.0)


def _animate(document: Document, node: int, times_s: F64, columns: Mapping[str, F64]) -> None:
    """Add keyframes to the scene's one animation."""
    values = np.hstack(list(columns.values()))
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
