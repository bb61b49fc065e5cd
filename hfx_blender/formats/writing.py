# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing of tracks and device output in the registered formats."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.raster import Raster
from ..engine.track import TrackReader
from ..errors import InputError, NothingFeltError, UsageError
from ..files import limits
from ..files.limits import TooLargeError
from ..text import name_key
from .clip.spatial_recorder import SpatialRecorder
from .registry import FORMATS, FormatInfo, refuse_unknown
from .signals import losses
from .signals.curves import clipped
from .signals.signals import DEFAULT_TOLERANCE, MAX_HZ, FrequencyRange, Signal, signals_of
from .written import Written

_LASTS: Final = "its envelopes last"


def write(
    id: str, raster: Raster, device: DeviceConfig, stem: Path, tolerance: float = DEFAULT_TOLERANCE
) -> Written:
    """Write the output of a device in one format; existing files are replaced.

    ``id`` is a key of ``FORMATS`` with ``write_raster`` or ``write_signals``; ``stem`` is
    ``folder/name`` without suffix; ``tolerance`` the amplitude error of keyframe formats, a share
    of full scale. Modalities outside the format and clipped values are sentences in ``left_out``;
    several frequencies reduced to one are in ``notes``.

    Raises InputError if the format holds none of the device's modalities, a size limit is exceeded,
    or the writer can store nothing or only part of a signal; OutputError for an unwritable file.
    """
    info = FORMATS[id]
    # A format may hold some of the device's modalities only: the rest is a loss, not an error.
    held = info.plays_of(device.modalities)
    lost = [modality for modality in device.modalities if modality not in held]
    if not held:
        raise InputError(
            f"Device '{device.id}' plays {' and '.join(lost)}, the format {id} holds "
            f"{' and '.join(info.modalities or ())} only; export it as csv or npz."
        )
    # Rows of a table take memory, envelopes time: each is limited before writing.
    if info.read_raster:
        refuse_large(raster, info.title)
    elif info.write_signals or info.decode:
        limits.SECONDS.check(len(raster.times_s) / float(raster.rate_hz), info.title, _LASTS)
    if info.write_raster:
        written: Written = info.function("write_raster")(raster, device, stem, tolerance)
    else:
        signals, frequencies = signals_of(raster, device)
        written = write_signals(info, signals, frequencies, stem, tolerance)
        # A format whose range ends below MAX_HZ reports its own limit (off_range), not that of
        # skin.
        frequencies = info.function("held")(frequencies)
        highest_hz = MAX_HZ if frequencies.highest_hz >= MAX_HZ else np.inf
        written += Written((), losses.beyond_limits(raster, device, highest_hz=highest_hz))
    if not info.holds_waves:
        written += Written(notes=losses.several_frequencies(raster))
    written = written.prefixed(f"{info.title} of device '{device.id}'")
    if lost:
        missing = f"the format {id} cannot hold the {' and '.join(lost)} of device '{device.id}'"
        written = Written(written.files, (missing, *written.left_out), written.notes)
    return written


def write_signals(
    info: FormatInfo,
    signals: list[Signal],
    frequencies: FrequencyRange,
    stem: Path,
    tolerance: float,
) -> Written:
    """Write signals in an envelope format, clipped to the format's frequencies and reported. Raises
    InputError for signals beyond the format's limits, OutputError for an unwritable file."""
    left_out: tuple[str, ...] = ()
    if info.held:
        frequencies = info.function("held")(frequencies)
        low, high = frequencies.lowest_hz, frequencies.highest_hz
        left_out = losses.off_range(signals, frequencies)
        signals = [
            replace(signal, frequency_hz=clipped(signal.frequency_hz, low, high))
            for signal in signals
        ]
    written: Written = info.function("write_signals")(signals, frequencies, stem, tolerance)
    return written + Written((), left_out)


def check(formats: Sequence[str], devices: Sequence[DeviceConfig]) -> None:
    """Raise UsageError for a choice of formats and devices that cannot be exported. Cases: an
    unknown format, a device format without devices or without a matching modality in any device,
    two different devices with equal ids (their files would coincide). Returns nothing."""
    refuse_unknown(formats, "format")
    of_id: dict[str, list[DeviceConfig]] = {}
    for device in devices:
        # Two devices with one id would write the same file names.
        same = of_id.setdefault(name_key(device.id), [])
        if all(vars(device) != vars(known_device) for known_device in same):
            same.append(device)
    clashes = [
        f"{'two' if len(same) == 2 else len(same)} different devices have the id "
        + " or ".join(dict.fromkeys(f"'{device.id}'" for device in same))
        for same in of_id.values()
        if len(same) > 1
    ]
    if clashes:
        raise UsageError(
            f"{', '.join(clashes)}, which their files are named by: give the configurations of all "
            "but one of them another 'id', as its file is called"
        )
    for id in formats:
        info = FORMATS[id]
        if info.is_of_device and not devices:
            raise UsageError(
                f"the format {id} holds what a device plays: choose one with --device "
                "('hfx device list' shows them)"
            )
        if info.is_of_device and not info.plays_of(_modalities_of(devices)):
            raise UsageError(
                f"none of the devices has {' or '.join(info.modalities or ())} actuators, which "
                f"is what the format {id} holds"
            )


def _modalities_of(devices: Iterable[DeviceConfig]) -> list[str]:
    """Modalities of all devices in order, with duplicates."""
    return [modality for device in devices for modality in device.modalities]


def usable(formats: Sequence[str], devices: Sequence[DeviceConfig]) -> tuple[str, ...]:
    """Ids of ``formats``, in order: all track formats, and device formats that hold a modality of
    one of the devices."""
    played = _modalities_of(devices)
    infos = [FORMATS[id] for id in formats]
    return tuple(info.id for info in infos if not info.is_of_device or info.plays_of(played))


def _why_nothing(info: FormatInfo, device: DeviceConfig) -> str:
    """Reason for no file of a format for one device; empty if a file is possible."""
    if not info.plays_of(device.modalities):
        return f"device '{device.id}' has no {' or '.join(info.modalities or ())} actuators"
    return str(info.function("why_nothing")(device)) if info.why_nothing else ""


def why_nothing(id: str, devices: Sequence[DeviceConfig]) -> str:
    """Tooltip: reason for no file of a format for any device; empty if a file is possible. Empty
    for formats of tracks."""
    info = FORMATS[id]
    if not info.is_of_device:
        return ""
    if not devices:
        return "Formats of devices need a device"
    if not info.plays_of(_modalities_of(devices)):
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
    """Write the files of all formats except the track and the glTF scene.

    ``played`` are ``folder/stem``, configuration and output of each device; ``stem`` is
    ``folder/stem`` of files without a device; ``scene`` has bodies and effects for formats with
    ``write_played``. A format unable to hold the whole output of a device is left out for this
    device and reported; so is a track format without any samples, and a format beyond its limits.
    Raises OutputError for an unwritable file.
    """
    written = Written()
    for info in (FORMATS[id] for id in formats):
        # A format has exactly one kind of writer: of tracks, of all devices, or of a
        # device.
        try:
            if info.write_track:
                time = track.header.time
                if info.decode:
                    seconds = time.sample_count / float(time.rate_hz)
                    limits.SECONDS.check(seconds, info.title, _LASTS)
                result = info.function("write_track")(track, devices, stem, tolerance)
                written += result.prefixed(info.title)
            elif info.write_played:
                of_devices = [(device, raster) for _, device, raster in played]
                result = info.function("write_played")(track.header, of_devices, stem, scene)
                written += result.prefixed(info.title)
        except NothingFeltError:
            written += Written(left_out=(f"nothing is felt: no {info.title}",))
        except TooLargeError as error:
            written += Written(left_out=(str(error).removesuffix("."),))
        for path, device, raster in played if info.is_of_device else ():
            why = _why_nothing(info, device)
            if not why:
                try:
                    written += write(info.id, raster, device, path, tolerance)
                    continue
                except InputError as error:
                    why = f"device '{device.id}': {str(error).removesuffix('.')}"
            written += Written(left_out=(f"{why}: no {info.title} for it",))
    return written


def refuse_large(raster: Raster, name: str) -> None:
    """Raise TooLargeError for a raster with more seconds or bytes of values than readers take."""
    times = raster.times_s
    limits.SECONDS.check(len(times) / float(raster.rate_hz), name, "its rows last")
    limits.MEMORY.check(8.0 * (times.size + raster.values.size), name, "its values would take")
