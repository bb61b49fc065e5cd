# SPDX-License-Identifier: GPL-3.0-or-later
"""Run of a scene at a setting: the work of an export, without files."""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import bpy

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import AnimationBlock, SceneDescription
from hfx_blender.engine.tolerance import Tolerance
from hfx_blender.engine.track import TrackHeader
from hfx_blender.reading.scene_reader import SceneReader


@dataclass(frozen=True, eq=False)
class Recording:
    """Results of a setting; ``blocks`` only if kept, ``memory_bytes`` only if traced."""

    description: SceneDescription
    runs: list[SampleRun]
    rasters: list[tuple[DeviceConfig, Raster]]
    blocks: list[AnimationBlock] = field(default_factory=list)
    memory_bytes: int = 0
    note: str = ""
    counters: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class Times:
    """Processor seconds of a run, summed over all cores.

    Nearly independent of other load on the machine.
    """

    read_s: float
    engine_s: float
    render_s: float

    @property
    def total_s(self) -> float:
        return self.read_s + self.engine_s + self.render_s


def record(
    scene: bpy.types.Scene,
    tolerance: Tolerance,
    devices: Sequence[DeviceConfig],
    frames: tuple[int, int] | None,
    *,
    rate_hz: Fraction | None = None,
    keep_blocks: bool = False,
) -> tuple[Recording, Times]:
    """Read, evaluate and render a scene, and time each step.

    Raises
    ------
    InputError
        The scene cannot be exported.
    """
    start = time.process_time()
    reader = SceneReader(scene, frames=frames, rate_hz=rate_hz, tolerance=tolerance)
    description = reader.description
    engine = Engine(description, tolerance=tolerance)
    models = {effect.model_id: load_model(effect.model_id) for effect in description.effects}
    header = TrackHeader.of(description, models, settings={}, tools={})
    renderers = [
        (device, Renderer(header, device, load_model, body_id=body.id))
        for body in description.bodies
        for device in devices
    ]
    runs: list[SampleRun] = []
    blocks: list[AnimationBlock] = []
    engine_s = render_s = 0.0
    for block in reader.blocks():
        before = time.process_time()
        samples = engine.evaluate(block)
        between = time.process_time()
        for _, renderer in renderers:
            renderer.add(samples)
        render_s += time.process_time() - between
        engine_s += between - before
        runs += samples
        if keep_blocks:
            blocks.append(block)
    before = time.process_time()
    rasters = [(device, renderer.raster()) for device, renderer in renderers]
    render_s += time.process_time() - before
    total_s = time.process_time() - start
    recording = Recording(
        description,
        runs,
        rasters,
        blocks,
        note=reader.stepping_note,
        counters=engine.counters.as_dict(),
    )
    return recording, Times(total_s - engine_s - render_s, engine_s, render_s)


def traced(
    scene: bpy.types.Scene,
    tolerance: Tolerance,
    devices: Sequence[DeviceConfig],
    frames: tuple[int, int] | None,
    *,
    keep_blocks: bool = False,
) -> Recording:
    """Record a scene with the peak memory of Python and numpy."""
    gc.collect()
    tracemalloc.start()
    try:
        recording, _ = record(scene, tolerance, devices, frames, keep_blocks=keep_blocks)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return replace(recording, memory_bytes=peak)
