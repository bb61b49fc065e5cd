# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts of the demos over time: samples, outputs of devices, and sound."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.colouring import COLOURS
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import TrackReader
from hfx_blender.text import printable

from ..charts import chart
from ..spatial_sound.loudspeakers import LoudspeakerLayout

_WIDTH: Final = 1150
_ROW: Final = 46
_STEPS: Final = 480  # columns of a chart over the whole time


def draw_track(track: TrackReader, rasters: Sequence[Raster], path: Path) -> None:
    """Draw a recorded track (a row per stream) and its rasters (a heat map per device) as SVG.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    time = track.header.time
    start_s = float(time.times_s(np.array([0]))[0])
    length_s = time.sample_count / float(time.rate_hz)
    edges_s = np.linspace(start_s, start_s + length_s, _STEPS + 1)
    labels, bottom = [], 0.0
    with chart(path, _WIDTH, (len(track.header.streams) + len(rasters)) * _ROW + 50) as figure:
        axes = figure.subplots()
        for label, colour, levels in _stream_levels(track):
            labels.append(label)
            bottom -= 1.0
            cuts = np.flatnonzero(np.diff(levels, prepend=-1.0, append=-1.0))
            values = bottom + 0.8 * levels[cuts[:-1]]
            axes.stairs(values, edges_s[cuts], baseline=bottom, fill=True, color=colour, alpha=0.75)
        for raster in rasters:
            labels.append(f"{raster.device_id}\n{len(raster.actuators)} actuators")
            bottom -= 1.0
            extent = (edges_s[0], edges_s[-1], bottom, bottom + 0.8)
            _heat_map(axes, _strengths(raster, time), extent, "#4a4a52")
        axes.hlines(np.arange(bottom, 0.0), *edges_s[[0, -1]], color="#bbbbbb", lw=0.8)
        axes.set_yticks(np.arange(-1.0, bottom - 1.0, -1.0) + 0.4, labels)
        axes.set_ylim(bottom - 0.1, 0.0)
        _time_axis(axes, edges_s)


def draw_belt(raster: Raster, sound: Path, layout: LoudspeakerLayout, path: Path) -> None:
    """Draw a belt's raster and the loudspeakers' sound as SVG.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    from scipy.io import wavfile

    amplitudes = [
        k for k, column in enumerate(raster.columns) if column.parameter == "amplitude_m_s2"
    ]
    waves = np.abs(wavfile.read(sound)[1].astype(np.float64))
    edges_s = np.linspace(0.0, len(raster.values) / float(raster.rate_hz), _STEPS + 1)
    with chart(path, _WIDTH, 400) as figure:
        motors, loudspeakers = figure.subplots(2, sharex=True)
        for axes, values, names, colour, title in (
            (
                motors,
                raster.values[:, amplitudes],
                [raster.columns[k].actuator for k in amplitudes],
                "#c81e1e",
                "Motors of the belt",
            ),
            (
                loudspeakers,
                waves,
                [f"{azimuth:+.0f}°" for azimuth in layout.azimuths_deg],
                "#1e46b4",
                "Loudspeakers, by their azimuth (left positive)",
            ),
        ):
            starts = np.arange(_STEPS) * len(values) // _STEPS
            strongest = np.maximum.reduceat(values, starts).T
            extent = (edges_s[0], edges_s[-1], len(names), 0)
            _heat_map(axes, strongest / (strongest.max() or 1.0), extent, colour)
            axes.set_yticks(np.arange(len(names)) + 0.5, names)
            axes.set_title(title)
        _time_axis(loudspeakers, edges_s)


def _stream_levels(track: TrackReader) -> list[tuple[str, tuple[float, ...], F64]]:
    """Label, sRGB colour and levels (_STEPS,) of each stream."""
    effects = {effect.id: effect for effect in track.header.effects}
    streams = {(s.effect_id, s.body_id): k for k, s in enumerate(track.header.streams)}
    levels = np.zeros((len(streams), _STEPS))
    counts = [0] * len(streams)
    for run in track.runs():
        k = streams[run.stream.effect_id, run.stream.body_id]
        strengths = run.levels * (run.sizes > 0)
        levels[k] = np.maximum(levels[k], _strongest(run.times_s, strengths, track.header.time))
        counts[k] = max(counts[k], int(run.sizes.max(initial=0)))
    return [
        (
            f"{printable(effects[stream.effect_id].name)}\n"
            f"{stream.modality}, up to {counts[k]} vertices",
            tuple(channel ** (1 / 2.2) for channel in COLOURS[stream.modality]),
            levels[k],
        )
        for k, stream in enumerate(track.header.streams)
    ]


def _strengths(raster: Raster, time: TimeBase) -> F64:
    """Strengths (n, _STEPS) of a raster's columns, relative to the maximum of their parameter.

    A strength is the absolute difference from neutral. Columns of frequencies and shapes are left
    out.
    """
    columns = [k for k, column in enumerate(raster.columns) if column.unit not in ("Hz", "1")]
    bands = np.zeros((len(columns), _STEPS))
    for band, k in zip(bands, columns, strict=True):
        band[:] = _strongest(raster.times_s, np.abs(raster.values[:, k] - raster.neutral[k]), time)
    parameters = np.array([raster.columns[k].parameter for k in columns])
    for parameter in set(parameters.tolist()):  # kPa and degrees have separate scales
        is_same = parameters == parameter
        bands[is_same] /= bands[is_same].max() or 1.0
    return bands


def _strongest(times_s: F64, values: F64, time: TimeBase) -> F64:
    """Largest value in each column of the chart, (_STEPS,); each value holds for one period."""
    period_s = 1.0 / float(time.rate_hz)
    per_second = _STEPS / (time.sample_count * period_s)
    start_s = time.times_s(np.array([0]))[0]
    first = np.floor((times_s - start_s) * per_second + 1e-6).astype(np.int64)
    stop = np.ceil((times_s + period_s - start_s) * per_second - 1e-6).astype(np.int64)
    # Repeat each value for every column of its period.
    counts = np.maximum(stop - first, 1)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    columns = np.clip(np.repeat(first, counts) + within, 0, _STEPS - 1)
    strongest = np.zeros(_STEPS)
    np.maximum.at(strongest, columns, np.repeat(values, counts))
    return strongest


def _heat_map(axes: Any, shares: F64, extent: tuple[float, ...], colour: str) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("", ["white", colour])
    axes.imshow(
        shares,
        colours,
        vmin=0,
        vmax=1,
        extent=extent,
        aspect="auto",
        interpolation="none",
        zorder=1,
    )


def _time_axis(axes: Any, edges_s: F64) -> None:
    axes.set_xlim(*edges_s[[0, -1]])
    axes.locator_params(axis="x", nbins=16, steps=[1, 2, 5, 10])
    axes.xaxis.set_major_formatter(lambda seconds, _: f"{seconds:.6g} s")
    axes.grid(axis="x", color="#e4e4e8")
    axes.set_axisbelow(True)
