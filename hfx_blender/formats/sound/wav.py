# SPDX-License-Identifier: GPL-3.0-or-later
"""Multichannel WAV of a raster, a channel per vibration actuator.

Each channel of a raster is a wave with amplitude and frequency linear between raster rows; the
phase is the exact integral of the frequency and thus continuous. An actuator with waveform output
plays the sum of a wave per effect, of the shape named by the actuator type. A file ends in silence,
faded over the last row.
"""

import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64, I64
from ...engine.rendering.conditioning.actuator_limits import limited
from ...engine.rendering.conditioning.waveform import (
    DriveCurve,
    cycles_on_the_way,
    cycles_since_the_beginning,
    cycles_until_it_repeats,
    driven,
    kept_through_silence,
    kinds_of,
    waves,
)
from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.raster import Raster
from ...errors import InputError
from ...files.atomic import atomic_file
from ..registry import FORMATS
from ..signals import losses
from ..signals.signals import MAX_HZ, vibration_of
from ..written import Written

SUFFIX: Final = FORMATS["wav"].suffix
RATE_HZ: Final = 48_000
SIDECAR_SUFFIX: Final = FORMATS["channels"].suffix

_BITS: Final = 16
_PCM, _EXTENSIBLE = 1, 0xFFFE
# Tail of KSDATAFORMAT_SUBTYPE_PCM, after the number of the format.
_SUBTYPE_TAIL = bytes.fromhex("000000001000800000aa00389b71")
_MAX_CHANNELS = 65_535
MAX_BYTES = 2**32 - 1024  # RIFF counts in 32 bits
BLOCK_SAMPLES = 1 << 18  # over all channels


@dataclass(frozen=True, eq=False)
class WaveDrive:
    """Waves of the channels at the rows of a raster."""

    actuators: tuple[str, ...]
    amplitudes: F64  # (T + 1, C) 0..1 of full scale; the last row is the silent end
    first_hz: F64  # (T, C) frequency at the beginning of each row
    last_hz: F64  # (T, C) frequency at the end of each row
    cycles: F64  # (T, C) phase at each row in cycles, modulo the period of the wave shape
    kinds: I64  # (C,) wave shapes
    full_scale: float  # m/s^2
    first_row: int = 0  # first raster row


def write(raster: Raster, device: DeviceConfig, path: Path, *, rate_hz: int = RATE_HZ) -> None:
    """Write a raster as WAV of 16 bits, and its channel list ``path.channels.json``.

    Full scale is the largest amplitude of the device's vibration actuators; ``rate_hz`` is the
    audio rate, 8000 to 384000. Raises InputError for a device without vibration actuators or a file
    above 4 GiB, OutputError for an unwritable file (no partial file remains), and ValueError for a
    raster of another device.
    """
    if raster.device_id != device.id:
        raise ValueError(f"raster is for '{raster.device_id}', not for '{device.id}'")
    if not 8_000 <= rate_hz <= 384_000:
        raise ValueError(f"rate_hz: expected 8000 to 384000, got {rate_hz}")
    drives = drives_of(raster, device)
    channel_count = len(drives[0].actuators)
    count = sample_count(len(raster.values), raster.rate_hz, rate_hz)
    data_bytes = count * channel_count * _BITS // 8
    if data_bytes > MAX_BYTES or channel_count > _MAX_CHANNELS:
        raise InputError(
            f"{path}: {channel_count} channels of {count / rate_hz:.0f} s are "
            f"{data_bytes / 2**30:.1f} GiB, a WAV file holds 4 GiB at most; export a shorter "
            "range, or as CSV."
        )
    write_sidecar(
        path,
        {
            "format": "hfx-wav-channels",
            "version": 1,
            "device": raster.device_id,
            "body": raster.body_id,
            "rate_hz": rate_hz,
            "start_s": float(raster.times_s[0]),
            "full_scale_m_s2": drives[0].full_scale,
            "channels": [{"channel": i, "actuator": a} for i, a in enumerate(drives[0].actuators)],
        },
    )
    with atomic_file(path) as file:
        file.write(head(_BITS, channel_count, rate_hz, count))
        for block in waveforms(raster, drives, rate_hz):
            file.write(encoded(block, _BITS))


def export(raster: Raster, device: DeviceConfig, stem: Path, tolerance: float) -> Written:
    """Write a device's output as ``stem.wav`` with a channel list; ``tolerance`` is not used."""
    path = stem.with_name(stem.name + SUFFIX)
    write(raster, device, path)
    files = path, path.with_name(path.name + SIDECAR_SUFFIX)
    return Written(files, losses.beyond_limits(raster, device))


def waveforms(raster: Raster, drives: Sequence[WaveDrive], rate_hz: int) -> Iterator[F64]:
    """Yield blocks of audio samples (n, C) of whole raster rows, the sum of all drives, of full
    scale 1, before quantization. Samples per row alternate if the rates have no whole ratio."""
    channel_count = len(drives[0].actuators)
    numerator, denominator = (raster.rate_hz / rate_hz).as_integer_ratio()
    # Whole numbers, rounded up, as times in floats would move a sample to a neighbouring row.
    starts = -(-np.arange(len(raster.values) + 1) * denominator // numerator)
    row_count = max(1, int(BLOCK_SAMPLES * raster.rate_hz / (rate_hz * channel_count)))
    for first in range(0, len(raster.values), row_count):
        block = starts[first : first + row_count + 1]
        played = np.zeros((int(block[-1] - block[0]), channel_count))
        for drive in drives:
            _add_waveform(played, drive, raster, rate_hz, first, block)
        yield played


def drives_of(raster: Raster, device: DeviceConfig) -> list[WaveDrive]:
    """One drive of all raster rows and actuators, silent for actuators with waveform output, then a
    drive of each effect on these, from a silent row before it. Raises InputError for a device
    without vibration actuators, or with full scale 0."""
    vibrating, pairs, full_scale = vibration_of(raster, device)
    if not vibrating or full_scale == 0.0:
        raise InputError(
            f"Device '{device.id}' has no vibration actuators, and a WAV file plays only these; "
            "export it as CSV."
        )
    names = tuple(actuator.id for actuator in vibrating)
    kinds = kinds_of([actuator.type.waveform for actuator in vibrating])
    # Actuators with waveform output play partials; the mixed tone of the raster is silenced.
    sums = [names.index(name) for name in raster.waveform_actuators]
    pairs[:, sums, 0] = 0.0
    curves = [actuator.type.drive for actuator in vibrating]
    totals = np.zeros(pairs.shape[:2])
    for partial in raster.partials:
        rows = slice(partial.first_row, partial.first_row + len(partial.amplitudes))
        totals[rows, sums] += partial.amplitudes
    drives = [_drive(_driven(pairs, curves, full_scale), names, kinds, full_scale, raster, 0)]
    for partial in raster.partials:
        first = max(partial.first_row - 1, 0)  # a silent row leads in
        lead = partial.first_row - first
        pairs = np.zeros((lead + len(partial.amplitudes), len(names), 2))
        pairs[lead:, sums, 0] = partial.amplitudes
        pairs[lead:, sums, 1] = partial.frequencies_hz
        pairs = _driven(pairs, curves, full_scale, totals[first : first + len(pairs)])
        drives.append(_drive(pairs, names, kinds, full_scale, raster, first))
    return drives


def _driven(
    pairs: F64, curves: Sequence[Sequence[DriveCurve]], full_scale: float, totals: F64 | None = None
) -> F64:
    """Pairs (T, C, 2) of amplitude and Hz, with each amplitude replaced by full scale times the
    drive needed for it; ``pairs`` itself without any drive curve.

    ``curves``: drive curves of each actuator; ``totals`` (T, C): summed amplitudes of its effects.
    Non-finite pairs are silent.
    """
    if not any(curves):
        return pairs
    # Curves are tables of finite numbers; NaN would pass through their interpolation.
    safe = np.clip(np.nan_to_num(pairs, nan=0.0, posinf=0.0, neginf=0.0), 0.0, None)
    safe[..., 0] = np.where(np.isfinite(pairs).all(axis=2), safe[..., 0], 0.0)
    drive = driven(curves, safe[..., 0], safe[..., 1], full_scale, totals)
    return np.stack([full_scale * drive, safe[..., 1]], axis=2)


def _drive(
    pairs: F64,
    actuators: tuple[str, ...],
    kinds: I64,
    full_scale: float,
    raster: Raster,
    first_row: int,
) -> WaveDrive:
    """Waves of amplitude and Hz pairs (T, C, 2), clipped to full scale and 1 kHz. The first pair is
    raster row ``first_row``. Silence has the frequency of the adjacent sound."""
    safe = limited(pairs, 0.0, [full_scale, MAX_HZ], 0.0)
    silence = np.zeros((1, len(actuators)))
    amplitudes = np.vstack([safe[..., 0], silence])
    frequencies = np.vstack([safe[..., 1], safe[-1:, :, 1]])
    first_hz, last_hz = kept_through_silence(
        (amplitudes[:-1], amplitudes[1:]), (frequencies[:-1], frequencies[1:])
    )
    # The phase of linear frequencies is the cumulative mean frequency times the row's duration.
    cycles = np.cumsum((first_hz + last_hz) / 2.0, axis=0) / float(raster.rate_hz)
    repeats = cycles_until_it_repeats(kinds)
    begun = cycles_since_the_beginning(first_hz[:1], first_row / float(raster.rate_hz), repeats)
    return WaveDrive(
        actuators=actuators,
        amplitudes=amplitudes / full_scale,
        first_hz=first_hz,
        last_hz=last_hz,
        cycles=(begun + np.vstack([silence, cycles[:-1]])) % repeats,
        kinds=kinds,
        full_scale=full_scale,
        first_row=first_row,
    )


def _add_waveform(
    played: F64, drive: WaveDrive, raster: Raster, rate_hz: int, first_row: int, starts: I64
) -> None:
    """Add the output of a drive in place to audio samples (n, C); independent of the block size.

    ``played`` are the samples of the raster rows from ``first_row`` on, full scale 1; ``starts``
    (R + 1,) the first sample of each row, and the sample after the last row.
    """
    skipped = max(drive.first_row - first_row, 0)
    start = first_row + skipped - drive.first_row
    stop = min(first_row + len(starts) - 1 - drive.first_row, len(drive.cycles))
    sounds = drive.amplitudes[start : max(stop, start) + 1] != 0.0
    # Only (row, channel) pairs with sound are computed.
    row, channel = np.nonzero(sounds[:-1] | sounds[1:])
    if len(row) == 0:
        return
    of_drive = row + start
    begin = starts[row + skipped]
    numerator, denominator = (raster.rate_hz / rate_hz).as_integer_ratio()
    longest = -(-denominator // numerator)  # samples of a row
    sample = np.arange(longest)
    # Position within the row, 0..1: equal for all rows of a whole number of samples.
    is_even = denominator % numerator == 0
    into = 0 if is_even else begin * numerator - (of_drive + drive.first_row) * denominator
    x = (np.reshape(into, (-1, 1)) + sample * numerator) / denominator
    way = drive.first_hz[of_drive, channel, None], drive.last_hz[of_drive, channel, None]
    cycles = cycles_on_the_way(way, x, 1.0 / float(raster.rate_hz))
    cycles += drive.cycles[of_drive, channel, None]
    ends = drive.amplitudes[of_drive, channel, None], drive.amplitudes[of_drive + 1, channel, None]
    values = waves(drive.kinds[channel, None], ends, way, x, cycles, rate_hz)
    if is_even:
        played.reshape(-1, longest, played.shape[1])[row + skipped, :, channel] += values
        return
    at = (begin - starts[0])[:, None] + sample
    # Rows of a fraction of samples differ by a sample: the surplus is left out.
    is_of_row = at < (starts[row + skipped + 1] - starts[0])[:, None]
    channels = np.broadcast_to(channel[:, None], at.shape)
    played[at[is_of_row], channels[is_of_row]] += values[is_of_row]


def encoded(waveform: F64, bits: int) -> bytes:
    """Quantize samples in -1..1 to 16 or 24 bits, little-endian; overwrites ``waveform``."""
    waveform *= 2 ** (bits - 1) - 1  # symmetric: the lowest code is not used
    np.rint(waveform, out=waveform)
    if bits == 16:
        return waveform.astype("<i2").tobytes()
    whole: npt.NDArray[np.uint8] = waveform.astype("<i4").view(np.uint8).reshape(-1, 4)
    lowest = np.empty((len(whole), 3), np.uint8)
    for k in range(3):  # column copies: five times as fast as whole[:, :3].tobytes()
        lowest[:, k] = whole[:, k]
    return lowest.tobytes()


def head(bits: int, channel_count: int, rate_hz: int, sample_count: int) -> bytes:
    """RIFF and fmt head of a WAV file of 16 or 24 bits (Microsoft, 1994). More than two channels,
    or 24 bits, use WAVE_FORMAT_EXTENSIBLE with channel mask 0 (no loudspeaker positions)."""
    frame_bytes = channel_count * bits // 8
    # Microsoft requires the extensible form here, and players refuse the plain form.
    is_extensible = channel_count > 2 or bits == 24
    kind, rates = _EXTENSIBLE if is_extensible else _PCM, (rate_hz, rate_hz * frame_bytes)
    form = struct.pack("<HHIIHH", kind, channel_count, *rates, frame_bytes, bits)
    if is_extensible:
        form += struct.pack("<HHIH", 22, bits, 0, _PCM) + _SUBTYPE_TAIL
    data_bytes = sample_count * frame_bytes  # the pad byte of an odd size is not counted
    chunks = b"fmt " + struct.pack("<I", len(form)) + form
    chunks += b"data" + struct.pack("<I", data_bytes)
    riff_bytes = 4 + len(chunks) + data_bytes + data_bytes % 2
    return b"RIFF" + struct.pack("<I", riff_bytes) + b"WAVE" + chunks


def write_sidecar(path: Path, channels: dict[str, Any]) -> None:
    """Write the channel list ``channels`` as JSON next to the WAV file ``path``."""
    with atomic_file(path.with_name(path.name + SIDECAR_SUFFIX)) as file:
        file.write(json.dumps(channels, indent=2).encode() + b"\n")


def sample_count(rows: int, raster_hz: Fraction, rate_hz: int = RATE_HZ) -> int:
    """Samples of ``rows`` raster rows at ``rate_hz``, rounded up; the last row counts in full."""
    return int(-(-rows * rate_hz // raster_hz))
