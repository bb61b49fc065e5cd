# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces as Blender objects: creation, removal, maps and haptic material.

A surface is an effect on an object of the scene. Its relief and the layers of its haptic map are
stored as images in the .blend, and are made again when the settings differ from those stored with
the images.
"""

from __future__ import annotations

import json
import time
import uuid
from typing import TYPE_CHECKING, Final

import bpy

from ...errors import HfxError, InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ...engine.texture.haptic_map import DeviceRange, HapticMap, SurfaceTexture
    from ...engine.texture.height_field import HeightField, SurfaceRelief

_IMAGES = ("relief_image", "intensity_image", "sharpness_image")

_RELIEF_SETTINGS = {
    "MATERIAL": ("uv_map", "resolution", "height_mm"),
    "IMAGE": ("image_kind", "height_mm"),
    "SCAN": ("scan_path", "scan_unit_mm", "scan_size_mm", "height_mm", "resolution"),
    "PROCEDURAL": ("procedural", "seed", "resolution"),
    "MAP": (),
    "GENERATED": (),
}
_FIXED: Final = ("MAP", "GENERATED")  # sources with stored images only, which no setting changes
_ROUNDING: Final = 1e-3  # rounding of values of imported maps beyond 0 to 1, from image conversion
bake_s: dict[str, float] = {}
"""Duration of the last bake of an object's materials, seconds, by its name."""

_LAYER_SETTINGS = ("blur_mm", "full_slope", "lowest_hz", "highest_hz", "use_steps")


def surfaces_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Surfaces of a scene, sorted by name."""
    surfaces = [obj for obj in scene.objects if is_surface(obj)]
    return sorted(surfaces, key=lambda obj: obj.name)


def is_surface(obj: bpy.types.Object | None) -> bool:
    """Test for an object with a haptic surface; False for None."""
    return obj is not None and obj.hfx.role == "EFFECT" and obj.hfx.kind == "SURFACE"


def add_surface(obj: bpy.types.Object, source: str = "MATERIAL") -> None:
    """Add a haptic surface to an object, without a bake. Raises InputError: the object is no mesh,
    is linked, or has a haptic role."""
    from ...engine.texture.haptic_map import STANDARD_GRAVITY, DeviceRange

    if obj.type != "MESH":
        raise InputError(f"'{obj.name}' is a {obj.type.lower()}, not a mesh: it has no surface.")
    if is_surface(obj):
        raise InputError(f"'{obj.name}' has a haptic surface already.")
    if obj.hfx.role != "NONE":
        raise InputError(f"'{obj.name}' is a haptic {obj.hfx.role.lower()} already.")
    if obj.library is not None:
        raise InputError(f"'{obj.name}' is linked from another file; add the surface there.")
    hfx = obj.hfx
    hfx.kind = "SURFACE"
    hfx.role = "EFFECT"
    hfx.uid = uuid.uuid4().hex
    hfx.modality = "vibration"
    device = DeviceRange()
    hfx.amplitude = device.amplitude_g[1] * STANDARD_GRAVITY
    hfx.frequency = device.carrier_hz
    hfx.surface.source = source


def remove_surface(obj: bpy.types.Object) -> None:
    """Reset role, kind, id and surface settings; remove relief and map images without users."""
    settings = obj.hfx.surface
    images = [getattr(settings, name) for name in _IMAGES]
    # Unset properties return to their defaults and take no room in the .blend.
    for name in settings.bl_rna.properties.keys():
        if name not in ("rna_type", "name"):
            settings.property_unset(name)
    obj.hfx.role = "NONE"
    obj.hfx.kind = "VOLUME"
    obj.hfx.uid = ""
    for image in images:
        if image is not None and image.users == 0:
            bpy.data.images.remove(image)


def has_outdated_settings(obj: bpy.types.Object) -> bool:
    """Test for maps with settings that differ from the present settings."""
    settings = obj.hfx.surface
    return settings.made_of != _relief_key(obj) or settings.layers_of != _layer_key(obj)


def make_maps(obj: bpy.types.Object, *, remake: bool = True) -> str:
    """Make an object's maps and store them in the .blend; return notes. With ``remake`` the relief
    is made even if the settings are unchanged, as the material may be edited. Raises InputError:
    the maps cannot be made. Stored maps are unchanged, and the error is shown in the panel."""
    from . import material_relief, surface_sources

    settings = obj.hfx.surface
    if obj.mode == "EDIT":  # the mesh is outdated in Edit Mode
        raise InputError(f"'{obj.name}' is in Edit Mode: leave that first.")
    try:
        # Roughness and heights are made only if their settings or material changed.
        if settings.source not in _FIXED and (remake or settings.made_of != _relief_key(obj)):
            start_s = time.monotonic()
            _store_relief(obj, surface_sources.relief_of(obj))
            settings.is_outdated = False
            settings.material_state = ""
            # Hash and duration decide on later bakes, see surface_updates.
            if settings.source == "MATERIAL":
                settings.material_state = material_relief.material_hash(obj)
                bake_s[obj.name] = time.monotonic() - start_s
        _update_layers(obj)
    except HfxError as error:
        settings.note, settings.is_faulty = str(error), True
        raise
    settings.is_faulty = False
    return settings.note


def _store_relief(obj: bpy.types.Object, relief: SurfaceRelief) -> None:
    """Store heights, roughness and slope as the relief image, with preview, size and notes; the
    layers are made again by the next update."""
    import numpy as np

    from ...engine.texture.mcha import MapSettings, make_map
    from . import image_values

    settings, field = obj.hfx.surface, relief.height
    # Roughness has a resolution of its own; the stored image has that of the heights. A map without
    # blur resamples roughness to this grid, and its sharpness is 1 - roughness.
    plain_settings = MapSettings(blur_m=0.0)
    if relief.roughness is None:
        shape = field.heights_m.shape
        roughness = np.full(shape, plain_settings.default_roughness, np.float32)
    else:
        roughness = 1.0 - make_map(field, relief.roughness, plain_settings).sharpness
    heights_mm = field.heights_m * 1000.0
    channels = [heights_mm, roughness] + ([] if relief.slope is None else [relief.slope])
    settings.relief_image = image_values.store(
        f"{obj.name} Relief (mm)", settings.relief_image, channels
    )
    settings.made_slope = relief.slope is not None
    image_values.set_preview(settings.relief_image, heights_mm)
    settings.made_size_mm = [1000.0 * length for length in field.size_m]
    settings.made_tiles = field.tiles
    settings.made_of = _relief_key(obj)
    settings.layers_of = ""  # the layers belong to the relief before
    settings.note = "; ".join(relief.notes)


def _update_layers(obj: bpy.types.Object) -> None:
    """Make, store and preview the layers of the map, with a warning on saturation, unless their
    settings are unchanged; imported layers are not stored again."""
    from . import image_values, material_relief

    settings = obj.hfx.surface
    if settings.layers_of == _layer_key(obj):
        return
    haptic_map = _map_of(obj, field_of(obj))
    # The layers of an imported map are stored already, and are exact only while untouched.
    if settings.source != "MAP":
        _store_layers(obj, haptic_map)
    image_values.set_preview(settings.intensity_image, haptic_map.intensity)
    image_values.set_preview(settings.sharpness_image, haptic_map.sharpness)
    settings.warning = material_relief.saturation_warning(obj, haptic_map)
    settings.layers_of = _layer_key(obj)


def _store_layers(obj: bpy.types.Object, haptic_map: HapticMap) -> None:
    from . import image_values

    settings = obj.hfx.surface
    settings.intensity_image = image_values.store(
        f"{obj.name} Intensity", settings.intensity_image, [haptic_map.intensity]
    )
    settings.sharpness_image = image_values.store(
        f"{obj.name} Sharpness", settings.sharpness_image, [haptic_map.sharpness]
    )


def ensure_maps(obj: bpy.types.Object) -> None:
    """Make an object's maps if their settings changed."""
    if has_outdated_settings(obj):
        make_maps(obj, remake=False)


def field_of(obj: bpy.types.Object) -> HeightField | None:
    """Stored relief, in its own size, or the present size of a UV unit for a material or image;
    None for an imported map. InputError if no relief is stored."""
    import numpy as np

    from ...engine.texture.height_field import HeightField
    from . import image_values, surface_sources

    settings = obj.hfx.surface
    if settings.source == "MAP":
        return None
    if settings.relief_image is None:
        raise InputError(f"The surface of '{obj.name}' has no map yet; bake it first.")
    heights_m = image_values.pixels_of(settings.relief_image)[..., 0].astype(np.float64) / 1000.0
    size_mm = settings.made_size_mm
    if settings.source in ("MATERIAL", "IMAGE"):  # a UV unit of the present size
        size_mm = surface_sources.tile_mm(obj)
    rows, columns = heights_m.shape
    texel = size_mm[0] / 1000.0 / columns, size_mm[1] / 1000.0 / rows
    return HeightField(heights_m, texel, settings.made_tiles)


def device_of(obj: bpy.types.Object) -> DeviceRange:
    """Amplitudes (m/s^2) and frequencies (Hz) that the map values 0 and 1 of a haptic surface stand
    for. Raises InputError if its lowest frequency is above its highest."""
    from ...engine.texture.haptic_map import STANDARD_GRAVITY, DeviceRange

    hfx = obj.hfx
    if hfx.surface.lowest_hz > hfx.surface.highest_hz:
        raise InputError(
            f"The surface of '{obj.name}': its lowest frequency, {hfx.surface.lowest_hz:g} Hz, is "
            f"above its highest, {hfx.surface.highest_hz:g} Hz."
        )
    return DeviceRange(
        amplitude_g=(0.0, max(hfx.amplitude / STANDARD_GRAVITY, 1e-6)),
        frequency_hz=(hfx.surface.lowest_hz, hfx.surface.highest_hz),
        carrier_hz=max(hfx.frequency, 1.0),
    )


def _layer_of(obj: bpy.types.Object, image: bpy.types.Image) -> npt.NDArray[np.float32]:
    """Layer of an imported map, (rows, columns), clipped to 0 to 1. Raises InputError: values are
    outside of 0 to 1 by more than 0.001, or NaN."""
    import numpy as np

    from . import image_values

    # NaN fails both comparisons, and so counts as invalid.
    values = image_values.pixels_of(image)[..., 0]
    invalid_count = int(np.count_nonzero(~((values >= -_ROUNDING) & (values <= 1.0 + _ROUNDING))))
    if invalid_count:
        raise InputError(
            f"The surface of '{obj.name}': {invalid_count} of {values.size} values of its map "
            f"'{image.name}' are not from 0 to 1; import it again."
        )
    return np.clip(values, 0.0, 1.0)


def _map_of(obj: bpy.types.Object, field: HeightField | None) -> HapticMap:
    """Haptic map of the stored relief, or for ``field`` None of imported layers, with the present
    settings. InputError if layers or packages are missing."""
    import numpy as np

    from ...engine.texture.haptic_map import HapticMap, NoticeableSteps
    from ...engine.texture.mcha import MapSettings, make_map
    from . import image_values

    settings = obj.hfx.surface
    device = device_of(obj)
    steps = NoticeableSteps() if settings.use_steps else None
    if field is None:
        if settings.intensity_image is None or settings.sharpness_image is None:
            raise InputError(f"The surface of '{obj.name}' is an imported map; import one.")
        intensity, sharpness = (
            _layer_of(obj, image) for image in (settings.intensity_image, settings.sharpness_image)
        )
        rows, columns = intensity.shape
        texel = settings.made_size_mm[0] / 1000.0 / columns, settings.made_size_mm[1] / 1000 / rows
        haptic_map = HapticMap(intensity, sharpness, texel, settings.made_tiles, device)
        return haptic_map if steps is None else haptic_map.in_steps(steps)
    pixels = image_values.pixels_of(settings.relief_image)
    slope = np.ascontiguousarray(pixels[..., 2]) if settings.made_slope else None
    map_settings = MapSettings(
        blur_m=settings.blur_mm / 1000.0, full_slope=settings.full_slope, device=device, steps=steps
    )
    try:
        return make_map(field, pixels[..., 1], map_settings, slope)
    except ModuleNotFoundError as error:  # the extension without wheels
        raise InputError(
            f"Haptic maps need '{error.name}', which this installation lacks; install the "
            "extension with its wheels."
        ) from error


def map_of(obj: bpy.types.Object) -> HapticMap:
    """Up-to-date haptic map of an object; InputError if it cannot be made."""
    ensure_maps(obj)
    return _map_of(obj, field_of(obj))


def texture_of(obj: bpy.types.Object) -> SurfaceTexture:
    """Up-to-date haptic material; InputError without maps, or heights for the renderer."""
    from ...devices.configurations import surface_calibration
    from ...engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture

    ensure_maps(obj)
    settings, field = obj.hfx.surface, field_of(obj)
    renderer = SurfaceRenderer[settings.renderer]
    if field is None and renderer is not SurfaceRenderer.MCHA:
        raise InputError(
            f"The surface of '{obj.name}' is an imported map, which has no heights; only "
            "micro-collisions can render it."
        )
    # The property is per millimetre; 0 stands for the calibrated value.
    drive = settings.drive * 1000.0 or surface_calibration.drive_per_m()
    return SurfaceTexture(
        field,
        _map_of(obj, field),
        renderer,
        drive,
        device_of(obj),
        is_calibrated=not settings.drive,
    )


def store_map(obj: bpy.types.Object, haptic_map: HapticMap, note: str = "") -> None:
    """Store an imported map as the object's surface, with its size, frequencies and amplitude. The
    source becomes "MAP", and ``note`` the text in the panel. The relief image is unchanged."""
    from ...engine.texture.haptic_map import STANDARD_GRAVITY

    settings = obj.hfx.surface
    _store_layers(obj, haptic_map)
    settings.made_size_mm = [1000.0 * length for length in haptic_map.size_m]
    settings.made_tiles = haptic_map.tiles
    settings.lowest_hz, settings.highest_hz = haptic_map.device.frequency_hz
    obj.hfx.amplitude = haptic_map.device.amplitude_g[1] * STANDARD_GRAVITY
    settings.source = "MAP"
    settings.made_of = _relief_key(obj)
    settings.layers_of = ""
    _update_layers(obj)
    settings.note, settings.is_faulty = note, False


def store_generated(obj: bpy.types.Object, relief: SurfaceRelief) -> None:
    """Store a generated relief as the surface, and make the map; InputError if that fails."""
    settings = obj.hfx.surface
    settings.source = "GENERATED"
    _store_relief(obj, relief)
    _update_layers(obj)
    settings.is_faulty, settings.is_outdated = False, False


def _relief_key(obj: bpy.types.Object) -> str:
    """JSON text of the source, its settings, names of images or materials, for comparison."""
    settings = obj.hfx.surface
    names = _RELIEF_SETTINGS[settings.source]
    key = [settings.source, *(_plain(getattr(settings, name)) for name in names)]
    # Names stand for datablocks: their pixels and nodes are compared by other means.
    if settings.source == "IMAGE":
        images = (settings.image, settings.roughness_image)
        key += [None if i is None else [i.name_full, i.filepath, *i.size] for i in images]
    if settings.source == "MATERIAL":
        materials = [slot.material for slot in obj.material_slots]
        key.append(["" if material is None else material.name_full for material in materials])
    return json.dumps(key)


def _layer_key(obj: bpy.types.Object) -> str:
    """JSON text that changes with the layers of a map: relief key, layer settings, and the
    effect's amplitude if its layers are rounded to noticeable steps (*Use Steps*)."""
    settings = obj.hfx.surface
    values = [_plain(getattr(settings, name)) for name in _LAYER_SETTINGS]
    # Steps are absolute accelerations, so that rounding depends on the full strength.
    if settings.use_steps:
        values.append(obj.hfx.amplitude)
    return json.dumps([settings.made_of, *values])


def _plain(value: object) -> object:
    return value if isinstance(value, str | int | float) else list(value)


def signature(obj: bpy.types.Object) -> tuple[object, ...]:
    """Comparable value of an object's haptic material: relief and layer settings, renderer, drive,
    the switch *Own Scale*, the entered size of the UV map in mm, amplitude and frequency. The
    object's scale and geometry are not included."""
    settings = obj.hfx.surface
    return (
        _relief_key(obj),
        _layer_key(obj),
        settings.renderer,
        settings.drive,
        settings.use_own_scale,
        *settings.uv_mm,
        obj.hfx.amplitude,
        obj.hfx.frequency,
    )
