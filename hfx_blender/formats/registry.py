# SPDX-License-Identifier: GPL-3.0-or-later
"""Registry of file formats by name: their content, writers, readers and checks."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from ..engine.body.model import load_model
from ..engine.rendering.device import DeviceConfig
from ..engine.rendering.raster import Raster
from ..engine.track import SUFFIX as TRACK_SUFFIX
from ..engine.track import TrackHeader, TrackReader
from ..errors import InputError, NothingFeltError, UsageError
from .ahap import ahap
from .clip import writing as clip_writing
from .clip.baked import Played
from .clip.container import SUFFIX as CLIP_SUFFIX
from .clip.spatial_recorder import SpatialRecorder
from .device_files import haptic, openxr
from .glb import glb
from .he import he
from .hjif import from_track
from .hjif.perceptions import SUFFIX as HJIF_SUFFIX
from .jsonl import jsonl_samples
from .rasters import csv_raster, npz_raster
from .signals import losses
from .signals.curves import CurveTolerance, clipped
from .signals.signals import DEFAULT_TOLERANCE, MAX_HZ, FrequencyRange, Signal, signals_of
from .signals.simplified_writer import WHOLE_MS, SignalWriter, simplified_writer
from .sound import wav
from .tact import tact
from .tact.tact_layouts import motors_of
from .written import Written

ALL_MODALITIES: Final = ("vibration", "pressure", "temperature", "wind")


@dataclass(frozen=True)
class DeviceFormat:
    """Format of one device's output; ``write`` takes ``folder/stem``, without a suffix.

    ``write`` raises ``InputError`` when the format can hold nothing of the device, or not all
    of a signal; ``OutputError`` when a file cannot be written. What else is lost is told by
    :attr:`Written.left_out`.
    """

    name: str
    title: str
    suffix: str
    modalities: tuple[str, ...]
    write: Callable[[Raster, DeviceConfig, Path, CurveTolerance], Written]
    write_signals: SignalWriter | None = None  # also from other formats' signals
    holds_waves: bool = False  # several frequencies of an actuator at once
    why_nothing: Callable[[DeviceConfig], str] = lambda device: ""  # why it can hold nothing of it


@dataclass(frozen=True)
class TrackFormat:
    """Format of a track, independent of devices; at most it names them."""

    name: str
    title: str
    suffix: str
    write: Callable[[TrackReader, Sequence[DeviceConfig], Path, CurveTolerance], Written]


@dataclass(frozen=True)
class PlayedFormat:
    """Format of what all devices play of a track, together in one file."""

    name: str
    title: str
    suffix: str
    write: Callable[[TrackHeader, Played, Path, SpatialRecorder | None], Written]


def write(
    name: str,
    raster: Raster,
    device: DeviceConfig,
    stem: Path,
    tolerance: CurveTolerance = DEFAULT_TOLERANCE,
) -> Written:
    """Write a device's output in one format, and report what it could not hold.

    Parameters
    ----------
    name : str
        Key of ``DEVICE_FORMATS``.
    raster : Raster
    device : DeviceConfig
    stem : Path
        ``folder/stem``; the files' names begin with it.
    tolerance : CurveTolerance
        Of the amplitude, a share of full scale, for formats with keyframes.

    Raises
    ------
    InputError
        The format can hold nothing of the device, or the signals do not fit into it.
    OutputError
        A file cannot be written.
    """
    chosen = DEVICE_FORMATS[name]
    held = [each for each in device.modalities if each in chosen.modalities]
    lost = [each for each in device.modalities if each not in chosen.modalities]
    if not held:
        raise InputError(
            f"Device '{device.id}' plays {' and '.join(lost)}, {chosen.title} holds "
            f"{' and '.join(chosen.modalities)} only; export it as csv or npz."
        )
    written = chosen.write(raster, device, stem, tolerance)
    if not chosen.holds_waves:
        written += Written(notes=losses.several_frequencies(raster))
    written = written.of(f"{chosen.title} of device '{device.id}'")
    if lost:
        missing = f"{chosen.title} cannot hold the {' and '.join(lost)} of device '{device.id}'"
        written = Written(written.files, (missing, *written.left_out), written.notes)
    return written


def _within(documented: FrequencyRange) -> Callable[[FrequencyRange], FrequencyRange]:
    """Range in a format with a documented one, see :meth:`FrequencyRange.or_default`."""
    return lambda frequencies: frequencies.or_default(documented)


def _signal_format(
    name: str,
    title: str,
    suffix: str,
    write_signals: SignalWriter,
    held: Callable[[FrequencyRange], FrequencyRange] = lambda frequencies: frequencies,
) -> DeviceFormat:
    """A format of signals; ``held`` tells the range that it holds frequencies in."""

    def write_all_signals(
        signals: list[Signal], frequencies: FrequencyRange, stem: Path, tolerance: CurveTolerance
    ) -> Written:
        frequencies = held(frequencies)
        low, high = frequencies.lowest_hz, frequencies.highest_hz
        cut = [
            replace(each, frequency_hz=clipped(each.frequency_hz, low, high)) for each in signals
        ]
        written = write_signals(cut, frequencies, stem, tolerance)
        return written + Written((), losses.off_range(signals, frequencies))

    def write_raster(
        raster: Raster, device: DeviceConfig, stem: Path, tolerance: CurveTolerance
    ) -> Written:
        signals, frequencies = signals_of(raster, device)
        written = write_all_signals(signals, frequencies, stem, tolerance)
        # Where its range ends below what skin feels, that is told by this range.
        highest_hz = MAX_HZ if frequencies.highest_hz >= MAX_HZ else np.inf
        return written + Written((), losses.beyond_limits(raster, device, highest_hz=highest_hz))

    return DeviceFormat(name, title, suffix, ("vibration",), write_raster, write_all_signals)


def _whole_raster_format(
    name: str, title: str, suffix: str, write: Callable[[Raster, Path], None]
) -> DeviceFormat:
    def write_raster(
        raster: Raster, device: DeviceConfig, stem: Path, tolerance: CurveTolerance
    ) -> Written:
        path = stem.with_name(stem.name + suffix)
        write(raster, path)
        return Written((path,))

    return DeviceFormat(name, title, suffix, ALL_MODALITIES, write_raster)


def _write_wav(
    raster: Raster, device: DeviceConfig, stem: Path, tolerance: CurveTolerance
) -> Written:
    path = stem.with_name(stem.name + wav.SUFFIX)
    wav.write(raster, device, path)
    files = path, path.with_name(path.name + wav.SIDECAR_SUFFIX)
    return Written(files, losses.beyond_limits(raster, device))


def _write_tact(
    raster: Raster, device: DeviceConfig, stem: Path, tolerance: CurveTolerance
) -> Written:
    why = _why_no_tact(device)
    if why:
        raise InputError(f"D{why[1:]}.")
    signals, _ = signals_of(raster, device)
    written = tact.write(signals, motors_of(device), stem)
    # It has no frequencies that could be cut.
    return written + Written((), losses.beyond_limits(raster, device, highest_hz=np.inf))


def _why_no_tact(device: DeviceConfig) -> str:
    """Reason that bHaptics' suits have no motor for a device; empty: they have."""
    if motors_of(device):
        return ""
    return (
        f"device '{device.id}' has no vibration actuators on the torso or a forearm, where "
        "bHaptics' vest and sleeves are"
    )


DEVICE_FORMATS: Final[dict[str, DeviceFormat]] = {
    each.name: each
    for each in (
        _whole_raster_format("csv", "CSV", csv_raster.SUFFIX, csv_raster.write),
        _whole_raster_format("npz", "an NPZ raster", npz_raster.SUFFIX, npz_raster.write),
        DeviceFormat("wav", "WAV", wav.SUFFIX, ("vibration",), _write_wav, holds_waves=True),
        _signal_format(
            "ahap",
            "Apple AHAP",
            ahap.SUFFIX,
            simplified_writer(ahap.write, ahap.SUFFIX, ahap.decode),
            _within(ahap.DEFAULT_RANGE),
        ),
        _signal_format(
            "haptic",
            "Meta .haptic",
            haptic.SUFFIX,
            simplified_writer(haptic.write, haptic.SUFFIX, haptic.decode),
            _within(haptic.DEFAULT_RANGE),
        ),
        _signal_format(
            "he",
            "RichTap .he",
            he.SUFFIX,
            simplified_writer(he.write, he.SUFFIX, he.decode, grid_s=WHOLE_MS),
            _within(he.DEFAULT_RANGE),
        ),
        _signal_format(
            "he1",
            "RichTap .he version 1",
            he.V1_SUFFIX,
            he.write_v1,
            _within(he.DEFAULT_RANGE),
        ),
        _signal_format(
            "openharmony",
            "an OpenHarmony pattern",
            he.OPENHARMONY_SUFFIX,
            he.write_openharmony,
            _within(he.DEFAULT_RANGE),
        ),
        _signal_format(
            "openxr",
            "OpenXR parametric vibration",
            openxr.SUFFIX,
            simplified_writer(openxr.write, openxr.SUFFIX, openxr.decode),
            openxr.held,
        ),
        DeviceFormat(
            "tact",
            "bHaptics .tact",
            tact.SUFFIX,
            ("vibration",),
            _write_tact,
            why_nothing=_why_no_tact,
        ),
    )
}


def _write_hjif(
    track: TrackReader, devices: Sequence[DeviceConfig], stem: Path, tolerance: CurveTolerance
) -> Written:
    return from_track.write(track, load_model, stem, devices, tolerance)


def _write_jsonl(
    track: TrackReader, devices: Sequence[DeviceConfig], stem: Path, tolerance: CurveTolerance
) -> Written:
    path = stem.with_name(stem.name + jsonl_samples.SUFFIX)
    jsonl_samples.write(track, path)
    return Written((path,))


TRACK_FORMATS: Final[dict[str, TrackFormat]] = {
    each.name: each
    for each in (
        TrackFormat("hjif", "MPEG HJIF", HJIF_SUFFIX, _write_hjif),
        TrackFormat("jsonl", "JSON Lines of samples", jsonl_samples.SUFFIX, _write_jsonl),
    )
}

PLAYED_FORMATS: Final[dict[str, PlayedFormat]] = {
    each.name: each
    for each in (PlayedFormat("clip", "a game clip", CLIP_SUFFIX, clip_writing.write),)
}

FORMATS: Final = ("track", *DEVICE_FORMATS, *TRACK_FORMATS, *PLAYED_FORMATS, "glb")
"""Formats of an export; ``glb`` is the scene's volumes (glb_scene)."""


_REMOVED: Final = {
    "ahap-sqrt": ("ahap", ".sqrt.ahap"),
    "jsonl-compact": ("jsonl", ".compact.samples.jsonl"),
    "wav24": ("wav", ".24bit.wav"),
    "wavfloat": ("wav", ".float.wav"),
}
"""Formats that are read, but written no more: what is written instead, and their suffixes."""


def refuse_unknown(names: Iterable[str], option: str, known: Collection[str] = FORMATS) -> None:
    """Reject names of formats that are not known; for a removed one, name its replacement.

    Raises
    ------
    UsageError
    """
    for name in names:
        if name in _REMOVED:
            instead = _REMOVED[name][0]
            raise UsageError(f"{option} {name}: is read, but written no more; use {instead}")
        if name not in known:
            raise UsageError(f"{option} {name}: expected one of {', '.join(known)}")


def refuse_removed(target: Path) -> None:
    """Reject a file whose suffix was that of a removed format: its content would be another.

    Raises
    ------
    UsageError
    """
    for name, (instead, suffix) in _REMOVED.items():
        if target.name.endswith(suffix):
            raise UsageError(
                f"{target}: '{suffix}' was the suffix of {name}, which is written no more; use "
                f"'{suffixes((instead,))[0]}', or '--to {instead}' with any name"
            )


def suffixes(names: Sequence[str]) -> tuple[str, ...]:
    """Ends of the names of the files that formats of :data:`FORMATS` write, also beside others."""
    formats: dict[str, DeviceFormat | TrackFormat | PlayedFormat] = {
        **DEVICE_FORMATS,
        **TRACK_FORMATS,
        **PLAYED_FORMATS,
    }
    of_others = {"track": TRACK_SUFFIX, "glb": glb.SUFFIX}
    found = [of_others[name] if name in of_others else formats[name].suffix for name in names]
    found += [glb.SUFFIX] if HJIF_SUFFIX in found else []
    found += [wav.SIDECAR_SUFFIX] if any(each.endswith(wav.SUFFIX) for each in found) else []
    return tuple(dict.fromkeys(found))


def check(formats: Sequence[str], devices: Sequence[DeviceConfig]) -> None:
    """Reject formats and devices with which no scene could be exported.

    Raises
    ------
    UsageError
        A format is unknown, needs a device, or none of the devices has anything for it; or two
        different devices have one id, which their files are named by.
    """
    refuse_unknown(formats, "format")
    known: dict[str, DeviceConfig] = {}
    for each in devices:
        if vars(known.setdefault(each.id, each)) != vars(each):
            raise UsageError(
                f"two different devices have the id '{each.id}', which their files are named by: "
                "give the configuration of one of them another 'id', as its file is called"
            )
    for name in formats:
        chosen = DEVICE_FORMATS.get(name)
        if chosen is None:
            continue
        if not devices:
            raise UsageError(
                f"the format {name} holds what a device plays: choose one with --device "
                "('hfx device list' shows them)"
            )
        if not any(set(chosen.modalities) & set(device.modalities) for device in devices):
            raise UsageError(
                f"none of the devices has {' or '.join(chosen.modalities)} actuators, which is "
                f"what {chosen.title} holds"
            )


def usable(formats: Sequence[str], devices: Sequence[DeviceConfig]) -> tuple[str, ...]:
    """Formats that hold what is felt, or what any of these devices plays."""
    played = {modality for device in devices for modality in device.modalities}
    chosen = DEVICE_FORMATS
    return tuple(f for f in formats if f not in chosen or played & set(chosen[f].modalities))


def _why_nothing(chosen: DeviceFormat, device: DeviceConfig) -> str:
    """Reason that a format can hold nothing of a device; empty: it can."""
    if not set(chosen.modalities) & set(device.modalities):
        return f"device '{device.id}' has no {' or '.join(chosen.modalities)} actuators"
    return chosen.why_nothing(device)


def why_nothing(name: str, devices: Sequence[DeviceConfig]) -> str:
    """Reason why a format can hold nothing of any of these devices; empty: it can."""
    chosen = DEVICE_FORMATS.get(name)
    if chosen is None:
        return ""
    if not devices:
        return "Formats of devices need a device"
    if not any(set(chosen.modalities) & set(device.modalities) for device in devices):
        return f"No device has {' or '.join(chosen.modalities)} actuators"
    reasons = [_why_nothing(chosen, device) for device in devices]
    return "" if "" in reasons else f"{chosen.title}: {reasons[0]}"


def write_all(
    formats: Sequence[str],
    played: Sequence[tuple[Path, DeviceConfig, Raster]],
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    stem: Path,
    tolerance: CurveTolerance = DEFAULT_TOLERANCE,
    scene: SpatialRecorder | None = None,
) -> Written:
    """Write all formats but the track itself.

    A format that can hold nothing of a device, or not all of it, is left out for that device,
    and told; so is a format of the track in which nothing is felt.

    Parameters
    ----------
    formats : sequence of str
        Of ``FORMATS``.
    played : sequence of (Path, DeviceConfig, Raster)
        ``folder/stem`` of a device's files, and what it plays.
    track : TrackReader
    devices : sequence of DeviceConfig
    stem : Path
        ``folder/stem`` of files that are of no device.
    tolerance : CurveTolerance
        See :func:`write`.
    scene : SpatialRecorder, optional
        What the formats of several devices tell of the scene itself.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    written = Written()
    for name in formats:
        if name in TRACK_FORMATS:
            one = TRACK_FORMATS[name]
            try:
                written += one.write(track, devices, stem, tolerance).of(one.title)
            except NothingFeltError:
                written += Written(left_out=(f"nothing is felt: no {one.title}",))
            continue
        if name in PLAYED_FORMATS:
            together = PLAYED_FORMATS[name]
            of_devices = [(device, raster) for _, device, raster in played]
            made = together.write(track.header, of_devices, stem, scene)
            written += made.of(together.title)
            continue
        if name not in DEVICE_FORMATS:
            continue  # the track and the scene are written by those that have them
        chosen = DEVICE_FORMATS[name]
        for path, device, raster in played:
            why = _why_nothing(chosen, device)
            if not why:
                try:
                    written += write(name, raster, device, path, tolerance)
                except InputError as error:
                    why = f"device '{device.id}': {str(error).removesuffix('.')}"
            if why:
                written += Written(left_out=(f"{why}: no {chosen.title} for it",))
    return written
