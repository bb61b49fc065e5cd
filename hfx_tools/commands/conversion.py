# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts tracks and rasters to device files, and vibration between formats."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster, columns_of
from hfx_blender.engine.rendering.render import renderers_of_track
from hfx_blender.engine.track import SUFFIX as TRACK_SUFFIX
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError, OutputError, UsageError
from hfx_blender.files import limits
from hfx_blender.files.atomic import inputs_kept, refuse_device
from hfx_blender.files.staging import place, staging
from hfx_blender.formats.files import format_of, read_signals
from hfx_blender.formats.hjif.semantics import is_date
from hfx_blender.formats.rasters import csv_raster
from hfx_blender.formats.registry import FORMATS, FormatInfo, refuse_unknown
from hfx_blender.formats.signals.signals import (
    DEFAULT_TOLERANCE,
    MAX_HZ,
    Credits,
    FrequencyRange,
    Signal,
)
from hfx_blender.formats.sound import wav
from hfx_blender.formats.sound.sound_analysis import SoundSettings, followed
from hfx_blender.formats.writing import write, write_signals
from hfx_blender.formats.written import Written, part_path

from ..formats import raster_rules
from ..formats.companions import meshes_of
from ..formats.hmpg import hmpg_files
from ..formats.signal_raster import RATE_HZ, raster_of
from ..formats.validation import fault_of
from ..missing_models import refuse_missing
from ..track_rendering import complete
from . import sound_reading

TARGETS: Final = tuple(
    info.id
    for info in FORMATS.values()
    if info.write_track or info.write_played or info.is_of_device
)
"""Ids of the formats that a file can be converted to."""

_START_BYTES: Final = 1 << 16  # bytes compared with those that HFX writes first
_READ_AGAIN: Final = 64 << 20  # bytes
_DOCUMENTS: Final = {"hjif", "hmpg"}  # two forms of one document
_DOCUMENT_SUFFIXES: Final = {FORMATS[id].suffix for id in _DOCUMENTS}
_BY_ROWS: Final = tuple(FORMATS[id].suffix for id in ("csv", "npz", "wav"))


def convert(
    source: Path,
    target: Path,
    *,
    to: str | None = None,
    device: str | None = None,
    body: str | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    strict: bool = False,
    sound: SoundSettings | None = None,
) -> Written:
    """Write a track, a raster (``.raster.npz``, ``.csv``), a file with vibration envelopes or a
    sound in another format; returns the final files, notes and omitted content.

    The suffix of ``target`` selects the format, unless ``to``, an id in ``TARGETS``, is given. A
    format with a file per actuator appends the actuator's name to the file name, unless the source
    holds a single signal, or the device has a single vibration actuator. Upper case in the suffix
    stays, except for files that refer to each other by name (HJIF and its models). Files that
    ``validate`` would reject are not written.

    ``device`` is a name or a file: required for device formats of tracks and rasters, and for
    envelopes in formats of a whole device (csv, npz, wav, tact). With a device, envelopes become
    its output in any format; HJIF then has the actuators and positions of the device. ``body`` is
    name or id of the wearer, required for tracks with several bodies; ``tolerance`` the largest
    error of simplified curves, a share of full scale; ``strict`` makes omitted content an error;
    ``sound`` how vibration follows a sound, None for the defaults.

    Raises UsageError for formats that cannot be converted into each other, or a missing option;
    InputError for a source that cannot be read, exceeds a limit of :mod:`.limits` or does not fit
    the target; OutputError for an unwritable file; ScriptError for a device's script that is not
    approved, or has failed.
    """
    # A move would replace the name of a device or pipe for all programs.
    refuse_device(target)  # with --to, a suffix may be added to it
    if to is not None:
        refuse_unknown((to,), "--to", TARGETS)
    info = target_of(target) if to is None else FORMATS[to]
    has_suffix = target.name.lower().endswith(info.suffix) and target.name.lower() != info.suffix
    stem = target.name[: -len(info.suffix)] if has_suffix else target.name
    if not target.parent.is_dir():
        raise OutputError(f"{target.parent}: cannot be written to (there is no such folder).")
    # Files are checked in the staging folder, and get final names only if all are valid.
    with inputs_kept([source]), staging(target.parent, "hfx") as stage:
        is_track, is_of_track = source.suffix.lower() == TRACK_SUFFIX, bool(info.write_track)
        if is_track:
            written = _of_track(source, info, stage / stem, device, body, tolerance)
        else:
            written = _of_file(source, info, stage / stem, device, tolerance, sound)
        named = target.with_name(stem + info.suffix)
        if has_suffix and ".glb" not in info.companions:
            written, named = _renamed(written, named.name, target.name), target
        notes = []
        if body is not None and not is_track:
            notes.append("--body says nothing here: the file is of no body")
        elif body is not None and is_of_track:
            notes.append("--body says nothing here: what each body feels is written")
        if device is not None and is_track and is_of_track and not info.write_raster:
            notes.append(f"--device says nothing here: {info.id} holds what is felt")
        written += Written(notes=tuple(notes))
        if strict and written.left_out:
            raise InputError(f"{source}: {'; '.join(written.left_out)}.")
        for path in written.files:
            _refuse_invalid(source, path, target.parent / path.name)
        kinds = {info.suffix, source.suffix.lower()}
        if device is None and hmpg_files.SUFFIX in kinds and kinds <= _DOCUMENT_SUFFIXES:
            # The document's vertices are those of meshes beside the source.
            meshes = [
                path for path in meshes_of(source) if not (target.parent / path.name).exists()
            ]
            copies = [Path(shutil.copyfile(path, stage / path.name)) for path in meshes]
            written = replace(written, files=(*written.files, *copies))
        finals = [target.parent / path.name for path in written.files]
        _refuse_foreign_files(finals, named)
        files = place(written.files, target.parent)
    return replace(written, files=files)


def _of_track(
    source: Path,
    target: FormatInfo,
    stem: Path,
    device: str | None,
    body: str | None,
    tolerance: float,
) -> Written:
    """Convert the samples of a track, or render them for a device."""
    with TrackReader(source) as track:
        if target.write_track:
            devices = (load_device(device),) if device else ()
            if target.id in _DOCUMENTS:  # these store every sample
                _refuse_long(track, None)
                refuse_missing(source, track.header)
            return target.function("write_track")(track, devices, stem, tolerance)  # type: ignore[no-any-return]
        config = _device(device, target)
        _refuse_long(track, config)
        refuse_missing(source, track.header)
        # A name is accepted in place of the id.
        ids = (wearer.id for wearer in track.header.bodies if body in (wearer.id, wearer.name))
        renderers = renderers_of_track(track, (config,), [next(ids, body)])
        rendered = complete(track, renderers)
        # One body and one device were chosen: hence one output.
        ((_, raster),) = rendered.played
        raster_rules.refuse(raster, str(source))
        if target.write_played:
            written = target.function("write_played")(track.header, rendered.played, stem, None)
        else:
            written = _write(target, raster, config, stem, tolerance)
    return written + Written(left_out=rendered.warnings, notes=rendered.notes)


def _of_file(
    source: Path,
    target: FormatInfo,
    stem: Path,
    device: str | None,
    tolerance: float,
    sound: SoundSettings | None,
) -> Written:
    """Convert a raster, envelopes or a sound, for a device where given or needed. Files of a single
    signal without a device get exactly the requested name. Raises UsageError for an impossible pair
    of formats, a missing device, or settings of a sound for another file; InputError for a file
    without vibration."""
    is_sound = sound_reading.is_sound(source)
    if sound is not None and not is_sound:
        raise UsageError(f"{source}: is no sound, to which the options of sounds apply")
    info = FORMATS["wav"] if is_sound else format_of(source)
    if "hmpg" in (pair := {info.id, target.id}) and pair <= _DOCUMENTS and device is None:
        return hmpg_files.converted(source, stem, target.suffix)
    if not info.read_raster and not info.decode and not is_sound and info.id != "hmpg":
        raise UsageError(
            f"{source}: {info.title} cannot be converted; a track, a raster (npz, csv), vibration "
            "in envelopes and sound can"
        )
    if not target.write_raster and not target.write_signals:
        raise UsageError(f"{source}: only a track can be converted to {target.id}")
    # Envelopes become envelopes without a device.
    needs_device = bool(info.read_raster) or not target.write_signals
    config = _device(device, target) if needs_device or device is not None else None
    if info.read_raster:
        assert config is not None
        return _write(target, _raster(source, info, config), config, stem, tolerance)
    signals, frequencies = (
        _of_sound(source, sound or SoundSettings(), config, target)
        if is_sound
        else hmpg_files.signals_at(source)
        if info.id == "hmpg"
        else read_signals(source)
    )
    if not signals:
        raise InputError(f"{source}: holds no vibration.")
    remarks = Written(
        left_out=tuple(note for signal in signals for note in signal.left_out),
        notes=tuple(note for signal in signals for note in signal.notes),
    )
    if all(signal.is_silent for signal in signals):
        remarks += Written(notes=("all of it is silent",))
        signals = [replace(signal, is_kept=True) for signal in signals]
    if config is not None:
        return _played(source, signals, target, config, stem, tolerance) + remarks
    notes = _lost_credits(signals[0].credits, target, target.credits, source)
    remarks = Written(notes=notes) + remarks
    written = write_signals(target, distinct(signals), frequencies, stem, tolerance)
    if len(signals) == 1:
        written = _without_part(written, stem, signals[0].name)
    return written + remarks


def _of_sound(
    source: Path, settings: SoundSettings, device: DeviceConfig | None, target: FormatInfo
) -> tuple[list[Signal], FrequencyRange]:
    """Signal that follows a sound, and its frequencies: where the settings state none, those of
    the device, or the range that the format holds. InputError for a file that is no sound."""
    blocks, rate_hz, notes = sound_reading.blocks_of(source)
    if device is not None and not settings.frequencies.is_stated:
        controls = [a.type.controls[1] for a in device.actuators if a.type.modality == "vibration"]
        if controls:
            lowest = min(control.lowest for control in controls)
            highest = max(control.highest for control in controls)
            settings = replace(settings, frequencies=FrequencyRange(lowest, min(highest, MAX_HZ)))
    elif target.held and not settings.frequencies.is_stated:
        held: FrequencyRange = target.function("held")(settings.frequencies)
        settings = replace(settings, frequencies=held)
    used = settings.frequencies
    low, high = f"{used.lowest_hz:g}", f"{used.highest_hz:g}"
    span = f"is at {low} Hz" if low == high else f"has frequencies from {low} to {high} Hz"
    notes += (f"the vibration {span}; --frequencies changes this",)
    signal = followed(blocks, rate_hz, source.stem, settings)
    return [replace(signal, notes=(*notes, *signal.notes))], settings.frequencies


def _write(
    target: FormatInfo, raster: Raster, device: DeviceConfig, stem: Path, tolerance: float
) -> Written:
    """Write the output of a device; a single vibration actuator has the requested file name."""
    written = write(target.id, raster, device, stem, tolerance)
    vibrating = [each.id for each in device.actuators if each.type.modality == "vibration"]
    return _without_part(written, stem, vibrating[0]) if len(vibrating) == 1 else written


def _without_part(written: Written, stem: Path, part: str) -> Written:
    """Rename the files ``stem.part.suffix`` to ``stem.suffix``, the name that was requested for a
    single signal; further files keep their names."""
    return _renamed(written, f"{part_path(stem, part, '').name}.", f"{stem.name}.")


def _renamed(written: Written, old: str, new: str) -> Written:
    """Rename the files whose names begin with ``old`` to begin with ``new``."""
    files = tuple(
        path.replace(path.with_name(new + path.name.removeprefix(old)))
        if path.name.startswith(old) and old != new
        else path
        for path in written.files
    )
    return replace(written, files=files)


def _played(
    source: Path,
    signals: list[Signal],
    target: FormatInfo,
    device: DeviceConfig,
    stem: Path,
    tolerance: float,
) -> Written:
    """Render envelopes for a device, and write the result. Raises TooLargeError for a small file
    that would expand to a huge table or sound, and InputError for signals that the device cannot
    play."""
    # A small file of envelopes may expand to a huge table or sound.
    duration_s = max(signal.duration_s for signal in signals)
    per_s = 8.0 * RATE_HZ * len(device.controls)
    if target.id == "wav":
        per_s = 2.0 * wav.RATE_HZ * len(device.actuators)
    limits.check_unfolded(duration_s * per_s, source.stat().st_size, str(source))
    raster, left_out, notes = raster_of(signals, device, str(source))
    if device.script is not None:
        notes += (
            f"the script of device '{device.id}' did not run: {source.name} holds "
            "what to play, not what is felt",
        )
    notes = (*_lost_credits(signals[0].credits, target, frozenset(), source), *notes)
    return _write(target, raster, device, stem, tolerance) + Written((), left_out, notes)


def _lost_credits(
    credits: Credits, target: FormatInfo, held: frozenset[str], source: Path
) -> tuple[str, ...]:
    """Notes on metadata of the source outside the fields ``held`` by the target, and for HJIF and
    HMPG on a creation date of another form; a description equal to the file name is no loss."""
    if credits.description == source.name.partition(".")[0]:  # repeats the file name
        credits = replace(credits, description="")
    if target.id in _DOCUMENTS and not is_date(credits.created):  # its dates have a fixed form
        held -= {"created"}
    return credits.lost(held, target.title)


def _refuse_invalid(source: Path, path: Path, final: Path) -> None:
    """Raise InputError for a written file that our own validation rejects. Tables and sound files
    above ``_READ_AGAIN`` bytes are not read again: their rows were checked before writing."""
    size = path.stat().st_size
    if not path.name.lower().endswith(wav.SUFFIX):  # readers load the header only
        limits.MEMORY.check(size, str(final), "it would have")
    if size > _READ_AGAIN and path.name.lower().endswith(_BY_ROWS):
        return
    fault = fault_of(path)
    if fault:
        raise InputError(
            f"{source}: cannot be converted to {final.name}, which would not be valid: {fault}."
        )


def _refuse_long(track: TrackReader, device: DeviceConfig | None) -> None:
    """Raise TooLargeError for a track above a day, or with too many values for the memory."""
    time, name = track.header.time, str(track.path)
    limits.SECONDS.check(time.sample_count / float(time.rate_hz), name, "its samples last")
    # A time and the device's columns; for HJIF, six values of an effect at a time.
    columns = 6 if device is None else len(device.controls)
    rows_bytes = 8.0 * time.sample_count * (columns + 1)
    recipient = "" if device is None else f" for '{device.id}'"
    clause = f"'sample_count' is {time.sample_count:,}: values{recipient} would take"
    limits.MEMORY.check(rows_bytes, name, clause)


def _device(device: str | None, target: FormatInfo) -> DeviceConfig:
    if device is None:
        raise UsageError(f"{target.id} holds what a device plays: choose one with --device")
    return load_device(device)


def _raster(source: Path, info: FormatInfo, device: DeviceConfig) -> Raster:
    """Read a raster for a device; csv files name no device and get its id. InputError for other
    columns, or the raster of another device."""
    raster: Raster = info.function("read_raster")(source)
    expected = columns_of(device)
    if raster.columns != expected:
        difference = f"it has {len(raster.columns)}, expected are {len(expected)}"
        for number, pair in enumerate(zip(raster.columns, expected, strict=False), start=1):
            if pair[0] != pair[1]:
                names = [csv_raster.column_name(column) for column in pair]
                difference = f"column {number} is '{names[0]}', expected is '{names[1]}'"
                break
        raise InputError(
            f"{source}: its columns are not those of the device '{device.id}': {difference}."
        )
    # Columns may be equal for devices with different ranges.
    if info.id != "csv" and raster.device_id != device.id:
        raise InputError(f"{source}: is for the device '{raster.device_id}', not '{device.id}'.")
    return replace(raster, device_id=device.id)


def _refuse_foreign_files(files: Iterable[Path], target: Path) -> None:
    """Raise OutputError for an existing file other than ``target`` without HFX's first bytes.
    Missing files are ignored, an unreadable file counts as another program's; returns nothing."""
    for path in files:
        if path == target or not path.is_file():
            continue
        starts = (
            info.own_start for info in FORMATS.values() if path.name.lower().endswith(info.suffix)
        )
        start = next(filter(None, starts), None)
        head = b""  # an unreadable file counts as another program's
        with suppress(OSError), path.open("rb") as file:
            head = file.read(_START_BYTES)
        if start is None or not re.match(start, head, re.DOTALL):
            raise OutputError(
                f"{path}: cannot be written (another program's file has this name); "
                f"'{target.name}' needs this name: choose another target."
            )


def target_of(path: Path) -> FormatInfo:
    """Return the format to write to an output path: that of the longest suffix with which the name
    ends, in upper or lower case. Raises UsageError for an unknown suffix, and for a name of only a
    suffix."""
    # ".v1.he" ends with ".he", too: the longest suffix wins.
    targets = [FORMATS[id] for id in TARGETS]
    for info in sorted(targets, key=lambda each: -len(each.suffix)):
        if path.name.lower().endswith(info.suffix) and path.name.lower() != info.suffix:
            return info
    suffixes = ", ".join(target.suffix for target in targets)
    raise UsageError(f"{path}: its suffix names no format; there are {suffixes}, or say --to")


def distinct(signals: Iterable[Signal]) -> list[Signal]:
    """Signals in order, repeated names numbered ("a", "a 2"), as files are named after signals.
    Case does not count; a number that is a name already is passed over."""
    taken: dict[str, int] = {}  # last number given to each name
    renamed = []
    for signal in signals:
        name, key = signal.name, signal.name.casefold()
        while name.casefold() in taken:
            taken[key] = taken.get(key, 1) + 1
            name = f"{signal.name} {taken[key]}"
        taken[name.casefold()] = 1
        renamed.append(replace(signal, name=name))
    return renamed
