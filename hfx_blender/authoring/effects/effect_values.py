# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluated values of an effect: parameters, falloff, shape and matrices."""

from contextlib import suppress
from typing import Final

import bpy
import numpy as np

from ...blender import mesh_arrays
from ...blender.stored_values import limited
from ...engine.arrays import F64
from ...engine.counters import ReadingCounters
from ...engine.modality import MODALITIES
from ...engine.response_filters.controls import ContactLaw
from ...engine.volume.mesh import MeshVolume
from ...engine.volume.shape import Falloff, FalloffKind, Shape
from ...errors import InputError
from .. import volumes

TRANSFORM: Final = ("location", "rotation_euler", "scale")
"""Properties (3) of an object that place a volume."""

LAW: Final = ("stiffness", "damping", "friction")
"""Properties of an effect with its contact law, in the order of the fields of ContactLaw."""


def properties_of(modality: str) -> tuple[str, ...]:
    """RNA names in ``Object.hfx`` of a modality's controls, in order, strength first."""
    return tuple(control.prop for control in MODALITIES[modality].controls)


def world_matrix(obj: bpy.types.Object | bpy.types.DepsgraphObjectInstance) -> F64:
    """World matrix (4, 4) of an evaluated object or instance, in Blender units."""
    # Slicing rows is four times faster than np.array(matrix), which reads number by number.
    return np.array([row[:] for row in obj.matrix_world], np.float64)


def parameters(hfx: bpy.types.PropertyGroup, world: F64) -> list[float]:
    """Parameter values of an effect in the modality's order; wind has the direction (3) last."""
    values = [limited(hfx, name) for name in properties_of(hfx.modality)]
    return [*values, *directions(world).tolist()] if hfx.modality == "wind" else values


def falloff(hfx: bpy.types.PropertyGroup) -> Falloff:
    """Kind of falloff, and share clipped to the limits of the property."""
    return Falloff(FalloffKind(hfx.falloff), limited(hfx, "falloff_share"))


def contact_law(hfx: bpy.types.PropertyGroup) -> ContactLaw | None:
    """Contact law of a volume, clipped to the limits of the properties; None without stiffness."""
    is_stiff = limited(hfx, LAW[0]) > 0.0  # most volumes have no law
    return ContactLaw(*(limited(hfx, name) for name in LAW)) if is_stiff else None


def directions(world: F64) -> F64:
    """Unit vectors (..., 3) along the local Z axis of world matrices (..., 4, 4), for wind. (0, 0,
    0) for an axis of zero length or NaN, which the engine reports."""
    axis = world[..., :3, 2]
    lengths = np.linalg.norm(axis, axis=-1, keepdims=True)
    # Division by 1 instead of 0 avoids warnings; the result is replaced below.
    is_valid = (lengths > 0.0) & np.isfinite(lengths)
    return np.where(is_valid, axis / np.where(is_valid, lengths, 1.0), 0.0)


def shape_matrices(world: F64, unit_m: float, hfx: bpy.types.PropertyGroup) -> F64:
    """Matrices (..., 4, 4) from the unit shape to world metres: ``world`` times ``unit_m`` metres,
    the axes also times the effect's size."""
    scaled = to_metres(world, unit_m)
    scaled[..., :3, :3] *= volumes.shape_scale(hfx)
    return scaled


def to_metres(world: F64, unit_m: float) -> F64:
    """Copy of world matrices (..., 4, 4) with the upper three rows times ``unit_m``."""
    scaled = world.copy()
    scaled[..., :3, :] *= unit_m
    return scaled


def is_empty(evaluated: bpy.types.Object) -> bool:
    """Test for a mesh without vertices in Object Mode, such as a result of instances only."""
    return evaluated.type == "MESH" and not evaluated.mode == "EDIT" and not evaluated.data.vertices


class ShapeCache:
    """Shapes of a scene's volumes; an unchanged mesh is converted once."""

    def __init__(self) -> None:
        self._meshes: dict[tuple[str, int], tuple[bytes, MeshVolume]] = {}
        self.notes: dict[str, None] = {}  # unique notes on repaired meshes, in order
        self.counters = ReadingCounters()

    def shape_of(
        self, effect: bpy.types.Object, evaluated: bpy.types.Object, part: int = 0
    ) -> Shape:
        """Unit shape, or mesh volume in Blender units (cached by ``part`` for equal positions).
        Raises InputError: a mesh is required, and the object has no surface, or a surface without
        an inside."""
        if evaluated.hfx.shape != "MESH":
            return volumes.analytic_shape(evaluated.hfx)
        if evaluated.type == "MESH" and not evaluated.data.is_editmode:
            return self._mesh_volume(effect, evaluated.data, part)
        # Curves, texts, metaballs, and meshes with pending edits have to be converted. The
        # temporary mesh belongs to the object and must be freed.
        try:
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
        # Converting a mesh to a volume takes far longer than comparing its vertices.
        positions = mesh_arrays.positions(mesh)
        self.counters.meshes_read += 1
        # Equal positions count as an unchanged mesh.
        content = positions.tobytes()
        key = effect.name_full, part
        cached = self._meshes.get(key)
        if cached is None or cached[0] != content:
            self.counters.meshes_made += 1
            triangles = mesh_arrays.triangles(mesh)
            volume = MeshVolume(positions.astype(np.float64), triangles, effect.name)
            cached = self._meshes[key] = (content, volume)
            if volume.note:
                self.notes[volume.note] = None
        return cached[1]

    def box_of(self, effect: bpy.types.Object, evaluated: bpy.types.Object) -> MeshVolume | None:
        """Box around an evaluated mesh; None without a finite bounding box, or in Edit Mode."""
        if evaluated.type != "MESH" or evaluated.mode == "EDIT" or is_empty(evaluated):
            return None
        corners = np.array([corner[:] for corner in evaluated.bound_box], np.float64)
        bounds = np.stack([corners.min(axis=0), corners.max(axis=0)])
        return MeshVolume.box(bounds, effect.name) if np.isfinite(bounds).all() else None

    def last_of(self, effect: bpy.types.Object) -> Shape | None:
        """Last valid mesh volume of an effect; None if missing."""
        cached = self._meshes.get((effect.name_full, 0))
        return cached[1] if cached else None
