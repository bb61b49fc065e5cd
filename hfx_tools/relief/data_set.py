# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of pictures and relief on disk, made once by several processes, read during training.

Sample ``k`` depends on the seed and on ``k`` only.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from hfx_blender.processes import start

from . import pictures

TEXELS: Final = 192
_AT_ONCE: Final = 50
_MODULE: Final = "hfx_tools.relief.data_set"
MOST_SLOPE: Final = 2.0
"""Largest stored slope; slopes are stored as 8-bit square roots."""


class DataSet(NamedTuple):
    """Arrays of K samples: (K, N, N, 3) uint8, (K, N, N) float16, uint8, uint8."""

    pictures: npt.NDArray[np.uint8]
    heights: npt.NDArray[np.float16]
    slopes: npt.NDArray[np.uint8]
    roughness: npt.NDArray[np.uint8]


def _make_samples(seed: int, first: int) -> list[npt.NDArray[np.generic]]:
    samples = [
        pictures.sample(np.random.default_rng([seed, k]), TEXELS)
        for k in range(first, first + _AT_ONCE)
    ]
    slopes = np.sqrt(np.stack([sample.slope for sample in samples]) / MOST_SLOPE)
    heights = np.stack([sample.heights for sample in samples])
    return [
        np.stack([sample.picture for sample in samples]),
        np.clip(heights, -6e4, 6e4).astype(np.float16),
        np.round(255.0 * np.minimum(slopes, 1.0)).astype(np.uint8),
        np.round(255.0 * np.stack([sample.roughness for sample in samples])).astype(np.uint8),
    ]


def slopes_of(stored: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Decode stored slopes to float32."""
    return MOST_SLOPE * (stored.astype(np.float32) / 255.0) ** 2


def opened(folder: Path, count: int, seed: int, jobs: int) -> DataSet:
    """Open a data set of ``count`` samples in a folder, made by ``jobs`` processes if missing.

    Raises
    ------
    RuntimeError
        A process failed; its error output has the reason.
    """
    done = folder / f"{seed}-{count}.done"
    if not done.exists():
        folder.mkdir(parents=True, exist_ok=True)
        shapes, kinds = ((3,), (), (), ()), (np.uint8, np.float16, np.uint8, np.uint8)
        for path, kind, shape in zip(_paths(folder, count, seed), kinds, shapes, strict=True):
            np.lib.format.open_memmap(path, "w+", kind, (count, TEXELS, TEXELS, *shape)).flush()
        arguments = str(folder), str(count), str(seed), str(jobs)
        run_together([start.command(_MODULE, *arguments, str(job)) for job in range(jobs)])
        done.touch()
    return DataSet(*(np.load(path, mmap_mode="r") for path in _paths(folder, count, seed)))


def run_together(commands: list[list[str]]) -> None:
    """Run processes and wait for all; the first failure ends all processes.

    Raises
    ------
    RuntimeError
        A process failed.
    """
    running = [start.start(command, {"OMP_NUM_THREADS": "1"}) for command in commands]
    try:
        for process in running:
            if process.wait():
                raise RuntimeError(f"a process ended with {process.returncode}")
    finally:
        for process in running:
            process.kill()
            process.wait()


def _paths(folder: Path, count: int, seed: int) -> list[Path]:
    return [folder / f"{seed}-{count}-{name}.npy" for name in DataSet._fields]


def _fill(folder: Path, count: int, seed: int, jobs: int, job: int) -> None:
    """Make the samples of one job: every ``jobs``-th block of 50."""
    files = [np.load(path, mmap_mode="r+") for path in _paths(folder, count, seed)]
    for first in range(job * _AT_ONCE, count, jobs * _AT_ONCE):
        for file, part in zip(files, _make_samples(seed, first), strict=True):
            file[first : first + _AT_ONCE] = part[: count - first]
    for file in files:
        file.flush()


if __name__ == "__main__":
    _fill(Path(sys.argv[1]), *map(int, sys.argv[2:]))
