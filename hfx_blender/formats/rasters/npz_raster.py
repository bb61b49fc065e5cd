# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster as a NumPy archive, complete and bit-exact.

``docs/formats/index.md`` names the arrays for ``numpy.load``.
"""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import write_npz
from ...engine.rendering.raster import Raster
from ...files import limits
from ...files.atomic import atomic_file
from ..registry import FORMATS
from ..written import single_file

SUFFIX: Final = FORMATS["npz"].suffix
FORMAT: Final = "hfx-raster"
_MOST_HEAD: Final = 192  # bytes before an array's numbers
SIZE_WORDS: Final = "its arrays would take"

FELT_ARRAYS: Final = {"indices": np.int64, "strengths": np.float64, "is_rendered": np.bool_}


def write(raster: Raster, path: Path) -> None:
    """Write a raster; equal rasters give equal bytes. Raises OutputError for an unwritable file (no
    partial file remains), and TooLargeError beyond the memory limit of readers."""
    meta = {
        "format": FORMAT,
        "version": 1,
        "device": raster.device_id,
        "body": raster.body_id,
        "rate_hz": list(raster.rate_hz.as_integer_ratio()),
        "actuators": list(raster.actuators),
        "columns": [
            {"actuator": c.actuator, "parameter": c.parameter, "unit": c.unit}
            for c in raster.columns
        ],
        "shortfalls": [vars(shortfall) for shortfall in raster.shortfalls],
        "felt": [
            [felt.stream.effect_id, felt.stream.body_id, felt.stream.modality, felt.stream.model_id]
            for felt in raster.felt
        ],
    }
    arrays: dict[str, npt.NDArray[Any]] = {
        "meta": np.frombuffer(json.dumps(meta).encode(), np.uint8),
        "times_s": raster.times_s,
        "values": raster.values,
        "neutral": raster.neutral,
    }
    for k, stream in enumerate(raster.felt):
        arrays |= {f"felt.{k}.{name}": getattr(stream, name) for name in FELT_ARRAYS}
    # Readers have this limit: a larger file could not be read back.
    size = sum(array.nbytes + _MOST_HEAD for array in arrays.values())
    limits.MEMORY.check(size, path.name, SIZE_WORDS)
    with atomic_file(path) as file:
        write_npz(file, arrays, is_compressed=True)


export: Final = single_file(write, SUFFIX)
