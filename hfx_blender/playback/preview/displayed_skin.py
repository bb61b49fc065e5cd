# SPDX-License-Identifier: GPL-3.0-or-later
"""Displayed skins of avatars, read once for everything that is drawn over them."""

from __future__ import annotations

import bpy
import numpy as np
import numpy.typing as npt

_VERTICES_STAY_FIRST = frozenset({"SUBSURF", "MULTIRES", "SOLIDIFY", "MIRROR", "ARRAY"})
"""Modifiers that add vertices behind those of the mesh."""


class DisplayedSkin:
    """Skin of one mesh at this moment.

    Attributes
    ----------
    size : int
        How many vertices it has before modifiers add any.
    positions, normals : (V, 3) float32
        In the mesh's own space, Blender's units; the first ``size`` are those of the mesh.
    world : mathutils.Matrix
        From there to the world.
    """

    def __init__(self, evaluated: bpy.types.Object, size: int) -> None:
        data = evaluated.data
        self.size = size
        count = len(data.vertices)
        positions, normals = np.empty(count * 3, np.float32), np.empty(count * 3, np.float32)
        data.attributes["position"].data.foreach_get("vector", positions)
        data.vertex_normals.foreach_get("vector", normals)
        self.positions, self.normals = positions.reshape(-1, 3), normals.reshape(-1, 3)
        self.world = evaluated.matrix_world.copy()


class DisplayedSkins:
    """Skins by mesh, cached until something moves."""

    def __init__(self) -> None:
        self._known: dict[str, DisplayedSkin] = {}

    def touch(self) -> None:
        """Invalidate the skins: something moved."""
        self._known.clear()

    def of(self, mesh: bpy.types.Object, graph: bpy.types.Depsgraph) -> DisplayedSkin | None:
        """Skin of a mesh; None where the mesh is not displayed."""
        if not mesh.visible_get() or mesh.mode != "OBJECT":
            return None
        key = mesh.name_full
        if key not in self._known:
            size = len(mesh.data.vertices)
            evaluated = mesh.evaluated_get(graph)
            if len(evaluated.data.vertices) != size and not _only_adds(mesh, evaluated):
                evaluated = mesh  # the cage, which at least is coloured
            self._known[key] = DisplayedSkin(evaluated, size)
        return self._known[key]


def _only_adds(mesh: bpy.types.Object, evaluated: bpy.types.Object) -> bool:
    made = {each.type for each in mesh.modifiers if each.show_viewport and each.type != "ARMATURE"}
    return len(evaluated.data.vertices) > len(mesh.data.vertices) and made <= _VERTICES_STAY_FIRST


def triangles_of(mesh: bpy.types.Object) -> npt.NDArray[np.int32]:
    """A mesh's triangles, (F, 3)."""
    data = mesh.data
    if not len(data.loop_triangles):
        data.calc_loop_triangles()
    corners = np.zeros(len(data.loop_triangles) * 3, np.int32)
    data.loop_triangles.foreach_get("vertices", corners)
    return corners.reshape(-1, 3)
