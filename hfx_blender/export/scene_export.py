# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports a scene: records the track, renders it for devices, writes files and a report.

All files are written into a hidden folder at the destination and moved into place when complete.
"""

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import bpy

from ..authoring.effects import swarms
from ..blender import linked_files
from ..devices.script_rendering import Rendered, rendering
from ..engine.areas.felt_times import FeltTimes
from ..engine.arrays import write_npz
from ..engine.body.model import load_model
from ..engine.counters import OF_HISTORY, Unfelt
from ..engine.evaluate import Engine
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.render import misfits, renderers_of_track
from ..engine.rendering.renderer import Renderer
from ..engine.rendering.room import needs_positions
from ..engine.scene import AnimationBlock, HapticVolume
from ..engine.stepwise import Progress, finish
from ..engine.tolerance import Tolerance
from ..engine.track import SUFFIX, TrackReader
from ..engine.track.excerpt import merge
from ..engine.track.track_reader import Content
from ..errors import InputError
from ..files.atomic import atomic_file, inputs_kept
from ..files.kinds import REPORT_SUFFIX
from ..files.staging import place, staging
from ..formats import writing
from ..formats.clip import DETAIL
from ..formats.files import without_invalid_files
from ..formats.registry import FORMATS
from ..formats.signals.signals import DEFAULT_TOLERANCE
from ..formats.written import Written
from ..processes.start import cores
from ..reading.description.scene_settings import formats_without, scene_tolerance
from ..reading.description.unfelt import is_partial
from ..reading.scene_reader import BLOCK_SIZE, SceneReader
from ..text import MOST_LINES, counted, shortened
from . import report, result_files
from .clip_files import write_clips
from .recording import Recorded, SceneRecorders, record_track

_THREADS: Final = 8
"""Largest number of engine threads; one thread reads, renders and writes, and cannot feed more."""


@dataclass(frozen=True)
class ExportSettings:
    """Settings of an export; repeated formats and devices count once. Raises UsageError for formats
    and devices that no scene could be exported with."""

    formats: tuple[str, ...] = ("track",)
    devices: tuple[DeviceConfig, ...] = ()
    frames: tuple[int, int] | None = None  # both included; None: of the scene
    rate_hz: Fraction | None = None  # None: of the scene
    tolerance: Tolerance | None = None  # None: of the scene
    full_precision: bool = False  # weights as 32-bit floats instead of 8 bits
    record: tuple[str, ...] = ()  # engine.areas.sample_run_builder.ON_DEMAND
    strict: bool = False  # a warning about the scene is an error
    threads: int = field(default_factory=cores)  # largest number, without effect on results
    clip_detail: int = DETAIL  # level of detail of bodies in game clips
    per_clip: bool = False  # separate files for each named clip instead of the whole timeline
    missing: Mapping[str, str] = field(default_factory=dict)  # device id to reason of silence

    def __post_init__(self) -> None:
        writing.check(self.formats, self.devices)
        devices = {device.id: device for device in self.devices}
        # Fields of a frozen dataclass are set through object.
        object.__setattr__(self, "devices", tuple(devices.values()))
        object.__setattr__(self, "formats", tuple(dict.fromkeys(self.formats)))

    def without(self, missing: Mapping[str, str]) -> "ExportSettings":
        """Settings without the given devices, mapped to reasons; InputError without output."""
        if not missing:
            return self
        devices = tuple(device for device in self.devices if device.id not in missing)
        together = {**self.missing, **missing}
        formats = formats_without(together, self.formats, devices)
        return replace(self, formats=formats, devices=devices, missing=together)


@dataclass(frozen=True, eq=False)
class ScenePart:
    """Part of the samples of a scene, recorded separately."""

    track: Path
    recorded: Recorded
    volumes: Path  # arrays of SceneRecorders; missing without recorders


class SceneExport:
    """Export of a scene of the open file, whole or in parts; InputError for an unusable scene."""

    def __init__(self, scene: bpy.types.Scene, settings: ExportSettings) -> None:
        # Actuators with a position in the room are rendered from the positions of samples.
        if needs_positions(settings.devices) and "positions" not in settings.record:
            settings = replace(settings, record=(*settings.record, "positions"))
        self._scene = scene
        self.tolerance = settings.tolerance or scene_tolerance(scene)
        self.reader = SceneReader(
            scene,
            frames=settings.frames,
            rate_hz=settings.rate_hz,
            tolerance=self.tolerance,
            with_positions="positions" in settings.record or "glb" in settings.formats,
            with_velocities="velocities" in settings.record,
            with_far="glb" in settings.formats or "clip" in settings.formats,
        )
        # Devices that fit no body are left out before anything is recorded.
        self._settings = settings.without(misfits(self.reader.description, settings.devices))
        self._warnings = self.reader.description.warnings
        # By name, in the order of the effects; effects known as unfelt have their own reason.
        self._without_clip: dict[str, Unfelt] = {}
        if settings.per_clip:
            why = Unfelt("has no clip, and only clips are exported", is_warned=True)
            self._without_clip = {
                effect.name: why
                for effect in self.reader.description.effects
                if not (effect.clips or effect.name in self.reader.unfelt)
            }
            text = "effects without a clip are left out with --per-clip"
            self._warnings = (*self._warnings, *counted([*self._without_clip], text))
        if settings.strict:
            _refuse((*self._warnings, *self._settings.missing.values()))

    def _recorders(self) -> SceneRecorders:
        """Recorders for the formats of this export; none for other formats than glb and clip."""
        return SceneRecorders(
            self.reader.description, self._settings.formats, self._settings.clip_detail
        )

    def steps(
        self,
        folder: Path,
        stem: str,
        made_from: Mapping[str, Any] | None = None,
        stage_in: Path | None = None,
    ) -> Generator[float, None, report.ExportReport]:
        """Export to ``folder/stem.*``, see :func:`export_scene`, in steps of :mod:`.stepwise`;
        closed early, no files are left. ``made_from`` is stored in the report. Unfinished files are
        in a new folder in ``stage_in``, or in ``folder`` by default."""
        with staging(folder, stem, stage_in) as stage:
            track = stage / (stem + SUFFIX)
            # Devices are rendered while samples arrive, so that the track is not read again.
            recorders = self._recorders()
            recorded, written, renderers = yield from self._record(
                track, recorders, None, self._settings.devices
            )
            with TrackReader(track, written) as whole:
                rendered = yield from rendering(whole, renderers)
                return self._finish(whole, recorders, recorded, rendered, folder, made_from or {})

    def record_part(
        self,
        part: tuple[int, int],
        track: Path,
        volumes: Path,
        progress: Progress = lambda share: None,
    ) -> ScenePart:
        """Record only samples ``first <= index < stop``, whole chunks of the track."""
        recorders = self._recorders()
        recorded, *_ = finish(self._record(track, recorders, part, ()), progress)
        if recorders.is_any:
            with atomic_file(volumes) as file:
                write_npz(file, recorders.arrays())
        return ScenePart(track, recorded, volumes)

    def merge_parts(
        self,
        parts: Sequence[ScenePart],
        folder: Path,
        stem: str,
        made_from: Mapping[str, Any] | None = None,
        stage_in: Path | None = None,
    ) -> report.ExportReport:
        """Merge parts, in order of time, into the results of :meth:`steps`. Devices are rendered
        here, on the whole track, because devices carry state between samples."""
        with staging(folder, stem, stage_in) as stage:
            track = stage / (stem + SUFFIX)
            merge([part.track for part in parts], track)
            recorders = self._recorders()

            def blocks_at(sample: int) -> Iterable[AnimationBlock]:
                # Positions of blocks are fixed in time, so this block equals the recorded one.
                start = sample // BLOCK_SIZE * BLOCK_SIZE
                return self.reader.blocks((start, start + BLOCK_SIZE))

            if recorders.is_any:
                recorders.join([part.volumes for part in parts], blocks_at)
            with TrackReader(track) as whole:
                rendered = finish(
                    rendering(whole, renderers_of_track(whole, self._settings.devices))
                )
                recorded = Recorded.merged([part.recorded for part in parts])
                return self._finish(whole, recorders, recorded, rendered, folder, made_from or {})

    def _record(
        self,
        track: Path,
        recorders: SceneRecorders,
        part: tuple[int, int] | None,
        devices: Sequence[DeviceConfig],
    ) -> Generator[
        float, None, tuple[Recorded, Content | None, list[tuple[DeviceConfig, Renderer]]]
    ]:
        """Record samples ``part`` (None: all) into ``track``, in steps; returns the facts of the
        recording, the content of the track, and the renderers of ``devices`` with these samples."""
        settings = self._settings
        engine = Engine(
            self.reader.description,
            record=settings.record,
            tolerance=self.tolerance,
            threads=min(settings.threads, _THREADS),
        )
        times = FeltTimes()
        writer, renderers = yield from record_track(
            self.reader,
            engine,
            track,
            devices=devices,
            record=settings.record,
            full_precision=settings.full_precision,
            watch=recorders.add if recorders.is_any else None,
            part=part,
            times=times,
        )
        return Recorded.of(self.reader, engine, times), writer and writer.written, renderers

    def _finish(
        self,
        whole: TrackReader,
        recorders: SceneRecorders,
        recorded: Recorded,
        rendered: Rendered,
        folder: Path,
        made_from: Mapping[str, Any],
    ) -> report.ExportReport:
        """Write the files and the report of a recorded track, close it, and move all into
        ``folder``, the report last. Stale files of silenced devices are removed. InputError for
        warnings if strict, before any move."""
        settings = self._settings
        stem = whole.path.with_name(whole.path.name.removesuffix(SUFFIX))
        answering = {
            effect.id
            for effect in self.reader.description.effects
            if isinstance(effect.area, HapticVolume) and effect.area.response
        }
        effects, missed = report.effect_facts(
            whole,
            self._without_clip | self.reader.unfelt,
            recorded.warnings,
            flattened=recorded.flattened,
            is_part=is_partial(self.reader.found.scene, self.reader.time),
            instances={effect.id for effect in self.reader.instances.descriptions},
            times=recorded.times,
            answering=answering,
            seen_on=recorded.reading.get("on", {}),
        )
        unfelt = {line["effect"] for line in effects if not line["felt"]}
        felt_lines = tuple(
            line
            for line in report.felt_effects(whole, recorded.times, unfelt)
            # Unfelt effects have lines for samples without strength only.
            if line["effect"] not in unfelt
            or (line["mean_vertices"] and line["effect"] not in self._without_clip)
        )
        written, rendered = self._write(whole, recorders, rendered, stem)
        rasters = [raster for _, raster in rendered.played]
        lost = report.not_played(whole.header, rasters, self._without_clip)
        short = report.shortfalls(whole.header, rasters, self._without_clip)
        short += report.below_threshold(whole.header, recorded.times)
        whole.close()  # Windows moves no open file
        silenced = {**settings.missing, **rendered.silent}
        silent = tuple(silenced.values())
        new_warnings = *recorded.warnings, *missed, *rendered.warnings, *silent, *written.left_out
        # Before anything is moved: a refused export leaves the files of an earlier one.
        if settings.strict:
            _refuse(new_warnings)
        new = {folder / path.relative_to(stem.parent) for path in written.files}
        earlier = [
            path for path in report.stale_files(folder, stem.name, silenced) if path not in new
        ]
        removed = tuple(f"{path.name} of an earlier export is removed" for path in earlier)
        result = report.ExportReport(
            scene=self._scene.name,
            folder=stem.parent,
            files=written.files,
            felt=felt_lines,
            effects=effects,
            unrendered=lost,
            warnings=shortened((*self._warnings, *new_warnings)),
            left_out=written.left_out,
            silent_devices=silent,
            engine={
                "tolerance": self.tolerance.name,
                "stepping": recorded.stepping,
                **{name: n for name, n in recorded.engine.items() if name not in OF_HISTORY},
            },
            reading=recorded.reading,
            notes=shortened((*removed, *recorded.notes, *short, *rendered.notes, *written.notes)),
            made_from=made_from,
        )
        # Everything is complete in the staging folder; moving files is the only step that is left.
        report_file = stem.with_name(stem.name + REPORT_SUFFIX)
        with atomic_file(report_file) as file:
            file.write(report.encoded_report(result.as_dict(), report_file.name))
        # The report comes last: its presence implies the presence of all of its files.
        with inputs_kept(linked_files.files_read(self.reader.files)):
            placed = place((*result.files, report_file), folder, stem.parent)
        # An old file would pass for the device's present output.
        for path in earlier:
            path.unlink(missing_ok=True)
        return replace(result, folder=folder, files=placed)

    def _write(
        self, whole: TrackReader, recorders: SceneRecorders, rendered: Rendered, stem: Path
    ) -> tuple[Written, Rendered]:
        """Write the files of all formats next to the track; InputError without any result. Returns
        the rendering without devices that failed in a clip."""
        settings = self._settings
        # Formats simplify within the scene's tolerance, but never beyond 1 % of full scale.
        tolerance = min(self.tolerance.amplitude, DEFAULT_TOLERANCE)
        if settings.per_clip:
            written, rendered = write_clips(
                whole, settings.formats, settings.devices, rendered, stem, tolerance
            )
        else:
            tracks = (whole.path,) if "track" in settings.formats else ()
            played = result_files.placed(whole.header, rendered.played, stem, stem)
            written = Written(tracks) + writing.write_all(
                settings.formats,
                played,
                whole,
                settings.devices,
                stem,
                tolerance,
                recorders.spatial,
            )
        written = without_invalid_files(written)
        if settings.formats and not written.files and recorders.volumes is None:
            _refuse(written.left_out)
        if recorders.volumes is not None:
            # The glb refers to the HJIF of the same export, by its file name as a URI.
            models = [load_model(model.id) for model in whole.header.models]
            hjif = stem.name + FORMATS["hjif"].suffix
            has_hjif = hjif in {path.name for path in written.files} and not settings.per_clip
            written += recorders.volumes.write(models, stem, quote(hjif) if has_hjif else None)
        return written, rendered


def export_scene(
    scene: bpy.types.Scene,
    folder: Path,
    stem: str,
    settings: ExportSettings,
    progress: Progress = lambda share: None,
) -> report.ExportReport:
    """Export a scene of the open file as ``folder/stem.*``; after an error nothing is left. Raises
    InputError for an unusable scene, OutputError for an unwritable folder."""
    return finish(SceneExport(scene, settings).steps(folder, stem), progress)


def _refuse(warnings: Sequence[str]) -> None:
    """Raise InputError with all warnings, unless there are none."""
    if warnings:
        raise InputError("; ".join(shortened(warnings, MOST_LINES)) + ".")


def other_scenes(scene: bpy.types.Scene) -> list[str]:
    """Names of the local scenes of the open file with effects that ``scene``, with its background
    scenes, lacks."""
    listed = {*swarms.listed_effects(scene)}
    own = (other for other in bpy.data.scenes if other.library is None)
    return [other.name for other in own if not listed.issuperset(swarms.listed_effects(other))]


def scene_named(name: str | None) -> bpy.types.Scene:
    """Scene of the open file by name; None: the scene that was active when saved. Raises InputError
    for an unknown name."""
    if name is None:
        return bpy.context.scene
    if name not in bpy.data.scenes:
        names = ", ".join(f"'{scene.name}'" for scene in bpy.data.scenes)
        raise InputError(f"{bpy.data.filepath}: has no scene '{name}'; there are: {names}.")
    return bpy.data.scenes[name]
