# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes the tangible parts of an object's materials through Cycles: relief, roughness, colour.

A bake happens in a scratch scene, on a copy of the object with copies of its materials, so that
there is nothing to restore in the user's: neither render settings nor selection nor nodes are
ever touched. Relief is the sum of what the materials state, see :mod:`.material_relief`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...blender import mesh_arrays
from ...blender.scene_info import metres_of
from ...engine.arrays import F32, F64, Bool
from ...engine.texture.height_field import heights_of_normals
from ...engine.texture.relief.linear_light import luminance
from ...engine.texture.scan import fill_holes
from ...errors import InputError
from . import material_relief, surface_uv
from .material_relief import Relief, Value
from .surface_uv import Charts

FINEST = 4096
"""Texels along an edge: a bake of more takes gigabytes."""

_FLAT_M = 1e-9
_COVERAGE = 256
_OVERLAP = 0.02  # share of the UV map's area; less is rounding
_NAME = ".HFX Bake"


@dataclass(frozen=True, eq=False)
class BakedMaterial:
    """An object's materials on its UV map; rows go up with V, (H, W)."""

    heights_m: F64  # continued smoothly where there is no face
    roughness: F64  # 0..1
    luminance: F32 | None  # 0..1 of the base colour, linear light; where there is no relief
    covered: Bool  # texels that belong to a face
    tile_mm: tuple[float, float]  # of a UV unit, along U and V
    tiles: bool  # whether it continues at the opposite edge
    notes: tuple[str, ...]

    @property
    def is_flat(self) -> bool:
        """Test that no material states any relief."""
        return self.luminance is not None


def bake(obj: bpy.types.Object, width: int, height: int, uv_map: str = "") -> BakedMaterial:
    """Bake an object's materials to maps of ``height`` rows of ``width`` texels.

    Where the UV map leaves the unit square or covers parts of it twice, and the materials
    depend on nothing but it, one tile of them is baked instead.

    Raises
    ------
    InputError
        No mesh, no size, no UV map, no material, overlapping UVs, or Cycles cannot bake it.
    """
    if not (2 <= width <= FINEST and 2 <= height <= FINEST):
        raise InputError(
            f"Surface of '{obj.name}': {width} x {height} texels; expected 2 to {FINEST}."
        )
    if not hasattr(bpy.types.Scene, "cycles"):
        raise InputError(
            "Baking a material needs Cycles, which is switched off; enable the add-on 'Cycles "
            "Render Engine' in the preferences."
        )
    with _scratch(obj) as scratch:
        return _bake(scratch, obj.name, width, height, uv_map)


def _bake(scratch: _Scratch, owner: str, width: int, height: int, uv_map: str) -> BakedMaterial:
    copy, notes = scratch.copy, []
    charts = surface_uv.charts_of(copy.data, uv_map, owner, copy.matrix_world)
    copy.data.uv_layers[charts.name].active = True
    copy.data.uv_layers[charts.name].active_render = True
    scratch.copy_materials(charts, owner)
    fault = _fault(scratch, charts)
    if fault:
        _use_one_tile(scratch, charts, owner, fault)
        notes.append(f"UV map '{charts.name}' {fault}: one tile of the material was baked")
    unit = metres_of(bpy.context.scene)
    tile_m = charts.tile[0] * unit, charts.tile[1] * unit
    scratch.new_image(width, height)
    reliefs = [material_relief.relief_of(material) for material in scratch.materials]
    pixels = scratch.emitted([relief.height for relief in reliefs])
    covered = pixels[..., 3] > 0.5
    if not covered.any():
        raise InputError(
            f"Surface of '{owner}': no face is as large as a texel of UV map '{charts.name}'."
        )
    if not np.isfinite(pixels[..., 0]).all():
        raise InputError(f"The material of '{owner}' has heights that are not finite numbers.")
    heights = pixels[..., 0].astype(np.float64) * unit
    if any(relief.has_normal for relief in reliefs):
        texel_m = tile_m[0] / width, tile_m[1] / height
        normals = scratch.normals(reliefs)
        normals[~covered] = np.nan
        heights += heights_of_normals(normals, texel_m, tiles=bool(fault))
    roughness = scratch.baked("ROUGHNESS")[..., 0]
    is_flat = float(np.ptp(heights[covered])) < _FLAT_M
    return BakedMaterial(
        # A map continues beyond its charts, or their rims would be felt as steps.
        heights_m=fill_holes(np.where(covered, heights, np.nan)),
        roughness=fill_holes(np.where(covered, roughness, np.nan)).clip(0.0, 1.0),
        luminance=_luminance(scratch) if is_flat else None,
        covered=covered,
        tile_mm=(tile_m[0] * 1000.0, tile_m[1] * 1000.0),
        tiles=bool(fault),
        notes=tuple(notes),
    )


def _luminance(scratch: _Scratch) -> F32:
    colour = scratch.emitted([material_relief.colour_of(m) for m in scratch.materials])
    values = luminance(np.nan_to_num(colour))
    return np.clip(values, 0.0, 1.0).astype(np.float32)


def _fault(scratch: _Scratch, charts: Charts) -> str:
    """Reason why the object itself cannot be baked on its UV map; empty if it can."""
    if charts.leaves_unit_square:
        return "goes beyond 0 to 1"
    scratch.new_image(_COVERAGE, _COVERAGE)
    share = float((scratch.emitted([1.0] * len(scratch.materials))[..., 3] > 0.5).mean())
    overlap = 1.0 - share / charts.uv_area
    return f"covers {overlap:.0%} of its area twice" if overlap > _OVERLAP else ""


def _use_one_tile(scratch: _Scratch, charts: Charts, owner: str, fault: str) -> None:
    stranger = material_relief.depends_on(scratch.materials, charts.name)
    if stranger or len(scratch.materials) > 1:
        reason = (
            f"its material depends on more than UVs ({stranger})"
            if stranger
            else f"it has {len(scratch.materials)} materials"
        )
        raise InputError(
            f"UV map '{charts.name}' of '{owner}' {fault}, and {reason}; unwrap it into another "
            "UV map without overlaps, and choose that one."
        )
    scratch.make_tile(charts)


@contextmanager
def _scratch(obj: bpy.types.Object) -> Iterator[_Scratch]:
    """Context with the object as it is evaluated now, alone in a scene of its own; removed
    afterwards.
    """
    if obj.type != "MESH":
        raise InputError(f"'{obj.name}' is a {obj.type.lower()}, not a mesh: it has no UV map.")
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    scratch = _Scratch()
    try:
        scratch.fill(obj)
        yield scratch
    finally:
        # scenes.remove() crashes Blender 4.3 within ``blender --command``.
        bpy.data.batch_remove(scratch.made)


class _Scratch:
    """Scratch scene with a copy of one object, which Cycles bakes."""

    def __init__(self) -> None:
        self.made: list[bpy.types.ID] = []
        self.materials: list[bpy.types.Material] = []
        self._image: bpy.types.Image | None = None

    def fill(self, obj: bpy.types.Object) -> None:
        graph = bpy.context.evaluated_depsgraph_get()
        evaluated = obj.evaluated_get(graph)
        mesh = bpy.data.meshes.new_from_object(
            evaluated, preserve_all_data_layers=True, depsgraph=graph
        )
        self.made.append(mesh)
        mesh.name = _NAME
        self._slots = [slot.material for slot in evaluated.material_slots]
        self.copy = self._keep(bpy.data.objects.new(_NAME, mesh))
        self.copy.matrix_world = evaluated.matrix_world
        self.scene = self._keep(bpy.data.scenes.new(_NAME))
        self.scene.collection.objects.link(self.copy)
        self.scene.render.engine = "CYCLES"
        cycles = self.scene.cycles
        cycles.samples, cycles.device = 1, "CPU"
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        self.scene.view_layers[0].update()

    def _keep(self, made: bpy.types.ID) -> bpy.types.ID:
        self.made.append(made)
        return made

    def copy_materials(self, charts: Charts, owner: str) -> None:
        """Give the copy materials of its own, in one slot for each that a face uses."""
        mesh = self.copy.data
        place: dict[int, int] = {}
        last = len(self._slots) - 1
        for slot in charts.used_slots:
            material = self._slots[min(slot, last)] if last >= 0 else None
            if material is None:
                raise InputError(
                    f"'{owner}' has faces without a material; give it one, or choose an image, a "
                    "scan or a procedural surface."
                )
            place[slot] = len(self.materials)
            # The original, not the evaluated one: only that can be copied into the file.
            copy = self._keep(material.original.copy())
            material_relief.prepare(copy, material.name)
            self.materials.append(copy)
        indices = mesh_arrays.values(mesh.polygons, "material_index", kind=np.int32)
        mesh.materials.clear()
        for material in self.materials:
            mesh.materials.append(material)
        moved = np.array([place.get(int(k), 0) for k in indices], np.int32)
        mesh.polygons.foreach_set("material_index", moved)

    def make_tile(self, charts: Charts) -> None:
        """Reduce the copy to one face with one UV tile of its material."""
        scale = abs(self.copy.matrix_world.determinant()) ** (1.0 / 3.0)
        self.copy.matrix_world = Matrix.Scale(scale, 4)
        surface_uv.make_tile(self.copy.data, charts, scale)

    def new_image(self, width: int, height: int) -> None:
        """Bake into a new image from now on."""
        self._image = self._keep(
            bpy.data.images.new(_NAME, width, height, alpha=True, float_buffer=True, is_data=True)
        )
        for material in self.materials:
            material_relief.set_target(material, self._image)

    def emitted(self, sockets: Sequence[Value]) -> F32:
        """Bake a value of each material, (H, W, 4); alpha tells where faces are."""
        with _wired(self.materials, material_relief.emission, sockets):
            return self.baked("EMIT")

    def normals(self, reliefs: list[Relief]) -> F64:
        """Bake shading normals in tangent space, (H, W, 3), without the relief that is known as
        heights.
        """
        with _wired(self.materials, material_relief.matt, reliefs):
            colours = self.baked("NORMAL")[..., :3].astype(np.float64)
        normals = colours * 2.0 - 1.0
        lengths = np.linalg.norm(normals, axis=2, keepdims=True)
        return np.divide(normals, lengths, out=np.full_like(normals, np.nan), where=lengths > 0.5)

    def baked(self, kind: str) -> F32:
        """The pixels (H, W, 4) of a bake; zero where no face is."""
        image, layer = self._image, self.scene.view_layers[0]
        assert image is not None
        width, height = image.size
        # Blender clears to an opaque black, which would look like a face everywhere.
        image.pixels.foreach_set(np.zeros(width * height * 4, np.float32))
        image.update()
        layer.objects.active = self.copy
        layer.update()
        try:
            with bpy.context.temp_override(
                scene=self.scene,
                view_layer=layer,
                object=self.copy,
                active_object=self.copy,
                selected_objects=[self.copy],
                selected_editable_objects=[self.copy],
            ):
                bpy.ops.object.bake(
                    type=kind,
                    margin=0,
                    use_clear=False,
                    normal_space="TANGENT",
                    use_selected_to_active=False,
                    use_cage=False,
                    target="IMAGE_TEXTURES",
                    save_mode="INTERNAL",
                )
        except RuntimeError as error:
            reason = str(error).strip().removeprefix("Error: ").splitlines()[0]
            raise InputError(f"Cycles cannot bake this surface ({reason}).") from error
        pixels = np.zeros(width * height * 4, np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(height, width, 4)


@contextmanager
def _wired(
    materials: Sequence[bpy.types.Material],
    wire: Callable[[bpy.types.Material, Any], Callable[[], None]],
    values: Sequence[Any],
) -> Iterator[None]:
    """Context with temporary surfaces."""
    undo = [wire(material, value) for material, value in zip(materials, values, strict=True)]
    try:
        yield
    finally:
        for each in undo:
            each()
