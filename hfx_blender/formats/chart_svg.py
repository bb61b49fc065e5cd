# SPDX-License-Identifier: GPL-3.0-or-later
"""A chart of a track over time, as SVG: what was felt, and what each device played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from math import ceil, floor
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from ..atomic_files import atomic_file
from ..engine.colouring import COLOURS
from ..engine.rendering.raster import Raster
from ..engine.track import TrackReader

F64 = npt.NDArray[np.float64]

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


def write(track: TrackReader, rasters: Sequence[Raster], path: Path) -> None:
    """Draw a recorded track and its rasters.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    time = track.header.time
    start_s = float(time.times_s(np.array([0]))[0])
    length_s = time.sample_count / float(time.rate_hz)
    rows = [*_felt_rows(track, start_s, length_s), *_device_rows(rasters, start_s, length_s)]
    with atomic_file(path) as file:
        file.write(_svg(rows, start_s, length_s).encode())


def _felt_rows(track: TrackReader, start_s: float, length_s: float) -> list[_Row]:
    effects = {effect.id: effect for effect in track.header.effects}
    levels = {stream: np.zeros(_STEPS) for stream in range(len(track.header.streams))}
    counts = dict.fromkeys(levels, 0)
    places = {(s.effect_id, s.body_id): k for k, s in enumerate(track.header.streams)}
    for run in track.runs():
        k = places[run.stream.effect_id, run.stream.body_id]
        sizes = run.sizes
        np.maximum.at(levels[k], _columns(run.times_s, start_s, length_s), run.levels * (sizes > 0))
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


def _device_rows(rasters: Sequence[Raster], start_s: float, length_s: float) -> list[_Row]:
    rows = []
    for raster in rasters:
        columns = _columns(raster.times_s, start_s, length_s)
        lines: list[F64] = []
        parameters: list[str] = []
        for k, column in enumerate(raster.columns):
            if column.unit in ("Hz", "1"):
                continue  # which, not how much
            line = np.zeros(_STEPS)
            np.maximum.at(line, columns, np.abs(raster.values[:, k] - raster.neutral[k]))
            lines.append(line)
            parameters.append(column.parameter)
        bands = np.array(lines).reshape(len(lines), _STEPS)
        for parameter in set(parameters):  # kPa and degrees are not to be compared
            alike = [each == parameter for each in parameters]
            bands[alike] /= bands[alike].max() or 1.0
        note = f"{len(raster.actuators)} actuators"
        rows.append(_Row(raster.device_id, note, "#4a4a52", bands))
    return rows


def _columns(times_s: F64, start_s: float, length_s: float) -> npt.NDArray[np.int64]:
    at = ((times_s - start_s) / length_s * _STEPS).astype(np.int64)
    return np.clip(at, 0, _STEPS - 1)


def _svg(rows: Sequence[_Row], start_s: float, length_s: float) -> str:
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
        f"{escape(row.label)}</text>",
        f'<text x="8" y="{top + 29}" fill="#777" {_TEXT}>{escape(row.note)}</text>',
        f'<line x1="{_LEFT}" y1="{bottom}" x2="{_LEFT + _WIDTH}" y2="{bottom}" stroke="#bbb"/>',
    ]
    if len(row.bands) == 1:
        return [*parts, _area(row.bands[0], top, bottom, row.colour)]
    thickness = (bottom - top) / max(len(row.bands), 1)
    for k, band in enumerate(row.bands):
        parts += _heat(band, top + k * thickness, thickness, row.colour)
    return parts


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
