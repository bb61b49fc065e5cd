# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of contacts on a surface sample by sample: drive and frequency of each.

The three methods are the same as for strokes. Micro-collisions need only the path since the sample
before; the rest need a window of heights, stored for each contact.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np

from ..arrays import F64, I64
from .contact_path import ContactPaths
from .haptic_map import SurfaceRenderer, SurfaceTexture
from .height_field import HeightField, Order
from .lookup import REST_M_S, strongest_crossed
from .stroke_rendering import amplitude_and_frequency, without_waviness
from .textile import RATE_HZ, WINDOW_S, weighted_rms

_MAX_FACTOR: Final = 32
_AT_ONCE: Final = 1 << 13  # heights looked up at a time, to stay in the processor's cache


class ContactRenderer:
    """Renderer of the contacts of a body with a surface, for samples ``step_s`` apart."""

    def __init__(self, texture: SurfaceTexture, step_s: float) -> None:
        self._texture = texture
        self._step_s = step_s
        self._steps = max(math.ceil(RATE_HZ * step_s - 1e-9), 1)  # heights per sample
        self._rate_hz = self._steps / step_s
        self._window = max(round(WINDOW_S * self._rate_hz), self._steps, 2)
        self._blocks = math.ceil(self._window / self._steps)
        self._history = np.zeros((0, self._blocks, self._steps))  # of the last time, newest last
        self._field: HeightField | None = None
        if texture.renderer is not SurfaceRenderer.MCHA:
            assert texture.height is not None
            is_direct = texture.renderer is SurfaceRenderer.DIRECT
            self._field = without_waviness(texture.height) if is_direct else texture.height
            self._order: Order = "cubic" if is_direct else "linear"  # as for strokes
            across, up = self._field.texel_m
            self._per_texel = np.array([[1.0 / up], [1.0 / across]])

    def render(self, paths: ContactPaths) -> tuple[F64, F64]:
        """Drive 0..1 and frequency (Hz; 0: the device's own) of each contact, (n,) each. To be
        called with each result of :meth:`.ContactFollower.follow` in order. Resting, new and
        carried contacts are silent; the drive is cut at 1."""
        drive, frequency = np.zeros(len(paths)), np.zeros(len(paths))
        moves = paths.length_m > REST_M_S * self._step_s
        moves[: paths.carried] = False
        moving = moves.nonzero()[0]
        if self._field is None:
            if len(moving):
                self._collide(paths, moving, drive, frequency)
            return drive, frequency
        heights = self._heights(self._field, paths, moving)
        if not len(moving):
            return drive, frequency
        if self._texture.renderer is SurfaceRenderer.TEXTILE:
            level = weighted_rms(heights, self._rate_hz)
        else:
            level, frequency[moving] = amplitude_and_frequency(heights, self._rate_hz)
        # Drive 1 is the strongest output of the surface, as set by the user.
        drive[moving] = np.minimum(self._texture.drive_per_m * level, 1.0)
        return drive, frequency

    def _collide(self, paths: ContactPaths, moving: I64, drive: F64, frequency: F64) -> None:
        """Set drive and frequency of contacts ``moving``, in place: the intensity and sharpness of
        the texel with the largest intensity on the contact's path. A path across a seam of the UV
        map has two pieces; the texel is chosen among those of both."""
        map_ = self._texture.map
        assert map_ is not None
        starts, ends = paths.ends_m[0].take(moving, axis=1), paths.ends_m[3].take(moving, axis=1)
        seam = np.isin(moving, paths.seams).nonzero()[0] if len(paths.seams) else paths.seams
        if len(seam):  # both pieces become segments, the second pieces at the end
            ends = np.concatenate([ends, ends[:, seam]], axis=1)
            ends[:, seam] = paths.ends_m[1][:, moving[seam]]
            starts = np.concatenate([starts, paths.ends_m[2][:, moving[seam]]], axis=1)
        strongest, texel = strongest_crossed(starts, ends, map_)
        if len(seam):
            count = len(moving)
            # The stronger piece counts; at a tie the lower texel number, as within a segment.
            second = (strongest[count:] > strongest[seam]) | (
                (strongest[count:] == strongest[seam]) & (texel[count:] < texel[seam])
            )
            strongest[seam[second]] = strongest[count:][second]
            texel[seam[second]] = texel[count:][second]
            strongest, texel = strongest[:count], texel[:count]
        drive[moving] = strongest
        frequency[moving] = self._texture.device.frequency_of(map_.sharpness.ravel().take(texel))

    def _heights(self, field: HeightField, paths: ContactPaths, moving: I64) -> F64:
        """Windows of heights (m, window) up to now of the contacts ``moving``. Stores the heights
        of all contacts of the last time for the next call."""
        carried, blocks, steps = paths.carried, self._blocks, self._steps
        stored = self._history[:carried].reshape(-1, steps)
        new = self._new_heights(field, paths)
        heights = np.concatenate([stored, new])
        # Row of heights before each row; for a new contact the row itself, as of a resting finger.
        back = np.arange(-1, len(heights) - 1)
        back[: len(stored) : blocks] += 1
        shift = len(stored) - carried
        before = paths.before[carried:]
        row = np.where(before < carried, before * blocks + blocks - 1, before + shift)
        back[len(stored) :] = np.where(before >= 0, row, np.arange(len(stored), len(heights)))
        # Only contacts of the last time continue in the next call.
        last = np.arange(paths.time.searchsorted(paths.time[-1:].max(initial=0)), len(paths))
        self._history = self._windows(heights, back, last + shift)
        windows = self._windows(heights, back, moving + shift)
        return windows.reshape(len(moving), blocks * steps)[:, -self._window :]

    def _windows(self, heights: F64, back: I64, which: I64) -> F64:
        """Heights (n, blocks, steps): rows ``which`` (n,), each after ``blocks - 1`` rows before,
        oldest first. ``back`` is the index of the row before each row."""
        rows = np.zeros((len(which), self._blocks), np.int64)
        for block in range(self._blocks - 1, -1, -1):
            rows[:, block] = which
            which = back.take(which)
        return heights.take(rows, axis=0)

    def _new_heights(self, field: HeightField, paths: ContactPaths) -> F64:
        """Heights (n, steps) on the paths that are not carried, so that no texel is skipped. Each
        is the mean of at most 32 heights."""
        steps = self._steps
        # Begin and end of both pieces in rows and columns, (4, 2, n).
        places = paths.ends_m[:, ::-1, paths.carried :] * self._per_texel
        texels = np.abs(places[1::2] - places[::2])
        texels = texels[0] + texels[1]
        most = texels.max(initial=0.0)
        new = np.zeros((texels.shape[1], steps))
        seams = paths.seams - paths.carried
        if most <= steps * (1.0 + 1e-9) and new.size <= _AT_ONCE:
            return _on_the_way(field, self._order, places, seams, steps, 1)
        # Oversample long paths, so that no step skips a texel. Equal factors share a call.
        factors = np.ceil(texels.max(axis=0) / steps - 1e-9).clip(1, _MAX_FACTOR)
        for factor in set(factors.tolist()):
            mine = (factors == factor).nonzero()[0]
            at_once = max(_AT_ONCE // (steps * int(factor)), 1)
            for first in range(0, len(mine), at_once):
                part = mine[first : first + at_once]
                apart = np.isin(part, seams).nonzero()[0]
                new[part] = _on_the_way(
                    field, self._order, places[:, :, part], apart, steps, int(factor)
                )
        return new


@lru_cache(maxsize=64)
def _shares(count: int) -> F64:
    """Centres (count,) of equal parts of a path, as shares of its length."""
    return np.asarray((np.arange(count) + 0.5) / count)


def _on_the_way(
    field: HeightField, order: Order, ends: F64, seams: I64, steps: int, factor: int
) -> F64:
    """Heights (n, steps) on paths, means of ``factor`` heights, so that no texel is skipped.

    The first piece of a path takes the first half of a sample interval, the second piece the second
    half. ``ends`` (4, 2, n) are begin and end of both pieces in rows and columns of texels;
    ``seams`` are indices of paths with separate pieces.
    """
    shares = _shares(steps * factor)
    # Without a seam both pieces form a straight line from ends[0] to ends[3].
    places = np.multiply.outer(ends[3] - ends[0], shares)
    # Places count from the centre of the first texel.
    places += (ends[0] - 0.5)[..., None]
    if len(seams):
        half = int(shares.searchsorted(0.5, "right"))
        for begin, part in ((0, slice(None, half)), (2, slice(half, None))):
            first, end = ends[begin : begin + 2, :, seams, None]
            along = 2.0 * shares[part] - (begin == 2)
            places[:, seams, part] = first - 0.5 + along * (end - first)
    heights = field.at_places(places, order)
    if factor == 1:
        return heights
    return np.asarray(heights.reshape(-1, steps, factor).mean(axis=2))
