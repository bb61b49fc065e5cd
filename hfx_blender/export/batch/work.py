# SPDX-License-Identifier: GPL-3.0-or-later
"""Executes a unit of work in a process with Blender."""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from uuid import uuid4

from ...devices.configuration import load_device
from ...devices.configurations.person_profile import personal
from ...engine.rendering.device_config import DeviceConfig
from ...engine.stepwise import finish, progress_shown
from ...engine.tolerance import parse as parse_tolerance
from ...engine.track import SUFFIX as TRACK_SUFFIX
from ...engine.track.layout import SAMPLES_PER_CHUNK
from ...errors import HfxError, InputError, OutputError, fault_of_file
from ...processes import blender_session
from ...text import named
from . import journal, pieces, units
from .units import ExportOptions, Outcome, Unit, failure

if TYPE_CHECKING:
    import bpy

    from ..scene_export import ExportSettings, SceneExport

Progress = Callable[[float], None]

_VOLUMES: Final = ".npz"
_LONGEST_NAME: Final = 255  # bytes, of file systems in use


@dataclass
class _OpenFile:
    """File that is open in this process."""

    opened: tuple[str, int, int] | None = None  # path, modification time, size

    def clear(self) -> None:
        self.opened = None


_state = _OpenFile()


def run_safely(unit: Unit, progress: Progress = lambda share: None) -> Outcome:
    """Execute a unit; every error except BrokenPipeError becomes the outcome. A defect, or lack of
    memory, asks for a new worker process by ``retire``."""
    try:
        return done(unit, progress)
    except HfxError as error:
        return failure(unit, str(error), error.exit_code)
    # The parent process has ended, and nothing may be written to it.
    except BrokenPipeError:
        raise
    except OSError as error:
        _state.clear()
        # Without a file name the fault is in no file of the user.
        if error.filename is None:
            return _defect(unit, error)
        fault = fault_of_file(error)
        return failure(unit, str(fault), fault.exit_code)
    except MemoryError:
        _state.clear()
        return failure(unit, "not enough memory for this scene", 1, retire=True)
    except Exception as error:
        return _defect(unit, error)


def _defect(unit: Unit, error: Exception) -> Outcome:
    """Outcome of an unexpected exception, with its traceback; asks for a new worker process."""
    _state.clear()
    reason = f"a defect of hfx ({error!r})"
    return failure(unit, reason, 1, retire=True, traceback=traceback.format_exc())


def done(unit: Unit, progress: Progress = lambda share: None) -> Outcome:
    """Execute a unit; raises HfxError for a scene that cannot be exported or written, and for a
    .blend whose results would have too long names."""
    # The longest name of all results: the temporary file of the report.
    longest = f"{unit.stem}.report.json.tmp"
    if len(os.fsencode(longest)) > _LONGEST_NAME:
        raise InputError(
            f"{unit.input}: its name is too long: results are named after it, and '{longest}' has "
            f"more than {_LONGEST_NAME} bytes."
        )
    blender_session.start()
    _open(unit)

    # After the start of Blender: these modules import bpy.
    from ..recording import Recorded, why_in_one_go
    from ..report import describe
    from ..scene_export import SceneExport, ScenePart, other_scenes, scene_named

    scene = scene_named(unit.options.scene)
    names, devices, missing = _devices(unit.options, scene)
    settings = replace(_settings(unit.options, devices, missing), threads=unit.cores)
    export = SceneExport(scene, settings)
    if unit.kind == "part":
        return {"part": _recorded_part(unit, export, progress)}
    models = sorted({effect.model_id for effect in export.reader.description.effects})
    made_from = journal.made_from(unit, names, models)
    if unit.kind == "piece":
        return _piece(unit, export, made_from, progress)
    folder, stage = Path(unit.folder), Path(unit.stage)
    others = () if unit.options.scene is not None else other_scenes(scene)
    remarks = [f"effects of other scenes need --scene NAME: {named(others)}"] if others else []
    if unit.kind in ("merge", "join"):
        if unit.kind == "join":
            parts = []
            for record in pieces.collect(unit, made_from, export.reader.time.sample_count):
                files = pieces.files_of(unit, record)
                volumes = files.get(_VOLUMES, Path())
                facts = Recorded.from_json(record["recorded"])
                parts.append(ScenePart(files[TRACK_SUFFIX], facts, volumes))
        else:
            parts = [
                ScenePart(
                    Path(part["track"]), Recorded.from_json(part["recorded"]), Path(part["volumes"])
                )
                for part in unit.done
            ]
        with progress_shown(progress):
            report = export.merge_parts(parts, folder, unit.stem, made_from, stage)
        if unit.kind == "join":
            pieces.remove(unit)
    else:
        reader, time = export.reader, export.reader.time
        if unit.part_frames is None:
            cut = units.even_parts(reader.sample_indices, time.sample_count, unit.parts)
        else:
            size = ceil(unit.part_frames * time.rate_hz / time.fps)
            cut = units.parts_of(size, time.sample_count)
        # The batch makes a unit of each part, then a merge.
        if len(cut) > 1:
            reason = why_in_one_go(reader)
            if reason is None:
                return {"split": cut}
            remarks.append(f"exported in one go, not in {len(cut)} parts: {reason}")
        report = finish(export.steps(folder, unit.stem, made_from, stage), progress)
    return {
        "input": unit.title,
        "report": report.as_dict(),
        "text": describe(report),
        "remarks": remarks,
    }


def _open(unit: Unit) -> None:
    """Open the file of a unit; all kinds but whole scenes reuse an open, unchanged file."""
    if unit.input is None:
        return
    path = Path(unit.input)
    try:
        stat = path.stat()
        now = (unit.input, stat.st_mtime_ns, stat.st_size)
    except OSError:
        now = None
    # Parts and merges of a scene follow one another in a worker, and reading restores the scene.
    if now is None or now != _state.opened or unit.kind == "scene":
        # Before opening: after a failure no file counts as open.
        _state.clear()
        blender_session.open_blend(path)
        _state.opened = now


def _devices(
    options: ExportOptions, scene: bpy.types.Scene
) -> tuple[list[str], tuple[DeviceConfig, ...], dict[str, str]]:
    """Names or files of devices, their configurations, and errors by unusable device of the
    scene."""
    from ...reading.description.scene_settings import scene_devices

    if options.devices:
        names = [name for name in options.devices if name != "none"]
        return names, tuple(personal(load_device(name), options.profile[0]) for name in names), {}
    devices, missing = scene_devices(scene)
    devices = tuple(personal(device, options.profile[0]) for device in devices)
    chosen = (device.name for device in scene.hfx.devices if device.is_exported)
    named = dict.fromkeys(chosen)
    return [name for name in named if name not in missing], devices, missing


def _settings(
    options: ExportOptions, devices: tuple[DeviceConfig, ...], missing: dict[str, str]
) -> ExportSettings:
    """Settings from options; without formats the track, and CSV files if there are devices. Raises
    InputError if no format is left without the ``missing`` devices."""
    from ...reading.description.scene_settings import formats_without
    from ..scene_export import ExportSettings

    formats = options.formats or (("track", "csv") if devices else ("track",))
    return ExportSettings(
        formats=formats_without(missing, formats, devices),
        devices=devices,
        missing=missing,
        frames=options.frames,
        rate_hz=None if options.rate is None else Fraction(options.rate),
        tolerance=None if options.tolerance is None else parse_tolerance(options.tolerance),
        full_precision=options.full_precision,
        record=options.record,
        strict=options.strict,
        per_clip=options.per_clip,
        clip_detail=options.clip_detail,
    )


def _recorded_part(unit: Unit, export: SceneExport, progress: Progress) -> dict[str, Any]:
    """Record the samples of a part into the unit's stage; returns "track" and "volumes" (paths; the
    latter may be missing) and "recorded" (fields of :class:`.Recorded`). An OutputError names the
    final file, not that of the stage."""
    assert unit.part is not None
    # A random name: a retry after a lost worker must not meet the files of the first attempt.
    track = Path(unit.stage) / f"{unit.part[0]:09d}-{uuid4().hex}"
    volumes = track.with_suffix(_VOLUMES)
    try:
        scene_part = export.record_part(unit.part, track, volumes, progress)
    # Files have random names until complete; messages name the final files.
    except OutputError as error:
        final = Path(unit.folder) / f"{unit.stem}{TRACK_SUFFIX}"
        if unit.piece is not None:
            final = pieces.path_of(pieces.folder_of(unit), unit.piece, TRACK_SUFFIX)
        text = str(error).replace(str(volumes), str(final.with_suffix(_VOLUMES)))
        raise OutputError(text.replace(str(track), str(final))) from error
    return {
        "track": str(scene_part.track),
        "volumes": str(scene_part.volumes),
        "recorded": scene_part.recorded.as_json(),
    }


def _piece(
    unit: Unit, export: SceneExport, made_from: dict[str, Any], progress: Progress
) -> Outcome:
    """Record a piece of a scene for a later merge; empty pieces get a record without samples."""
    from ..recording import why_in_one_go

    assert unit.piece is not None
    number, count = unit.piece
    reader = export.reader
    samples = reader.time.sample_count
    cut = units.even_parts(reader.sample_indices, samples, count, SAMPLES_PER_CHUNK)
    remarks = []
    # Without independent parts, piece 1 records all and the other pieces stay empty.
    if len(cut) > 1 and (reason := why_in_one_go(reader)) is not None:
        remarks.append(f"recorded in one go, as piece 1 of {count}: {reason}")
        cut = [(0, samples)]
    if number > len(cut):
        record = pieces.keep(unit, None, None, made_from)
        text = f"piece {number} of {count}: nothing to record"
    else:
        part = cut[number - 1]
        recorded = _recorded_part(replace(unit, part=part), export, progress)
        track, volumes = Path(recorded["track"]), Path(recorded["volumes"])
        track = track.replace(track.with_suffix(TRACK_SUFFIX))
        files = (track, volumes) if volumes.is_file() else (track,)
        record = pieces.keep(unit, part, recorded["recorded"], made_from, files)
        text = f"piece {number} of {count}: samples {part[0]} to {part[1] - 1}"
    return {"input": unit.title, "piece": record, "text": text, "remarks": remarks}
