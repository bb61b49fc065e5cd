# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws into the current 3D viewport, from a draw handler; never in background mode."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...blender.translation import translated
from ...engine.arrays import F32, I32
from ...engine.colouring import PALETTES
from ..timeline import value_chart
from . import card_shaders
from .actuator_glow import MOST_DISCS

if TYPE_CHECKING:
    from ..timeline.timeline_record import TimelineRecord
    from ..timeline.timeline_recorder import TimelineRecorder
    from ..timeline.value_chart import Chart
    from .actuator_glow import Discs, Looks
    from .skin_colours import Layer

MARGIN = 10.0
_TALLEST = 0.45  # of the chart, as a share of the viewport
TEXT = (0.92, 0.92, 0.92, 1.0)
_PLAYHEAD = (0.28, 0.45, 0.7, 1.0)  # as in Blender's timeline
_TICK = (1.0, 1.0, 1.0, 0.06)


def draw_layers(layers: Sequence[Layer], opacity: float) -> None:
    """Draw colours over the skin; ``opacity`` 0..1 is that of the full colour."""
    if not layers:
        return
    shader = card_shaders.skin()
    # Without writing: coplanar surfaces would flicker.
    with card_state("ALPHA_PREMULT", "LESS_EQUAL"):
        gpu.state.face_culling_set("BACK")
        shader.bind()
        shader.uniform_float("opacity", opacity)
        for layer in layers:
            batch = _skins[layer]
            shader.uniform_float("above", layer.above)
            with gpu.matrix.push_pop():
                gpu.matrix.multiply_matrix(layer.matrix)
                # The third row of the model-view matrix is the viewer's direction in mesh space.
                to_viewer = gpu.matrix.get_model_view_matrix()[2].xyz.normalized()
                shader.uniform_float("to_viewer", to_viewer)
                submit(batch, shader)


def draw_discs(parts: Sequence[Discs]) -> None:
    """Draw discs of actuators over the skin and in the room, hidden behind other surfaces."""
    if not parts:
        return
    shader = card_shaders.discs()
    with card_state("ALPHA", "LESS_EQUAL"):
        shader.bind()
        for part in parts:
            shader.uniform_float("above", part.above)
            shader.uniform_float("scale", part.scale)
            with gpu.matrix.push_pop():
                gpu.matrix.multiply_matrix(part.matrix)
                for first, batch, rows in _discs[part.looks]:
                    rows.update(part.rows[first : first + MOST_DISCS])
                    shader.uniform_block("rows", rows)
                    submit(batch, shader)


def submit(batch: gpu.types.GPUBatch, shader: gpu.types.GPUShader) -> None:
    """Submit a batch to the graphics card, which draws later. ``hfx bench preview`` times this."""
    batch.draw(shader)


@contextmanager
def card_state(blend: str = "ALPHA", depth_test: str = "NONE") -> Iterator[None]:
    """Context of drawing with a blend mode and a depth test, without writing depth.

    Ends with the state that Blender expects after a draw handler, also after an exception.
    """
    state = gpu.state
    writes = state.depth_mask_get()
    state.blend_set(blend)
    state.depth_test_set(depth_test)
    state.depth_mask_set(False)
    try:
        yield
    finally:
        state.depth_mask_set(writes)
        state.depth_test_set("NONE")
        state.face_culling_set("NONE")
        state.point_size_set(1.0)
        state.line_width_set(1.0)
        state.blend_set("NONE")


def draw_lines(
    points: F32, colour: tuple[float, ...], kind: str = "LINE_STRIP", width: float = 2.5
) -> None:
    """Draw a line (n, 3), or with "LINES" a line for each two points; world space, ``width`` in
    pixels, hidden behind other surfaces. Nothing for less than two points."""
    if len(points) < 2:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, kind, {"pos": points})
    with card_state("ALPHA", "LESS_EQUAL"):
        shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
        shader.uniform_float("lineWidth", width)
        shader.uniform_float("color", colour)
        batch.draw(shader)


class _OnCard:
    """Cache of buffers on the graphics card, by identity of the source object.

    ``send`` creates a buffer; the cache is emptied when it has ``most`` entries.
    """

    def __init__(self, send: Callable[[Any], Any], most: int) -> None:
        self._send, self._most = send, most
        self._sent: dict[int, tuple[object, Any]] = {}

    def __getitem__(self, made_of: object) -> Any:
        # The entry holds the source: its id cannot pass to a new object while cached.
        known = self._sent.get(id(made_of))
        if known is None or known[0] is not made_of:
            if len(self._sent) >= self._most:
                self._sent.clear()
            known = self._sent[id(made_of)] = made_of, self._send(made_of)
        return known[1]

    def forget(self) -> None:
        self._sent.clear()


@cache
def _skin_format() -> gpu.types.GPUVertFormat:
    """Format of a skin's vertices; colours of bytes become 0..1 in the shader."""
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    layout.attr_add(id="normal", comp_type="F32", len=3, fetch_mode="FLOAT")
    layout.attr_add(id="colour", comp_type="U8", len=4, fetch_mode="INT_TO_FLOAT_UNIT")
    return layout


def _skin_batch(layer: Layer) -> gpu.types.GPUBatch:
    """Batch of a layer's triangles, with positions, normals and colours of its vertices."""
    # A buffer for all attributes: each buffer costs more than its content.
    vertices = gpu.types.GPUVertBuf(_skin_format(), len(layer.positions))
    vertices.attr_fill("pos", layer.positions)
    vertices.attr_fill("normal", layer.normals)
    vertices.attr_fill("colour", layer.shown.colours)
    return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=_indices[layer.shown.triangles])


def _index_buffer(triangles: I32) -> gpu.types.GPUIndexBuf:
    return gpu.types.GPUIndexBuf(type="TRIS", seq=triangles)


def _column(name: str, values: F32) -> gpu.types.GPUVertBuf:
    """Vertex buffer of one attribute, filled in one copy."""
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id=name, comp_type="F32", len=values.shape[1], fetch_mode="FLOAT")
    buffer = gpu.types.GPUVertBuf(layout, len(values))
    buffer.attr_fill(name, values)
    return buffer


def _disc_batches(looks: Looks) -> list[tuple[int, gpu.types.GPUBatch, gpu.types.GPUUniformBuf]]:
    """Batches of at most :data:`MOST_DISCS` discs: number of the first disc, batch, and the uniform
    buffer of the moving rows."""
    nothing = np.zeros((MOST_DISCS, 2, 4), np.float32)
    batches = []
    for first in range(0, len(looks.radii), MOST_DISCS):
        part = slice(first, first + MOST_DISCS)
        corners, triangles = card_shaders.disc_geometry(len(looks.radii[part]))
        # The fourth column is the number of the disc in its batch.
        which = corners[:, 3].astype(np.int64)
        full = np.column_stack([looks.colours[part], looks.radii[part]])
        batch = gpu.types.GPUBatch(
            type="TRIS", buf=_column("corner", corners), elem=_index_buffer(triangles)
        )
        batch.vertbuf_add(_column("full", full[which]))
        batch.vertbuf_add(_column("cold", looks.cold[part][which]))
        batches.append((first, batch, gpu.types.GPUUniformBuf(nothing)))
    return batches


# Moving data is sent once a frame, even for several viewports.
_skins, _indices = _OnCard(_skin_batch, 8), _OnCard(_index_buffer, 8)
_discs = _OnCard(_disc_batches, 32)


def forget() -> None:
    """Free the memory on the graphics card."""
    for sent in (_skins, _indices, _discs):
        sent.forget()


def free_part(area: bpy.types.Area, region: bpy.types.Region) -> tuple[float, float]:
    """Left and right end of a region, pixels, without toolbar, sidebar and 10 pixels at both
    ends."""
    left, right = 0.0, float(region.width)
    for panel in area.regions:
        if panel.width <= 1 or panel.type not in ("TOOLS", "UI"):
            continue
        if panel.x <= region.x + 1 and panel.type == "TOOLS":
            left = max(left, panel.x + panel.width - region.x)
        elif panel.type == "UI" and panel.x > region.x:
            right = min(right, panel.x - region.x)
    return left + MARGIN, right - MARGIN


class ChartView:
    """Values over time at the lower end of a viewport; keeps the charts of the last few sizes."""

    def __init__(self) -> None:
        self._charts: dict[tuple[object, ...], tuple[Chart, gpu.types.GPUBatch]] = {}

    def draw(self, context: bpy.types.Context, recorder: TimelineRecorder) -> None:
        """Draw the newest record into the current region, or a sentence without a record.

        No effect without overlays, in narrow regions, and in all views of a quad view but one.
        """
        area, region, scene = context.area, context.region, context.scene
        if not context.space_data.overlay.show_overlays:
            return
        if region != next(part for part in area.regions if part.type == "WINDOW"):
            return  # quad view: draw one chart only, next to the sidebar
        left, right = free_part(area, region)
        if right - left < 120.0:
            return
        record = recorder.result
        if record is None:
            blf.size(0, 11.0 * bpy.context.preferences.system.ui_scale)
            blf.color(0, *TEXT)
            note = recorder.fault or "Values over time: nothing is felt yet"
            write(translated(note), left, MARGIN, 10_000.0)
            return
        frames = _chart_frames(context, record, region.x + left, region.x + right)
        size = right - left, _TALLEST * region.height
        chart, batch = self._chart_of(record, scene.hfx.palette, size, frames)
        note = "; ".join(record.notes)
        if recorder.must_step:
            note = "Not up to date: press Update Values"
        elif chart.hidden:
            note = f"{chart.hidden} more rows; enlarge the viewport to see them"
        _draw_chart(chart, batch, left, scene.frame_current_final, recorder.is_fresh, note)

    def _chart_of(
        self,
        record: TimelineRecord,
        palette: str,
        size: tuple[float, float],
        frames: tuple[float, float],
    ) -> tuple[Chart, gpu.types.GPUBatch]:
        """Chart, and the batch of its triangles."""
        colours, scale = PALETTES[palette], bpy.context.preferences.system.ui_scale
        # Viewports of different sizes keep charts of different sizes.
        key = (id(record), *colours.values(), size, frames, scale)
        if key not in self._charts:
            if len(self._charts) > 8:
                self._charts.clear()
            chart = value_chart.chart(record, colours, *size, scale, frames)
            content = {"pos": chart.positions, "color": chart.colours}
            shader = gpu.shader.from_builtin("SMOOTH_COLOR")
            self._charts[key] = chart, batch_for_shader(shader, "TRIS", content)
        return self._charts[key]


def _draw_chart(
    chart: Chart, batch: gpu.types.GPUBatch, left: float, frame: float, fresh: bool, note: str
) -> None:
    """Draw a chart and the time axis at the lower end of a viewport, ``left`` in pixels, with the
    playhead at a frame and a note above, if any. Labels are dimmed unless ``fresh``."""
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    scale = bpy.context.preferences.system.ui_scale
    marks = value_chart.ticks(bpy.context.scene, chart, scale)
    lines = [(x, 0.5, _TICK) for x, _ in marks]
    lines.append((chart.x_of(frame), max(scale, 1.0), _PLAYHEAD))
    with card_state(), gpu.matrix.push_pop():
        gpu.matrix.translate((left, MARGIN))
        batch.draw(shader)
        for x, wide, colour in lines:
            if 0.0 <= x <= chart.width:
                # Lines have one pixel on some cards, so the playhead is a strip.
                line = [(x + side, y) for y in (0.0, chart.height) for side in (-wide, wide)]
                content = {"pos": line, "color": [colour] * 4}
                batch_for_shader(shader, "TRI_STRIP", content).draw(shader)
    blf.size(0, 11.0 * scale)
    blf.color(0, *TEXT[:3], 1.0 if fresh else 0.5)
    blf.enable(0, blf.SHADOW)  # texts are drawn over the curves
    blf.shadow(0, 3, 0.0, 0.0, 0.0, 0.9)
    for label in chart.labels:
        text = label.text
        if label.values is not None:
            index = min(max(int(np.searchsorted(chart.times, frame)), 0), len(label.values) - 1)
            text = f"{text}   {label.values[index]:.1f} {label.unit}"
        write(text, left + label.left, MARGIN + label.bottom, chart.width - label.left)
    for x, text in marks:
        write(text, left + x + 3 * scale, MARGIN + 4 * scale, chart.width - x)
    if note:
        write(translated(note), left, MARGIN + chart.height + 4 * scale, chart.width)
    blf.disable(0, blf.SHADOW)


def _chart_frames(
    context: bpy.types.Context, record: TimelineRecord, left: float, right: float
) -> tuple[float, float]:
    """Frames at both ends of a chart, window pixels ``left`` and ``right``: those of the widest
    timeline (else NLA Editor) at these pixels, if they lack few frames of the record in its view;
    else all of these; the whole record if the playhead is outside of the view."""
    start, end = record.time.frame_first, record.time.frame_last + 1
    first, last, frame = start, end, context.scene.frame_current_final
    by_rank = sorted(context.screen.areas, key=lambda a: (a.ui_type == "TIMELINE", a.width))
    for area in [a for a in by_rank if a.ui_type in ("TIMELINE", "NLA_EDITOR")][-1:]:
        region = next(region for region in area.regions if region.type == "WINDOW")
        pixels = 0.0, region.width, left - region.x, right - region.x
        low, high, *ends = (region.view2d.region_to_view(x, 0.0)[0] for x in pixels)
        first, last = max(start, low), min(end, high)
        hidden = 0.05 * (last - first)  # behind the toolbar, in a usual layout
        if ends[0] - hidden <= first <= frame <= last <= ends[1] + hidden:
            return ends[0], ends[1]
    return (first, last) if first <= frame <= last else (min(start, frame), max(end, frame))


def write(text: str, x: float, y: float, width: float) -> None:
    """Write a text, shortened by "..." to ``width`` pixels, or nothing if no text fits."""
    shown, size = text, len(text)
    while size > 1 and blf.dimensions(0, shown)[0] > width:
        size -= 1
        shown = text[:size].rstrip() + "..."
    if blf.dimensions(0, shown)[0] > width:
        return  # clipped text would overlap the neighbour
    blf.position(0, x, y, 0)
    blf.draw(0, shown)
