# SPDX-License-Identifier: GPL-3.0-or-later
"""Sources of a surface's relief: material, image, scan, or library."""

from pathlib import Path

import bpy
import numpy as np
import numpy.typing as npt

from ...engine.texture import procedural
from ...engine.texture.height_field import HeightField, SurfaceRelief, from_image
from ...engine.texture.relief.relief_estimate import EstimatedRelief
from ...engine.texture.scan import from_points, seen_from_above
from ...errors import InputError
from ...files.hashes import is_elsewhere
from ...files.kinds import PICTURE_SUFFIXES
from ...formats.pictures import point_cloud
from . import image_values, surface_baking, surface_uv

_LIKELY_M = (1e-3, 5.0)  # plausible length of a scan


def relief_of(obj: bpy.types.Object) -> SurfaceRelief:
    """Relief of an object's surface from its source; InputError if missing or unusable."""
    source = obj.hfx.surface.source
    if source == "MATERIAL":
        return _material_relief(obj)
    if source == "IMAGE":
        return _image_relief(obj)
    if source == "SCAN":
        return _scan_relief(obj)
    if source == "PROCEDURAL":
        settings = obj.hfx.surface
        material = procedural.material(settings.procedural)
        return SurfaceRelief(*material.make(max(settings.resolution, 16), settings.seed))
    raise InputError(f"The surface of '{obj.name}' is an imported map: it has no relief.")


def tile_mm(obj: bpy.types.Object) -> tuple[float, float]:
    """Width and height of a UV unit on an object, millimetres: entered, or measured."""
    settings = obj.hfx.surface
    if settings.use_own_scale:
        return settings.uv_mm[0], settings.uv_mm[1]
    return surface_uv.tile_mm(obj, settings.uv_map)


def _material_relief(obj: bpy.types.Object) -> SurfaceRelief:
    settings = obj.hfx.surface
    tile = tile_mm(obj)
    # Texels are nearly square on the object, even if UV units are not.
    width, height = (max(8, round(settings.resolution * t / max(tile))) for t in tile)
    baked = surface_baking.bake(obj, width, height, settings.uv_map)
    heights, notes = baked.heights_m, list(baked.notes)
    # Without relief, colour differences stand in for heights; a uniform colour does not, which
    # differs by rounding of 8 bits only.
    if baked.luminance is not None and float(np.ptp(baked.luminance)) > 1.0 / 512.0:
        heights = baked.luminance.astype(np.float64) * settings.height_mm / 1000.0
        notes.append("the material has no relief: its colour was used as heights")
    elif baked.luminance is not None:
        notes.append("the material has no relief: only its roughness is used")
    else:
        heights = heights - heights[baked.covered].mean()
    texel = tile[0] / 1000.0 / width, tile[1] / 1000.0 / height
    return SurfaceRelief(HeightField(heights, texel, baked.tiles), baked.roughness, tuple(notes))


def _image_relief(obj: bpy.types.Object) -> SurfaceRelief:
    settings = obj.hfx.surface
    if settings.image is None:
        raise InputError(f"The surface of '{obj.name}' is made of an image; choose one.")
    if settings.image_kind == "ESTIMATE":
        return _estimate_relief(obj)
    # Photographs are decoded to linear light; height maps are data, without a colour space.
    is_colour = settings.image_kind == "COLOUR"
    read_values = image_values.brightness_of if is_colour else image_values.data_of
    grey, notes = image_values.without_holes(read_values(settings.image), settings.image.name)
    tile = tile_mm(obj)
    field = from_image(grey, settings.height_mm / 1000.0, (tile[0] / 1000.0, tile[1] / 1000.0))
    roughness = settings.roughness_image
    return SurfaceRelief(
        field, None if roughness is None else image_values.data_of(roughness), notes
    )


def estimate_channels(estimate: EstimatedRelief) -> list[npt.NDArray[np.floating]]:
    """Image channels of an estimate: height 0 to 1, roughness, normalised slope. The slope is that
    of a unit square of height 1, and scales with size and height."""
    # Stored relative to height and size, so that both can be changed afterwards.
    height_m = float(estimate.field.heights_m.max()) or 1.0
    width, length = estimate.field.size_m
    slope = estimate.slope * np.float32(np.sqrt(width * length) / height_m)
    return [estimate.field.heights_m / height_m, estimate.roughness, slope]


def _estimate_relief(obj: bpy.types.Object) -> SurfaceRelief:
    settings, tile = obj.hfx.surface, tile_mm(obj)
    pixels = image_values.pixels_of(settings.image)
    if pixels.shape[2] < 3 or not np.isfinite(pixels).all():
        raise InputError(f"Image '{settings.image.name}' is no estimate: make it again.")
    size_m = tile[0] / 1000.0, tile[1] / 1000.0
    field = from_image(pixels[..., 0], settings.height_mm / 1000.0, size_m)
    # Undoes the normalisation of estimate_channels, with the present size and height.
    steepness = abs(settings.height_mm) / float(np.sqrt(tile[0] * tile[1]))
    slope = steepness * np.abs(pixels[..., 2])
    return SurfaceRelief(field, pixels[..., 1].clip(0.0, 1.0), slope=slope)


def _scan_relief(obj: bpy.types.Object) -> SurfaceRelief:
    settings = obj.hfx.surface
    if not settings.scan_path:
        raise InputError(f"The surface of '{obj.name}' is made of a scan; choose its file.")
    path = Path(bpy.path.abspath(settings.scan_path))
    if is_elsewhere(path, Path(bpy.data.filepath) if bpy.data.filepath else None):
        raise InputError(f"{path}: the scan of '{obj.name}' is on another machine; copy it here.")
    return read_scan(
        path,
        unit_mm=settings.scan_unit_mm,
        size_mm=tuple(settings.scan_size_mm),
        height_mm=settings.height_mm,
        resolution=settings.resolution,
    )


def read_scan(
    path: Path, *, unit_mm: float, size_mm: tuple[float, float], height_mm: float, resolution: int
) -> SurfaceRelief:
    """Relief of a scan: a height map for suffixes in ``PICTURE_SUFFIXES``, else a point cloud.

    ``size_mm`` and ``height_mm`` are the size of a height map, and of white above black. The
    coordinates of a point cloud have the unit ``unit_mm``; its longer edge gets at most
    ``resolution`` texels, and an implausible length gives a note. Raises InputError: the
    file is missing or unreadable, or more than half of the heights are missing.
    """
    if path.suffix.lower() in PICTURE_SUFFIXES:
        image = image_values.load(str(path))
        try:
            grey, notes = image_values.without_holes(image_values.data_of(image), path.name)
        finally:
            bpy.data.images.remove(image)
        size = size_mm[0] / 1000.0, size_mm[1] / 1000.0
        return SurfaceRelief(from_image(grey, height_mm / 1000.0, size, tiles=False), notes=notes)
    points = seen_from_above(point_cloud.read(path) * (unit_mm / 1000.0))
    span = np.ptp(points[:, :2], axis=0)
    # A texel per point, up to the given resolution.
    texel = max(float(np.sqrt(span.prod() / len(points))), float(span.max()) / resolution)
    longest, notes = float(span.max()), ()
    if not _LIKELY_M[0] <= longest <= _LIKELY_M[1]:
        notes = (f"the scan is {1000.0 * longest:.3g} mm long; is the unit of its numbers right?",)
    return SurfaceRelief(from_points(points, texel), notes=notes)
