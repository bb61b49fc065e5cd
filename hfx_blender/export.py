# SPDX-License-Identifier: GPL-3.0-or-later
"""Exporting one scene: record its track, render it for devices, write files, tell what was felt.

Everything is written into a folder of its own beside the destination and moved into place when
all of it is complete.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any
from urllib.parse import quote

import bpy

from . import __version__
from .atomic_files import atomic_file
from .devices.configuration import load_device
from .engine.body.model import load_model
from .engine.evaluate import Engine
from .engine.rendering.device import DeviceConfig
from .engine.rendering.raster import Raster, unrendered
from .engine.rendering.render import Renderer, blocks
from .engine.scene import AnimationBlock
from .engine.tolerance import Tolerance, parse
from .engine.track import SUFFIX, TrackHeader, TrackReader, TrackWriter, as_kept
from .errors import InputError, OutputError, UsageError
from .formats import registry
from .formats.curves import CurveTolerance
from .formats.glb_scene import VolumeRecorder
from .formats.hjif.perceptions import SUFFIX as HJIF_SUFFIX
from .formats.signals import DEFAULT_TOLERANCE
from .reading.scene_reader import SceneReader

FORMATS = registry.FORMATS

Progress = Callable[[float], None]


@dataclass(frozen=True)
class ExportSettings:
    """What is exported, and how."""

    formats: tuple[str, ...] = ("track",)
    devices: tuple[DeviceConfig, ...] = ()
    frames: tuple[int, int] | None = None  # both included; None: the scene's own
    rate_hz: Fraction | None = None  # None: the scene's own
    tolerance: Tolerance | None = None  # None: the scene's own
    full_precision: bool = False  # weights as 32-bit floats instead of 8 bits
    record: tuple[str, ...] = ()  # engine.on_demand.ON_DEMAND
    strict: bool = False  # a warning about the scene is an error

    def __post_init__(self) -> None:
        registry.check(self.formats, self.devices)


@dataclass(frozen=True)
class ExportReport:
    """What one export wrote, and what was felt."""

    scene: str
    files: tuple[Path, ...]
    felt: tuple[dict[str, Any], ...]  # per effect and body: name, seconds, vertices, peak level
    unrendered: tuple[dict[str, Any], ...]  # felt by the body, played by none of the devices
    warnings: tuple[str, ...]
    engine: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # what formats had to simplify, and how far

    def as_dict(self) -> dict[str, Any]:
        """Plain data; file names without folders."""
        return {
            "scene": self.scene,
            "files": [
                {
                    "name": path.name,
                    "bytes": path.stat().st_size,
                    "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
                }
                for path in self.files
            ],
            "felt": list(self.felt),
            "unrendered": list(self.unrendered),
            "warnings": list(self.warnings),
            "notes": list(self.notes),
            "engine": self.engine,
        }


def export_scene(
    scene: bpy.types.Scene,
    folder: Path,
    stem: str,
    settings: ExportSettings,
    progress: Progress = lambda share: None,
) -> ExportReport:
    """Export a scene of the open file as ``folder/stem.*``.

    Raises
    ------
    InputError
        The scene cannot be exported; nothing was written.
    OutputError
        The folder cannot be written to; nothing was left there.
    """
    tolerance = settings.tolerance or scene_tolerance(scene)
    reader = SceneReader(
        scene,
        frames=settings.frames,
        rate_hz=settings.rate_hz,
        tolerance=tolerance,
        with_positions="positions" in settings.record,
        with_velocities="velocities" in settings.record,
    )
    if settings.strict and reader.description.warnings:
        raise InputError("; ".join(reader.description.warnings) + ".")
    engine = Engine(reader.description, record=settings.record, tolerance=tolerance)
    with _staging(folder, stem) as stage:
        track = stage / (stem + SUFFIX)
        volumes = VolumeRecorder(reader.description)
        watch = volumes.add if "glb" in settings.formats else None
        played = record_track(reader, engine, track, settings, progress, watch)
        files = [track] if "track" in settings.formats else []
        with TrackReader(track) as recorded:
            felt = felt_effects(recorded)
            lost = not_played(recorded.header, [raster for _, raster in played])
            written = registry.write_all(
                settings.formats,
                _named(played),
                recorded,
                settings.devices,
                stage / stem,
                CurveTolerance(min(tolerance.amplitude, DEFAULT_TOLERANCE.value)),
            )
            if watch is not None:
                models = [load_model(model.id) for model in recorded.header.models]
                hjif = quote(stem + HJIF_SUFFIX) if "hjif" in settings.formats else None
                written += volumes.write(models, stage / stem, hjif)
        if settings.strict and written.left_out:
            raise InputError("; ".join(written.left_out) + ".")
        report = ExportReport(
            scene=scene.name,
            files=(*files, *written.files),
            felt=felt,
            unrendered=lost,
            warnings=(
                *reader.description.warnings,
                *_counted(engine.counters.warnings),
                *written.left_out,
            ),
            engine={
                "tolerance": tolerance.name,
                "stepping": reader.stepping_note,
                **engine.counters.as_dict(),
            },
            notes=tuple(dict.fromkeys(written.notes)),
        )
        report_file = stage / f"{stem}.report.json"
        with atomic_file(report_file) as file:
            file.write((json.dumps(report.as_dict(), indent=1) + "\n").encode())
        placed = _move((*report.files, report_file), folder)
    return replace(report, files=placed)


def record_track(
    reader: SceneReader,
    engine: Engine,
    path: Path,
    settings: ExportSettings,
    progress: Progress = lambda share: None,
    watch: Callable[[AnimationBlock], None] | None = None,
) -> list[tuple[DeviceConfig, Raster]]:
    """Evaluate a scene block by block, record it, and render it for the devices on the way.

    The devices get exactly what the track keeps: rendering the track later gives the same.
    """
    scene = reader.description
    models = {effect.model_id: load_model(effect.model_id) for effect in scene.effects}
    header = TrackHeader.of(
        scene,
        models,
        settings={"record": sorted(settings.record), "tolerance": reader.tolerance.name},
        tools={"hfx": __version__, "blender": bpy.app.version_string},
    )
    renderers = _renderers(header, settings.devices)
    precise = settings.full_precision
    count = max(len(reader.sample_indices), 1)
    done = 0
    with TrackWriter(path, header, full_precision=precise) as writer:
        for block in reader.blocks():
            runs = [as_kept(run, full_precision=precise) for run in engine.evaluate(block)]
            writer.append(runs)
            for _, renderer in renderers:
                renderer.add(runs)
            if watch is not None:
                watch(block)
            done += len(block.indices) - block.history
            progress(done / count)
    return [(device, renderer.raster()) for device, renderer in renderers]


def felt_effects(track: TrackReader) -> tuple[dict[str, Any], ...]:
    """What each effect did to each body over a whole track."""
    names = {effect.id: effect for effect in track.header.effects}
    bodies = {body.id: body.name for body in track.header.bodies}
    period_s = 1.0 / float(track.header.time.rate_hz)
    return tuple(
        {
            "effect": names[summary.stream.effect_id].name,
            "body": bodies[summary.stream.body_id],
            "modality": summary.stream.modality,
            "kind": names[summary.stream.effect_id].kind,
            "seconds": round(summary.sample_count * period_s, 6),
            "first_s": summary.first_s,
            "last_s": summary.last_s,
            "mean_vertices": round(summary.entry_count / max(summary.sample_count, 1), 1),
            "peak_level": summary.peak_level,
        }
        for summary in track.summary()
    )


def render_devices(
    track: TrackReader, devices: Sequence[DeviceConfig]
) -> list[tuple[DeviceConfig, Raster]]:
    """A recorded track, read once and rendered for each device on each body."""
    renderers = _renderers(track.header, devices)
    for block in blocks(track.header, track.runs()):
        for _, renderer in renderers:
            renderer.add(block)
    return [(device, renderer.raster()) for device, renderer in renderers]


def _renderers(
    header: TrackHeader, devices: Sequence[DeviceConfig]
) -> list[tuple[DeviceConfig, Renderer]]:
    return [
        (device, Renderer(header, device, load_model, body_id=body.id))
        for body in header.bodies
        for device in devices
    ]


def not_played(header: TrackHeader, rasters: Sequence[Raster]) -> tuple[dict[str, Any], ...]:
    """What was felt by a body but rendered by none of its devices."""
    effects = {effect.id: effect.name for effect in header.effects}
    bodies = {body.id: body.name for body in header.bodies}
    return tuple(
        {
            "effect": effects[lost.effect_id],
            "body": bodies[lost.body_id],
            "modality": lost.modality,
            "seconds": round(lost.seconds, 6),
            "share": round(lost.share, 4),
        }
        for lost in unrendered(rasters)
    )


def _named(
    played: Sequence[tuple[DeviceConfig, Raster]],
) -> list[tuple[str, DeviceConfig, Raster]]:
    """What each device plays, with what tells its files' names apart."""
    several = len({raster.body_id for _, raster in played}) > 1
    return [
        # an id may be any text
        (
            f".{quote(raster.body_id, safe='')}.{device.id}" if several else f".{device.id}",
            device,
            raster,
        )
        for device, raster in played
    ]


def _counted(warnings: dict[str, int]) -> list[str]:
    return [f"{text} ({count} times)" for text, count in warnings.items()]


@contextmanager
def _staging(folder: Path, stem: str) -> Iterator[Path]:
    """A folder beside the results that is gone afterwards, whatever happens."""
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=f".{stem}.", suffix=".tmp", dir=folder))
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written to ({error.strerror}).") from error
    try:
        yield stage
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: {error.strerror}.") from error
    except OutputError as error:  # the user knows the file by its final name
        raise OutputError(str(error).replace(str(stage), str(folder))) from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        if is_new:
            with suppress(OSError):  # it holds the results, unless there are none
                folder.rmdir()


def _move(files: Sequence[Path], folder: Path) -> tuple[Path, ...]:
    for path in files:
        if (folder / path.name).is_dir():
            raise OutputError(
                f"{folder / path.name}: cannot be written (there is a folder of that name)."
            )
    return tuple(path.replace(folder / path.name) for path in files)


def scene_devices(scene: bpy.types.Scene) -> tuple[DeviceConfig, ...]:
    """The devices that a scene names. A .blend names devices, it never chooses files."""
    for device in scene.hfx.devices:
        if "/" in device.name or "\\" in device.name or device.name.endswith(".json"):
            raise InputError(
                f"Scene '{scene.name}' asks for the device file '{device.name}': a .blend may "
                "name devices only. Choose the file with --device."
            )
    return tuple(load_device(device.name) for device in scene.hfx.devices)


def scene_tolerance(scene: bpy.types.Scene) -> Tolerance:
    """The tolerance that a scene asks for."""
    if scene.hfx.tolerance != "CUSTOM":
        return parse(scene.hfx.tolerance)
    try:
        return parse(scene.hfx.tolerance_custom)
    except UsageError as error:
        raise InputError(f"Scene '{scene.name}': {error}.") from error


def scene_named(name: str | None) -> bpy.types.Scene:
    """A scene of the open file; the one that was active when it was saved by default."""
    if name is None:
        return bpy.context.scene
    if name not in bpy.data.scenes:
        names = ", ".join(f"'{scene.name}'" for scene in bpy.data.scenes)
        raise InputError(f"{bpy.data.filepath}: has no scene '{name}'; there are: {names}.")
    return bpy.data.scenes[name]
