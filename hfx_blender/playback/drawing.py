# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing into the 3D viewport that Blender draws at this moment; never called in background."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import bpy
import numpy as np

if TYPE_CHECKING:
    import gpu

    from .actuator_glow import Discs
    from .preview_layers import F32, I32, Layer
    from .value_chart import Chart

_DARKEST = 0.55
"""Colour of skin that is seen from the side, as a share: it keeps the body's shape readable."""

_MARGIN = 10.0
_TEXT = (0.92, 0.92, 0.92, 1.0)
_PLAYHEAD = (0.28, 0.45, 0.7, 1.0)  # as in Blender's timeline


def draw_layers(layers: Sequence[Layer], opacity: float) -> None:
    """Draw colours over the skin.

    Parameters
    ----------
    layers : sequence of Layer
    opacity : float
        Of full colour, 0..1.
    """
    import gpu

    if not layers:
        return
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    view = np.array(gpu.matrix.get_model_view_matrix(), np.float32)
    # Premultiplied, so that a colour fades out at its edge without turning dark.
    gpu.state.blend_set("ALPHA_PREMULT")
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.face_culling_set("BACK")
    for layer in layers:
        batch = _batch(layer.positions, shaded(layer, view, opacity), layer.triangles)
        submit(batch, shader)
    gpu.state.face_culling_set("NONE")
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def shaded(layer: Layer, view: F32, opacity: float) -> F32:
    """Premultiplied colours as if lit from the viewer, (N, 4).

    ``view`` is the world to view matrix.
    """
    axis = view[2, :3] / max(float(np.linalg.norm(view[2, :3])), 1e-12)
    # Not as a product of matrices: that wakes other threads for it.
    light = np.einsum("ij,j->i", layer.normals, axis)
    np.clip(light, 0.0, 1.0, out=light)
    light *= np.float32(1.0 - _DARKEST)
    light += np.float32(_DARKEST)
    colours = layer.colours * np.float32(opacity)
    light *= colours[:, 3]
    colours[:, :3] = layer.colours[:, :3] * light[:, None]
    return colours


def draw_discs(discs: Discs | None) -> None:
    """Draw actuators on the skin."""
    import gpu

    if discs is None:
        return
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    gpu.state.blend_set("ALPHA")
    gpu.state.depth_test_set("LESS_EQUAL")
    submit(_batch(discs.positions, discs.colours, discs.triangles), shader)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def submit(batch: gpu.types.GPUBatch, shader: gpu.types.GPUShader) -> None:
    """Let the graphics card draw; what it costs is the card's."""
    batch.draw(shader)


_indices: dict[int, tuple[I32, gpu.types.GPUIndexBuf]] = {}
"""Triangles that are on the graphics card, by the array that they were made of."""


def _batch(positions: F32, colours: F32, triangles: I32) -> gpu.types.GPUBatch:
    """A batch with a colour at each vertex; triangles are sent once."""
    import gpu

    known = _indices.get(id(triangles))
    if known is None or known[0] is not triangles:
        if len(_indices) >= 8:
            _indices.clear()
        known = triangles, gpu.types.GPUIndexBuf(type="TRIS", seq=triangles)
        _indices[id(triangles)] = known
    vertices = gpu.types.GPUVertBuf(_vertex_format(), len(positions))
    vertices.attr_fill("pos", positions)
    vertices.attr_fill("color", colours)
    return gpu.types.GPUBatch(type="TRIS", buf=vertices, elem=known[1])


def _vertex_format() -> gpu.types.GPUVertFormat:
    """A place and a colour; what a built-in shader calls its inputs differs between Blenders."""
    import gpu

    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id="pos", comp_type="F32", len=3, fetch_mode="FLOAT")
    layout.attr_add(id="color", comp_type="F32", len=4, fetch_mode="FLOAT")
    return layout


def free_part(area: bpy.types.Area, region: bpy.types.Region) -> tuple[float, float]:
    """Left and right end of what no toolbar or sidebar covers, pixels of a viewport's region."""
    left, right = 0.0, float(region.width)
    for other in area.regions:
        if other.width <= 1 or other.type not in ("TOOLS", "UI"):
            continue
        if other.x <= region.x + 1 and other.type == "TOOLS":
            left = max(left, other.x + other.width - region.x)
        elif other.type == "UI" and other.x > region.x:
            right = min(right, other.x - region.x)
    return left + _MARGIN, right - _MARGIN


class ChartDrawing:
    """A chart on its way to the screen; what does not change is kept on the graphics card."""

    def __init__(self, chart: Chart) -> None:
        self.chart = chart
        self._batches: list[object] = []

    def draw(self, left: float, frame: float, fresh: bool, note: str) -> None:
        """Draw it at the lower end of a viewport, with the playhead at a frame."""
        import blf
        import gpu
        from gpu_extras.batch import batch_for_shader

        from .value_chart import background

        chart = self.chart
        shader = gpu.shader.from_builtin("SMOOTH_COLOR")
        scale = bpy.context.preferences.system.ui_scale
        if not self._batches:
            behind = background(chart.width, chart.height)
            for positions, colours in (behind, (chart.positions, chart.colours)):
                if len(positions):
                    content = {"pos": positions, "color": colours}
                    self._batches.append(batch_for_shader(shader, "TRIS", content))
        x = chart.x_of(frame)
        gpu.state.blend_set("ALPHA")
        with gpu.matrix.push_pop():
            gpu.matrix.translate((left, _MARGIN))
            for batch in self._batches:
                batch.draw(shader)
            half = max(scale, 1.0)
            line = [
                (x - half, 0.0),
                (x + half, 0.0),
                (x - half, chart.height),
                (x + half, chart.height),
            ]
            batch_for_shader(shader, "TRI_STRIP", {"pos": line, "color": [_PLAYHEAD] * 4}).draw(
                shader
            )
        blf.size(0, 11.0 * scale)
        blf.color(0, *_TEXT[:3], 1.0 if fresh else 0.5)
        for label in chart.labels:
            _write(label.text, left + label.left, _MARGIN + label.bottom, chart.left - 70 * scale)
            if label.values is not None:
                index = min(max(int(np.searchsorted(chart.times, frame)), 0), len(label.values) - 1)
                text = f"{label.values[index]:.1f} {label.unit}"
                wide = blf.dimensions(0, text)[0]
                _write(text, left + chart.left - 6 * scale - wide, _MARGIN + label.bottom, wide + 2)
        if note:
            _write(note, left + chart.left, _MARGIN + chart.height + 4 * scale, chart.width)
        gpu.state.blend_set("NONE")


def write_note(text: str, left: float) -> None:
    """A sentence where the chart would be."""
    import blf

    scale = bpy.context.preferences.system.ui_scale
    blf.size(0, 11.0 * scale)
    blf.color(0, *_TEXT)
    _write(text, left, _MARGIN, 10_000.0)


def _write(text: str, x: float, y: float, width: float) -> None:
    import blf

    shown, size = text, len(text)
    while size > 1 and blf.dimensions(0, shown)[0] > width:
        size -= 1
        shown = text[:size].rstrip() + "..."
    blf.position(0, x, y, 0)
    blf.draw(0, shown)
