# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of pictures and relief on disk, made once by several processes and read while training.

Sample ``k`` depends on the seed and on ``k`` only.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from . import pictures

TEXELS: Final = 192
_AT_ONCE: Final = 50
MOST_SLOPE: Final = 2.0
"""Slopes are stored as 8-bit roots up to this one."""


class DataSet(NamedTuple):
    """Arrays of K samples: (K, N, N, 3) uint8, (K, N, N) float16, uint8, uint8."""

    pictures: npt.NDArray[np.uint8]
    heights: npt.NDArray[np.float16]
    slopes: npt.NDArray[np.uint8]
    roughness: npt.NDArray[np.uint8]


def _made(seed: int, first: int) -> list[npt.NDArray[np.generic]]:
    found = [
        pictures.sample(np.random.default_rng([seed, k]), TEXELS)
        for k in range(first, first + _AT_ONCE)
    ]
    slopes = np.sqrt(np.stack([each.slope for each in found]) / MOST_SLOPE)
    heights = np.stack([each.heights for each in found])
    return [
        np.stack([each.picture for each in found]),
        np.clip(heights, -6e4, 6e4).astype(np.float16),
        np.round(255.0 * np.minimum(slopes, 1.0)).astype(np.uint8),
        np.round(255.0 * np.stack([each.roughness for each in found])).astype(np.uint8),
    ]


def slopes_of(stored: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Slopes of their stored codes."""
    return MOST_SLOPE * (stored.astype(np.float32) / 255.0) ** 2


def opened(folder: Path, count: int, seed: int, jobs: int) -> DataSet:
    """A data set of at least ``count`` samples in a folder, made if it is not there."""
    done = folder / f"{seed}-{count}.done"
    shapes = ((3,), (), (), ())
    paths = [folder / f"{seed}-{count}-{name}.npy" for name in DataSet._fields]
    if not done.exists():
        folder.mkdir(parents=True, exist_ok=True)
        kinds = (np.uint8, np.float16, np.uint8, np.uint8)
        files = [
            np.lib.format.open_memmap(path, "w+", kind, (count, TEXELS, TEXELS, *shape))
            for path, kind, shape in zip(paths, kinds, shapes, strict=True)
        ]
        starts = range(0, count, _AT_ONCE)
        with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
            for first, parts in zip(starts, pool.map(partial(_made, seed), starts), strict=True):
                for file, part in zip(files, parts, strict=True):
                    file[first : first + _AT_ONCE] = part[: count - first]
        for file in files:
            file.flush()
        done.touch()
    return DataSet(*(np.load(path, mmap_mode="r") for path in paths))
