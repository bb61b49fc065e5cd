# SPDX-License-Identifier: GPL-3.0-or-later
"""Values over time as a strip chart: a curve for each effect, a row for each actuator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, floor, log10
from typing import TYPE_CHECKING

import numpy as np

from ...blender.scene_info import fps_of
from ...engine.arrays import F32, F64
from ...engine.colouring import COLD, Colour
from ...engine.modality import MODALITIES
from .timeline_record import TimelineRecord

if TYPE_CHECKING:
    import bpy

CURVE_HEIGHT = 22.0  # pixels of an effect's row, times the user's scale
ROW_HEIGHT = 5.0  # of an actuator's
AXIS_HEIGHT = 16.0  # of the labels of the time axis
_TICK_WIDTH = 80.0
_GAP = 4.0
_LOWEST_ALPHA = 0.07
_BACKGROUND = (0.08, 0.08, 0.09, 0.82)


@dataclass(frozen=True)
class Label:
    """Label of a row; position in pixels of the chart."""

    text: str
    left: float
    bottom: float
    values: F64 | None = None  # (T,) the current value is written next to the row
    unit: str = ""


@dataclass(eq=False)
class Chart:
    """Chart geometry, pixels from the lower left corner."""

    width: float
    height: float
    frames: tuple[float, float]  # at the left and right end
    times: F64  # (T,) frames of the labels' values
    positions: F32  # (P, 2) three to a triangle; the first six are the background
    colours: F32  # (P, 4)
    labels: list[Label] = field(default_factory=list)
    hidden: int = 0  # number of rows without room

    def x_of(self, frame: float) -> float:
        """Horizontal position of a frame, pixels; outside of 0 to ``width`` for hidden frames."""
        first, last = self.frames
        return self.width * (frame - first) / max(last - first, 1e-9)


def chart(
    timeline: TimelineRecord,
    palette: Mapping[str, Colour],
    width: float,
    height: float,
    scale: float = 1.0,
    frames: tuple[float, float] | None = None,
) -> Chart:
    """Lay out a record's values from the top: effects, then actuators below their device's name,
    then the time axis.

    Rows without room are left out and counted. ``palette``: colours by modality. ``width``,
    ``height``: available size, pixels. ``scale``: interface scale of Blender. ``frames``: frames at
    the left and right end; None: all frames of the record.
    """
    first, last = frames or (timeline.time.frame_first, timeline.time.frame_last + 1)
    height -= AXIS_HEIGHT * scale
    columns = max(int(width), 1)
    # Samples at the edges of the columns of pixels; a sample lasts until the next.
    edges = timeline.position(np.linspace(first, last, columns + 1))
    is_recorded = (edges[1:] > 0.0) & (edges[:-1] < len(timeline.frames))
    curve, row, gap = (pixels * scale for pixels in (CURVE_HEIGHT, ROW_HEIGHT, _GAP))
    quads: list[tuple[F64, F64]] = []
    labels: list[Label] = []
    at, hidden = gap, 0
    for effect in timeline.rows():
        if at + curve + gap > height:
            hidden += 1
            continue
        full_colour = MODALITIES[effect.stream.modality].full_colour
        # A weak effect looks weak: rows are relative to full strength, and larger only for stronger
        # values.
        full = max(full_colour, float(np.abs(effect.values).max()))
        shares = _columns(effect.values, edges) / full
        quads.append(_bars(shares, _tints(shares, effect.stream.modality, palette), at, curve))
        unit = effect.unit.replace("^2", "²").replace("degC", "°C")
        labels.append(Label(effect.name, 0.0, at + 0.3 * curve, effect.values, unit))
        at += curve + gap
    for device, raster in timeline.devices:
        head = 16.0 * scale
        if at + head + row > height:
            hidden += len(device.actuators)
            continue
        labels.append(Label(device.name, 0.0, at + 0.25 * head))
        at += head
        for actuator, column in zip(device.actuators, device.strength_columns, strict=True):
            strength = actuator.type.strength
            values = raster.values[:, column] - strength.neutral
            if at + row > height:
                hidden += 1
                continue
            shares = _columns(values, edges) / max(strength.reach, 1e-9)
            tints = _tints(shares, actuator.type.modality, palette)
            # The root keeps weak values visible, as on the skin; off is a faint row, not a gap.
            tints[:, 3] = np.maximum(np.sqrt(np.abs(shares)), _LOWEST_ALPHA)
            quads.append(_bars(is_recorded.astype(float), tints, at, row - 1.0))
            at += row
        at += gap
    used = min(at, height) + AXIS_HEIGHT * scale
    quads.insert(0, (np.array([[0.0, 0.0, width, used]]), np.array([_BACKGROUND])))
    positions, colours = _triangles(quads)
    positions[:, 1] = used - positions[:, 1]
    labels = [
        replace(label, left=6.0 * scale, bottom=used - label.bottom - 10.0 * scale)
        for label in labels
    ]
    span = float(first), float(last)
    return Chart(width, used, span, timeline.frames, positions, colours, labels, hidden)


def ticks(scene: bpy.types.Scene, chart: Chart, scale: float = 1.0) -> list[tuple[float, str]]:
    """Marks of a chart's time axis as (position in pixels, label), from the left, in the scene's
    unit: frames, or seconds from the first frame. Steps are 1, 2 or 5 times a power of ten."""
    is_seconds = scene.hfx.time_unit == "SECONDS"
    zero, unit = (scene.frame_start, fps_of(scene)) if is_seconds else (0, 1.0)
    start, end = ((frame - zero) / unit for frame in chart.frames)
    least = max(end - start, 1e-6) * _TICK_WIDTH * scale / chart.width
    power = 10.0 ** floor(log10(least))
    step = next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= least * 0.999)
    step = step if is_seconds else max(step, 1.0)
    numbers = [k * step for k in range(ceil(start / step), floor(end / step) + 1)]
    return [(chart.x_of(zero + n * unit), f"{n:g}{' s' * is_seconds}") for n in numbers]


def _columns(values: F64, edges: F64) -> F64:
    """Value of the largest magnitude between every two of the C + 1 ``edges`` (indices of samples,
    with fractions), signed, (C,); 0 outside of the N ``values``."""
    starts, ends = np.floor(edges[:-1]), np.maximum(np.ceil(edges[1:]), np.floor(edges[:-1]) + 1)
    is_inside = (ends > 0) & (starts < len(values))
    starts = np.clip(starts, 0, len(values) - 1).astype(np.int64)
    ends = np.clip(ends, starts + 1, len(values)).astype(np.int64)
    # The extreme of each column, not the mean: an impact of one sample stays visible. `reduceat`
    # needs one more value, as an end may be the length.
    padded, bounds = np.append(values, 0.0), np.stack((starts, ends), axis=1).ravel()
    high = np.maximum.reduceat(padded, bounds)[::2]
    low = np.minimum.reduceat(padded, bounds)[::2]
    return np.where(is_inside, np.where(-low > high, low, high), 0.0)


def _tints(shares: F64, modality: str, palette: Mapping[str, Colour]) -> F64:
    """Opaque colours (n, 4) of a modality; of coldness where a temperature's share is negative."""
    colours = np.ones((len(shares), 4))
    colours[:, :3] = palette[modality]
    if modality == "temperature":
        colours[shares < 0.0, :3] = palette[COLD]
    return colours


def _bars(shares: F64, colours: F64, top: float, height: float) -> tuple[F64, F64]:
    """A bar for each run of equal columns, from the lower edge, none for height 0: boxes (n, 4) as
    left, top, right, bottom, pixels; colours (n, ...)."""
    # Rounded before the comparison: a slowly changing curve becomes few boxes.
    heights = np.round(np.abs(shares) * height, 1)
    shown = np.concatenate([heights[:, None], np.round(colours, 2)], axis=1)
    cuts = np.flatnonzero((np.diff(shown, axis=0) != 0.0).any(axis=1)) + 1
    starts = np.concatenate([[0], cuts])
    ends = np.concatenate([cuts, [len(shares)]])
    is_filled = heights[starts] > 0.0
    starts, ends = starts[is_filled], ends[is_filled]
    bottom = np.full(len(starts), top + height)
    boxes = np.column_stack((starts, bottom - heights[starts], ends, bottom))
    return boxes, colours[starts]


def _triangles(quads: list[tuple[F64, F64]]) -> tuple[F32, F32]:
    """Split boxes (n, 4) with colours (n, 4) into two triangles each: corners (6n, 2), colours."""
    boxes = np.concatenate([quad for quad, _ in quads])
    # Left top, right top, right bottom; left top, right bottom, left bottom.
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 1, 2, 3, 0, 3]].reshape(-1, 2)
    colours = np.repeat(np.concatenate([quad for _, quad in quads]), 6, axis=0)
    return corners.astype(np.float32), colours.astype(np.float32)
