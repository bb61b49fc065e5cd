# SPDX-License-Identifier: GPL-3.0-or-later
"""Devices, tolerances and play space chosen in a scene."""

from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import numpy as np

from ...blender.stored_values import bad_values
from ...devices.configuration import load_device, named_in_blend
from ...engine.arrays import F64
from ...engine.rendering.conditioning.feel import Feel
from ...engine.rendering.device_config import DeviceConfig
from ...engine.scene import TimeBase
from ...engine.tolerance import PREVIEW, Tolerance, parse
from ...errors import InputError, UsageError
from ...formats.writing import usable
from ..curves.animation_curves import NotModelledError
from ..curves.animation_time import animation_frames, sample_frames
from ..curves.fcurve_kinematics import PlainObject


def scene_devices(scene: bpy.types.Scene) -> tuple[tuple[DeviceConfig, ...], dict[str, str]]:
    """Load the devices chosen for export, each name once, and warnings by name for unloadable
    devices. Raises InputError for a file path: only names of configurations are allowed in a
    .blend."""
    chosen = {item.name: item for item in scene.hfx.devices if item.is_exported}
    devices: list[DeviceConfig] = []
    missing: dict[str, str] = {}
    for name, item in chosen.items():
        named_in_blend(name)
        try:
            devices.append(load_scene_device(item))
        except InputError as error:
            missing[name] = f"device '{name}' plays nothing: {error}".removesuffix(".")
    return tuple(devices), missing


def load_scene_device(item: bpy.types.PropertyGroup) -> DeviceConfig:
    """Load a device with the rendering scheme chosen in the scene. Raises InputError if the name is
    a file path, or if the device cannot be read."""
    return load_device(named_in_blend(item.name)).rendered_by(scheme_of(item))


def scheme_of(item: bpy.types.PropertyGroup) -> str:
    """Rendering scheme chosen for a device of a scene; "" for CONFIGURED, the device's own
    scheme."""
    return "" if item.scheme == "CONFIGURED" else str(item.scheme)


def formats_without(
    missing: Mapping[str, str], formats: Sequence[str], devices: Sequence[DeviceConfig]
) -> tuple[str, ...]:
    """Formats that the loaded devices can still write; all formats if no device is missing. Raises
    InputError with the reasons of ``missing`` if formats were requested and none is left."""
    # With all devices present a format without a device is the user's mistake, reported elsewhere.
    usable_formats = usable(formats, devices) if missing else tuple(formats)
    if formats and not usable_formats:
        raise InputError("; ".join(missing.values()) + ".")
    return usable_formats


def scene_tolerance(scene: bpy.types.Scene) -> Tolerance:
    """Export tolerance of a scene, preset or custom; raises InputError if the stored value is no
    tolerance."""
    for bad in bad_values(scene):
        if bad.path in ("tolerance", "tolerance_custom"):
            raise InputError(f"Scene '{scene.name}': {bad}.")
    if scene.hfx.tolerance != "CUSTOM":
        return parse(scene.hfx.tolerance)
    try:
        return parse(scene.hfx.tolerance_custom)
    except UsageError as error:
        raise InputError(f"Scene '{scene.name}': {error}.") from error


def live_tolerance(scene: bpy.types.Scene) -> Tolerance:
    """Tolerance of preview and live devices: PREVIEW, or the export tolerance, see
    :func:`scene_tolerance`."""
    return PREVIEW if scene.hfx.live_tolerance == "PREVIEW" else scene_tolerance(scene)


def scene_feel(scene: bpy.types.Scene) -> dict[str, Any]:
    """Track setting of the scene's *Equal Feel*, adaptation and persistence; empty by default."""
    hfx = scene.hfx
    return Feel(hfx.equal_feel, hfx.adaptation, hfx.persistence).as_setting()


def play_space_poses(scene: bpy.types.Scene, time: TimeBase, unit_m: float) -> F64 | None:
    """Play space to world at all samples, (T, 4, 4) in metres; None if the room is the world.
    Raises InputError with constraints, drivers or physics, and for a matrix without an inverse."""
    space = scene.hfx.play_space
    if space is None:
        return None
    try:
        plain = PlainObject(space)
    except NotModelledError as error:
        raise InputError(
            f"Play space '{space.name}': {error}; it is moved by keyframes, clips or parents only."
        ) from None
    # A track stores the room at each sample, so its motion must be known without stepping.
    frames = animation_frames(scene, sample_frames(time, np.arange(time.sample_count)))
    world = plain.world(frames, plain.values.sample(frames))
    world[:, :3, 3] *= unit_m
    if not np.isfinite(world).all() or (np.abs(np.linalg.det(world)) < 1e-12).any():
        raise InputError(f"Play space '{space.name}': its scale is 0, or its place no number.")
    return world


def play_space_now(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, unit_m: float) -> F64:
    """Play space to world at the present frame, (4, 4) in metres, with the scale; identity without
    a play space."""
    space = scene.hfx.play_space
    if space is None:
        return np.eye(4)
    matrix = np.array(space.evaluated_get(layer.depsgraph).matrix_world, np.float64)
    matrix[:3, 3] *= unit_m
    return matrix
