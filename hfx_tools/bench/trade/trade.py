# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed against accuracy: one scene at every setting, against the exact reference.

The reference is the preset ``exact`` at the same samples, and for the begin of contacts at a
much higher rate. Every setting is run once to see what it finds, with its memory traced, and
then timed in turn with the others: in processor time, so that other work on the machine hardly
counts, and is unfair to all of them.
"""

from __future__ import annotations

import gc
import math
import statistics
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Final

import bpy
import numpy as np

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.arrays import F64
from hfx_blender.engine.samples import Stream
from hfx_blender.engine.tolerance import EXACT, PRESETS, Tolerance, parse
from hfx_blender.reading.description.scene_settings import scene_devices

from .trade_chart import NOISE
from .trade_judge import Judge, events
from .trade_recording import Times, record, traced

Progress = Callable[[float], None]

SWEEP: Final = (
    *("20mm,10ms,5%", "10mm,10ms,5%", "2mm,10ms,5%", "1mm,10ms,5%"),
    *("5mm,80ms,5%", "5mm,40ms,5%", "5mm,20ms,5%", "5mm,5ms,5%"),
)
"""Sweep of one parameter of the preset ``standard`` at a time: the distance, then the time."""

STANDARD_DEVICES: Final = (
    *("forearm_band_left", "back_pad", "pressure_vest", "insoles", "fan_heater"),
)
"""Devices of a scene that names none."""

REFERENCE_RATE_HZ: Final = Fraction(1000)


def settings(sweep: bool = True) -> tuple[Tolerance, ...]:
    """The presets, and a sweep of single knobs."""
    return (*PRESETS.values(), *(parse(text) for text in SWEEP if sweep))


def measure(
    scene: bpy.types.Scene,
    *,
    tolerances: Sequence[Tolerance],
    frames: tuple[int, int] | None = None,
    rounds: int = 7,
    reference_rate_hz: Fraction | None = REFERENCE_RATE_HZ,
    progress: Progress = lambda share: None,
) -> dict[str, Any]:
    """Run a scene of the open file at each setting; plain data.

    ``reference_rate_hz`` is that of the begin of contacts; None: the samples' own.

    Raises
    ------
    InputError
        The scene cannot be exported.
    """
    named, _ = scene_devices(scene)
    devices = named or tuple(load_device(name) for name in STANDARD_DEVICES)
    steps = (len(tolerances) + 2) * 2 + rounds * len(tolerances)
    done = 0

    def step(count: int = 1) -> None:
        nonlocal done
        done += count
        progress(done / steps)

    reference = traced(scene, EXACT, devices, frames, keep_blocks=True)
    step(2)
    rate_hz = float(reference_rate_hz or reference.description.time.rate_hz)
    onsets = (
        events(reference.runs, rate_hz)
        if reference_rate_hz is None
        else _onsets(scene, frames, reference_rate_hz)
    )
    step(2)
    judge = Judge(reference, onsets)
    found = []
    for tolerance in tolerances:
        is_exact = tolerance == EXACT
        recording = reference if is_exact else traced(scene, tolerance, devices, frames)
        found.append(judge.errors(recording, tolerance))
        step(2)
    times: list[list[Times]] = [[] for _ in tolerances]
    for _ in range(rounds):
        for k, tolerance in enumerate(tolerances):
            gc.collect()
            times[k].append(record(scene, tolerance, devices, frames)[1])
            step()
    time_base = reference.description.time
    count = time_base.frame_last - time_base.frame_first + 1
    rows = [
        {**_setting(tolerance), **_cost(each, count), **errors}
        for tolerance, each, errors in zip(tolerances, times, found, strict=True)
    ]
    for row in rows:
        row["on_front"] = row["is_bounded"] and not any(
            _beats(other, row) for other in rows if other["is_bounded"]
        )
    return {
        "scene": scene.name,
        "frames": count,
        "samples": time_base.sample_count,
        "rate_hz": float(time_base.rate_hz),
        "reference_rate_hz": rate_hz,
        "bodies": len(reference.description.bodies),
        "effects": len(reference.description.effects),
        "volumes": sum(effect.kind == "volume" for effect in reference.description.effects),
        "devices": [device.id for device in devices],
        "contacts": int(sum(run.sizes.sum() for run in reference.runs)),
        "rounds": rounds,
        "settings": rows,
    }


def _setting(tolerance: Tolerance) -> dict[str, Any]:
    return {
        "setting": tolerance.name,
        "is_preset": tolerance.name in PRESETS,
        "is_bounded": math.isfinite(tolerance.edge_m(1.0)),
        "mm": None if np.isinf(tolerance.distance_m) else 1000.0 * tolerance.distance_m,
        "spacings": None if np.isinf(tolerance.spacing_share) else tolerance.spacing_share,
        "ms": 1000.0 * tolerance.time_s,
        "percent": None if np.isinf(tolerance.amplitude) else 100.0 * tolerance.amplitude,
    }


def _cost(times: Sequence[Times], frames: int) -> dict[str, float]:
    """Milliseconds of processor time per frame: the fastest run, and how far runs were apart.

    Whatever else the machine does, and how warm it is, only lengthens a run.
    """
    scale = 1000.0 / frames
    totals = [each.total_s * scale for each in times]
    best = min(times, key=lambda each: each.total_s)
    return {
        "ms_per_frame": best.total_s * scale,
        "ms_median": statistics.median(totals),
        "ms_highest": max(totals),
        "read_ms": best.read_s * scale,
        "engine_ms": best.engine_s * scale,
        "render_ms": best.render_s * scale,
    }


ERRORS: Final = (
    *("wrong_share", "amplitude_mean", "amplitude_largest", "onset_mean_ms", "events_missed"),
)
"""Criteria of a setting: one that costs more and is better in none of them is off the front."""


def _beats(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Test a setting for being faster than another and at least as exact in every way."""
    faster = one["ms_per_frame"] * NOISE < other["ms_per_frame"]
    return faster and all(one[name] <= other[name] + 1e-9 for name in ERRORS)


def _onsets(
    scene: bpy.types.Scene, frames: tuple[int, int] | None, rate_hz: Fraction
) -> dict[Stream, F64]:
    """Exact begin and end of each stream's contacts."""
    recording, _ = record(scene, EXACT, (), frames, rate_hz=rate_hz)
    return events(recording.runs, float(rate_hz))
