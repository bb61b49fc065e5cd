# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing tracks and devices' output in the formats of the table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..engine.rendering.device import DeviceConfig
from ..engine.rendering.raster import Raster
from ..engine.track import TrackReader
from ..errors import InputError, NothingFeltError, UsageError
from ..text import name_key
from .clip.spatial_recorder import SpatialRecorder
from .registry import FORMATS, FormatInfo, refuse_unknown
from .signals import losses
from .signals.curves import clipped
from .signals.signals import DEFAULT_TOLERANCE, MAX_HZ, FrequencyRange, Signal, signals_of
from .written import Written


def write(
    id: str,
    raster: Raster,
    device: DeviceConfig,
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Written:
    """Write a device's output in one format, and report what it could not hold.

    Parameters
    ----------
    id : str
        Key of ``FORMATS``; one with ``write_raster`` or ``write_signals``.
    stem : Path
        ``folder/stem``; the files' names begin with it.
    tolerance : float
        Of the amplitude, a share of full scale, for formats with keyframes.

    Raises
    ------
    InputError
        The format can hold nothing of the device, or the signals do not fit into it.
    OutputError
        A file cannot be written.
    """
    info = FORMATS[id]
    held = info.plays_of(device.modalities)
    lost = [each for each in device.modalities if each not in held]
    if not held:
        raise InputError(
            f"Device '{device.id}' plays {' and '.join(lost)}, the format {id} holds "
            f"{' and '.join(info.modalities or ())} only; export it as csv or npz."
        )
    if info.write_raster:
        written: Written = info.function("write_raster")(raster, device, stem, tolerance)
    else:
        written = _write_as_signals(info, raster, device, stem, tolerance)
    if not info.holds_waves:
        written += Written(notes=losses.several_frequencies(raster))
    written = written.of(f"{info.title} of device '{device.id}'")
    if lost:
        missing = f"the format {id} cannot hold the {' and '.join(lost)} of device '{device.id}'"
        written = Written(written.files, (missing, *written.left_out), written.notes)
    return written


def _write_as_signals(
    info: FormatInfo, raster: Raster, device: DeviceConfig, stem: Path, tolerance: float
) -> Written:
    signals, frequencies = signals_of(raster, device)
    written = write_signals(info, signals, frequencies, stem, tolerance)
    # Where the format's range ends below what skin feels, that is told by this range.
    frequencies = info.function("held")(frequencies)
    highest_hz = MAX_HZ if frequencies.highest_hz >= MAX_HZ else np.inf
    return written + Written((), losses.beyond_limits(raster, device, highest_hz=highest_hz))


def write_signals(
    info: FormatInfo,
    signals: list[Signal],
    frequencies: FrequencyRange,
    stem: Path,
    tolerance: float,
) -> Written:
    """Write signals in a format of envelopes, cut to the frequencies that it holds.

    Raises
    ------
    InputError
        The signals do not fit into it.
    OutputError
        A file cannot be written.
    """
    left_out: tuple[str, ...] = ()
    if info.held:
        frequencies = info.function("held")(frequencies)
        low, high = frequencies.lowest_hz, frequencies.highest_hz
        left_out = losses.off_range(signals, frequencies)
        signals = [
            replace(each, frequency_hz=clipped(each.frequency_hz, low, high)) for each in signals
        ]
    written: Written = info.function("write_signals")(signals, frequencies, stem, tolerance)
    return written + Written((), left_out)


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
        other = known.setdefault(name_key(each.id), each)
        if vars(other) != vars(each):
            ids = dict.fromkeys((f"'{other.id}'", f"'{each.id}'"))
            raise UsageError(
                f"two different devices have the id {' or '.join(ids)}, which their files are "
                "named by: give the configuration of one of them another 'id', as its file is "
                "called"
            )
    for id in formats:
        info = FORMATS[id]
        if info.is_of_device and not devices:
            raise UsageError(
                f"the format {id} holds what a device plays: choose one with --device "
                "('hfx device list' shows them)"
            )
        if info.is_of_device and not info.plays_of(_played(devices)):
            raise UsageError(
                f"none of the devices has {' or '.join(info.modalities or ())} actuators, which "
                f"is what the format {id} holds"
            )


def _played(devices: Iterable[DeviceConfig]) -> list[str]:
    """Modalities that any of the devices plays."""
    return [modality for device in devices for modality in device.modalities]


def usable(formats: Sequence[str], devices: Sequence[DeviceConfig]) -> tuple[str, ...]:
    """Formats that hold what is felt, or what any of these devices plays."""
    played = _played(devices)
    infos = [FORMATS[id] for id in formats]
    return tuple(each.id for each in infos if not each.is_of_device or each.plays_of(played))


def _why_nothing(info: FormatInfo, device: DeviceConfig) -> str:
    """Reason that a format can hold nothing of a device; empty: it can."""
    if not info.plays_of(device.modalities):
        return f"device '{device.id}' has no {' or '.join(info.modalities or ())} actuators"
    return str(info.function("why_nothing")(device)) if info.why_nothing else ""


def why_nothing(id: str, devices: Sequence[DeviceConfig]) -> str:
    """Reason why a format can hold nothing of any of these devices; empty: it can."""
    info = FORMATS[id]
    if not info.is_of_device:
        return ""
    if not devices:
        return "Formats of devices need a device"
    if not info.plays_of(_played(devices)):
        return f"No device has {' or '.join(info.modalities or ())} actuators"
    reasons = [_why_nothing(info, device) for device in devices]
    return "" if "" in reasons else f"{info.title}: {reasons[0]}"


def write_all(
    formats: Sequence[str],
    played: Sequence[tuple[Path, DeviceConfig, Raster]],
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
    scene: SpatialRecorder | None = None,
) -> Written:
    """Write all formats but the track itself, and the scene's volumes.

    A format that can hold nothing of a device, or not all of it, is left out for that device,
    and told; so is a format of the track in which nothing is felt.

    Parameters
    ----------
    formats : sequence of str
        Keys of ``FORMATS``.
    played : sequence of (Path, DeviceConfig, Raster)
        ``folder/stem`` of a device's files, and what it plays.
    stem : Path
        ``folder/stem`` of files that are of no device.
    tolerance : float
        See :func:`write`.
    scene : SpatialRecorder, optional
        What the formats of several devices tell of the scene itself.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    written = Written()
    for info in (FORMATS[id] for id in formats):
        if info.write_track:
            try:
                made = info.function("write_track")(track, devices, stem, tolerance)
                written += made.of(info.title)
            except NothingFeltError:
                written += Written(left_out=(f"nothing is felt: no {info.title}",))
        elif info.write_played:
            of_devices = [(device, raster) for _, device, raster in played]
            made = info.function("write_played")(track.header, of_devices, stem, scene)
            written += made.of(info.title)
        elif info.is_of_device:
            for path, device, raster in played:
                written += _write_or_tell(info, raster, device, path, tolerance)
    return written


def _write_or_tell(
    info: FormatInfo, raster: Raster, device: DeviceConfig, stem: Path, tolerance: float
) -> Written:
    """Write a device's output, or tell why the format has no file for it."""
    why = _why_nothing(info, device)
    if not why:
        try:
            return write(info.id, raster, device, stem, tolerance)
        except InputError as error:
            why = f"device '{device.id}': {str(error).removesuffix('.')}"
    return Written(left_out=(f"{why}: no {info.title} for it",))
