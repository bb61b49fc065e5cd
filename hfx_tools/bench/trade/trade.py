# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed against accuracy: a scene at every setting, compared with the exact reference.

The reference is the preset ``exact`` at the same samples, and at a much higher rate for the
begin of contacts. Every setting runs once for its errors, with memory traced, and is then timed
in turn with all settings: in processor time, nearly independent of other load on the machine.
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
"""Settings with one parameter of the preset ``standard`` changed: the distance, then the time."""

STANDARD_DEVICES: Final = (
    *("forearm_band_left", "back_pad", "pressure_vest", "insoles", "fan_heater"),
)
"""Devices for a scene without devices."""

REFERENCE_RATE_HZ: Final = Fraction(1000)


def settings(sweep: bool = True) -> tuple[Tolerance, ...]:
    """All presets and, with ``sweep``, settings with one changed parameter."""
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
    """Measure cost and errors of a scene of the open file at each setting; plain data.

    ``reference_rate_hz`` is the rate for the begin of contacts; None: the rate of the samples.

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
    runs = reference.runs
    if reference_rate_hz is not None:
        runs = record(scene, EXACT, (), frames, rate_hz=reference_rate_hz)[0].runs
    onsets = events(runs, rate_hz)
    step(2)
    judge = Judge(reference, onsets)
    errors_of_settings = []
    for tolerance in tolerances:
        is_exact = tolerance == EXACT
        recording = reference if is_exact else traced(scene, tolerance, devices, frames)
        errors_of_settings.append(judge.errors(recording, tolerance))
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
        {**_setting(tolerance), **_cost(runs_, count), **errors}
        for tolerance, runs_, errors in zip(tolerances, times, errors_of_settings, strict=True)
    ]
    for row in rows:
        row["on_front"] = row["is_bounded"] and not any(
            _beats(rival, row) for rival in rows if rival["is_bounded"]
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
    """Milliseconds of processor time per frame: the fastest run, and median and maximum of all.

    The fastest run counts: other load and heat of the machine only lengthen a run.
    """
    scale = 1000.0 / frames
    totals = [time.total_s * scale for time in times]
    best = min(times, key=lambda times_: times_.total_s)
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
"""Criteria of a setting: off the Pareto front if slower than another and better in none."""


def _beats(row: dict[str, Any], rival: dict[str, Any]) -> bool:
    """Test a setting for being faster than a second setting, and as exact by all criteria."""
    faster = row["ms_per_frame"] * NOISE < rival["ms_per_frame"]
    return faster and all(row[name] <= rival[name] + 1e-9 for name in ERRORS)
