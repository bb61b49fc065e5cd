# SPDX-License-Identifier: GPL-3.0-or-later
"""Baking of an object's materials with Cycles: relief, roughness, colour.

A bake uses copies of the object and its materials in a scratch scene, so render settings, selection
and nodes of the user stay unchanged. The relief is the sum of the materials' heights, see
:mod:`.material_relief`.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...avatars import mesh_copies
from ...blender import mesh_arrays
from ...blender.scene_info import metres_of
from ...engine.arrays import F32, F64, Bool
from ...engine.texture.height_field import heights_of_normals
from ...engine.texture.relief.linear_light import luminance
from ...engine.texture.scan import fill_holes
from ...errors import InputError
from . import image_values, material_relief, surface_uv
from .material_relief import ReliefNodes, Value
from .surface_uv import Charts

FINEST = 4096  # largest edge of a bake, texels: larger bakes take gigabytes of memory
_FLAT_M = 1e-9
_COVERAGE = 256
_OVERLAP = 0.02  # rounding tolerance, as a share of the UV map's area
_NAME = ".HFX Bake"


@dataclass(frozen=True, eq=False)
class BakedMaterial:
    """Materials of an object on the UV map, arrays (H, W), bottom row first."""

    heights_m: F64  # extrapolated smoothly outside of faces
    roughness: F64  # 0..1
    # 0..1 of the base colour in linear light; None for a material with relief.
    luminance: F32 | None
    covered: Bool  # texels of faces
    tile_mm: tuple[float, float]  # size of a UV unit along U and V
    tiles: bool  # opposite edges match
    notes: tuple[str, ...]


def bake(obj: bpy.types.Object, width: int, height: int, uv_map: str = "") -> BakedMaterial:
    """Bake an object's materials to maps of ``height`` rows of ``width`` texels.

    If the UV map leaves the unit square or overlaps, a tile of the material is baked instead,
    provided that no further coordinates are used.

    Raises InputError: the object has no mesh, size, UV map or material, UVs overlap, or Cycles
    cannot bake the material.
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
    surface_uv.update_mesh(obj)
    with _kept_images(), mesh_copies.scratch() as datablocks:
        return _bake(_Scratch(datablocks, obj), obj.name, width, height, uv_map)


@contextmanager
def _kept_images() -> Iterator[None]:
    """Context that restores the images of all Image Editors at its end. Blender shows the target of
    a bake in them, also where the image is pinned."""
    spaces = [area.spaces.active for screen in bpy.data.screens for area in screen.areas]
    shown = [(space, space.image) for space in spaces if space and space.type == "IMAGE_EDITOR"]
    try:
        yield
    finally:
        for space, image in shown:
            if space.image != image:
                space.image = image


def _bake(scratch: "_Scratch", owner: str, width: int, height: int, uv_map: str) -> BakedMaterial:
    copy, notes = scratch.copy, []
    charts = surface_uv.charts_of(copy.data, uv_map, owner, copy.matrix_world)
    copy.data.uv_layers[charts.name].active = True
    copy.data.uv_layers[charts.name].active_render = True
    scratch.copy_materials(charts, owner)
    # Coverage is measured with an extra bake, before the large bakes.
    fault = _uv_fault(scratch, charts)
    if fault:
        _use_one_tile(scratch, charts, owner, fault)
        notes.append(f"UV map '{charts.name}' {fault}: one tile of the material was baked")
    unit = metres_of(bpy.context.scene)
    tile_m = charts.tile[0] * unit, charts.tile[1] * unit
    scratch.new_image(width, height)
    reliefs = [material_relief.relief_of(material) for material in scratch.materials]
    pixels = scratch.emitted([relief.height for relief in reliefs])
    is_covered = pixels[..., 3] > 0.5
    if not is_covered.any():
        raise InputError(
            f"Surface of '{owner}': no face is as large as a texel of UV map '{charts.name}'."
        )
    if not np.isfinite(pixels[..., 0]).all():
        raise InputError(f"The material of '{owner}' has heights that are not finite numbers.")
    heights = pixels[..., 0].astype(np.float64) * unit
    # Heights of displacement and bump are exact; further normals are integrated, and added.
    if any(r.normal is not None or r.is_surface_bent for r in reliefs):
        texel_m = tile_m[0] / width, tile_m[1] / height
        normals = scratch.normals(reliefs)
        normals[~is_covered] = np.nan
        heights += heights_of_normals(normals, texel_m, tiles=bool(fault))
    roughness = scratch.baked("ROUGHNESS")[..., 0]
    brightness = None
    if float(np.ptp(heights[is_covered])) < _FLAT_M:
        colours = [material_relief.colour_of(material) for material in scratch.materials]
        linear_light = luminance(np.nan_to_num(scratch.emitted(colours)))
        brightness = np.clip(linear_light, 0.0, 1.0).astype(np.float32)
    return BakedMaterial(
        # Extrapolation beyond the charts prevents steps at their rims.
        heights_m=fill_holes(np.where(is_covered, heights, np.nan)),
        roughness=fill_holes(np.where(is_covered, roughness, np.nan)).clip(0.0, 1.0),
        luminance=brightness,
        covered=is_covered,
        tile_mm=(tile_m[0] * 1000.0, tile_m[1] * 1000.0),
        tiles=bool(fault),
        notes=tuple(notes),
    )


def _uv_fault(scratch: "_Scratch", charts: Charts) -> str:
    """Fault of the UV map: UVs beyond 0..1, or by a test bake more than 2 % of overlap; else ""."""
    if charts.leaves_unit_square:
        return "goes beyond 0 to 1"
    scratch.new_image(_COVERAGE, _COVERAGE)
    # Rendered coverage below the summed area means overlapping faces.
    share = float((scratch.emitted([1.0] * len(scratch.materials))[..., 3] > 0.5).mean())
    overlap = 1.0 - share / charts.uv_area
    return f"covers {overlap:.0%} of its area twice" if overlap > _OVERLAP else ""


def _use_one_tile(scratch: "_Scratch", charts: Charts, owner: str, fault: str) -> None:
    """Bake a UV unit of the material instead of UV map ``charts``, which has the ``fault``. Raises
    InputError: several materials, or a material that depends on more than UVs."""
    # A tile stands for the whole surface only if nothing but UVs matters.
    dependency = material_relief.depends_on(scratch.materials, charts.name)
    if dependency or len(scratch.materials) > 1:
        reason = (
            f"its material depends on more than UVs ({dependency})"
            if dependency
            else f"it has {len(scratch.materials)} materials"
        )
        raise InputError(
            f"UV map '{charts.name}' of '{owner}' {fault}, and {reason}; unwrap it into another "
            "UV map without overlaps, and choose that one."
        )
    scratch.make_tile(charts)


class _Scratch:
    """Scratch scene with a copy of an evaluated object, for bakes with Cycles."""

    def __init__(self, datablocks: list[bpy.types.ID], obj: bpy.types.Object) -> None:
        self.scene, self._datablocks = datablocks[0], datablocks
        self.materials: list[bpy.types.Material] = []
        self._image: bpy.types.Image | None = None
        graph = bpy.context.evaluated_depsgraph_get()
        evaluated = obj.evaluated_get(graph)
        mesh = bpy.data.meshes.new_from_object(
            evaluated, preserve_all_data_layers=True, depsgraph=graph
        )
        self._add(mesh).name = _NAME
        self._slots = [slot.material for slot in evaluated.material_slots]
        self.copy = self._add(bpy.data.objects.new(_NAME, mesh))
        self.copy.matrix_world = evaluated.matrix_world
        self.scene.collection.objects.link(self.copy)
        self.scene.render.engine = "CYCLES"
        cycles = self.scene.cycles
        # A single sample suffices: emission and normals have no noise.
        cycles.samples, cycles.device = 1, "CPU"
        cycles.use_denoising = cycles.use_adaptive_sampling = False
        self.scene.view_layers[0].update()

    def _add(self, datablock: bpy.types.ID) -> bpy.types.ID:
        """Register a new datablock for removal at the end of the bake, and return it."""
        self._datablocks.append(datablock)
        return datablock

    def copy_materials(self, charts: Charts, owner: str) -> None:
        """Give the copied object copies of the materials with faces, by falling area. Raises
        InputError, with the object's name ``owner``: faces without a material."""
        mesh = self.copy.data
        new_slots: dict[int, int] = {}
        last = len(self._slots) - 1
        # Faces beyond the last slot show that slot's material, as in Blender.
        for slot in charts.used_slots:
            material = self._slots[min(slot, last)] if last >= 0 else None
            if material is None:
                raise InputError(
                    f"'{owner}' has faces without a material; give it one, or choose an image, a "
                    "scan or a procedural surface."
                )
            new_slots[slot] = len(self.materials)
            # The original: an evaluated material cannot be copied into the file.
            copy = self._add(material.original.copy())
            material_relief.prepare(copy, material.name)
            self.materials.append(copy)
        indices = mesh_arrays.values(mesh.polygons, "material_index", kind=np.int32)
        mesh.materials.clear()
        for material in self.materials:
            mesh.materials.append(material)
        new_indices = np.array([new_slots.get(int(k), 0) for k in indices], np.int32)
        mesh.polygons.foreach_set("material_index", new_indices)

    def make_tile(self, charts: Charts) -> None:
        """Replace the copy's mesh by a square face of one UV unit in real size."""
        scale = abs(self.copy.matrix_world.determinant()) ** (1.0 / 3.0)
        self.copy.matrix_world = Matrix.Scale(scale, 4)
        surface_uv.make_tile(self.copy.data, charts, scale)

    def new_image(self, width: int, height: int) -> None:
        """Create the target image of the next bakes."""
        self._image = self._add(
            bpy.data.images.new(_NAME, width, height, alpha=True, float_buffer=True, is_data=True)
        )
        for material in self.materials:
            material_relief.set_target(material, self._image)

    def emitted(self, sockets: Sequence[Value]) -> F32:
        """Bake a value of each material, (H, W, 4); alpha marks faces."""
        with _wired(self.materials, material_relief.emission, sockets):
            return self.baked("EMIT")

    def normals(self, reliefs: list[ReliefNodes]) -> F64:
        """Bake unit normals (H, W, 3) without heights, tangent space; NaN outside of faces."""
        with _wired(self.materials, material_relief.diffuse, reliefs):
            colours = self.baked("NORMAL")[..., :3].astype(np.float64)
        # Cycles stores normals as colours, 0 to 1; below half length there is no face.
        normals = colours * 2.0 - 1.0
        lengths = np.linalg.norm(normals, axis=2, keepdims=True)
        return np.divide(normals, lengths, out=np.full_like(normals, np.nan), where=lengths > 0.5)

    def baked(self, kind: str) -> F32:
        """Bake ``kind``, as EMIT, (H, W, 4), 0 outside of faces; InputError if Cycles fails."""
        image, layer = self._image, self.scene.view_layers[0]
        assert image is not None
        # Cleared here, as a bake clears to opaque black, and alpha marks faces.
        image.pixels.foreach_set(np.zeros(len(image.pixels), np.float32))
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
        return image_values.pixels_of(image)


@contextmanager
def _wired(
    materials: Sequence[bpy.types.Material],
    wire: Callable[[bpy.types.Material, Any], Callable[[], None]],
    values: Sequence[Any],
) -> Iterator[None]:
    """Context in which ``wire(material, value)`` has rewired each material. The returned undo
    functions are called at the end, the last first, also if ``wire`` or another undo raises."""
    # Materials are restored in any case, as the next bake rewires them again.
    with ExitStack() as undo:
        for material, value in zip(materials, values, strict=True):
            undo.callback(wire(material, value))
        yield
