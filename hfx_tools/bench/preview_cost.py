# SPDX-License-Identifier: GPL-3.0-or-later
"""Cost of the preview per frame of playback: the demo with 20 volumes, 5 of them in contact.

Dabs of the brush in Weight Paint are compared in the same way.

Each frame is played with and without the preview, one after the other in one run; the minimum
of all rounds counts. Measured is the processor time of the preview alone: frame handler, checks
for scene changes at the usual interval, evaluation, colours, actuators, and transfer to the
graphics card. Draw calls are measured apart: without a card this processor executes them.
Blender's own drawing is left out for the same reason.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hfx_blender.processes import blender_session

from ..command_process.temporary_folder import temporary_folder

if TYPE_CHECKING:
    import bpy

P95_MS: Final = 3.0
IDLE_MS: Final = 0.3
DAB_MS: Final = 1.0

VOLUMES: Final = 20
TOUCHED: Final = (
    ("upperarm01.L", "vibration"),
    ("lowerarm01.R", "pressure"),
    ("upperleg01.L", "temperature"),
    ("spine02", "vibration"),
    ("lowerleg01.R", "pressure"),
)
"""Parent bone and modality of each volume in contact."""

_MODALITIES: Final = ("vibration", "pressure", "temperature", "wind")
_IDLE: Final = (430, 770)  # frames of the demo without an active effect, end excluded
_CHECK_INTERVALS: Final = {"worked out at each frame": 15, "from the record": 60}
"""Frames between two checks for scene changes, at 60 frames a second."""

_SIZE: Final = (320, 200)

# Windows counts a thread's time in steps of 16 ms.
_now_s: Final = time.perf_counter if sys.platform == "win32" else time.thread_time

Progress = Callable[[float], None]


def measure(
    *, short: bool = False, rounds: int = 9, progress: Progress = lambda share: None
) -> dict[str, Any]:
    """Measure the preview with live and with recorded evaluation; rows of figures by name."""
    bpy = blender_session.start()

    with temporary_folder() as folder:
        blender_session.open_blend(build(Path(folder) / "preview.blend"))
    from hfx_blender.playback.preview.preview import preview
    from hfx_blender.playback.timeline.timeline_recorder import recorder

    scene = bpy.context.scene
    step = 12 if short else 4
    played = [
        frame
        for frame in range(scene.frame_start, scene.frame_end + 1, step)
        if not _IDLE[0] <= frame < _IDLE[1]
    ]
    parts = (
        ("played", played, "p95_ms", P95_MS),
        ("nothing active", range(*_IDLE, step), "median_ms", IDLE_MS),
    )
    screen = _Screen()
    preview.forget()
    preview.describe()
    rows: dict[str, Any] = {}
    for name in _CHECK_INTERVALS:
        if name == "from the record":  # usually made after a moment without edits
            recorder.check_settings(scene)
            recorder.update_now(scene)
        for part, frames, key, limit in parts:
            own, with_preview, without_preview = _play(
                screen, frames, rounds, _CHECK_INTERVALS[name]
            )
            rows[f"{part}, {name}"] = {
                **_figures(own),
                "of": key,
                "limit_ms": limit,
                "playback_with_ms": _median_ms(with_preview),
                "playback_without_ms": _median_ms(without_preview),
            }
            progress(len(rows) / 5)
    rows["a dab of the brush"] = _dabs(screen, 10 if short else 40, rounds)
    return rows


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` as a table for a terminal."""
    title = f"the preview, {VOLUMES} volumes, {len(TOUCHED)} in contact"
    lines = [
        f"{title:<44}{'frames':>7}{'median':>11}{'p95':>11}{'engine':>11}{'card':>11}  limit"
        "         a frame with / without"
    ]
    for name, row in result.items():
        figures = "".join(
            f"{row[k]:>8.3f} ms" for k in ("median_ms", "p95_ms", "engine_ms", "card_ms")
        )
        over = "     " if row[row["of"]] <= row["limit_ms"] else " over"
        lines.append(
            f"{name:<44}{row['frames']:>7}{figures}  "
            f"{row['of'].removesuffix('_ms'):>6} {row['limit_ms']:g} ms{over}"
            f"{row['playback_with_ms']:>9.1f} / {row['playback_without_ms']:.1f} ms"
        )
    return "\n".join(lines)


def build(path: Path) -> Path:
    """Save a .blend of the demo, filled up to :data:`VOLUMES` volumes; returns the path."""
    import bpy

    from ..demo import garage

    scene = garage.build()
    body = next(obj for obj in scene.objects if obj.hfx.role == "BODY")
    before = sum(obj.hfx.kind == "VOLUME" for obj in scene.objects if obj.hfx.role == "EFFECT")
    clips = ((0, _IDLE[0]), (_IDLE[1], scene.frame_end + 1))
    rng = np.random.default_rng(1)
    for k in range(VOLUMES - before):
        bone, modality = TOUCHED[k] if k < len(TOUCHED) else ("", _MODALITIES[k % 4])
        bpy.ops.hfx.add_volume(
            modality=modality, shape=("SPHERE", "CUBOID", "CAPSULE")[k % 3], name=f"Volume {k}",
            radius=0.12, height=0.4, size=(0.25, 0.25, 0.25),
        )  # fmt: skip
        volume = bpy.context.object
        if bone:
            volume.parent, volume.parent_type, volume.parent_bone = body, "BONE", bone
        else:  # away from the walk
            at = rng.uniform((-5.0, -3.0, 0.3), (5.0, -2.0, 1.8))
            volume.location = at.tolist()
        for first, end in clips:
            bpy.ops.hfx.add_clip(start=first, duration=(end - first) / garage.FPS)
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    return path


class _Screen:
    """Off-screen viewport for the preview's drawing alone."""

    def __init__(self) -> None:
        import bpy
        import gpu
        from mathutils import Matrix

        scene = bpy.context.scene
        bodies = [obj for obj in scene.objects if obj.hfx.role == "BODY"]
        self._meshes = [body.hfx.avatar for body in bodies]
        if hasattr(gpu, "init"):
            gpu.init()
        else:  # in older Blender, rendering a picture starts the graphics module
            render = scene.render
            old_settings = render.engine, render.resolution_x, render.resolution_y
            render.engine, render.resolution_x, render.resolution_y = "BLENDER_WORKBENCH", 8, 8
            bpy.ops.render.render()
            render.engine, render.resolution_x, render.resolution_y = old_settings
        self._buffer = gpu.types.GPUOffScreen(*_SIZE)
        self._view = Matrix.LocRotScale(
            (0.0, -9.0, 1.2), Matrix.Rotation(1.5708, 3, "X"), None
        ).inverted()
        self._projection = Matrix(
            ((1.5, 0, 0, 0), (0, 1.5 * _SIZE[0] / _SIZE[1], 0, 0), (0, 0, -1, -0.2), (0, 0, -1, 0))
        )

    def draw(self, more: Callable[[], None]) -> None:
        """Call ``more`` with a viewport's matrices set, drawing into the off-screen buffer."""
        import bpy
        import gpu

        graph = bpy.context.evaluated_depsgraph_get()
        for mesh in self._meshes:  # Blender's own drawing computes normals, too
            _ = mesh.evaluated_get(graph).data.vertex_normals[0].vector
        with self._buffer.bind():
            gpu.matrix.load_matrix(self._view)
            gpu.matrix.load_projection_matrix(self._projection)
            more()


def _play(
    screen: _Screen, frames: Sequence[int], rounds: int, check_interval: int
) -> tuple[list[_Seconds], list[float], list[float]]:
    """Minimum over all rounds, per frame: preview, frame with preview, frame without preview."""
    import bpy

    scene = bpy.context.scene
    own = [_Seconds(np.inf)] * len(frames)
    with_preview, without_preview = [np.inf] * len(frames), [np.inf] * len(frames)
    for turn in range(rounds + 1):  # the first round warms up
        for k, frame in enumerate(frames):
            # Alternating order cancels drift and warm caches.
            for is_on in (True, False) if (turn + k) % 2 else (False, True):
                calls = PreviewFrame(is_on, is_check=k % check_interval == 0)
                begun = time.perf_counter()
                scene.frame_set(frame)
                calls.on_frame()
                screen.draw(calls.draw)
                ended = time.perf_counter() - begun
                if turn and is_on:
                    own[k] = min(own[k], calls.seconds)
                    with_preview[k] = min(with_preview[k], ended)
                elif turn:
                    without_preview[k] = min(without_preview[k], ended)
    return own, with_preview, without_preview


def _dabs(screen: _Screen, count: int, rounds: int) -> dict[str, Any]:
    """Row of dabs in Weight Paint, each with the evaluation of the mesh by Blender and a drawing,
    with and without the preview's handlers."""
    import bpy

    from hfx_blender.authoring import painting
    from hfx_blender.blender.events import is_waiting
    from hfx_blender.playback.preview.preview import preview

    bpy.ops.hfx.add_painted(modality="pressure")
    bpy.ops.hfx.paint_begin()
    canvas = bpy.context.object
    group = canvas.vertex_groups[painting.GROUP]
    costs_s = {True: [np.inf] * count, False: [np.inf] * count}
    for turn in range(rounds + 1):  # the first round warms up
        for vertex in range(count):
            for is_on in (True, False) if (turn + vertex) % 2 else (False, True):
                if is_on:
                    preview.listen()
                group.add([vertex], 1.0 / (turn + 1), "REPLACE")
                canvas.data.update()
                begun_s = _now_s()
                bpy.context.view_layer.update()
                if is_on and is_waiting(preview.check_scene):
                    preview.check_scene()
                if is_on:
                    screen.draw(lambda: preview.draw_over(bpy.context.scene))
                else:
                    screen.draw(lambda: None)
                cost_s = _now_s() - begun_s
                preview.stop_listening()
                if turn:
                    costs_s[is_on][vertex] = min(costs_s[is_on][vertex], cost_s)
    own = [_Seconds(a - b) for a, b in zip(costs_s[True], costs_s[False], strict=True)]
    return {
        **_figures(own),
        "of": "median_ms",
        "limit_ms": DAB_MS,
        "playback_with_ms": _median_ms(costs_s[True]),
        "playback_without_ms": _median_ms(costs_s[False]),
    }


@dataclass(order=True)
class _Seconds:
    """Processor seconds of this thread, nearly independent of other load on the machine."""

    own: float = 0.0
    engine: float = 0.0  # part of own
    card: float = 0.0  # not part of own


class PreviewFrame:
    """Timed calls of the preview in one frame; no calls with ``is_on`` False."""

    def __init__(self, is_on: bool, is_check: bool) -> None:
        self._is_on, self._is_check = is_on, is_check
        self.seconds = _Seconds()

    def on_frame(self) -> None:
        """Call the preview's frame handler and, on check frames, its check of the scene."""
        from hfx_blender.playback.preview.preview import preview

        self._timed(preview.on_frame)
        if self._is_check:
            self._timed(lambda scene: preview.describe())

    def draw(self) -> None:
        """Call the preview's handler of viewport drawing."""
        from hfx_blender.playback.preview.preview import preview

        self._timed(preview.draw_over)

    def _timed(self, work: Callable[[bpy.types.Scene], object]) -> None:
        import bpy

        if not self._is_on:
            return
        from hfx_blender.engine.evaluate import Engine
        from hfx_blender.playback.preview import drawing

        scene, seconds = bpy.context.scene, self.seconds
        with _timed(Engine, "evaluate") as engine, _timed(drawing, "submit") as card:
            begun = _now_s()
            work(scene)
            duration_s = _now_s() - begun
        seconds.engine += sum(engine)
        seconds.card += sum(card)
        seconds.own += duration_s - sum(card)


@contextmanager
def _timed(owner: Any, name: str) -> Iterator[list[float]]:
    """Context with a list of the seconds of each call of ``owner.name``."""
    function, durations_s = getattr(owner, name), []

    def timed(*arguments: Any) -> Any:
        begun = _now_s()
        try:
            return function(*arguments)
        finally:
            durations_s.append(_now_s() - begun)

    setattr(owner, name, timed)
    try:
        yield durations_s
    finally:
        setattr(owner, name, function)


def _figures(samples: list[_Seconds]) -> dict[str, Any]:
    def figure(of: Callable[[Any], Any], seconds: list[float]) -> float:
        return round(1000.0 * float(of(np.array(seconds))), 4)

    own = [sample.own for sample in samples]
    return {
        "frames": len(samples),
        "median_ms": figure(np.median, own),
        "p95_ms": figure(lambda values: np.percentile(values, 95), own),
        "max_ms": figure(np.max, own),
        "engine_ms": figure(np.median, [sample.engine for sample in samples]),
        "card_ms": figure(np.median, [sample.card for sample in samples]),
    }


def _median_ms(seconds: list[float]) -> float:
    return round(1000.0 * float(np.median(seconds)), 3)
