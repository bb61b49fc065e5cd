# SPDX-License-Identifier: GPL-3.0-or-later
"""Converting files: tracks and rasters to device files, vibration from format to format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from ..devices.configuration import load_device
from ..devices.script_rendering import rendering
from ..engine.rendering.device import DeviceConfig
from ..engine.rendering.devices import renderers_of_track
from ..engine.rendering.raster import Column, Raster, columns_of
from ..engine.stepwise import finish
from ..engine.track import SUFFIX as TRACK_SUFFIX
from ..engine.track import TrackReader
from ..errors import InputError, OutputError, UsageError
from ..files import limits
from ..files.atomic import inputs_kept, refuse_device
from ..files.staging import place, staging
from ..formats.files import format_of, read_signals, refuse_strangers
from ..formats.gate import fault_of
from ..formats.hjif import from_actuators
from ..formats.hjif.semantics import is_date
from ..formats.rasters import csv_raster, npz_raster, raster_rules
from ..formats.rasters.signal_raster import RATE_HZ, raster_of
from ..formats.registry import (
    DEVICE_FORMATS,
    PLAYED_FORMATS,
    TRACK_FORMATS,
    DeviceFormat,
    PlayedFormat,
    TrackFormat,
    refuse_removed,
    refuse_unknown,
    suffixes,
    write,
)
from ..formats.signals.credits import Credits
from ..formats.signals.curves import CurveTolerance
from ..formats.signals.signals import DEFAULT_TOLERANCE, Signal, distinct
from ..formats.sound import wav
from ..formats.written import Written, beside

_READ_AGAIN: Final = 64 << 20  # bytes
_RICHTAP: Final = frozenset({"created"})
_HELD_CREDITS: Final = {
    "haptic": frozenset({"author", "project", "source", "tags"}),
    "ahap": frozenset({"project", "created", "others"}),
    **dict.fromkeys(("he", "he1", "openharmony"), _RICHTAP),
}
"""Statements of :class:`Credits` that formats have a place for; those of a device have none."""

_BY_ROWS: Final = (csv_raster.SUFFIX, npz_raster.SUFFIX, wav.SUFFIX)


def convert(
    source: Path,
    target: Path,
    *,
    to: str | None = None,
    device: str | None = None,
    body: str | None = None,
    tolerance: CurveTolerance = DEFAULT_TOLERANCE,
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
        Key of ``DEVICE_FORMATS``, ``TRACK_FORMATS`` or ``PLAYED_FORMATS``.
    device : str, optional
        Name or file; tracks and rasters need it for device formats, and envelopes for those
        that are of a whole device (csv, npz, wav, tact). With it envelopes become what that
        device plays in any format; HJIF then has its units and places on the body.
    body : str, optional
        Name or id of who wears it; tracks with several bodies need it.
    tolerance : CurveTolerance
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
    kind, stem = _target(target, to)
    if not target.parent.is_dir():
        raise OutputError(f"{target.parent}: cannot be written to (there is no such folder).")
    with inputs_kept([source]), staging(target.parent, "hfx") as stage:
        written = _converted(source, kind, stage / stem, device, body, tolerance)
        written += Written(notes=_ignored_options(source, kind, device, body))
        if strict and written.left_out:
            raise InputError(f"{source}: {'; '.join(written.left_out)}.")
        for path in written.files:
            _refuse_invalid(source, path, target.parent / path.name)
        finals = [target.parent / path.name for path in written.files]
        refuse_strangers(finals, target.with_name(stem + suffixes([kind])[0]))
        files = place(written.files, target.parent)
    return replace(written, files=files)


def _target(target: Path, to: str | None) -> tuple[str, str]:
    """Format and stem of the target."""
    formats: dict[str, DeviceFormat | TrackFormat | PlayedFormat] = {
        **DEVICE_FORMATS,
        **TRACK_FORMATS,
        **PLAYED_FORMATS,
    }
    if to is not None:
        refuse_unknown((to,), "--to", formats)
        suffix = formats[to].suffix
        name = target.name
        return to, name[: -len(suffix)] if name.endswith(suffix) and name != suffix else name
    refuse_removed(target)
    by_length = sorted(formats.values(), key=lambda each: -len(each.suffix))
    for each in by_length:
        if target.name.endswith(each.suffix) and target.name != each.suffix:
            # .he is version 2 by default: it comes first in the table.
            name = next(key for key, one in formats.items() if one.suffix == each.suffix)
            return name, target.name[: -len(each.suffix)]
    known = ", ".join(dict.fromkeys(each.suffix for each in formats.values()))
    raise UsageError(f"{target}: its suffix names no format; there are {known}, or say --to")


def _converted(
    source: Path,
    kind: str,
    stem: Path,
    device: str | None,
    body: str | None,
    tolerance: CurveTolerance,
) -> Written:
    if source.suffix == TRACK_SUFFIX:
        with TrackReader(source) as track:
            if kind in TRACK_FORMATS:
                devices = (load_device(device),) if device else ()
                if kind == "hjif":
                    _refuse_long(track, None)
                return TRACK_FORMATS[kind].write(track, devices, stem, tolerance)
            found = _device(device, kind)
            _refuse_long(track, found)
            given = renderers_of_track(track, (found,), [_body_id(track, body)])
            rendered = finish(rendering(track, given)).complete()
            ((_, raster),) = rendered.played
            raster_rules.refuse(raster, str(source))
            if kind in PLAYED_FORMATS:
                written = PLAYED_FORMATS[kind].write(track.header, rendered.played, stem, None)
            else:
                written = write(kind, raster, found, stem, tolerance)
        return written + Written(left_out=rendered.warnings, notes=rendered.notes)
    found_format = format_of(source)
    is_raster = found_format.name in ("npz", "csv")
    if not is_raster and not found_format.has_signals:
        raise UsageError(
            f"{source}: {found_format.title} cannot be converted; a track, a raster (npz, csv) and "
            "vibration in envelopes can"
        )
    if kind in PLAYED_FORMATS or (kind in TRACK_FORMATS and kind != "hjif"):
        raise UsageError(f"{source}: only a track can be converted to {kind}")
    if is_raster:
        found = _device(device, kind)
        raster = _raster(source, found)
        if kind == "hjif":
            return from_actuators.write(raster, found, stem, tolerance)
        return write(kind, raster, found, stem, tolerance)
    write_signals = (
        from_actuators.write_signals if kind == "hjif" else DEVICE_FORMATS[kind].write_signals
    )
    found_device = None
    if write_signals is None or device is not None:
        found_device = _device(device, kind)
    signals, frequencies = read_signals(source)
    lost = tuple(note for each in signals for note in each.left_out)
    read_notes = tuple(note for each in signals for note in each.notes)
    if not signals:
        raise InputError(f"{source}: holds no vibration.")
    if all(each.is_silent for each in signals):
        read_notes += ("all of it is silent",)
        signals = [replace(each, is_kept=True) for each in signals]
    _refuse_unfolding(signals, found_device, kind, source)
    read_notes += _lost_credits(signals[0].credits, kind, found_device, source)
    if found_device is not None:
        raster, left_out, notes = raster_of(signals, found_device, str(source))
        write_raster = from_actuators.write if kind == "hjif" else partial(write, kind)
        if found_device.script is not None:
            notes += (
                f"the script of device '{found_device.id}' did not run: {source.name} holds "
                "what to play, not what is felt",
            )
        written = write_raster(raster, found_device, stem, tolerance)
        return written + Written((), lost + left_out, read_notes + notes)
    assert write_signals is not None
    written = write_signals(distinct(signals), frequencies, stem, tolerance)
    written += Written((), lost, read_notes)
    return _named_as_asked(written, signals[0].name, stem) if len(signals) == 1 else written


def _lost_credits(
    credits: Credits, kind: str, device: DeviceConfig | None, source: Path
) -> tuple[str, ...]:
    """Statements of a file about itself that another format has no place for."""
    held = {"description"} if kind == "hjif" else _HELD_CREDITS.get(kind, frozenset())
    if kind == "hjif" and is_date(credits.created):
        held = {*held, "created"}
    if credits.description == source.name.partition(".")[0]:  # said by its name, too
        credits = replace(credits, description="")
    title = "HJIF" if kind == "hjif" else DEVICE_FORMATS[kind].title
    return credits.lost(frozenset() if device is not None else held, title)


def _ignored_options(
    source: Path, kind: str, device: str | None, body: str | None
) -> tuple[str, ...]:
    """Options that say nothing of this conversion."""
    is_track, is_of_track = source.suffix == TRACK_SUFFIX, kind in TRACK_FORMATS
    notes = []
    if body is not None and not is_track:
        notes.append("--body says nothing here: the file is of no body")
    elif body is not None and is_of_track:
        notes.append("--body says nothing here: what each body feels is written")
    if device is not None and is_track and is_of_track and kind != "hjif":
        notes.append(f"--device says nothing here: {kind} holds what is felt")
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
    signals: Sequence[Signal], device: DeviceConfig | None, kind: str, source: Path
) -> None:
    """Refuse a small file of envelopes that would become a huge table or sound."""
    if device is None:
        return  # envelopes again
    lasts_s = max(each.duration_s for each in signals)
    columns = len(device.controls)
    is_sound = kind == "wav"
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
    long = beside(stem, signal).name
    files = tuple(
        path.replace(path.with_name(stem.name + path.name.removeprefix(long)))
        if path.name.startswith(f"{long}.")
        else path
        for path in written.files
    )
    return replace(written, files=files)


def _device(device: str | None, kind: str) -> DeviceConfig:
    if device is None:
        raise UsageError(f"{kind} holds what a device plays: choose one with --device")
    return load_device(device)


def _body_id(track: TrackReader, body: str | None) -> str | None:
    if body is None:
        return None
    return next((each.id for each in track.header.bodies if body in (each.id, each.name)), body)


def _raster(source: Path, device: DeviceConfig) -> Raster:
    """A raster of a file, checked to be that device's."""
    is_csv = source.name.endswith(csv_raster.SUFFIX)
    raster = csv_raster.read(source) if is_csv else npz_raster.read(source)
    wanted = columns_of(device)
    if raster.columns != wanted:
        raise InputError(
            f"{source}: its columns are not those of the device '{device.id}'"
            f"{_first_difference(raster.columns, wanted)}."
        )
    if not is_csv and raster.device_id != device.id:
        raise InputError(f"{source}: is for the device '{raster.device_id}', not '{device.id}'.")
    return replace(raster, device_id=device.id)


def _first_difference(found: Sequence[Column], wanted: Sequence[Column]) -> str:
    for number, (one, other) in enumerate(zip(found, wanted, strict=False), start=1):
        if one != other:
            names = [csv_raster.column_name(each) for each in (one, other)]
            return f": column {number} is '{names[0]}', expected is '{names[1]}'"
    return f": it has {len(found)}, expected are {len(wanted)}"
