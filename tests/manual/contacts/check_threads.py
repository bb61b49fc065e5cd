# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how contacts and tracks scale with threads, and with processes that share a scene.

``python tests/manual/contacts/check_threads.py`` evaluates volumes within a bending body by 1, 2,
4, 8 and 16 threads of the engine, and writes the track. For each number of threads a line has the
time, the processor time of each part, and the time of the evaluating thread without a processor.
Then 1, 2, 4, 8 and 16 processes with a thread each evaluate equal parts of the scene, as
``hfx export --jobs`` does. Exits with 1 if tracks differ.

Needs numpy and the compiled library, but no Blender. Not part of the test suite.
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.native import library
from hfx_blender.engine.overlapping import overlapped
from hfx_blender.engine.samples import joined_runs
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
from hfx_blender.engine.tolerance import PRESETS
from hfx_blender.engine.track import TrackHeader, TrackWriter
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.shape import Falloff

MODEL = "hfx-vibration-1"
RATE_HZ = 100
ROWS = 64  # samples in a block, as in an export
SHAPES = (Sphere(), Cuboid(), Cylinder(), Capsule(0.75))


class CrowdedScene:
    """Volumes of all shapes in and around a bending body; half of the volumes move and turn."""

    def __init__(self, volumes: int, blocks: int) -> None:
        self.blocks = blocks
        self.model = load_model(MODEL)
        rng = np.random.default_rng(47)
        self._middles = rng.uniform((-0.6, -0.25, 0.1), (0.6, 0.25, 1.8), (volumes, 3))
        self._halves = rng.uniform(0.02, 0.2, (volumes, 3))
        self._ways = rng.normal(0.0, 0.15, (volumes, 3)) * (np.arange(volumes) % 2)[:, None]
        self._phases = rng.uniform(0.0, 2 * np.pi, len(self.model.bone_names))
        effects = tuple(
            EffectDescription(f"v{k}", f"v{k}", "vibration", MODEL, HapticVolume(Falloff()))
            for k in range(volumes)
        )
        body = BodyDescription("b", "b", SkinBinding(self.model.bone_names))
        last_frame = ROWS * blocks - 1
        rate = Fraction(RATE_HZ)
        self.description = SceneDescription(
            TimeBase(rate, rate, 0, 0, last_frame), (body,), effects
        )

    def block(self, number: int) -> AnimationBlock:
        """Samples ``number * ROWS`` and following."""
        indices = number * ROWS + np.arange(ROWS)
        times = indices / RATE_HZ
        angles = 0.2 * np.sin(2 * np.pi * times[:, None] + self._phases)
        bones = np.tile(np.eye(4)[:3], (*angles.shape, 1, 1))
        bones[..., 0, 0] = bones[..., 1, 1] = np.cos(angles)
        bones[..., 0, 1], bones[..., 1, 0] = -np.sin(angles), np.sin(angles)
        to_world = np.tile(np.eye(4), (ROWS, 1, 1))
        pose = PoseBlock(np.ones(ROWS, np.bool_), to_world, bones)
        effects = tuple(self._volume(k, times) for k in range(len(self._middles)))
        return AnimationBlock(indices, effects, (pose,))

    def _volume(self, k: int, times: np.ndarray) -> EffectBlock:
        """Block of volume ``k``: odd volumes move to and fro, and turn."""
        share = np.sin(3.0 * times + k)
        turn = share * (k % 2)
        matrices = np.tile(np.eye(4), (ROWS, 1, 1))
        matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(turn)
        matrices[:, 0, 1], matrices[:, 1, 0] = -np.sin(turn), np.sin(turn)
        matrices[:, :3, :3] *= self._halves[k]
        matrices[:, :3, 3] = self._middles[k] + share[:, None] * self._ways[k]
        shape = SHAPES[k % len(SHAPES)]
        return EffectBlock(np.ones(ROWS), np.full((ROWS, 2), 50.0), matrices, (shape,))


class Clock:
    """Processor seconds of the calling thread within named functions."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def timed(self, name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a function, and functions that the function returns."""

        def run(*arguments: Any) -> Any:
            start = time.thread_time()
            result = work(*arguments)
            self.seconds[name] = self.seconds.get(name, 0.0) + time.thread_time() - start
            return self.timed("collect", result) if callable(result) else result

        return run


def evaluate(
    scene: CrowdedScene, tolerance: str, threads: int, path: Path, part: range
) -> dict[str, Any]:
    """Evaluate the blocks ``part`` of a scene and write the track; returns seconds by part.

    Keys: wall; processor time: read (makes blocks), begin (broad phase), collect (compacts
    contacts), write (joins and encodes), search (narrow phase in other threads); wait (of the
    evaluating thread); digest (SHA-256 of the track).
    """
    engine = Engine(scene.description, tolerance=PRESETS[tolerance], threads=threads)
    models = {MODEL: scene.model}
    header = TrackHeader.of(scene.description, models, settings={}, tools={})
    clock, evaluating = Clock(), {"wall": 0.0, "own": 0.0}
    engine.begin = clock.timed("begin", engine.begin)  # type: ignore[method-assign]

    def work(blocks: Iterator[AnimationBlock]) -> Iterator[None]:
        start, own = time.perf_counter(), time.thread_time()
        with TrackWriter(path, header) as writer:
            for _, runs in engine.evaluated(blocks):
                writer.append(joined_runs([runs], header.streams))
                yield
        evaluating.update(wall=time.perf_counter() - start, own=time.thread_time() - own)

    reading = 0.0
    start, used = time.perf_counter(), time.process_time()
    made = map(clock.timed("read", scene.block), part)
    if threads > 1:
        for _ in overlapped(made, work):
            pass
    else:
        for _ in work(made):
            pass
        reading = clock.seconds["read"]  # in the evaluating thread
    wall, used = time.perf_counter() - start, time.process_time() - used
    begin, collect = clock.seconds["begin"], clock.seconds.get("collect", 0.0)
    alone = evaluating["own"] - reading
    return {
        "wall": wall,
        "read": clock.seconds["read"],
        "begin": begin,
        "collect": collect,
        "write": alone - begin - collect,
        "search": max(used - alone - clock.seconds["read"], 0.0),
        "wait": evaluating["wall"] - evaluating["own"],
        "digest": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def evaluate_part(task: tuple[int, int, int, int, str, str], barrier: Any, results: Any) -> None:
    """Evaluate a part of a scene in a process of its own; puts the first and last moment."""
    number, count, volumes, blocks, tolerance, folder = task
    scene = CrowdedScene(volumes, blocks)
    path = Path(folder) / f"{number}.hfxtrack"
    # Loads the model's skin, so that the times have no start-up.
    evaluate(scene, tolerance, 1, path, range(1))
    part = range(number * blocks // count, (number + 1) * blocks // count)
    barrier.wait()
    start = time.monotonic()
    evaluate(scene, tolerance, 1, path, part)
    results.put((start, time.monotonic()))


def seconds_of_processes(
    count: int, volumes: int, blocks: int, tolerance: str, folder: str
) -> float:
    """Seconds from the first start to the last end of ``count`` processes with equal parts."""
    context = multiprocessing.get_context("spawn")
    barrier, results = context.Barrier(count), context.Queue()
    tasks = [(k, count, volumes, blocks, tolerance, folder) for k in range(count)]
    workers = [context.Process(target=evaluate_part, args=(t, barrier, results)) for t in tasks]
    for worker in workers:
        worker.start()
    moments = [results.get(timeout=600) for _ in workers]
    for worker in workers:
        worker.join()
    return float(max(end for _, end in moments) - min(start for start, _ in moments))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--volumes", type=int, default=100, metavar="N")
    parser.add_argument("--blocks", type=int, default=16, metavar="N", help=f"of {ROWS} samples")
    parser.add_argument("--counts", default="1,2,4,8,16", metavar="N,N", help="threads, processes")
    parser.add_argument("--tolerances", default="paper,standard", metavar="NAME,NAME")
    options = parser.parse_args()
    counts = [int(count) for count in options.counts.split(",")]
    if not library.is_there():
        sys.stderr.write("the compiled library is missing\n")
        return 2
    say = sys.stdout.write
    say(
        f"{os.cpu_count()} processors, {options.volumes} volumes, {options.blocks * ROWS} samples\n"
    )
    is_equal = True
    scene = CrowdedScene(options.volumes, options.blocks)
    columns = ("read", "begin", "collect", "write", "search", "wait")
    with tempfile.TemporaryDirectory() as folder:
        for tolerance in options.tolerances.split(","):
            path = Path(folder) / "whole.hfxtrack"
            evaluate(scene, tolerance, 1, path, range(1))
            say(f"\n{tolerance}\n{'threads':>9}{'wall s':>8}{'speed-up':>9}")
            say("".join(f"{name:>9}" for name in columns) + "\n")
            whole = range(options.blocks)
            rows = {n: evaluate(scene, tolerance, n, path, whole) for n in counts}
            first = next(iter(rows.values()))
            for count, row in rows.items():
                is_equal &= row["digest"] == first["digest"]
                say(f"{count:9}{row['wall']:8.2f}{first['wall'] / row['wall']:9.2f}")
                say("".join(f"{row[name]:9.2f}" for name in columns) + "\n")
            say(f"{'processes':>9}{'wall s':>8}{'speed-up':>9}\n")
            walls: dict[int, float] = {}
            for count in counts:
                arguments = options.volumes, options.blocks, tolerance, folder
                walls[count] = seconds_of_processes(count, *arguments)
                say(f"{count:9}{walls[count]:8.2f}{walls[counts[0]] / walls[count]:9.2f}\n")
            sys.stdout.flush()
    say(f"\ntracks {'are equal' if is_equal else 'DIFFER'}\n")
    return int(not is_equal)


if __name__ == "__main__":
    sys.exit(main())
