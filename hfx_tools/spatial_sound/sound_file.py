# SPDX-License-Identifier: GPL-3.0-or-later
"""WAV of 24 bits for spatial sound, a channel per loudspeaker, in step with rasters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64
from hfx_blender.errors import InputError
from hfx_blender.files.atomic import atomic_file
from hfx_blender.formats.sound import wav

from .loudspeakers import LoudspeakerLayout

SOUND_SUFFIX: Final = ".sound.wav"
_BITS: Final = 24
_HIGHEST: Final = 0.98  # largest peak, a share of full scale
_CACHED: Final = 1 << 26
"""Most samples over all channels to cache; longer sound is rendered twice, for peak and file."""


def refuse_large(layout: LoudspeakerLayout, path: Path, *, count: int) -> int:
    """Bytes of ``count`` samples in 24 bits for all channels; InputError beyond 4 GiB."""
    data_bytes = count * len(layout) * _BITS // 8
    if data_bytes > wav.MAX_BYTES:
        raise InputError(
            f"{path}: {len(layout)} channels of {count / wav.RATE_HZ:.0f} s are "
            f"{data_bytes / 2**30:.1f} GiB, a WAV file holds 4 GiB at most; export a shorter range."
        )
    return data_bytes


def write_sound(
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
    # The gain depends on the largest peak, so the sound is rendered before it is written.
    cached: list[npt.NDArray[np.float32]] | None = [] if count * len(layout) <= _CACHED else None
    peak = 0.0
    for block in blocks():
        peak = max(peak, float(np.abs(block).max(initial=0.0)))
        if cached is not None:
            cached.append(block.astype(np.float32))
    # A gain for the whole sound keeps the balance between loudspeakers and over time.
    gain = min(1.0, _HIGHEST / peak) if peak > 0.0 else 1.0
    angles = zip(layout.azimuths_deg, layout.elevations_deg, strict=True)
    wav.write_sidecar(
        path,
        {
            "format": "hfx-sound-channels",
            "version": 1,
            "rate_hz": wav.RATE_HZ,
            "start_s": start_s,
            "layout": layout.name,
            "gain": gain,
            "channels": [
                {"channel": k, "azimuth_deg": azimuth, "elevation_deg": elevation}
                for k, (azimuth, elevation) in enumerate(angles)
            ],
        },
    )
    with atomic_file(path) as file:
        file.write(wav.head(_BITS, len(layout), wav.RATE_HZ, count))
        again = blocks() if cached is None else (part.astype(np.float64) for part in cached)
        for block in again:
            file.write(wav.encoded(block * gain, _BITS))
        file.write(b"\0" * (data_bytes % 2))
    return gain
