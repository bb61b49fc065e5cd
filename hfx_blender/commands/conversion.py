# SPDX-License-Identifier: GPL-3.0-or-later
"""Converting files: tracks and rasters to device files, vibration from format to format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from ..devices.configuration import load_device
from ..devices.script_rendering import rendering
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.raster import Column, Raster, columns_of
from ..engine.rendering.render import renderers_of_track
from ..engine.stepwise import finish
from ..engine.track import SUFFIX as TRACK_SUFFIX
from ..engine.track import TrackReader
from ..errors import InputError, OutputError, UsageError
from ..files import limits
from ..files.atomic import inputs_kept, refuse_device
from ..files.staging import place, staging
from ..formats.files import fault_of, format_of, read_signals, refuse_foreign_files
from ..formats.hjif.semantics import is_date
from ..formats.rasters import csv_raster, raster_rules
from ..formats.rasters.signal_raster import RATE_HZ, raster_of
from ..formats.registry import FORMATS, TARGETS, FormatInfo, refuse_unknown, target_of
from ..formats.signals.signals import DEFAULT_TOLERANCE, Credits, FrequencyRange, Signal, distinct
from ..formats.sound import wav
from ..formats.writing import write, write_signals
from ..formats.written import Written, part_path

_READ_AGAIN: Final = 64 << 20  # bytes
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
) -> Written:
    """Write ``source`` in another format.

    A format with one file an actuator puts the actuator's name into the file's name, unless the
    source holds a single signal.

    Parameters
    ----------
    source : Path
        A track, a raster (``.raster.npz``, ``.csv``), or a file with vibration envelopes.
    target : Path
        Its suffix names the format, unless ``to`` does.
    to : str, optional
        One of ``TARGETS``.
    device : str, optional
        Name or file; tracks and rasters need it for device formats, and envelopes for those
        that are of a whole device (csv, npz, wav, tact). With it envelopes become what that
        device plays in any format; HJIF then has its units and places on the body.
    body : str, optional
        Name or id of who wears it; tracks with several bodies need it.
    tolerance : float
    strict : bool
        Something left out is an error, and nothing is written.

    Raises
    ------
    UsageError
        The formats cannot be converted into each other, or an option is missing.
    InputError
        The source cannot be read, asks for too much (``files/limits.py``), or the target cannot
        hold what is asked: nothing is written that ``validate`` would not pass.
    OutputError
        A file cannot be written.
    ScriptError
        The device's script may not run, or has failed.
    """
    refuse_device(target)  # with --to, a suffix may be added to it
    if to is not None:
        refuse_unknown((to,), "--to", TARGETS)
    info = target_of(target) if to is None else FORMATS[to]
    stem = target.name.removesuffix(info.suffix) or target.name
    if not target.parent.is_dir():
        raise OutputError(f"{target.parent}: cannot be written to (there is no such folder).")
    with inputs_kept([source]), staging(target.parent, "hfx") as stage:
        if source.suffix == TRACK_SUFFIX:
            written = _of_track(source, info, stage / stem, device, body, tolerance)
        else:
            written = _of_file(source, info, stage / stem, device, tolerance)
        written += Written(notes=_ignored_options(source, info, device, body))
        if strict and written.left_out:
            raise InputError(f"{source}: {'; '.join(written.left_out)}.")
        for path in written.files:
            _refuse_invalid(source, path, target.parent / path.name)
        finals = [target.parent / path.name for path in written.files]
        refuse_foreign_files(finals, target.with_name(stem + info.suffix))
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
    """Write what is felt in a track, or what a device plays of it."""
    with TrackReader(source) as track:
        if target.write_track:
            devices = (load_device(device),) if device else ()
            if target.id == "hjif":  # it unfolds what is felt at each time
                _refuse_long(track, None)
            made: Written = target.function("write_track")(track, devices, stem, tolerance)
            return made
        found = _device(device, target)
        _refuse_long(track, found)
        named = (each.id for each in track.header.bodies if body in (each.id, each.name))
        given = renderers_of_track(track, (found,), [next(named, body)])
        rendered = finish(rendering(track, given)).complete()
        ((_, raster),) = rendered.played
        raster_rules.refuse(raster, str(source))
        if target.write_played:
            written = target.function("write_played")(track.header, rendered.played, stem, None)
        else:
            written = write(target.id, raster, found, stem, tolerance)
    return written + Written(left_out=rendered.warnings, notes=rendered.notes)


def _of_file(
    source: Path, target: FormatInfo, stem: Path, device: str | None, tolerance: float
) -> Written:
    """Write what a raster or envelopes play."""
    info = format_of(source)
    if not info.read_raster and not info.decode:
        raise UsageError(
            f"{source}: {info.title} cannot be converted; a track, a raster (npz, csv) and "
            "vibration in envelopes can"
        )
    if not target.write_raster and not target.write_signals:
        raise UsageError(f"{source}: only a track can be converted to {target.id}")
    needs_device = bool(info.read_raster) or not target.write_signals
    found = _device(device, target) if needs_device or device is not None else None
    if info.read_raster:
        assert found is not None
        return write(target.id, _raster(source, info, found), found, stem, tolerance)
    signals, frequencies = read_signals(source)
    if not signals:
        raise InputError(f"{source}: holds no vibration.")
    told = Written(
        left_out=tuple(note for each in signals for note in each.left_out),
        notes=tuple(note for each in signals for note in each.notes),
    )
    if all(each.is_silent for each in signals):
        told += Written(notes=("all of it is silent",))
        signals = [replace(each, is_kept=True) for each in signals]
    if found is not None:
        return _played(source, signals, target, found, stem, tolerance) + told
    return _as_envelopes(source, signals, frequencies, target, stem, tolerance) + told


def _played(
    source: Path,
    signals: list[Signal],
    target: FormatInfo,
    device: DeviceConfig,
    stem: Path,
    tolerance: float,
) -> Written:
    """Write what a device plays of envelopes."""
    _refuse_unfolding(signals, device, target, source)
    raster, left_out, notes = raster_of(signals, device, str(source))
    if device.script is not None:
        notes += (
            f"the script of device '{device.id}' did not run: {source.name} holds "
            "what to play, not what is felt",
        )
    notes = (*_lost_credits(signals[0].credits, target, frozenset(), source), *notes)
    return write(target.id, raster, device, stem, tolerance) + Written((), left_out, notes)


def _as_envelopes(
    source: Path,
    signals: list[Signal],
    frequencies: FrequencyRange,
    target: FormatInfo,
    stem: Path,
    tolerance: float,
) -> Written:
    """Write envelopes as they are; a single one gets exactly the name that was asked for."""
    credits, held = signals[0].credits, target.credits
    if target.id == "hjif" and not is_date(credits.created):
        held -= {"created"}
    notes = _lost_credits(credits, target, held, source)
    written = write_signals(target, distinct(signals), frequencies, stem, tolerance)
    if len(signals) == 1:
        written = _named_as_asked(written, signals[0].name, stem)
    return written + Written(notes=notes)


def _lost_credits(
    credits: Credits, target: FormatInfo, held: frozenset[str], source: Path
) -> tuple[str, ...]:
    """Statements of a file about itself that another one has no place for."""
    if credits.description == source.name.partition(".")[0]:  # said by its name, too
        credits = replace(credits, description="")
    return credits.lost(held, target.title)


def _ignored_options(
    source: Path, target: FormatInfo, device: str | None, body: str | None
) -> tuple[str, ...]:
    """Options that say nothing of this conversion."""
    is_track, is_of_track = source.suffix == TRACK_SUFFIX, bool(target.write_track)
    notes = []
    if body is not None and not is_track:
        notes.append("--body says nothing here: the file is of no body")
    elif body is not None and is_of_track:
        notes.append("--body says nothing here: what each body feels is written")
    if device is not None and is_track and is_of_track and not target.write_raster:
        notes.append(f"--device says nothing here: {target.id} holds what is felt")
    return tuple(notes)


def _refuse_invalid(source: Path, made: Path, final: Path) -> None:
    """Refuse to give a file its name that our own validation would not pass.

    Tables and sound are as large as their time: beyond ``_READ_AGAIN`` bytes the rules of their
    rows, kept before they are written, must do, and that they are no larger than what is read.
    """
    size = made.stat().st_size
    if not made.name.endswith(wav.SUFFIX):  # of which only the head is read
        limits.MEMORY.check(size, str(final), "it would have")
    if size > _READ_AGAIN and made.name.endswith(_BY_ROWS):
        return
    fault = fault_of(made)
    if fault:
        raise InputError(
            f"{source}: cannot be converted to {final.name}, which would not be valid: {fault}."
        )


def _refuse_unfolding(
    signals: Sequence[Signal], device: DeviceConfig, target: FormatInfo, source: Path
) -> None:
    """Refuse a small file of envelopes that would become a huge table or sound."""
    lasts_s = max(each.duration_s for each in signals)
    columns = len(device.controls)
    is_sound = target.id == "wav"
    per_s = 2.0 * wav.RATE_HZ * len(device.actuators) if is_sound else 8.0 * RATE_HZ * columns
    limits.check_unfolded(lasts_s * per_s, source.stat().st_size, str(source))


def _refuse_long(track: TrackReader, device: DeviceConfig | None) -> None:
    """Reject a track whose time base asks for too many values, before any is made."""
    time, name = track.header.time, str(track.path)
    limits.SECONDS.check(time.sample_count / float(time.rate_hz), name, "its samples last")
    # A time beside what each actuator is given; what HJIF has of one effect at a time.
    columns = 6 if device is None else len(device.controls)
    rows_bytes = 8.0 * time.sample_count * (columns + 1)
    whom = "" if device is None else f" for '{device.id}'"
    asks = f"'sample_count' is {time.sample_count:,}: values{whom} would take"
    limits.MEMORY.check(rows_bytes, name, asks)


def _named_as_asked(written: Written, signal: str, stem: Path) -> Written:
    """Rename files so that the only signal's name is left out."""
    long = part_path(stem, signal, "").name
    files = tuple(
        path.replace(path.with_name(stem.name + path.name.removeprefix(long)))
        if path.name.startswith(f"{long}.")
        else path
        for path in written.files
    )
    return replace(written, files=files)


def _device(device: str | None, target: FormatInfo) -> DeviceConfig:
    if device is None:
        raise UsageError(f"{target.id} holds what a device plays: choose one with --device")
    return load_device(device)


def _raster(source: Path, info: FormatInfo, device: DeviceConfig) -> Raster:
    """A raster of a file, checked to be that device's; a table knows no device."""
    raster: Raster = info.function("read_raster")(source)
    wanted = columns_of(device)
    if raster.columns != wanted:
        raise InputError(
            f"{source}: its columns are not those of the device '{device.id}'"
            f"{_first_difference(raster.columns, wanted)}."
        )
    if info.id != "csv" and raster.device_id != device.id:
        raise InputError(f"{source}: is for the device '{raster.device_id}', not '{device.id}'.")
    return replace(raster, device_id=device.id)


def _first_difference(found: Sequence[Column], wanted: Sequence[Column]) -> str:
    for number, (one, other) in enumerate(zip(found, wanted, strict=False), start=1):
        if one != other:
            names = [csv_raster.column_name(each) for each in (one, other)]
            return f": column {number} is '{names[0]}', expected is '{names[1]}'"
    return f": it has {len(found)}, expected are {len(wanted)}"
