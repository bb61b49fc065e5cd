# SPDX-License-Identifier: GPL-3.0-or-later
"""Spatial sound as one multichannel WAV, a channel per loudspeaker, in step with rasters."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.spatial_sound.loudspeakers import LoudspeakerLayout
from ...errors import InputError
from ...files.atomic import atomic_file
from .wav import SIDECAR_SUFFIX, encoded, head

SUFFIX: Final = ".sound.wav"
RATE_HZ: Final = 48_000
_BITS: Final = 24
_HIGHEST: Final = 0.98  # largest peak, a share of full scale
_MAX_BYTES: Final = 2**32 - 1024
_CACHED: Final = 1 << 26
"""Most samples over all channels to cache; longer sound is rendered twice, for peak and file."""


def sample_count(rows: int, raster_hz: Fraction, rate_hz: int = RATE_HZ) -> int:
    """Samples of ``rows`` raster rows at ``rate_hz``, rounded up, as in the WAV of a device."""
    return int(-(-rows * rate_hz // raster_hz))


def refuse_large(layout: LoudspeakerLayout, path: Path, *, count: int) -> int:
    """Bytes of ``count`` samples in 24 bits for all channels; InputError beyond 4 GiB."""
    data_bytes = count * len(layout) * _BITS // 8
    if data_bytes > _MAX_BYTES:
        raise InputError(
            f"{path}: {len(layout)} channels of {count / RATE_HZ:.0f} s are "
            f"{data_bytes / 2**30:.1f} GiB, a WAV file holds 4 GiB at most; export a shorter range."
        )
    return data_bytes


def write(
    blocks: Callable[[], Iterator[F64]],
    layout: LoudspeakerLayout,
    path: Path,
    *,
    count: int,
    start_s: float,
) -> float:
    """Write sound with 24 bits and its channel list, and return the gain applied to all samples.

    The gain is 1 or less: a peak above 0.98 of full scale is reduced to 0.98. ``blocks`` starts the
    rendering and yields samples (n, C), ``count`` in total; it is called twice for long sound. The
    channel list is ``path.channels.json``; ``start_s`` is the first sample's time in the scene.
    Raises InputError beyond 4 GiB, OutputError for an unwritable file; no partial file remains.
    """
    data_bytes = refuse_large(layout, path, count=count)
    cached: list[npt.NDArray[np.float32]] | None = [] if count * len(layout) <= _CACHED else None
    peak = 0.0
    for block in blocks():
        peak = max(peak, float(np.abs(block).max(initial=0.0)))
        if cached is not None:
            cached.append(block.astype(np.float32))
    # A gain for the whole sound keeps the balance between loudspeakers and over time.
    gain = min(1.0, _HIGHEST / peak) if peak > 0.0 else 1.0
    sidecar = {
        "format": "hfx-sound-channels",
        "version": 1,
        "rate_hz": RATE_HZ,
        "start_s": start_s,
        "layout": layout.name,
        "gain": gain,
        "channels": [
            {"channel": k, "azimuth_deg": azimuth, "elevation_deg": elevation}
            for k, (azimuth, elevation) in enumerate(
                zip(layout.azimuths_deg, layout.elevations_deg, strict=True)
            )
        ],
    }
    with atomic_file(path.with_name(path.name + SIDECAR_SUFFIX)) as file:
        file.write(json.dumps(sidecar, indent=2).encode() + b"\n")
    with atomic_file(path) as file:
        file.write(head(_BITS, len(layout), RATE_HZ, count))
        again = blocks() if cached is None else (part.astype(np.float64) for part in cached)
        for block in again:
            file.write(encoded(block * gain, _BITS))
        file.write(b"\0" * (data_bytes % 2))
    return gain
