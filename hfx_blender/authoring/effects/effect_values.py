# SPDX-License-Identifier: GPL-3.0-or-later
"""An effect's values at a time, from its properties: parameters, shape, place of its shape."""

from __future__ import annotations

from contextlib import suppress

import bpy
import numpy as np

from ...blender import mesh_arrays
from ...blender.stored_values import limited
from ...engine.arrays import F64
from ...engine.counters import ReadingCounters
from ...engine.modality import MODALITIES
from ...engine.volume.mesh import MeshVolume
from ...engine.volume.shape import Falloff, FalloffKind, Shape
from ...errors import InputError
from .. import volumes


def properties_of(modality: str) -> tuple[str, ...]:
    """Properties of ``Object.hfx`` in the order of a modality's parameters, without a direction."""
    return tuple(control.prop for control in MODALITIES[modality].controls)


def world_of(placed: bpy.types.Object | bpy.types.DepsgraphObjectInstance) -> F64:
    """The world matrix (4, 4) of an evaluated object or instance, in Blender's units.

    Numpy would ask a matrix for its numbers one by one, four times slower.
    """
    one, two, three, four = placed.matrix_world
    return np.array((one[:], two[:], three[:], four[:]), np.float64)


def parameters(hfx: bpy.types.PropertyGroup, world: F64) -> list[float]:
    """An effect's values in the order of its modality's parameters; world matrix (4, 4)."""
    values = [limited(hfx, name) for name in properties_of(hfx.modality)]
    return [*values, *directions(world).tolist()] if hfx.modality == "wind" else values


def falloff(hfx: bpy.types.PropertyGroup) -> Falloff:
    """Falloff of an effect."""
    return Falloff(FalloffKind(hfx.falloff), limited(hfx, "falloff_share"))


def directions(world: F64) -> F64:
    """Unit vectors along the local Z axis of world matrices (..., 4, 4): where wind blows to.

    (0, 0, 0) where it has no length, or is no number, which the engine tells.
    """
    along = world[..., :3, 2]
    lengths = np.linalg.norm(along, axis=-1, keepdims=True)
    is_known = (lengths > 0.0) & np.isfinite(lengths)
    return np.where(is_known, along / np.where(is_known, lengths, 1.0), 0.0)


def shape_matrices(world: F64, unit_m: float, hfx: bpy.types.PropertyGroup) -> F64:
    """World matrices (..., 4, 4) in Blender's units -> shape space to world, metres."""
    scaled = to_metres(world, unit_m)
    scaled[..., :3, :3] *= volumes.shape_scale(hfx)
    return scaled


def to_metres(world: F64, unit_m: float) -> F64:
    """World matrices (..., 4, 4) in Blender units -> in metres."""
    scaled = world.copy()
    scaled[..., :3, :] *= unit_m
    return scaled


def is_empty(evaluated: bpy.types.Object) -> bool:
    """Test for a mesh without vertices, as where nodes turn all of it into instances."""
    return evaluated.type == "MESH" and not evaluated.mode == "EDIT" and not evaluated.data.vertices


class Shapes:
    """Shapes of a scene's volumes; a mesh is converted again only if it deforms."""

    def __init__(self) -> None:
        self._meshes: dict[tuple[str, int], tuple[bytes, MeshVolume]] = {}
        self.notes: dict[str, None] = {}  # notes on repaired meshes, in order
        self.counters = ReadingCounters()

    def shape_of(
        self, effect: bpy.types.Object, evaluated: bpy.types.Object, part: int = 0
    ) -> Shape:
        """The shape of an effect as it is evaluated at a time; instances may have several.

        Raises
        ------
        InputError
            It is to be a mesh, and is none, or none with an inside.
        """
        if evaluated.hfx.shape != "MESH":
            return volumes.analytic_shape(evaluated.hfx)
        if evaluated.type == "MESH" and not evaluated.data.is_editmode:
            return self._mesh_volume(effect, evaluated.data, part)
        try:  # of curves, texts and metaballs, and edits that the evaluated mesh has not yet
            with suppress(RuntimeError):
                mesh = evaluated.to_mesh()
                if mesh is not None:
                    return self._mesh_volume(effect, mesh, part)
        finally:
            evaluated.to_mesh_clear()
        raise InputError(
            f"Volume '{effect.name}' has the shape of a mesh, but is a {evaluated.type.lower()} "
            "object without a surface: give it one, or choose another shape."
        )

    def _mesh_volume(self, effect: bpy.types.Object, mesh: bpy.types.Mesh, part: int) -> MeshVolume:
        positions = mesh_arrays.positions(mesh)
        self.counters.meshes_read += 1
        content = positions.tobytes()
        which = effect.name_full, part
        known = self._meshes.get(which)
        if known is None or known[0] != content:
            self.counters.meshes_made += 1
            triangles = mesh_arrays.triangles(mesh)
            volume = MeshVolume(positions.astype(np.float64), triangles, effect.name)
            known = self._meshes[which] = (content, volume)
            if volume.note:
                self.notes[volume.note] = None
        return known[1]

    def box_of(self, effect: bpy.types.Object, evaluated: bpy.types.Object) -> MeshVolume | None:
        """Box around a mesh as it is evaluated at a time; None where it may have none."""
        if evaluated.type != "MESH" or evaluated.mode == "EDIT" or is_empty(evaluated):
            return None
        corners = np.array([corner[:] for corner in evaluated.bound_box], np.float64)
        bounds = np.stack([corners.min(axis=0), corners.max(axis=0)])
        return MeshVolume.box(bounds, effect.name) if np.isfinite(bounds).all() else None

    def last_of(self, effect: bpy.types.Object) -> Shape | None:
        """Last valid mesh of an effect; None if there never was any."""
        known = self._meshes.get((effect.name_full, 0))
        return known[1] if known else None
