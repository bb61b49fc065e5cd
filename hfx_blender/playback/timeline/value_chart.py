# SPDX-License-Identifier: GPL-3.0-or-later
"""Values over time as a strip chart: a curve for each effect, a row for each actuator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...engine.arrays import F32, F64
from ...engine.colouring import COLD, Colour
from ...engine.modality import MODALITIES
from .timeline_record import TimelineRecord

CURVE_HEIGHT = 22.0  # pixels of an effect's row, times the user's scale
ROW_HEIGHT = 5.0  # of an actuator's
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
    left: float  # where time begins
    frames: tuple[float, float]
    times: F64  # (T,) frames of the labels' values
    positions: F32  # (P, 2) three to a triangle
    colours: F32  # (P, 4)
    labels: list[Label] = field(default_factory=list)
    hidden: int = 0  # number of rows without room

    def x_of(self, frame: float) -> float:
        """Horizontal position of a frame, pixels, within the ends of the time axis."""
        first, last = self.frames
        share = (frame - first) / max(last - first, 1e-9)
        return self.left + min(max(share, 0.0), 1.0) * (self.width - self.left)


def chart(
    timeline: TimelineRecord,
    palette: Mapping[str, Colour],
    width: float,
    height: float,
    scale: float = 1.0,
) -> Chart:
    """Lay out a record's values from the top: effects, then actuators below their device's name.

    Rows without room are left out and counted. ``palette``: colours by modality. ``width``,
    ``height``: available size, pixels. ``scale``: interface scale of Blender.
    """
    left = min(190.0 * scale, 0.35 * width)
    columns = max(int(width - left), 1)
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
        shares = _columns(effect.values, columns) / full
        quads.append(
            _bars(shares, _tints(shares, effect.stream.modality, palette), at, curve, left)
        )
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
            shares = _columns(values, columns) / max(strength.reach, 1e-9)
            tints = _tints(shares, actuator.type.modality, palette)
            # The root keeps weak values visible, as on the skin; off is a faint row, not a gap.
            tints[:, 3] = np.maximum(np.sqrt(np.abs(shares)), _LOWEST_ALPHA)
            quads.append(_bars(np.ones(len(shares)), tints, at, row - 1.0, left))
            at += row
        at += gap
    used = min(at, height)
    positions, colours = _triangles(quads)
    if len(positions):
        positions[:, 1] = used - positions[:, 1]
    labels = [
        replace(label, left=6.0 * scale, bottom=used - label.bottom - 10.0 * scale)
        for label in labels
    ]
    time = timeline.time
    span = float(time.frame_first), float(time.frame_last + 1)
    return Chart(width, used, left, span, timeline.frames, positions, colours, labels, hidden)


def _columns(values: F64, count: int) -> F64:
    """Value of the largest magnitude in each of ``count`` equal parts, signed, (count,)."""
    if len(values) <= count:
        return values[np.minimum(np.arange(count) * len(values) // count, len(values) - 1)]
    # The extreme of each column, not the mean: an impact of one sample stays visible.
    starts = np.arange(count) * len(values) // count
    high, low = np.maximum.reduceat(values, starts), np.minimum.reduceat(values, starts)
    return np.where(-low > high, low, high)


def _tints(shares: F64, modality: str, palette: Mapping[str, Colour]) -> F64:
    """Opaque colours (n, 4) of a modality; of coldness where a temperature's share is negative."""
    colours = np.ones((len(shares), 4))
    colours[:, :3] = palette[modality]
    if modality == "temperature":
        colours[shares < 0.0, :3] = palette[COLD]
    return colours


def _bars(shares: F64, colours: F64, top: float, height: float, left: float) -> tuple[F64, F64]:
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
    boxes = np.column_stack((left + starts, bottom - heights[starts], left + ends, bottom))
    return boxes, colours[starts]


def _triangles(quads: list[tuple[F64, F64]]) -> tuple[F32, F32]:
    """Split boxes (n, 4) with colours (n, 4) into two triangles each: corners (6n, 2), colours."""
    if not quads:
        return np.zeros((0, 2), np.float32), np.zeros((0, 4), np.float32)
    boxes = np.concatenate([quad for quad, _ in quads])
    # Left top, right top, right bottom; left top, right bottom, left bottom.
    corners = boxes[:, [0, 1, 2, 1, 2, 3, 0, 1, 2, 3, 0, 3]].reshape(-1, 2)
    colours = np.repeat(np.concatenate([quad for _, quad in quads]), 6, axis=0)
    return corners.astype(np.float32), colours.astype(np.float32)


def background(width: float, height: float) -> tuple[F32, F32]:
    """Background of a chart: two triangles as positions (6, 2) and colours (6, 4)."""
    boxes = np.array([[0.0, 0.0, width, height]])
    return _triangles([(boxes, np.array([_BACKGROUND]))])
