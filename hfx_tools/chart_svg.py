# SPDX-License-Identifier: GPL-3.0-or-later
"""Chart of a track over time, as SVG: samples, and the output of each device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from math import ceil, floor
from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.colouring import COLOURS
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.track import TrackReader
from hfx_blender.files.atomic import atomic_file

_LEFT: Final = 215
_WIDTH: Final = 960  # of the plot
_ROW: Final = 46
_STEPS: Final = 480  # columns of the chart over the whole time
_TICKS_S: Final = (0.01, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300, 600, 3600, 36_000, 1e9)
_TEXT: Final = 'font-family="sans-serif" font-size="12"'


@dataclass(frozen=True, eq=False)
class _Row:
    label: str
    note: str
    colour: str
    bands: F64  # (lines, _STEPS) 0..1; one line is drawn as an area, more as a heat map


@dataclass(frozen=True)
class _Span:
    start_s: float
    length_s: float
    period_s: float  # of a sample


def write(track: TrackReader, rasters: Sequence[Raster], path: Path) -> None:
    """Draw a recorded track and its rasters.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    time = track.header.time
    span = _Span(
        float(time.times_s(np.array([0]))[0]),
        time.sample_count / float(time.rate_hz),
        1.0 / float(time.rate_hz),
    )
    rows = [*_felt_rows(track, span), *_device_rows(rasters, span)]
    with atomic_file(path) as file:
        file.write(_svg(rows, span).encode())


def _felt_rows(track: TrackReader, span: _Span) -> list[_Row]:
    effects = {effect.id: effect for effect in track.header.effects}
    levels = {stream: np.zeros(_STEPS) for stream in range(len(track.header.streams))}
    counts = dict.fromkeys(levels, 0)
    places = {(s.effect_id, s.body_id): k for k, s in enumerate(track.header.streams)}
    for run in track.runs():
        k = places[run.stream.effect_id, run.stream.body_id]
        sizes = run.sizes
        felt = _held(run.times_s, run.levels * (sizes > 0), span)
        levels[k] = np.maximum(levels[k], felt)
        counts[k] = max(counts[k], int(sizes.max(initial=0)))
    return [
        _Row(
            effects[stream.effect_id].name,
            f"{stream.modality}, up to {counts[k]} vertices",
            _hex(COLOURS[stream.modality]),
            levels[k][None],
        )
        for k, stream in enumerate(track.header.streams)
    ]


def _device_rows(rasters: Sequence[Raster], span: _Span) -> list[_Row]:
    rows = []
    for raster in rasters:
        lines: list[F64] = []
        parameters: list[str] = []
        for k, column in enumerate(raster.columns):
            if column.unit in ("Hz", "1"):
                continue  # which, not how much
            strengths = np.abs(raster.values[:, k] - raster.neutral[k])
            lines.append(_held(raster.times_s, strengths, span))
            parameters.append(column.parameter)
        bands = np.array(lines).reshape(len(lines), _STEPS)
        for parameter in set(parameters):  # kPa and degrees are not to be compared
            alike = [each == parameter for each in parameters]
            bands[alike] /= bands[alike].max() or 1.0
        note = f"{len(raster.actuators)} actuators"
        rows.append(_Row(raster.device_id, note, "#4a4a52", bands))
    return rows


def _held(times_s: F64, values: F64, span: _Span) -> F64:
    """The strongest value in each column of the chart; a value holds for a period, (_STEPS,)."""
    scale = _STEPS / span.length_s
    first = np.floor((times_s - span.start_s) * scale + 1e-6).astype(np.int64)
    stop = np.ceil((times_s + span.period_s - span.start_s) * scale - 1e-6).astype(np.int64)
    counts = np.maximum(stop - first, 1)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    columns = np.clip(np.repeat(first, counts) + within, 0, _STEPS - 1)
    line = np.zeros(_STEPS)
    np.maximum.at(line, columns, np.repeat(values, counts))
    return line


def _svg(rows: Sequence[_Row], span: _Span) -> str:
    start_s, length_s = span.start_s, span.length_s
    height = len(rows) * _ROW + 50
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_LEFT + _WIDTH + 20}" '
        f'height="{height}" viewBox="0 0 {_LEFT + _WIDTH + 20} {height}">',
        f'<rect width="100%" height="{height}" fill="#ffffff"/>',
    ]
    step_s = next(step for step in _TICKS_S if length_s / step < 20)
    for k in range(ceil(start_s / step_s), floor((start_s + length_s) / step_s) + 1):
        tick = k * step_s
        x = _LEFT + (tick - start_s) / length_s * _WIDTH
        parts.append(
            f'<line x1="{x:.1f}" y1="10" x2="{x:.1f}" y2="{height - 32}" stroke="#e4e4e8"/>'
            f'<text x="{x:.1f}" y="{height - 16}" text-anchor="middle" fill="#555" {_TEXT}>'
            f"{tick:g} s</text>"
        )
    for k, row in enumerate(rows):
        parts += _row_parts(row, 14 + k * _ROW)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _row_parts(row: _Row, top: int) -> list[str]:
    bottom = top + _ROW - 10
    parts = [
        f'<text x="8" y="{top + 14}" fill="#222" font-weight="bold" {_TEXT}>'
        f"{_shown(row.label)}</text>",
        f'<text x="8" y="{top + 29}" fill="#777" {_TEXT}>{escape(row.note)}</text>',
        f'<line x1="{_LEFT}" y1="{bottom}" x2="{_LEFT + _WIDTH}" y2="{bottom}" stroke="#bbb"/>',
    ]
    if len(row.bands) == 1:
        return [*parts, _area(row.bands[0], top, bottom, row.colour)]
    thickness = (bottom - top) / max(len(row.bands), 1)
    for k, band in enumerate(row.bands):
        parts += _heat(band, top + k * thickness, thickness, row.colour)
    return parts


def _shown(name: str) -> str:
    """A name as XML may hold it: Blender's may have control characters and broken UTF-8."""
    return escape("".join(each if each.isprintable() else "?" for each in name))


def _area(band: F64, top: float, bottom: float, colour: str) -> str:
    step = _WIDTH / _STEPS
    points = [f"{_LEFT},{bottom}"]
    for k, value in enumerate(band):
        y = bottom - value * (bottom - top)
        points += [f"{_LEFT + k * step:.1f},{y:.1f}", f"{_LEFT + (k + 1) * step:.1f},{y:.1f}"]
    points.append(f"{_LEFT + _WIDTH},{bottom}")
    return f'<polygon points="{" ".join(points)}" fill="{colour}" fill-opacity="0.75"/>'


def _heat(band: F64, top: float, thickness: float, colour: str) -> list[str]:
    """Rectangles of equal strength, in sixteen steps."""
    steps = np.ceil(band * 16).astype(int)
    cuts = np.flatnonzero(np.diff(steps, prepend=-1, append=-1))
    width = _WIDTH / _STEPS
    return [
        f'<rect x="{_LEFT + a * width:.1f}" y="{top:.2f}" width="{(b - a) * width:.1f}" '
        f'height="{thickness:.2f}" fill="{colour}" fill-opacity="{steps[a] / 16:.3f}"/>'
        for a, b in pairwise(cuts)
        if steps[a] > 0
    ]


def _hex(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * channel ** (1 / 2.2)):02x}" for channel in colour)
