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
from .engine.track import SUFFIX, TrackHeader, TrackReader, TrackWriter, as_kept
from .errors import InputError, OutputError, UsageError
from .formats import csv_raster, wav
from .scene_reader import SceneReader

FORMATS = ("track", "csv", "wav")

Progress = Callable[[float], None]


@dataclass(frozen=True)
class ExportSettings:
    """What is exported, and how."""

    formats: tuple[str, ...] = ("track",)
    devices: tuple[DeviceConfig, ...] = ()
    frames: tuple[int, int] | None = None  # both included; None: the scene's own
    rate_hz: Fraction | None = None  # None: the scene's own
    full_precision: bool = False  # weights as 32-bit floats instead of 8 bits
    record: tuple[str, ...] = ()  # engine.evaluate.ON_DEMAND
    strict: bool = False  # a warning about the scene is an error

    def __post_init__(self) -> None:
        unknown = sorted(set(self.formats) - set(FORMATS))
        if unknown:
            raise UsageError(f"format '{unknown[0]}' is unknown; there are: {', '.join(FORMATS)}")
        if set(self.formats) - {"track"} and not self.devices:
            raise UsageError(
                "the formats csv and wav hold what a device plays: choose one with --device "
                "('hfx device list' shows them)"
            )
        if "wav" in self.formats and not any("vibration" in d.modalities for d in self.devices):
            raise UsageError("none of the devices has vibration actuators, which WAV files play")


@dataclass(frozen=True)
class ExportReport:
    """What one export wrote, and what was felt."""

    scene: str
    files: tuple[Path, ...]
    felt: tuple[dict[str, Any], ...]  # per effect and body: name, seconds, vertices, peak level
    unrendered: tuple[dict[str, Any], ...]  # felt by the body, played by none of the devices
    warnings: tuple[str, ...]
    engine: dict[str, Any] = field(default_factory=dict)

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
    reader = SceneReader(
        scene,
        frames=settings.frames,
        rate_hz=settings.rate_hz,
        with_positions="positions" in settings.record,
        with_velocities="velocities" in settings.record,
    )
    if settings.strict and reader.description.warnings:
        raise InputError("; ".join(reader.description.warnings) + ".")
    engine = Engine(reader.description, record=settings.record)
    with _staging(folder, stem) as stage:
        track = stage / (stem + SUFFIX)
        played = record_track(reader, engine, track, settings, progress)
        files = [track] if "track" in settings.formats else []
        with TrackReader(track) as recorded:
            felt = felt_effects(recorded)
            lost = not_played(recorded.header, [raster for _, raster in played])
        written, left_out = write_rasters(played, stage, stem, settings.formats)
        report = ExportReport(
            scene=scene.name,
            files=(*files, *written),
            felt=felt,
            unrendered=lost,
            warnings=(
                *reader.description.warnings,
                *_counted(engine.counters.warnings),
                *left_out,
            ),
            engine={"stepping": reader.stepping_note, **engine.counters.as_dict()},
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
) -> list[tuple[DeviceConfig, Raster]]:
    """Evaluate a scene block by block, record it, and render it for the devices on the way.

    The devices get exactly what the track keeps: rendering the track later gives the same.
    """
    scene = reader.description
    models = {effect.model_id: load_model(effect.model_id) for effect in scene.effects}
    header = TrackHeader.of(
        scene,
        models,
        settings={"record": sorted(settings.record)},
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


def write_rasters(
    played: Sequence[tuple[DeviceConfig, Raster]],
    folder: Path,
    stem: str,
    formats: Sequence[str],
) -> tuple[list[Path], list[str]]:
    """Write what each device plays in the formats that were asked for; what was left out."""
    several = len({raster.body_id for _, raster in played}) > 1
    files: list[Path] = []
    left_out: list[str] = []
    for device, raster in played:
        body = f".{quote(raster.body_id, safe='')}" if several else ""  # an id may be any text
        name = f"{stem}{body}.{device.id}"
        if "csv" in formats:
            files.append(folder / f"{name}.csv")
            csv_raster.write(raster, files[-1])
        if "wav" not in formats:
            continue
        if "vibration" not in device.modalities:
            left_out.append(f"device '{device.id}' has no vibration actuators: no WAV for it")
            continue
        files.append(folder / f"{name}.wav")
        wav.write(raster, device, files[-1])
        files.append(files[-1].with_name(files[-1].name + wav.SIDECAR_SUFFIX))
    return files, left_out


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


def scene_named(name: str | None) -> bpy.types.Scene:
    """A scene of the open file; the one that was active when it was saved by default."""
    if name is None:
        return bpy.context.scene
    if name not in bpy.data.scenes:
        names = ", ".join(f"'{scene.name}'" for scene in bpy.data.scenes)
        raise InputError(f"{bpy.data.filepath}: has no scene '{name}'; there are: {names}.")
    return bpy.data.scenes[name]
