# SPDX-License-Identifier: GPL-3.0-or-later
"""Canonical skeleton: MakeHuman's default rig with Blender's bone matrices."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.body.model import Skeleton

from .source import Source


def bone_order(rig: dict[str, Any]) -> tuple[str, ...]:
    """Bone names in depth-first order: parents before children, siblings in the file's order."""
    children: dict[str, list[str]] = {}
    for name, bone in rig.items():
        children.setdefault(bone["parent"], []).append(name)
    order: list[str] = []
    waiting = list(reversed(children[""]))
    while waiting:
        name = waiting.pop()
        order.append(name)
        waiting.extend(reversed(children.get(name, [])))
    return tuple(order)


def rest_matrix(head: F64, tail: F64, roll: float) -> F64:
    """Compute the rest matrix of a bone like Blender from an edit bone.

    The y axis is along the bone; x and z follow from the shortest rotation of +Y to this
    direction, then from ``roll`` about the bone.

    Parameters
    ----------
    head, tail : (3,) float64
    roll : float
        Radians.

    Returns (4, 4) float64: bone to armature space: ``bone.matrix_local``.
    """
    x, y, z = axis = (tail - head) / np.linalg.norm(tail - head)
    apart = x * x + z * z
    # Close to straight down 1 + y loses its digits, so Blender uses a series in x and z.
    along = 1.0 + y if 1.0 + y > 6.1e-3 else apart / 2.0 + apart**2 / 8.0
    if 1.0 + y > 6.1e-3 or apart > 2.5e-4**2:
        turn = np.array(
            [
                [1.0 - x * x / along, x, -x * z / along],
                [-x, y, -z],
                [-x * z / along, z, 1.0 - z * z / along],
            ]
        )
    else:
        turn = np.diag((-1.0, -1.0, 1.0))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rolled = (
        np.cos(roll) * np.eye(3)
        + np.sin(roll) * cross
        + (1.0 - np.cos(roll)) * np.outer(axis, axis)
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rolled @ turn
    matrix[:3, 3] = head
    return matrix


def make(source: Source, scale: float, ground_m: float) -> Skeleton:
    """Build the skeleton in rest space; heads and tails follow the shaped base mesh."""
    names = bone_order(source.rig)
    index = {name: number for number, name in enumerate(names)}
    rest = np.zeros((len(names), 4, 4))
    lengths = np.zeros(len(names))
    for number, name in enumerate(names):
        bone = source.rig[name]
        head = scale * joint(source, bone["head"]) - (0.0, 0.0, ground_m)
        tail = scale * joint(source, bone["tail"]) - (0.0, 0.0, ground_m)
        rest[number] = rest_matrix(head, tail, bone["roll"])
        lengths[number] = np.linalg.norm(tail - head)
    parents = [index.get(source.rig[name]["parent"], -1) for name in names]
    return Skeleton(
        bone_names=names,
        parents=np.array(parents, np.int32),
        rest=rest.astype(np.float32),
        lengths_m=lengths.astype(np.float32),
    )


def joint(source: Source, end: dict[str, Any]) -> F64:
    strategy = end["strategy"]
    if strategy == "CUBE":
        point = source.vertices[source.joints[end["cube_name"]]].mean(axis=0)
    elif strategy == "VERTEX":
        point = source.vertices[end["vertex_index"]]
    else:
        point = source.vertices[end["vertex_indices"]].mean(axis=0)
    return point
