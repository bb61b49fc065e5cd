# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a scene's samples that can be recorded each for itself."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from ...engine.track.layout import SAMPLES_PER_CHUNK

SHORTEST = 8 * SAMPLES_PER_CHUNK
"""Samples at which something may be felt in a part that is cut off to keep workers busy: with
fewer, opening the scene once more costs more than it saves."""


def even_parts(
    samples: npt.NDArray[np.int64], count: int, parts: int, shortest: int = SHORTEST
) -> list[tuple[int, int]]:
    """Cut so that each part has about as many samples to work on.

    Parameters
    ----------
    samples : (n,) int64
        At which something may be felt, ascending.
    count : int
        Of all samples; the parts cover them.
    parts : int
        At most so many.
    shortest : int
        Least samples to work on in a part, about.

    Returns
    -------
    list of (first, stop)
        Whole chunks of a track, but for the last.
    """
    parts = max(min(parts, len(samples) // max(shortest, 1)), 1)
    cuts = [int(samples[len(samples) * k // parts]) for k in range(1, parts)]
    return _between(cuts, count)


def parts_of(size: int, count: int) -> list[tuple[int, int]]:
    """Cut into parts of ``size`` samples, rounded up to whole chunks of a track."""
    whole = -(-max(size, 1) // SAMPLES_PER_CHUNK) * SAMPLES_PER_CHUNK
    return _between(list(range(whole, count, whole)), count)


def _between(cuts: list[int], count: int) -> list[tuple[int, int]]:
    rounded = {round(cut / SAMPLES_PER_CHUNK) * SAMPLES_PER_CHUNK for cut in cuts}
    edges = sorted({0, count, *(cut for cut in rounded if 0 < cut < count)})
    return list(pairwise(edges))
