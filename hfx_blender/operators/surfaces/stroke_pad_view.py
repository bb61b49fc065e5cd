# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing of the stroke pad over an editor: the map, the finger's path, and four plots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...blender.translation import translated
from ...properties.surface_properties import RENDERERS

if TYPE_CHECKING:
    from ...engine.arrays import F64
    from ...playback.stroke_pad import StrokePad

_Colour = tuple[float, float, float, float]

SIDE_PX = 400
_MARGIN_PX = 60
PLOT_PX = (260, 76)
_SHOWN_S = 3.0
_MOST_TILES = 64

_BACK: _Colour = (0.06, 0.06, 0.07, 0.92)
_LINE: _Colour = (0.95, 0.55, 0.2, 1.0)
_WAY: _Colour = (0.3, 0.8, 1.0, 1.0)
_GRID: _Colour = (1.0, 1.0, 1.0, 0.25)
_GOOD: _Colour = (0.35, 0.8, 0.4, 1.0)
_OFF: _Colour = (0.9, 0.6, 0.2, 1.0)


class PadPlace:
    """Layout of the pad in a region, and conversion between pixels and places of the surface."""

    def __init__(self, width: int, height: int) -> None:
        side = min(SIDE_PX, width - _MARGIN_PX - PLOT_PX[0] - 30, height - 2 * _MARGIN_PX)
        self.side = max(side, 64)
        self.left, self.bottom = _MARGIN_PX, max((height - self.side) // 2, 30)

    def holds(self, x: float, y: float) -> bool:
        """Test a pixel of the region for being on the pad."""
        return 0 <= x - self.left < self.side and 0 <= y - self.bottom < self.side

    def surface_point(self, pad: StrokePad, x: float, y: float) -> tuple[float, float]:
        """Metres from the pad's lower left corner, along both edges, of a pixel of the region."""
        scale = pad.metres_per_pixel
        return (x - self.left) * scale, (y - self.bottom) * scale

    def pixels(
        self, pad: StrokePad, points_m: Sequence[tuple[float, float]]
    ) -> list[tuple[float, float]]:
        """Pixels of the region for points in metres from the pad's lower left corner."""
        scale = pad.metres_per_pixel
        return [(x / scale + self.left, y / scale + self.bottom) for x, y in points_m]


def draw(
    pad: StrokePad, image: bpy.types.Image | None, rectangle: PadPlace, region: bpy.types.Region
) -> None:
    """Draw the pad in the pad's region; no effect in other viewports."""
    if bpy.context.region != region:
        return
    gpu.state.blend_set("ALPHA")
    left, bottom, side = rectangle.left, rectangle.bottom, rectangle.side
    width = side + PLOT_PX[0] + 40
    _box(left - 12, bottom - 54, width, side + 110, _BACK)
    if image is not None and pad.texture.map is not None:
        _tiles(image, pad, rectangle)
    _frame(left, bottom, side, side)
    if len(pad.trail_m) > 1:
        gpu.state.line_width_set(2.0)
        _lines(rectangle.pixels(pad, pad.trail_m), _WAY)
        gpu.state.line_width_set(1.0)
    _texts(pad, rectangle)
    _plots(pad, left + side + 16, bottom)
    gpu.state.blend_set("NONE")


def _texts(pad: StrokePad, rectangle: PadPlace) -> None:
    """Draw name, keys, the speed of the stroke as a bar, and below it the speed or the pad's fault.

    The mark in the middle of the bar is the target; near it, from 0.8 to 1.25, the bar is green.
    """
    target, now = pad.target_m_s, pad.now
    top = rectangle.bottom + rectangle.side
    kind = pad.texture.renderer.name
    renderer = next(label for name, label, _ in RENDERERS if name == kind)
    _text(rectangle.left, top + 34, f"{pad.name}   ({renderer})", 15)
    _text(
        rectangle.left,
        top + 12,
        "drag: stroke    1, 2: 2 or 10 cm/s    R: renderer    E: export    Esc: close",
        11,
    )
    share = now.speed_m_s / target
    is_near = 0.8 <= share <= 1.25
    speed = f"{now.speed_m_s * 100:.1f} cm/s of {target * 100:.0f} cm/s (200 px/s)"
    bar = rectangle.bottom - 18
    _box(rectangle.left, bar, rectangle.side, 8, _GRID)
    length = rectangle.side * min(share / 2.0, 1.0)
    _box(rectangle.left, bar, length, 8, _GOOD if is_near else _OFF)
    _box(rectangle.left + rectangle.side / 2 - 1, bar - 3, 2, 14, (1.0, 1.0, 1.0, 0.9))
    _text(rectangle.left, bar - 20, pad.fault or speed, 12)


def _plots(pad: StrokePad, left: float, bottom: float) -> None:
    """Draw height, amplitude and frequency of the last 3 s, and the newest waveform."""
    import numpy as np

    shown = pad.recent(_SHOWN_S)
    device = pad.texture.device
    end = shown[-1][0] if shown else 0.0
    times = np.array([t - max(end - _SHOWN_S, 0.0) for t, _ in shown]) / _SHOWN_S
    heights = 1e6 * np.array([sample.height_m for _, sample in shown])
    middle = float(heights.mean()) if len(heights) else 0.0
    # Half the height of the plot is at least 1 µm, so that flat surfaces look flat.
    reach = max(float(np.abs(heights - middle).max(initial=0.0)), 1.0)
    full = float(device.amplitude_m_s2(1.0))
    wave = pad.waveform_m_s2
    now = pad.now
    curves: list[tuple[str, F64, F64]] = [
        (f"height, {reach * 2:.0f} µm", times, 0.5 + 0.5 * (heights - middle) / reach),
        (
            f"amplitude {now.amplitude_m_s2:.2f} m/s² of {full:.1f}",
            times,
            np.array([sample.amplitude_m_s2 for _, sample in shown]) / full,
        ),
        (
            f"frequency {now.frequency_hz:.0f} Hz of {device.frequency_hz[1]:.0f}",
            times,
            np.array([sample.frequency_hz for _, sample in shown]) / device.frequency_hz[1],
        ),
        (
            f"waveform, {1000 * device.update_s:.0f} ms",
            np.linspace(0.0, 1.0, len(wave)),
            0.5 + 0.5 * wave / max(float(np.abs(wave).max(initial=0.0)), 1e-9),
        ),
    ]
    for row, (title, across, up) in enumerate(curves):
        low = bottom + (len(curves) - 1 - row) * (PLOT_PX[1] + 26)
        _frame(left, low, *PLOT_PX)
        _text(left, low + PLOT_PX[1] + 5, title, 11)
        if len(across) > 1:
            points = np.stack([across, np.clip(up, 0.0, 1.0)], axis=1) * PLOT_PX + (left, low)
            _lines(points, _LINE)


def _tiles(image: bpy.types.Image, pad: StrokePad, rectangle: PadPlace) -> None:
    """Draw the map over the pad, repeated if it tiles, clipped at the edges; nothing above 64
    tiles."""
    import numpy as np

    assert pad.texture.map is not None
    size = np.array(pad.texture.map.size_m) / pad.metres_per_pixel
    count = np.ceil(rectangle.side / size).astype(int)
    if not pad.texture.map.tiles:
        count = np.minimum(count, 1)
    if int(count.prod()) > _MOST_TILES:
        return  # too fine to be seen
    corners, uvs = [], []
    for column in range(int(count[0])):
        for row in range(int(count[1])):
            low = np.array([column, row]) * size
            share = np.minimum((rectangle.side - low) / size, 1.0)
            x0, y0 = low + np.array([rectangle.left, rectangle.bottom])
            x1, y1 = np.array([x0, y0]) + size * share
            corners += [(x0, y0), (x1, y0), (x1, y1), (x0, y0), (x1, y1), (x0, y1)]
            u, v = share
            uvs += [(0, 0), (u, 0), (u, v), (0, 0), (u, v), (0, v)]
    shader = gpu.shader.from_builtin("IMAGE_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": corners, "texCoord": uvs})
    shader.bind()
    bright = 1.0 / max(pad.brightest, 1e-3)  # scale brightness to the map's maximum
    shader.uniform_float("color", (bright, bright, bright, 1.0))
    shader.uniform_sampler("image", gpu.texture.from_image(image))
    batch.draw(shader)


def _box(x: float, y: float, width: float, height: float, colour: _Colour) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    gpu.state.blend_set("ALPHA")  # text drawing disables blending
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shape = batch_for_shader(shader, "TRIS", {"pos": corners}, indices=[(0, 1, 2), (0, 2, 3)])
    shader.uniform_float("color", colour)
    shape.draw(shader)


def _frame(x: float, y: float, width: float, height: float) -> None:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
    _lines(corners, _GRID)


def _lines(points: F64 | Sequence[tuple[float, float]], colour: _Colour) -> None:
    gpu.state.blend_set("ALPHA")
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    shape = batch_for_shader(shader, "LINE_STRIP", {"pos": [tuple(p) for p in points]})
    shader.uniform_float("color", colour)
    shape.draw(shader)


def _text(x: float, y: float, text: str, size: float) -> None:
    blf.size(0, size)
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    blf.position(0, x, y, 0)
    blf.draw(0, translated(text))
