# SPDX-License-Identifier: GPL-3.0-or-later
"""The belt's demo over time, as SVG: how strongly each motor and each loudspeaker plays."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.spatial_sound.layouts import Layout
from hfx_blender.files.atomic import atomic_file

_LEFT: Final = 110
_WIDTH: Final = 900
_ROW: Final = 18
_COLUMNS: Final = 225
_SHADES: Final = 10
_TEXT: Final = 'font-family="sans-serif" font-size="12"'


def write(raster: Raster, sound: Path, layout: Layout, path: Path) -> None:
    """Draw a belt's raster and the sound that goes with it.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    from scipy.io import wavfile

    amplitudes = [k for k, each in enumerate(raster.columns) if each.parameter == "amplitude_m_s2"]
    motors = _pooled(raster.values[:, amplitudes])
    heard = _pooled(np.abs(wavfile.read(sound)[1].astype(np.float64)))
    duration_s = len(raster.values) / float(raster.rate_hz)
    lines = [
        f'<text x="{_LEFT}" y="18" {_TEXT} font-weight="bold">Motors of the belt</text>',
        *_rows(motors, [raster.columns[k].actuator for k in amplitudes], 28, "#c81e1e"),
    ]
    top = 28 + _ROW * len(amplitudes) + 30
    names = [f"{azimuth:+.0f}°" for azimuth in layout.azimuths_deg]
    lines += [
        f'<text x="{_LEFT}" y="{top - 10}" {_TEXT} font-weight="bold">Loudspeakers, by their '
        "azimuth (left positive)</text>",
        *_rows(heard, names, top, "#1e46b4"),
    ]
    bottom = top + _ROW * len(layout)
    for second in range(int(duration_s) + 1):
        x = _LEFT + _WIDTH * second / duration_s
        lines.append(f'<text x="{x:.1f}" y="{bottom + 18}" {_TEXT}>{second} s</text>')
    size = f'width="{_LEFT + _WIDTH + 40}" height="{bottom + 30}"'
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n'
        '<rect width="100%" height="100%" fill="white"/>\n' + "\n".join(lines) + "\n</svg>\n"
    )
    with atomic_file(path) as file:
        file.write(svg.encode())


def _pooled(values: F64) -> F64:
    """The strongest of each column of the chart, (channels, columns) in 0..1."""
    edges = np.linspace(0, len(values), _COLUMNS + 1).astype(int)
    pooled = np.stack([values[a : max(b, a + 1)].max(axis=0) for a, b in pairwise(edges.tolist())])
    return np.asarray(pooled.T / max(float(pooled.max()), 1e-12))


def _rows(values: F64, names: list[str], top: int, colour: str) -> list[str]:
    lines = []
    step = _WIDTH / _COLUMNS
    for k, (row, name) in enumerate(zip(values, names, strict=True)):
        y = top + k * _ROW
        lines.append(
            f'<text x="{_LEFT - 8}" y="{y + 13}" text-anchor="end" {_TEXT}>{name}</text>'
            f'<rect x="{_LEFT}" y="{y}" width="{_WIDTH}" height="{_ROW - 2}" fill="#f2f2f2"/>'
        )
        # One path for each shade: a chart of thousands of cells stays small.
        shades = np.round(row * _SHADES).astype(int)
        for shade in range(1, _SHADES + 1):
            cells = "".join(
                f"M{_LEFT + column * step:g} {y}h{step:g}v{_ROW - 2}h-{step:g}z"
                for column in np.flatnonzero(shades == shade).tolist()
            )
            if cells:
                lines.append(f'<path d="{cells}" fill="{colour}" opacity="{shade / _SHADES:.2f}"/>')
    return lines
