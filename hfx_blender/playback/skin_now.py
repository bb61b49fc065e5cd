# SPDX-License-Identifier: GPL-3.0-or-later
"""The skins of avatars as they are shown now: read once for all that is drawn over them."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
Numbers = npt.NDArray[np.integer]

_VERTICES_STAY_FIRST = frozenset({"SUBSURF", "MULTIRES", "SOLIDIFY", "MIRROR", "ARRAY"})
"""Modifiers that add vertices behind those of the mesh."""


class Skin:
    """One mesh at this moment."""

    def __init__(self, evaluated: bpy.types.Object, size: int) -> None:
        data = evaluated.data
        self.size = size
        count = len(data.vertices)
        self._at, self._outward = np.empty(count * 3, np.float32), np.empty(count * 3, np.float32)
        data.attributes["position"].data.foreach_get("vector", self._at)
        data.vertex_normals.foreach_get("vector", self._outward)
        self._at, self._outward = self._at.reshape(-1, 3), self._outward.reshape(-1, 3)
        self._matrix = np.array(evaluated.matrix_world, np.float32)
        inverse = evaluated.matrix_world.to_3x3().inverted_safe()
        self._inverse = np.array(inverse, np.float32)

    def at(self, vertices: Numbers) -> tuple[F32, F32]:
        """Positions and unit normals (N, 3) of some vertices, world space, Blender's units."""
        at = self._at.take(vertices, axis=0) @ self._matrix[:3, :3].T
        at += self._matrix[:3, 3]
        outward = self._outward.take(vertices, axis=0) @ self._inverse
        lengths = np.sqrt(np.einsum("ij,ij->i", outward, outward))
        outward /= np.maximum(lengths, np.float32(1e-12))[:, None]
        return at, outward


class Skins:
    """Skins by mesh, kept until something moves."""

    def __init__(self) -> None:
        self._known: dict[str, Skin] = {}

    def touch(self) -> None:
        """Something moved."""
        self._known.clear()

    def of(self, mesh: bpy.types.Object, graph: bpy.types.Depsgraph) -> Skin | None:
        """The skin of a mesh; None where it is not shown."""
        if not mesh.visible_get() or mesh.mode != "OBJECT":
            return None
        key = mesh.name_full
        if key not in self._known:
            size = len(mesh.data.vertices)
            evaluated = mesh.evaluated_get(graph)
            if len(evaluated.data.vertices) != size and not _only_adds(mesh, evaluated):
                evaluated = mesh  # the cage, which at least is coloured
            self._known[key] = Skin(evaluated, size)
        return self._known[key]


def _only_adds(mesh: bpy.types.Object, evaluated: bpy.types.Object) -> bool:
    made = {each.type for each in mesh.modifiers if each.show_viewport and each.type != "ARMATURE"}
    return len(evaluated.data.vertices) > len(mesh.data.vertices) and made <= _VERTICES_STAY_FIRST


def triangles_of(mesh: bpy.types.Object) -> npt.NDArray[np.int32]:
    """A mesh's triangles, (3, F)."""
    data = mesh.data
    if not len(data.loop_triangles):
        data.calc_loop_triangles()
    corners = np.zeros(len(data.loop_triangles) * 3, np.int32)
    data.loop_triangles.foreach_get("vertices", corners)
    return np.ascontiguousarray(corners.reshape(-1, 3).T)
