# SPDX-License-Identifier: GPL-3.0-or-later
"""Stimuli from tracks, game clips, tables of values, scenes and sensations."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.conditioning.actuator_limits import limited
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster, columns_of
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.files import resources

from ..command_process.temporary_folder import temporary_folder
from .plan import Conditions, Plan, as_text

SUFFIXES: Final = (".hfxtrack", ".hfxclip", ".csv", ".blend")
_SENSATION: Final = ".hfxeffect"


def file_raster(plan: Plan, conditions: Conditions, device: DeviceConfig) -> Raster:
    """Raster of a file or sensation for a device. Begins with the first row that has strength; a
    silent file keeps all rows. Raises InputError for an unusable file."""
    if "effect" in conditions:
        raster = _of_sensation(_sensation_path(plan, as_text(conditions["effect"])), device)
    else:
        path = take_path(plan, conditions)
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise InputError(f"{path}: is no take; allowed are {', '.join(SUFFIXES)}.")
        raster = {
            ".hfxtrack": _of_track,
            ".hfxclip": _of_clip,
            ".csv": _of_table,
            ".blend": _of_scene,
        }[suffix](path, device)
    columns = device.strength_columns
    is_on = np.any(raster.values[:, columns] != device.neutral[columns], axis=1)
    first = int(np.argmax(is_on))
    return raster_of(device, raster.values[first:].copy(), raster.rate_hz)


def _of_track(path: Path, device: DeviceConfig) -> Raster:
    from ..track_rendering import render_devices

    with TrackReader(path) as track:
        return render_devices(track, [device])[0][1]


def _of_clip(path: Path, device: DeviceConfig) -> Raster:
    """Baked rows of a game clip on the clock of the clip."""
    from ..commands.played_clip import PlayedClip

    clip = PlayedClip(path, {device.id: device})
    count = round((clip.end_s - clip.start_s) / clip.sample_s)
    times = clip.start_s + (np.arange(count) + 0.5) * clip.sample_s
    rows = []
    for time_s in times.tolist():
        rows.append(clip.values(device.id, time_s))
    return raster_of(device, np.array(rows), Fraction(1.0 / clip.sample_s).limit_denominator(1001))


def _of_table(path: Path, device: DeviceConfig) -> Raster:
    from ..formats import csv_reader

    raster = csv_reader.read(path)
    if raster.columns != columns_of(device):
        raise InputError(f"{path}: its columns are not those of '{device.id}'.")
    return replace(raster, values=np.array(raster.values))


def _of_scene(path: Path, device: DeviceConfig) -> Raster:
    """Scene of a .blend, exported as a track."""
    import bpy

    from hfx_blender.errors import refuse_no_file
    from hfx_blender.processes import blender_session

    refuse_no_file(path)
    blender_session.start()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), use_scripts=False)
    except RuntimeError as error:
        raise InputError(f"{path}: Blender cannot open it ({error}).") from error
    return _exported(device)


def _of_sensation(path: Path, device: DeviceConfig) -> Raster:
    """Sensation on the avatar, exported as a track."""
    import bpy

    from hfx_blender.authoring.effects import effect_exchange, effect_file, effects
    from hfx_blender.processes import blender_session

    blender_session.start()
    sensation = effect_file.load(path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.hfx.add_avatar()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 0, 24 * 12
    effect_exchange.place_sensation(scene, sensation, body=effects.bodies_of(scene)[0], frame=0.0)
    bpy.context.view_layer.update()
    return _exported(device)


def _exported(device: DeviceConfig) -> Raster:
    """Raster of the open file's scene for a device, by way of a track."""
    import bpy

    from hfx_blender.export import ExportSettings, export_scene

    with temporary_folder() as folder:
        export_scene(bpy.context.scene, Path(folder), "take", ExportSettings(("track",), ()))
        return _of_track(Path(folder) / "take.hfxtrack", device)


def _sensation_path(plan: Plan, name: str) -> Path:
    """File of a sensation: next to the plan, of the user, or shipped; InputError if unknown."""
    folders = (plan.path.parent, resources.user_effects(), resources.effect_library())
    paths = [folder / f"{name.removesuffix(_SENSATION)}{_SENSATION}" for folder in folders]
    for path in paths:
        if path.is_file():
            return path
    shipped = sorted(path.stem for path in folders[-1].glob(f"*{_SENSATION}"))
    raise InputError(
        f"{plan.path}: effect is '{name[:60]}', allowed is one of {', '.join(shipped)}."
    )


def take_path(plan: Plan, conditions: Conditions) -> Path:
    """File of a take, relative to the plan: the value of "take", or "path" of the stimulus with
    values of factors in braces."""
    pattern = str(plan.stimulus.get("path", "{take}"))
    names = set(re.findall(r"\{(\w+)\}", pattern))
    if names - conditions.keys():
        missing = ", ".join(sorted(names - conditions.keys()))
        raise InputError(
            f"{plan.path}: stimulus.path is '{pattern}', but there is no factor {missing}."
        )
    filled = re.sub(r"\{(\w+)\}", lambda match: as_text(conditions[match[1]]), pattern)
    return plan.path.parent / filled


def raster_of(device: DeviceConfig, values: F64, rate_hz: Fraction) -> Raster:
    """Raster of values (T, columns) within the limits of the device's actuators, from time 0."""
    controls = device.controls
    for part in device.actuator_columns:
        values[:, part] = limited(
            values[:, part],
            [control.lowest for control in controls[part]],
            [control.highest for control in controls[part]],
            [control.neutral for control in controls[part]],
        )
    return Raster(
        device.id,
        "",
        tuple(actuator.id for actuator in device.actuators),
        columns_of(device),
        np.arange(len(values)) / float(rate_hz),
        rate_hz,
        values,
        device.neutral,
        (),
        (),
    )
