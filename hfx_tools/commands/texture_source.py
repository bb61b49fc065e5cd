# SPDX-License-Identifier: GPL-3.0-or-later
"""Source of ``hfx texture``: map, picture, point cloud, library material, or object of a .blend."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.arguments import checked, pair_of
from hfx_blender.errors import InputError, UsageError, refuse_no_file
from hfx_blender.files.kinds import PICTURE_SUFFIXES, TEXTURE_MAP_SUFFIX, title_of
from hfx_blender.processes import blender_session

from .size_option import add_largest

if TYPE_CHECKING:
    from hfx_blender.engine.arrays import F64
    from hfx_blender.engine.texture.haptic_map import HapticMap
    from hfx_blender.engine.texture.height_field import HeightField


@dataclass(frozen=True, eq=False)
class TextureSource:
    """Haptic surface of any source."""

    name: str
    map: HapticMap
    height: HeightField | None  # None for a map
    notes: tuple[str, ...] = ()
    is_estimate: bool = False  # heights estimated from a photograph


_RANGES: Final = {
    "resolution": (8, 4096, ""),
    "seed": (0, 2**32 - 1, ""),
    "size": (1e-3, 1e6, " mm"),
    "height": (-1e5, 1e5, " mm"),
    "unit": (1e-9, 1e6, " mm"),
    "blur": (0.0, 1e4, " mm"),
    "slope": (1e-6, 1e6, ""),
    "amplitude": (0.0, 1e3, " g"),
    "frequency": (0.0, 1e5, " Hz"),
    "cutoff": (1e-3, 1e4, " mm"),
}
"""Lowest and highest value, both included, and unit of options with numbers."""

_HEIGHT_MM: Final = 0.2

_READINGS: Final = ("heights", "relief", "sobel")
"""Meaning of a picture: heights, a photograph with estimated relief, or brightness as height."""


pair = checked(pair_of(float, ","), lambda pair: True, "two numbers with a comma between")
"""Parser of two numbers, for argparse."""


def add_arguments(parser: Any, *, readings: bool = True) -> None:
    """Add the arguments of a source; ``--from`` only with ``readings``."""
    parser.add_argument(
        "source",
        metavar="SOURCE",
        help="a map (.texture.json), a picture of heights, a point cloud (.ply, .xyz), a .blend, "
        "or a material of 'hfx texture list'",
    )
    add_largest(parser)
    parser.add_argument("--object", metavar="NAME", help="object with the surface, in a .blend")
    parser.add_argument(
        "--resolution", type=int, default=512, metavar="N", help="texels along the longer edge"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed: another sample of a library material"
    )
    parser.set_defaults(reading="heights")
    if readings:
        parser.add_argument(
            "--from",
            dest="reading",
            choices=_READINGS,
            help="meaning of a picture: heights (default); relief: a photograph with estimated "
            "relief and roughness; sobel: a photograph, bright is high",
        )
    parser.add_argument(
        "--colours", action="store_const", const="sobel", dest="reading", help="--from sobel"
    )
    parser.add_argument(
        "--size",
        type=pair,
        metavar="MM,MM",
        help="width and height of what a picture shows (default: 100 mm along the longer edge; "
        "--from relief needs it)",
    )
    parser.add_argument(
        "--height",
        type=float,
        metavar="MM",
        help=f"of white over black ({_HEIGHT_MM:g}; with --from relief: as estimated)",
    )
    parser.add_argument(
        "--unit", type=float, default=1.0, metavar="MM", help="of a point cloud's numbers (1)"
    )
    parser.add_argument(
        "--tiles", action="store_true", help="the picture or scan tiles: its opposite edges match"
    )
    parser.add_argument("--roughness", type=Path, metavar="PICTURE", help="dark is smooth")
    parser.add_argument("--blur", type=float, default=0.1, metavar="MM", help="Gaussian (0.1)")
    parser.add_argument(
        "--slope", type=float, default=1.0, help="that is felt at full strength (1)"
    )
    parser.add_argument(
        "--amplitude", type=pair, default=(0.0, 1.3), metavar="G,G", help="the device's, in g"
    )
    parser.add_argument(
        "--frequency", type=pair, default=(80.0, 260.0), metavar="HZ,HZ", help="the device's"
    )
    parser.add_argument(
        "--steps", action="store_true", help="round to noticeable steps of 0.2 g and 40 Hz"
    )


def read(options: argparse.Namespace) -> TextureSource:
    """Read the source named by the options. Raises UsageError for an option out of range, and
    InputError for an unusable source."""
    from hfx_blender.engine.texture.procedural import MATERIALS

    check_numbers(options)
    name, path = options.source, Path(options.source)
    if name in MATERIALS:
        # Procedural materials need 16 texels; the option allows 8, for pictures.
        field, roughness = MATERIALS[name].make(max(options.resolution, 16), options.seed)
        return _built(name, field, roughness, (), options)
    if name.lower().endswith(TEXTURE_MAP_SUFFIX):
        from hfx_blender.formats.pictures import texture_map

        stem = path.name[: -len(TEXTURE_MAP_SUFFIX)]
        return TextureSource(stem, texture_map.read(path), None)
    if path.suffix.lower() == ".blend":
        return _object(path, options)
    if not path.is_file():
        if path.exists():
            refuse_no_file(path)
        fault = "it is a folder" if path.is_dir() else "there is no such file"
        if not path.suffix:
            fault += f", and no library material ({', '.join(MATERIALS)})"
        raise InputError(f"{path}: {fault}.")
    return _file(path, options)


def check_numbers(options: argparse.Namespace) -> None:
    """Raise UsageError for numbers outside their allowed ranges."""
    for option, (low, high, unit) in _RANGES.items():
        given = getattr(options, option, None)
        for value in given if isinstance(given, tuple) else (given,):
            if value is not None and not low <= value <= high:
                allowed = f"{low:.10g} to {high:.10g}{unit}"
                raise UsageError(f"--{option} {value:.10g}: expected {allowed}")


def _file(path: Path, options: argparse.Namespace) -> TextureSource:
    """Surface of a picture or point cloud by the options; InputError for another suffix."""
    blender_session.start()
    from hfx_blender.authoring.surfaces import image_values, surface_sources
    from hfx_blender.engine.texture.height_field import from_image
    from hfx_blender.formats.pictures import point_cloud

    full = Path(os.path.abspath(path))
    suffix = path.suffix.lower()
    if suffix not in (*PICTURE_SUFFIXES, *point_cloud.SUFFIXES):
        pictures = ", ".join(PICTURE_SUFFIXES)
        clouds = ", ".join(point_cloud.SUFFIXES)
        raise InputError(
            f"{path}: is {title_of(path)}; expected a map (.texture.json), a picture ({pictures}), "
            f"a point cloud ({clouds}), a .blend, or the name of a material."
        )
    if suffix not in PICTURE_SUFFIXES:
        relief = surface_sources.read_scan(
            full,
            unit_mm=options.unit,
            size_mm=(1.0, 1.0),
            height_mm=_HEIGHT_MM if options.height is None else options.height,
            resolution=options.resolution,
        )
        field, notes = replace(relief.height, tiles=options.tiles), relief.notes
    else:
        if options.reading == "relief":
            return _estimated(full, options)
        # Heights are the raw numbers of a picture, without conversion of colours.
        grey = picture(full, "brightness" if options.reading == "sobel" else "data")
        grey, notes = image_values.without_holes(grey, path.name)
        height, width = grey.shape
        longest = max(width, height)
        size = options.size or (100.0 * width / longest, 100.0 * height / longest)
        if float(grey.max()) == float(grey.min()):
            notes += ("the picture has the same value everywhere: nothing is felt",)
        size_m = size[0] / 1000.0, size[1] / 1000.0
        height_mm = _HEIGHT_MM if options.height is None else options.height
        field = from_image(grey, height_mm / 1000.0, size_m, tiles=options.tiles)
        del grey  # up to half a gigabyte
    return _built(path.stem, field, None, notes, options)


def _estimated(path: Path, options: argparse.Namespace) -> TextureSource:
    """Estimate relief and roughness from a photograph; ``--height`` rescales the relief. UsageError
    without ``--size``."""
    import numpy as np

    from hfx_blender.engine.texture.relief.relief_estimate import estimate

    if options.size is None:
        raise UsageError(
            f"{path.name}: --from relief needs --size MM,MM, the width and height of what the "
            "picture shows"
        )
    colours = picture(path, "colours")
    size_m = options.size[0] / 1000.0, options.size[1] / 1000.0
    estimated = estimate(colours, size_m, tiles=options.tiles)
    field, slope = estimated.field, estimated.slope
    # Heights begin at 0, so the highest is the whole relief.
    estimated_mm = 1000.0 * float(field.heights_m.max())
    if options.height is not None:
        factor = options.height / estimated_mm if estimated_mm > 0.0 else 0.0
        field = replace(field, heights_m=field.heights_m * factor)
        slope = slope * np.float32(abs(factor))
    note = f"the relief is an estimate from the colours, {estimated_mm:.3g} mm high"
    source = _built(path.stem, field, estimated.roughness, (note,), options, slope)
    return replace(source, is_estimate=True)


def _object(path: Path, options: argparse.Namespace) -> TextureSource:
    """Surface of the object named by ``--object``, or of the only object with a surface in the
    scene of a .blend; a named object without a surface gets one. InputError for no such object."""
    blender_session.open_blend(path)
    import bpy

    from hfx_blender.authoring.surfaces import surfaces

    scene = bpy.context.scene
    candidates = surfaces.surfaces_of(scene)
    if options.object is None:
        if len(candidates) != 1:
            names = ", ".join(f"'{obj.name}'" for obj in candidates) or "none"
            raise InputError(f"{path}: choose a surface with --object; there are: {names}.")
        obj = candidates[0]
    else:
        obj = scene.objects.get(options.object)
        if obj is None:
            raise InputError(f"{path}: has no object '{options.object}'.")
    # An object without a surface gets a surface for this command; the file is not saved.
    if not surfaces.is_surface(obj):
        surfaces.add_surface(obj)
        obj.hfx.surface.resolution = options.resolution
    haptic_map = surfaces.map_of(obj)
    note = obj.hfx.surface.note
    return TextureSource(obj.name, haptic_map, surfaces.field_of(obj), (note,) if note else ())


def _built(
    name: str,
    field: HeightField,
    roughness: Any,
    notes: tuple[str, ...],
    options: Any,
    slope: Any = None,
) -> TextureSource:
    from hfx_blender.engine.texture.haptic_map import DeviceRange, NoticeableSteps
    from hfx_blender.engine.texture.mcha import MapSettings, make_map

    # A picture of roughness replaces the estimate.
    if options.roughness is not None:
        refuse_no_file(options.roughness)
        roughness = picture(options.roughness, "data")
    settings = MapSettings(
        blur_m=options.blur / 1000.0,
        full_slope=options.slope,
        device=DeviceRange(options.amplitude, options.frequency),
        steps=NoticeableSteps() if options.steps else None,
    )
    return TextureSource(name, make_map(field, roughness, settings, slope), field, notes)


def picture(path: Path, values: str) -> F64:
    """Read a picture of any of Blender's formats, bottom row first. ``values`` is "colours" for
    sRGB (h, w, 3), "brightness" (h, w), or "data" for raw numbers (h, w)."""
    blender_session.start()
    import bpy

    from hfx_blender.authoring.surfaces import image_values

    # Blender does not search the working folder.
    image = image_values.load(os.path.abspath(path))
    read = {
        "colours": image_values.colours_of,
        "brightness": image_values.brightness_of,
        "data": image_values.data_of,
    }[values]
    try:
        return read(image)
    finally:
        # Images stay in Blender's memory until removed, and a watched folder may have thousands.
        bpy.data.images.remove(image)


def check_folder(path: Path) -> None:
    """Raise UsageError for a path in a missing folder."""
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder '{path.parent}'")


def steps_of(options: argparse.Namespace) -> Any:
    """Just-noticeable steps with ``--steps``; None without."""
    from hfx_blender.engine.texture.haptic_map import NoticeableSteps

    return NoticeableSteps() if options.steps else None
