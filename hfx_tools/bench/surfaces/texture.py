# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces: cost, accuracy, and identification of materials."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.texture import mcha, procedural, stroke
from hfx_blender.engine.texture.contact_path import ContactFollower, SurfaceMesh
from hfx_blender.engine.texture.contact_rendering import ContactRenderer
from hfx_blender.engine.texture.haptic_map import HapticMap, SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.stroke_rendering import StrokeSignal, render_stroke
from hfx_blender.engine.texture.textile import drive_levels

from . import classify
from .collisions import Collisions, collisions, most_salient
from .textile_correlation import SPEEDS_M_S, as_lines, correlation

_FRAME_HZ: Final = 60.0
_FRAMES: Final = 4  # followed together, as the engine does with 100 contacts


def measure(short: bool, progress: Callable[[float], None]) -> dict[str, Any]:
    """Run all measurements of surfaces; plain data."""
    rough = correlation(1 if short else 20, progress=lambda share: progress(0.3 * share))
    result: dict[str, Any] = {"roughness": rough}
    progress(0.3)
    result["identification"] = identification(1 if short else 3, 1 if short else 2)
    progress(0.6)
    result["salience"] = salience(short)
    result["windows"] = windows()
    progress(0.7)
    result["maps"] = maps((512, 1024) if short else (512, 1024, 2048, 4096), 1 if short else 3)
    progress(0.8)
    result["contacts"] = contacts((100,) if short else (1, 10, 100, 400), 20 if short else 60)
    progress(1.0)
    return result


# Identification


def identification(train: int, test: int, texels: int = 384) -> dict[str, Any]:
    """Classify materials on maps, directions and speeds outside of the training set.

    ``train`` and ``test`` are numbers of variants per material.
    """
    learnt = library_strokes(train, texels)
    judge = classify.NearestNeighbour.of(learnt)
    examples = _examples(range(100, 100 + test), (0.2, 1.0, 2.2), (0.03, 0.06, 0.1), texels)
    truth = [kind for kind, _ in examples]
    guesses = judge.classify([signal for _, signal in examples])
    table = classify.confusion(truth, guesses, procedural.KINDS)
    return {
        "names": list(procedural.KINDS),
        "confusion": table.tolist(),
        "share": float(np.trace(table) / table.sum()),
        "learnt": len(learnt),
    }


def library_strokes(seeds: int, texels: int) -> list[tuple[str, StrokeSignal]]:
    """Strokes over all materials of the library as a training set, with the kinds of material."""
    return _examples(range(seeds), (0.0, 0.4, 0.8, 1.2, 1.57), (0.02, 0.04, 0.08), texels)


def _examples(
    seeds: range, directions: tuple[float, ...], speeds: tuple[float, ...], texels: int
) -> list[tuple[str, StrokeSignal]]:
    examples = []
    for material in procedural.MATERIALS.values():
        for seed in seeds:
            map_ = mcha.make_map(*material.make(texels, seed))
            signals = strokes_over(map_, directions, speeds, seed)
            examples += [(material.kind, signal) for signal in signals]
    return examples


def strokes_over(
    map_: HapticMap, directions: tuple[float, ...], speeds: tuple[float, ...], seed: int
) -> list[StrokeSignal]:
    """Render strokes of 0.6 s over a map from random points; radians and m/s."""
    texture = SurfaceTexture(map=map_)
    rng = np.random.default_rng([seed, 5])
    signals = []
    for direction in directions:
        for speed in speeds:
            start = (float(rng.uniform(0.0, 0.05)), float(rng.uniform(0.0, 0.05)))
            path = stroke.line(start, direction, 0.6 * speed, speed)
            signals.append(render_stroke(texture, path, step_s=2e-3, waveform_rate_hz=1000.0))
    return signals


# Remaining collisions of a too fast stroke


def salience(short: bool) -> list[dict[str, Any]]:
    """Shares of the best playable strength, for a device with 50 ms between two collisions.

    By material and speed: most salient first, and first come; strokes without collisions are
    left out.
    """
    rows = []
    for name in ("gravel-fine", "wood-oak") if short else procedural.MATERIALS:
        map_ = mcha.make_map(*procedural.material(name).make(384))
        for speed in SPEEDS_M_S:
            path = stroke.line((0.01, 0.02), 0.3, 2.0 * speed, speed, 240.0)
            hits = collisions(map_, path)
            if not len(hits):
                continue
            best = _best_possible(hits, 0.05)
            rows.append(
                {
                    "material": name,
                    "speed_m_s": speed,
                    "collisions": len(hits),
                    "salient": float(most_salient(hits, 0.05).intensity.sum()) / best,
                    "first_come": float(_first_come(hits, 0.05).intensity.sum()) / best,
                }
            )
    return rows


def _first_come(candidates: Collisions, gap_s: float) -> Collisions:
    """Collisions of a device playing every collision at least ``gap_s`` after the last played."""
    played, free_at = [], -np.inf
    for k, t in enumerate(candidates.times_s.tolist()):
        if t >= free_at:
            played.append(k)
            free_at = t + gap_s
    return candidates.only(np.array(played, np.int64))


def _best_possible(candidates: Collisions, gap_s: float) -> float:
    """Largest sum of strengths of collisions at least ``gap_s`` apart, by dynamic programming."""
    before = np.searchsorted(candidates.times_s, candidates.times_s - gap_s * (1.0 - 1e-9), "right")
    best = [0.0]
    for k, strength in enumerate(candidates.intensity.tolist()):
        best.append(max(best[-1], best[int(before[k])] + strength))
    return max(best[-1], 1e-12)


# Cost


def windows() -> list[dict[str, Any]]:
    """Measure spread of the textile renderer's level over an even stroke, and cost, by window."""
    field, _ = procedural.material("fabric-denim").make(512)
    path = stroke.line((0.0, 0.0), 0.3, 0.4, 0.1, 240.0)
    rows = []
    for window_s in (0.0125, 0.025, 0.05, 0.1, 0.2):
        start = time.perf_counter()
        levels = drive_levels(field, path, 1.0, window_s)
        seconds = time.perf_counter() - start
        rows.append(
            {
                "window_ms": 1e3 * window_s,
                "spread": float(levels.std() / levels.mean()),
                "ms_per_second": 1e3 * seconds / path.duration_s,
            }
        )
    return rows


def maps(sizes: tuple[int, ...], rounds: int) -> list[dict[str, Any]]:
    """Measure seconds for building a map, and the error of coarser maps against 2048 texels."""
    rows = []
    rng = np.random.default_rng(0)
    for size in sizes:
        field = HeightField(rng.standard_normal((size, size)) * 1e-5, (0.1 / size, 0.1 / size))
        rough = rng.uniform(size=(size, size)).astype(np.float32)
        seconds = []
        for _ in range(rounds):
            start = time.perf_counter()
            mcha.make_map(field, rough)
            seconds.append(time.perf_counter() - start)
        rows.append({"texels": size, "seconds": min(seconds)})
    cloth = procedural.Weave("twill", 0.8e-3, 0.2e-3, np.pi / 6.0)
    finest = _mean_intensity(cloth, 2048)
    for row in rows:
        row["error"] = abs(_mean_intensity(cloth, min(row["texels"], 2048)) / finest - 1.0)
    return rows


def _mean_intensity(cloth: procedural.Weave, texels: int) -> float:
    map_ = mcha.make_map(procedural.woven(cloth, 0.04, texels))
    return float(map_.intensity.mean())


def contacts(counts: tuple[int, ...], rounds: int) -> list[dict[str, Any]]:
    """Measure the cost of a frame of contacts: in blocks as in an export, single as live."""
    field, rough = procedural.material("fabric-denim").make(512)
    map_ = mcha.make_map(field, rough)
    vertices, triangles = _sheet(20)
    mesh = SurfaceMesh(triangles, vertices[triangles][..., :2])
    rows = []
    for renderer in SurfaceRenderer:
        texture = SurfaceTexture(field, map_, renderer)
        for count in counts:
            for frames in (_FRAMES, 1):
                seconds, samples = _frames(texture, mesh, vertices, count, frames, rounds)
                rows.append(
                    {
                        "renderer": renderer.value,
                        "contacts": samples,
                        "frames": frames,
                        "ms_per_frame": 1e3 * seconds,
                    }
                )
    return rows


def _frames(
    texture: SurfaceTexture, mesh: SurfaceMesh, vertices: F64, count: int, frames: int, rounds: int
) -> tuple[float, int]:
    """Seconds per frame (minimum over all rounds), and contacts per frame."""
    follower = ContactFollower(mesh, 0.003, count)
    renderer = ContactRenderer(texture, 1.0 / _FRAME_HZ)
    rng = np.random.default_rng(0)
    fingertip = rng.uniform(-0.02, 0.02, (count, 3)) * (1.0, 1.0, 0.0)
    times = np.repeat(np.arange(frames), count)
    ids = np.tile(np.arange(count), frames)
    matrices = np.tile(np.eye(4), (frames, 1, 1))
    seconds, contact_count = [], 0
    for k in range(rounds + 1):
        time_s = (k * frames + np.arange(frames))[:, None] / _FRAME_HZ
        # A circle of 3 cm at 10 cm/s.
        turn = time_s * stroke.FAST_M_S / 0.03
        centre = 0.03 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=2)
        points = (centre + fingertip).reshape(-1, 3)
        start = time.perf_counter()
        paths = follower.follow(
            matrices, vertices[None], times, ids, points, np.arange(frames) + k > 0
        )
        renderer.render(paths)
        if k:
            seconds.append((time.perf_counter() - start) / frames)
        contact_count = (len(paths) - paths.carried) // frames
    # The minimum: other load on the machine only adds.
    return min(seconds), contact_count


def _sheet(count: int) -> tuple[F64, npt.NDArray[np.int32]]:
    """Vertices and triangles of a flat square of 20 cm with ``count`` quads a side."""
    steps = np.linspace(-0.1, 0.1, count + 1)
    x, y = np.meshgrid(steps, steps)
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    a, b, c, d = first, first + 1, first + count + 2, first + count + 1
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    return vertices, triangles.astype(np.int32)


def confusion_lines(result: dict[str, Any]) -> list[str]:
    """Format a confusion matrix with names for a terminal, in lines."""
    lines = [f"  {'':8}" + "".join(f"{name:>8}" for name in result["names"])]
    for name, row in zip(result["names"], result["confusion"], strict=True):
        lines.append(f"  {name:8}" + "".join(f"{n:8}" for n in row))
    return lines


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    identified = result["identification"]
    lines = as_lines(result["roughness"])
    lines += [
        f"Nearest neighbour of {identified['learnt']} strokes, unseen maps, directions and speeds: "
        f"{100 * identified['share']:.1f} % right; rows are, columns were found:",
        *confusion_lines(identified),
    ]
    lines.append("Strokes too fast for a device (50 ms a collision): strength kept, of the best")
    lines.append(f"  {'material':18} {'cm/s':>5} {'hits':>5} {'salient':>8} {'first come':>11}")
    lines += [
        f"  {row['material']:18} {100 * row['speed_m_s']:5g} {row['collisions']:5} "
        f"{100 * row['salient']:6.1f} % {100 * row['first_come']:9.1f} %"
        for row in result["salience"]
    ]
    lines.append("Window of the textile renderer: spread of its level over an even stroke, cost")
    lines += [
        f"  {row['window_ms']:6.1f} ms {100 * row['spread']:6.1f} % "
        f"{row['ms_per_second']:6.2f} ms a second"
        for row in result["windows"]
    ]
    lines.append("Building a haptic map (10 cm): time, error of its mean intensity against 2048")
    lines += [
        f"  {row['texels']:5} x {row['texels']:<5} {row['seconds']:7.2f} s "
        f"{100 * row['error']:6.2f} %"
        for row in result["maps"]
    ]
    lines.append("One frame of contacts, followed and rendered")
    lines += [
        f"  {row['renderer']:8} {row['contacts']:4} contacts, {row['frames']:2} frames at once: "
        f"{row['ms_per_frame']:6.3f} ms"
        for row in result["contacts"]
    ]
    return "\n".join(lines)


def as_markdown() -> str:
    """Measure classification and salience; returns the text of ``docs/surfaces.md``."""
    small, large = identification(1, 1), identification(3, 10)
    names, table = small["names"], np.array(small["confusion"])
    lines = [
        f"A nearest-neighbour judge that learnt {small['learnt']} strokes (18 materials, five "
        f"directions, 2, 4 and 8 cm/s) names the kind of {np.trace(table)} of {table.sum()} "
        "strokes on other maps, in other directions and at 3, 6 and 10 cm/s, by micro-collisions "
        "with their mean level taken away:",
        "",
        f"| is, found as | {' | '.join(names)} |",
        "|---" * (len(names) + 1) + "|",
        *(
            f"| {name} | {' | '.join(map(str, row))} |"
            for name, row in zip(names, table.tolist(), strict=True)
        ),
    ]
    table = np.array(large["confusion"])
    right, all_ = np.diag(table), table.sum(axis=1)
    worst = int(np.argmin(right / all_))
    fast = [row for row in salience(False) if row["speed_m_s"] == max(SPEEDS_M_S)]
    shares = [
        f"{100 * min(row[key] for row in fast):.0f} to {100 * max(row[key] for row in fast):.0f} %"
        for key in ("salient", "first_come")
    ]
    return "\n".join(
        [
            *lines,
            "",
            f"With three variants of each material learnt ({large['learnt']} strokes) and ten "
            f"others asked ({all_.sum()} strokes), {right.sum()} ({100 * large['share']:.1f} %) "
            f"are named right; the worst kind, {large['names'][worst]}, {right[worst]} of "
            f"{all_[worst]}.",
            "",
            "Where a device needs 50 ms between two collisions, taking the most salient first "
            f"keeps {shares[0]} of the strength that the best possible choice keeps, over the 18 "
            f"materials at 10 cm/s; taking what comes first keeps {shares[1]}.",
        ]
    )
