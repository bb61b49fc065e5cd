# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about losses of vibration in file formats, with the count of affected signals."""

from collections.abc import Sequence

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from ...engine.rendering.raster import Raster
from ...text import counted
from .curves import Curve
from .signals import MAX_HZ, FrequencyRange, Signal, bursts, joined_times, vibration_of

_SAME_HZ = 1.0  # frequencies within this distance count as equal, as in the mixing of vibrations


def beyond_limits(
    raster: Raster,
    device: DeviceConfig,
    *,
    highest_m_s2: float | None = None,
    highest_hz: float = MAX_HZ,
) -> tuple[str, ...]:
    """Sentences about vibration actuators with a value above a limit, which a file clips.
    ``highest_m_s2`` None: full scale of the device. Frequencies of silent rows do not count."""
    vibrating, pairs, full_scale = vibration_of(raster, device)
    full_scale = full_scale if highest_m_s2 is None else highest_m_s2
    loud, high = [], []
    for actuator, (amplitude, hertz) in zip(vibrating, pairs.transpose(1, 2, 0), strict=True):
        # Rounding of the renderer is no loss.
        if (amplitude > full_scale * (1.0 + 1e-9)).any():
            loud.append(actuator.id)
        if (hertz[amplitude > 0.0] > highest_hz).any():
            high.append(actuator.id)
    return (
        *counted(loud, f"vibrations above full scale, {full_scale:g} m/s^2, are cut to it"),
        *counted(high, f"vibrations above {highest_hz:g} Hz are written as {highest_hz:g} Hz"),
    )


def off_range(signals: Sequence[Signal], held: FrequencyRange) -> tuple[str, ...]:
    """Sentence about signals with sound or ticks outside a Hz range, silence not counted; or ""."""
    cut, (low, high) = [], (held.lowest_hz, held.highest_hz)
    for signal in signals:
        amplitude = signal.amplitude
        # Frequencies are linear between keyframes, so keyframes with sound are enough.
        times = np.union1d(amplitude.times_s, signal.frequency_hz.times_s)
        times = times[(amplitude.at(times) > 0.0) | (amplitude.before(times) > 0.0)]
        ticks = [tick.frequency_hz for tick in signal.transients if tick.amplitude > 0.0]
        pitch = signal.frequency_hz
        hertz = np.concatenate([pitch.at(times), pitch.before(times), np.asarray(ticks, float)])
        if ((hertz < low - 1e-6) | (hertz > high + 1e-6)).any():
            cut.append(signal.name)
    return counted(cut, f"it holds {low:g} to {high:g} Hz; vibrations cut to that")


def errors_of(original: Signal, written: Signal, grid_s: float) -> tuple[float, float]:
    """Largest errors of a signal read back: share of full scale, and Hz where the original sounds.

    ``grid_s`` is the time resolution of the format: a value is met if the curve has this value
    within this time. The last ``grid_s`` do not count.
    """
    curves = (original.amplitude, original.frequency_hz, written.amplitude, written.frequency_hz)
    end_s = float(original.amplitude.times_s[-1])
    knots = joined_times(curves, 0.0, end_s)
    # Besides the knots, points close to them are compared: at a step or the edge of silence
    # each side counts.
    inside = np.diff(knots) * 1e-3
    times = np.concatenate([knots[1:-1], knots[:-1] + inside, knots[1:] - inside])
    times = times[times < end_s - grid_s]
    sounds = times[(original.amplitude.at(times) > 0.0) & (original.amplitude.before(times) > 0.0)]
    return (
        _largest_distance(original.amplitude, written.amplitude, times, grid_s),
        _largest_distance(original.frequency_hz, written.frequency_hz, sounds, grid_s),
    )


def _largest_distance(first: Curve, second: Curve, times: F64, grid_s: float) -> float:
    """Largest distance of a curve's value from the other curve's range within ``grid_s``. Both
    ways, at ``times``; 0 without times."""
    most = 0.0
    for curve, near in ((first, second), (second, first)):
        low, high = _range_near(near, times, grid_s)
        for values in (curve.at(times), curve.before(times)):
            most = max(most, float(np.maximum(low - values, values - high).max(initial=0.0)))
    return most


def _range_near(curve: Curve, times: F64, grid_s: float) -> tuple[F64, F64]:
    """Lowest and highest value, (n,) each, of a curve within +-``grid_s`` of each time (n,), with
    both limits at steps."""
    ends = [side(times + off) for off in (-grid_s, grid_s) for side in (curve.at, curve.before)]
    first = np.searchsorted(curve.times_s, times - grid_s)
    stop = np.searchsorted(curve.times_s, times + grid_s, side="right")
    # Keyframes inside each window are reduced in one call; reduceat needs non-empty spans, so
    # windows without keyframes get a dummy span, which has_keyframes masks.
    spans = np.column_stack([first, np.maximum(stop, first + 1)]).ravel()
    values = np.append(curve.values, curve.values[-1:].repeat(2))
    has_keyframes = stop > first
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    if not len(times):
        return low, high
    low_inside = np.minimum.reduceat(values, spans)[::2]
    high_inside = np.maximum.reduceat(values, spans)[::2]
    return (
        np.where(has_keyframes, np.minimum(low, low_inside), low),
        np.where(has_keyframes, np.maximum(high, high_inside), high),
    )


def silenced(dense: Sequence[Signal], simplified: Sequence[Signal]) -> tuple[str, ...]:
    """Sentence about bursts of ``dense`` signals without any positive value in the ``simplified``.
    Signals correspond by position. One sentence with names and count of bursts, or empty."""
    names, count = [], 0
    for before, after in zip(dense, simplified, strict=True):
        times, values = after.amplitude.times_s, after.amplitude.values
        gone = 0
        for ends in bursts(before.amplitude):
            start_s, end_s = before.amplitude.times_s[list(ends)]
            # A step at an end belongs to the burst by its limit from inside only.
            inside = values[(times > start_s) & (times < end_s)]
            limits = after.amplitude.at([start_s]), after.amplitude.before([end_s])
            gone += not (np.concatenate([inside, *limits]) > 0.0).any()
        if gone:
            names.append(before.name)
            count += gone
    return counted(
        names,
        f"stretches weaker than the tolerance are silent, {count} times; vibrations with such",
    )


def several_frequencies(raster: Raster) -> tuple[str, ...]:
    """Sentence about actuators with simultaneous frequencies over 1 Hz apart, or empty."""
    shape = len(raster.values), len(raster.waveform_actuators)
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    for partial in raster.partials:
        rows = slice(partial.first_row, partial.first_row + len(partial.amplitudes))
        sounds = partial.amplitudes > 0.0
        low[rows] = np.where(sounds, np.minimum(low[rows], partial.frequencies_hz), low[rows])
        high[rows] = np.where(sounds, np.maximum(high[rows], partial.frequencies_hz), high[rows])
    mixed = (high - low > _SAME_HZ).any(axis=0)
    names = [name for name, is_it in zip(raster.waveform_actuators, mixed, strict=True) if is_it]
    text = "the format holds the strongest frequency at each time (WAV holds all)"
    return counted(names, f"{text}; actuators with several at once")
