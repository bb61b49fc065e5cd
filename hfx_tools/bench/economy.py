# SPDX-License-Identifier: GPL-3.0-or-later
"""Economy: cost of vertices, volumes and bodies without contact, and of one live evaluation.

The engine alone is timed, on a shipped model bending at random among a few volumes; each case is
timed in turn with the plain case.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.body.model import PerceptualModel, SkinWeights, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import STANDARD, Tolerance
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.shape import Falloff

from ..command_process.temporary_folder import temporary_folder

MODEL_ID: Final = "hfx-vibration-1"
_BLOCK: Final = 32  # times
_AWAY_M: Final = 5.0  # distance of volumes and bodies without contact
_SHAPES: Final = (Sphere(), Cuboid(), Cylinder(), Capsule(0.75), Sphere())
_PLACES: Final = ((0.0, 0.0, 1.2), (0.2, 0.0, 0.9), (-0.2, 0.05, 0.5), (0.0, 0.1, 1.6), (0, 0, 0.1))


def measure(
    *,
    short: bool = False,
    rounds: int = 7,
    tolerance: Tolerance = STANDARD,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Any]:
    """Time all cases and live evaluation; Blender is needed for the demo only.

    The result is plain data: milliseconds per time, median ratio to the plain case, contacts.
    """
    blocks = 1 if short else 4
    cases: dict[str, Callable[[], Callable[[], Engine]]] = {
        "plain": lambda: evaluated_case(blocks, tolerance),
        "twice the vertices": lambda: evaluated_case(
            blocks, tolerance, model=doubled_model(load_model(MODEL_ID))
        ),
        "twice the volumes": lambda: evaluated_case(blocks, tolerance, idle_volumes=len(_SHAPES)),
        "100 more volumes": lambda: evaluated_case(blocks, tolerance, idle_volumes=100),
        "twice the bodies": lambda: evaluated_case(blocks, tolerance, idle_bodies=1),
    }
    runners = {name: make() for name, make in cases.items()}
    seconds: dict[str, list[float]] = {name: [] for name in runners}
    contacts: dict[str, int] = {}
    for k in range(rounds + 1):  # the first round warms up
        for name, work in runners.items():
            start = time.perf_counter()
            engine = work()
            if k:
                seconds[name].append(time.perf_counter() - start)
            contacts[name] = engine.counters.contacts
        progress((k + 1) / (rounds + 2))
    rows = [
        {
            "case": name,
            "ms_per_time": 1e3 * statistics.median(times) / (blocks * _BLOCK),
            "ratio": statistics.median(a / b for a, b in zip(times, seconds["plain"], strict=True)),
            "contacts": contacts[name],
        }
        for name, times in seconds.items()
    ]
    live = _time_live(tolerance, short)
    progress(1.0)
    return {"cases": rows, "live": live, "model": MODEL_ID, "tolerance": tolerance.name}


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    lines = [
        f"Cost without contact ({result['model']}, 5 volumes, {result['tolerance']}): engine time",
        f"  {'case':20} {'ms/time':>8} {'ratio':>6}  contacts",
    ]
    lines += [
        f"  {row['case']:20} {row['ms_per_time']:8.3f} {row['ratio']:6.2f}  {row['contacts']}"
        for row in result["cases"]
    ]
    live = result["live"]
    lines.append(
        f"Live evaluation of the demo, one time each ({live['times']} times): median "
        f"{live['median_ms']:.2f} ms, p99 {live['p99_ms']:.2f} ms, most {live['largest_ms']:.2f} ms"
    )
    return "\n".join(lines)


def evaluated_case(
    blocks: int,
    tolerance: Tolerance,
    *,
    model: PerceptualModel | None = None,
    idle_volumes: int = 0,
    idle_bodies: int = 0,
) -> Callable[[], Engine]:
    """Build a function for evaluating a moving body and volumes; each call returns the engine.

    Idle volumes and bodies move along, too far away for any contact.
    """
    model = model or load_model(MODEL_ID)
    effects = tuple(
        EffectDescription(f"v{k}", f"v{k}", "vibration", model.id, HapticVolume(Falloff()))
        for k in range(len(_SHAPES) + idle_volumes)
    )
    binding = SkinBinding(model.bone_names)
    bodies = tuple(BodyDescription(f"b{k}", f"b{k}", binding) for k in range(1 + idle_bodies))
    scene = SceneDescription(
        TimeBase(Fraction(24), Fraction(100), 0, 0, 24 * blocks), bodies, effects
    )
    animated = [
        _make_block(b, len(model.bone_names), idle_volumes, idle_bodies) for b in range(blocks)
    ]
    engine = Engine(scene, models=lambda _: model, tolerance=tolerance)

    def work() -> Engine:
        engine.counters.contacts = 0
        for block in animated:
            engine.evaluate(block)
        return engine

    return work


def _make_block(number: int, bones: int, idle_volumes: int, idle_bodies: int) -> AnimationBlock:
    rng = np.random.default_rng(1)  # the same bends in every block and case
    phase = rng.uniform(0.0, 2 * np.pi, bones)
    times = (number * _BLOCK + np.arange(_BLOCK)) / 100.0
    angles = 0.1 * np.sin(2 * np.pi * times[:, None] + phase)
    posed = np.tile(np.eye(4)[:3], (_BLOCK, bones, 1, 1))
    posed[..., 0, 0] = posed[..., 1, 1] = np.cos(angles)
    posed[..., 0, 1], posed[..., 1, 0] = -np.sin(angles), np.sin(angles)
    poses = []
    for k in range(1 + idle_bodies):
        to_world = np.tile(np.eye(4), (_BLOCK, 1, 1))
        to_world[:, 1, 3] = -2.0 * _AWAY_M * k
        poses.append(PoseBlock(np.ones(_BLOCK, np.bool_), to_world, posed))
    effects = []
    for k in range(len(_SHAPES) + idle_volumes):
        matrices = np.tile(np.diag([0.15, 0.15, 0.15, 1.0]), (_BLOCK, 1, 1))
        idle = k >= len(_SHAPES)
        matrices[:, :3, 3] = (0.0, _AWAY_M + k, 1.0) if idle else _PLACES[k]
        matrices[:, 0, 3] += 0.05 * np.sin(3.0 * times + k)
        effects.append(
            EffectBlock(
                np.ones(_BLOCK),
                np.full((_BLOCK, 2), 50.0),
                matrices,
                (_SHAPES[k % len(_SHAPES)],),
            )
        )
    indices = number * _BLOCK + np.arange(_BLOCK)
    return AnimationBlock(indices, tuple(effects), tuple(poses))


def doubled_model(model: PerceptualModel) -> PerceptualModel:
    """Model with a second copy of all vertices, far from every volume.

    The copy's parts have other labels, so the clusters of the first half stay equal.
    """
    count = len(model)

    def twice(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.concatenate([values, values])

    copies = (model.vertices + np.array([0.0, -_AWAY_M, 0.0])).astype(np.float32)
    weights = model.weights
    offsets = np.concatenate([weights.offsets, weights.offsets[1:] + weights.offsets[-1]])
    return replace(
        model,
        vertices=np.concatenate([model.vertices, copies]),
        triangles=np.concatenate([model.triangles, model.triangles + count]).astype(np.int32),
        normals=twice(model.normals),
        areas_m2=twice(model.areas_m2),
        part=np.concatenate([model.part, model.part + len(PARTS)]).astype(np.uint8),
        side=twice(model.side),
        mirror=np.concatenate([model.mirror, model.mirror + count]).astype(np.int32),
        weights=SkinWeights(offsets.astype(np.int32), twice(weights.bones), twice(weights.values)),
        avatar_vertices=twice(model.avatar_vertices),
        avatar_weights=twice(model.avatar_weights),
        avatar_offset_m=twice(model.avatar_offset_m),
    )


def _time_live(tolerance: Tolerance, short: bool) -> dict[str, float]:
    """Measure evaluation of the demo in blocks of one time; the first of two passes warms up."""
    from hfx_blender.processes import blender_session

    bpy = blender_session.start()
    from hfx_blender.reading.scene_reader import SceneReader

    from . import scenes

    with temporary_folder() as folder:
        blender_session.open_blend(scenes.build("demo", Path(folder) / "demo.blend"))
    reader = SceneReader(bpy.context.scene, tolerance=tolerance)
    engine = Engine(reader.description, tolerance=tolerance)
    rows = [
        single
        for k, block in enumerate(reader.blocks())
        if not (short and k % 4)
        for single in _single_times(block)
    ]
    times_ms: list[float] = []
    for turn in range(2):
        for block in rows:
            start = time.perf_counter()
            engine.evaluate(block)
            if turn:
                times_ms.append(1e3 * (time.perf_counter() - start))
    return {
        "times": len(times_ms),
        "median_ms": statistics.median(times_ms),
        "p99_ms": float(np.quantile(times_ms, 0.99)),
        "largest_ms": max(times_ms),
    }


def _single_times(block: AnimationBlock) -> list[AnimationBlock]:
    """Cut a block into blocks of one time each, without the block's warm-up rows."""
    return [
        _rows_of_block(block, slice(row, row + 1)) for row in range(len(block.indices))[block.own]
    ]


def _rows_of_block(block: AnimationBlock, rows: slice) -> AnimationBlock:
    return AnimationBlock(
        block.indices[rows],
        tuple(
            replace(
                effect,
                levels=effect.levels[rows],
                parameters=effect.parameters[rows],
                matrices=None if effect.matrices is None else effect.matrices[rows],
                shape_index=None if effect.shape_index is None else effect.shape_index[rows],
            )
            for effect in block.effects
        ),
        tuple(
            replace(
                pose,
                valid=pose.valid[rows],
                to_world=pose.to_world[rows],
                bones=None if pose.bones is None else pose.bones[rows],
                surface=None if pose.surface is None else pose.surface[rows],
            )
            for pose in block.poses
        ),
    )
