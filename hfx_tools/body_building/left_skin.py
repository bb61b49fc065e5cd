# SPDX-License-Identifier: GPL-3.0-or-later
"""Left half of the skin: source of the thinned meshes, and samples for measuring errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64, I64, U8, Bool
from hfx_blender.engine.body.parts import CENTRE, RIGHT

from .joint_gradient import UNIFORM, JointGradient
from .meshes import mesh_edges
from .outer_skin import Skins

SAMPLES_ACROSS: Final = 7
"""Approximate number of sample points across one cell of skin."""

SOURCE_SPACING_M: Final = 0.002
"""Largest distance of neighbouring samples (Danieau et al. 2018: under 2 mm)."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Points spread evenly over the skin of the left half, each with its area of skin."""

    points: F64  # (S, 3)
    normals: F64  # (S, 3)
    areas_m2: F64  # (S,)
    part: U8  # (S,)
    vertex: I64  # (S,) near vertex of the medium half


@dataclass(frozen=True, eq=False)
class Half:
    """Left half of a mesh; its border is the midline at x = 0."""

    points: F64  # (V, 3)
    triangles: I64  # (F, 3)
    part: U8  # (V,)
    is_midline: Bool  # (V,)


@dataclass(frozen=True, eq=False)
class LeftSkin:
    """Left half of the skin: source of the thinned meshes, and reference for measurements."""

    medium: Half  # its vertices are the first of the dense half
    points: F64  # (V, 3) dense
    normals: F64  # (V, 3)
    quads: I64  # (F, 4) dense; the first corner of each is a vertex of the medium half
    source_ids: I64  # (V,) vertex of the whole dense skin

    @property
    def triangles(self) -> I64:
        """The dense quads split into triangles (2 F, 3)."""
        return _split(self.quads)


def _split(quads: I64) -> I64:
    return np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))


def left_of(skins: Skins, part: U8, side: U8) -> LeftSkin:
    """Cut the left half out of the skins; ``part`` and ``side`` label the dense vertices."""
    on_left = side != RIGHT
    left_ids = np.flatnonzero(on_left)
    renumber = np.full(len(side), -1, np.int64)
    renumber[left_ids] = np.arange(len(left_ids))
    quads, medium_quads = (
        renumber[faces[on_left[faces].all(axis=1)]]
        for faces in (skins.dense.faces, skins.medium_faces)
    )
    points = skins.dense.vertices[left_ids]
    triangles = _split(quads)
    facing = mesh_edges.triangle_normals(points, triangles)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], facing)
    is_midline = side[left_ids] == CENTRE
    normals[is_midline, 0] = 0.0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    count = int(medium_quads.max()) + 1
    medium = Half(points[:count], _split(medium_quads), part[left_ids[:count]], is_midline[:count])
    return LeftSkin(medium, points, normals, quads, left_ids)


def sample(skin: LeftSkin, spacing_m: F64, gradient: JointGradient = UNIFORM) -> Samples:
    """Sample points in a regular grid on every quad, fine enough for the local spacing.

    ``spacing_m`` (parts,) float64.
    """
    quads = skin.quads
    vertex = quads[:, 0]
    part = skin.medium.part[vertex]
    corners, corner_normals = skin.points[quads], skin.normals[quads]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1
    )
    sides = np.sqrt(areas)
    local_m = spacing_m[part] * gradient.relative(skin.points[vertex], part)
    divisions = np.maximum(
        np.rint(sides * SAMPLES_ACROSS / local_m), np.ceil(sides / SOURCE_SPACING_M)
    ).astype(int)
    pieces: list[tuple[F64, F64, F64, I64]] = []
    for division in np.unique(divisions):
        chosen = np.flatnonzero(divisions == division)
        steps = (np.arange(division) + 0.5) / division
        for u in steps:
            for v in steps:
                share = np.array([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
                pieces.append(
                    (
                        np.einsum("k,nkd->nd", share, corners[chosen]),
                        np.einsum("k,nkd->nd", share, corner_normals[chosen]),
                        areas[chosen] / division**2,
                        vertex[chosen],
                    )
                )
    points, facing, sizes, vertices = (
        np.concatenate(columns) for columns in zip(*pieces, strict=True)
    )
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    return Samples(points, facing, sizes, skin.medium.part[vertices], vertices)
