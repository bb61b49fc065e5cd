# SPDX-License-Identifier: GPL-3.0-or-later
"""What contacts feel at one sample of the engine: amplitude and frequency of each.

The same three renderers as for strokes. Micro-collisions need nothing but the way since the
sample before; the others need the heights of one window, which are kept for each contact.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from .contact_path import ContactPaths
from .height_field import HeightField, sample_at
from .lookup import REST_M_S, crossed_texels
from .surface_texture import Renderer, SurfaceTexture
from .synthesis import amplitude_and_frequency, without_waviness
from .textile import RATE_HZ, WINDOW_S, weighted_rms

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

_MAX_FACTOR: Final = 32
_TEXEL_BITS: Final = 31


class ContactRenderer:
    """Renders the contacts of one body with one surface.

    Parameters
    ----------
    texture : SurfaceTexture
    step_s : float
        Time from sample to sample.
    """

    def __init__(self, texture: SurfaceTexture, step_s: float) -> None:
        self._texture = texture
        self._step_s = step_s
        self._steps = max(math.ceil(RATE_HZ * step_s - 1e-9), 1)  # heights in each sample
        self._rate_hz = self._steps / step_s
        self._window = max(round(WINDOW_S * self._rate_hz), self._steps, 2)
        self._blocks = math.ceil(self._window / self._steps)
        self._kept = np.zeros((0, self._blocks, self._steps))  # of the last time, newest last
        self._field: HeightField | None = None
        if texture.renderer is not Renderer.MCHA:
            assert texture.height is not None
            is_direct = texture.renderer is Renderer.DIRECT
            self._field = without_waviness(texture.height) if is_direct else texture.height

    def render(self, paths: ContactPaths) -> tuple[F64, F64]:
        """Drive 0..1 and frequency (Hz; 0: the device's own) of each contact, two (n,).

        To be called with each result of :meth:`.ContactFollower.follow`, in their order.
        Contacts that rest, and new ones, are silent; so are those that are only carried.
        """
        drive, frequency = np.zeros(len(paths)), np.zeros(len(paths))
        moves = paths.way_m > REST_M_S * self._step_s
        moves[: paths.carried] = False
        felt = np.flatnonzero(moves)
        if self._field is None:
            if len(felt):
                self._collide(paths.pieces_m[felt], felt, drive, frequency)
            return drive, frequency
        heights = self._heights(self._field, paths, felt)
        if not len(felt):
            return drive, frequency
        if self._texture.renderer is Renderer.TEXTILE:
            level = weighted_rms(heights, self._rate_hz)
        else:
            level, frequency[felt] = amplitude_and_frequency(heights, self._rate_hz)
        drive[felt] = np.minimum(self._texture.drive_per_m * level, 1.0)
        return drive, frequency

    def _collide(self, pieces_m: F64, felt: I64, drive: F64, frequency: F64) -> None:
        """The strongest texel that each contact crossed."""
        map_ = self._texture.map
        assert map_ is not None
        pieces = pieces_m.reshape(-1, 2, 2)
        found = crossed_texels(
            pieces[:, 0], pieces[:, 1], map_.intensity.shape, map_.texel_m, map_.tiles
        )
        # The float's bits rise with its value. Of equally strong ones, the texel with the lowest
        # number is it, whatever the direction.
        bits = map_.intensity.ravel()[found.texel].view(np.int32).astype(np.int64)
        code = (bits << _TEXEL_BITS) - found.texel
        segment = found.segment
        best = np.full(len(pieces), np.iinfo(np.int64).min)
        borders = np.flatnonzero(np.diff(segment)) + 1  # each segment's texels come in runs
        starts = np.concatenate([[0], borders])
        runs = np.maximum.reduceat(code, starts)
        for part in _ascending(segment[starts]):
            mine = segment[starts[part]]
            best[mine] = np.maximum(best[mine], runs[part])
        best = best.reshape(-1, 2).max(axis=1)
        strongest = -(-best >> _TEXEL_BITS)
        texel = (strongest << _TEXEL_BITS) - best
        drive[felt] = strongest.astype(np.int32).view(np.float32)
        frequency[felt] = self._texture.device.frequency_of(map_.sharpness.ravel()[texel])

    def _heights(self, field: HeightField, paths: ContactPaths, felt: I64) -> F64:
        """Windows of heights up to now of some contacts; all are remembered for the next call."""
        carried, steps = paths.carried, self._steps
        new = np.zeros((len(paths), steps))
        new[carried:] = self._new_heights(field, paths.pieces_m[carried:])
        # Heights of the call before stand before the carried contacts, as if they were known.
        old = self._kept if carried else self._kept[:0]
        everything = np.concatenate([old.transpose(1, 0, 2).reshape(-1, steps), new[carried:]])
        shift = self._blocks * carried - carried
        before = np.where(paths.before >= 0, paths.before + shift, -1)
        chain = np.arange(self._blocks * carried) - carried
        before = np.concatenate([np.maximum(chain, -1), before[carried:]])
        windows = self._windows(everything, before, felt + shift)
        is_last = paths.time == paths.time.max(initial=-1)
        last = np.flatnonzero(is_last)
        self._kept = self._windows(everything, before, last + shift).reshape(
            -1, self._blocks, steps
        )
        return windows[:, -self._window :]

    def _windows(self, heights: F64, before: I64, which: I64) -> F64:
        """The heights of some contacts with those before them, (n, blocks * steps).

        Where a contact is new its heights stand still, and so they did before it touched.
        """
        windows = np.zeros((len(which), self._blocks, heights.shape[1]))
        at = which
        for block in range(self._blocks - 1, -1, -1):
            windows[:, block] = heights[at]
            at = np.where(before[at] >= 0, before[at], at)
        return windows.reshape(len(which), self._blocks * heights.shape[1])

    def _new_heights(self, field: HeightField, pieces: F64) -> F64:
        """Heights on each way, (n, steps)."""
        count, steps = len(pieces), self._steps
        if not count:
            return np.zeros((0, steps))
        texels = np.abs(pieces[:, :, 1] - pieces[:, :, 0]).sum(axis=1) / np.asarray(field.texel_m)
        most = texels.max(axis=1) / steps
        factors = np.clip(np.ceil(most - 1e-9), 1, _MAX_FACTOR).astype(np.int64)
        new = np.zeros((count, steps))
        for factor in np.unique(factors).tolist():
            mine = np.flatnonzero(factors == factor)
            new[mine] = _on_the_way(field, pieces[mine], steps, factor)
        return new


def _on_the_way(field: HeightField, pieces: F64, steps: int, factor: int) -> F64:
    """Heights (n, steps), each the mean of ``factor`` ones: so no texel is skipped.

    The way takes the time of a sample: its first half the first piece, then the second.
    """
    share = (np.arange(steps * factor) + 0.5) / (steps * factor)
    begin, end = pieces[:, 0, 0], pieces[:, 1, 1]
    x, y = (begin[:, [c]] + share * (end - begin)[:, [c]] for c in (0, 1))
    seam = np.flatnonzero((pieces[:, 0, 1] != pieces[:, 1, 0]).any(axis=1))
    if len(seam):
        piece = (share > 0.5).astype(np.int64)
        first, way = pieces[seam, :, 0], pieces[seam, :, 1] - pieces[seam, :, 0]
        x[seam], y[seam] = (
            first[:, piece, c] + (2.0 * share - piece) * way[:, piece, c] for c in (0, 1)
        )
    heights = sample_at(field.heights_m, x, y, field.texel_m, field.tiles)
    return heights if factor == 1 else heights.reshape(len(pieces), steps, factor).mean(axis=2)


def _ascending(values: I64) -> list[slice]:
    """The stretches in which values rise strictly."""
    borders = np.concatenate([[0], np.flatnonzero(np.diff(values) <= 0) + 1, [len(values)]])
    return [slice(int(a), int(b)) for a, b in pairwise(borders)]
