# SPDX-License-Identifier: GPL-3.0-or-later
"""Stroke over a surface as a file: WAV, AHAP, .he, .haptic or CSV."""

from pathlib import Path
from typing import Final

import numpy as np

from ...engine.texture.haptic_map import STANDARD_GRAVITY, DeviceRange
from ...engine.texture.stroke import Stroke
from ...engine.texture.stroke_rendering import StrokeSignal
from ...errors import InputError, UsageError
from ...files import kinds
from ...files.atomic import atomic_file
from ...files.strict_json import read_bytes
from ..device_files import ahap, haptic, he
from ..sound import wav
from ..written import Written, write_json
from .curves import Curve, clipped
from .signals import DEFAULT_TOLERANCE, FrequencyRange, Signal, simplified_signals
from .simplified_writer import WHOLE_MS, error_note, pitch_tolerance

WAV_RATE_HZ: Final = 48_000

_KINDS: Final = {ahap.SUFFIX: ahap, he.SUFFIX: he, haptic.SUFFIX: haptic}
SUFFIXES: Final = kinds.STROKE_SUFFIXES


def check(path: Path) -> None:
    """Raise UsageError for a path whose suffix is none of ``SUFFIXES``."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: expected a file name with one of: {', '.join(SUFFIXES)}")


def write(rendered: StrokeSignal, stroke: Stroke, device: DeviceRange, path: Path) -> Written:
    """Write a stroke in the format of the path's suffix.

    Full scale is the device's largest amplitude. A WAV file holds the rendered waveform, 16 bits,
    mono. Raises UsageError for another suffix, InputError if an envelope format would be silent,
    and OutputError for an unwritable file.
    """
    check(path)
    suffix = path.suffix.lower()
    if suffix == ".wav":
        full = device.amplitude_g[1] * STANDARD_GRAVITY
        peak = float(np.abs(rendered.waveform_m_s2).max(initial=0.0)) / full
        samples = np.clip(rendered.waveform_m_s2 / full, -1.0, 1.0)
        with atomic_file(path) as file:
            file.write(wav.head(16, 1, round(rendered.waveform_rate_hz), len(samples)))
            file.write(wav.encoded(samples, 16))
        return Written((path,), notes=(f"full scale is {full:.3g} m/s^2; the peak is {peak:.0%}",))
    if suffix == ".csv":
        return _csv(rendered, stroke, path)
    frequencies, kind = FrequencyRange(*device.frequency_hz), _KINDS[suffix]
    signal = _envelope(rendered, device)
    pitch_hz = pitch_tolerance(frequencies)
    (few,) = simplified_signals([signal], DEFAULT_TOLERANCE, frequency_hz=pitch_hz)
    if few.is_silent:
        raise InputError(f"{path}: this stroke is silent; no file was written.")
    write_json(kind.document(few, frequencies), path)
    # Read back, as rounding in the file is part of the error.
    (read,), _ = kind.decode(read_bytes(path), path.name)
    note = error_note([(signal, read)], WHOLE_MS if kind is he else 0.0)
    return Written((path,), notes=(note,))


def _envelope(rendered: StrokeSignal, device: DeviceRange) -> Signal:
    """Signal of constant amplitude and frequency per step, from time 0, with full scale 1. Clipped
    to full scale and the device's frequencies."""
    full = device.amplitude_g[1] * STANDARD_GRAVITY
    begins = rendered.times_s - rendered.times_s[0]
    times = np.stack([begins, begins + rendered.step_s], axis=1).ravel()
    times[1:-1:2] = times[2::2]  # bit-exact steps: each end is the next begin
    amplitude = np.repeat(np.clip(rendered.amplitude_m_s2 / full, 0.0, 1.0), 2)
    frequency = np.repeat(np.clip(rendered.frequency_hz, 0.1, 1000.0), 2)
    pitch = clipped(Curve(times, frequency), *device.frequency_hz)
    return Signal("stroke", Curve(times, amplitude), pitch)


def _csv(rendered: StrokeSignal, stroke: Stroke, path: Path) -> Written:
    """Write a CSV row per step: time, s, place, mm, speed, mm/s, amplitude, m/s^2, and Hz."""
    middles = rendered.times_s + 0.5 * rendered.step_s
    places, speeds = stroke.at(rendered.times_s) * 1000.0, stroke.speed_at(middles) * 1000.0
    rows = ["time_s,x_mm,y_mm,speed_mm_s,amplitude_m_s2,frequency_hz"]
    amplitudes, frequencies = rendered.amplitude_m_s2, rendered.frequency_hz
    columns = zip(rendered.times_s, places, speeds, amplitudes, frequencies, strict=True)
    rows += [f"{t:.6f},{x:.4f},{y:.4f},{v:.4f},{a:.6g},{f:.6g}" for t, (x, y), v, a, f in columns]
    with atomic_file(path) as file:
        file.write(("\n".join(rows) + "\n").encode())
    return Written((path,))
