# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about what formats cannot hold of a vibration: each once, with how many it concerns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.raster import Raster
from ...text import counted
from .curves import Curve
from .signals import MAX_HZ, FrequencyRange, Signal, bursts, joined_times

_ALIKE_HZ = 1.0
"""Frequencies closer than this count as one, as where vibrations are mixed."""


def beyond_limits(
    raster: Raster,
    device: DeviceConfig,
    *,
    highest_m_s2: float | None = None,
    highest_hz: float = MAX_HZ,
) -> tuple[str, ...]:
    """Actuators of a raster whose vibration is cut: to full scale, if not told otherwise, or to
    what skin feels.
    """
    columns = {(each.actuator, each.parameter): k for k, each in enumerate(raster.columns)}
    vibrating = [each for each in device.actuators if each.type.modality == "vibration"]
    full_scale = highest_m_s2
    if full_scale is None:
        full_scale = max((each.type.strength.highest for each in vibrating), default=0.0)
    loud, high = [], []
    for each in vibrating:
        amplitude = raster.values[:, columns[each.id, "amplitude_m_s2"]]
        hertz = raster.values[:, columns[each.id, "frequency_hz"]]
        if (amplitude > full_scale * (1.0 + 1e-9)).any():
            loud.append(each.id)
        if (hertz[amplitude > 0.0] > highest_hz).any():
            high.append(each.id)
    return (
        *counted(loud, f"vibrations above full scale, {full_scale:g} m/s^2, are cut to it"),
        *counted(high, f"vibrations above {highest_hz:g} Hz are written as {highest_hz:g} Hz"),
    )


def off_range(signals: Sequence[Signal], held: FrequencyRange) -> tuple[str, ...]:
    """Signals that sound at frequencies outside of those that a file holds."""
    cut = [each.name for each in signals if _is_off(each, held)]
    low, high = held.lowest_hz, held.highest_hz
    return counted(cut, f"it holds {low:g} to {high:g} Hz; vibrations cut to that")


def _is_off(signal: Signal, held: FrequencyRange) -> bool:
    amplitude = signal.amplitude
    times = np.union1d(amplitude.times_s, signal.frequency_hz.times_s)
    sounds = (amplitude.at(times) > 0.0) | (amplitude.before(times) > 0.0)
    hertz = [
        signal.frequency_hz.at(times[sounds]),
        signal.frequency_hz.before(times[sounds]),
        [each.frequency_hz for each in signal.transients if each.amplitude > 0.0],
    ]
    every = np.concatenate([np.asarray(each, np.float64) for each in hertz])
    return bool(((every < held.lowest_hz - 1e-6) | (every > held.highest_hz + 1e-6)).any())


def errors_of(wanted: Signal, written: Signal, grid_s: float) -> tuple[float, float]:
    """Largest error of a signal as it was written and read again.

    Parameters
    ----------
    grid_s : float
        What times may be off, seconds: a value counts if the other signal has it that near.

    Returns
    -------
    amplitude : float
        Share of full scale.
    frequency : float
        Hertz, while something sounds.
    """
    curves = (wanted.amplitude, wanted.frequency_hz, written.amplitude, written.frequency_hz)
    end_s = float(wanted.amplitude.times_s[-1])
    knots = joined_times(curves, 0.0, end_s)
    inside = np.diff(knots) * 1e-3  # near a step, or silence, each side counts by itself
    times = np.concatenate([knots[1:-1], knots[:-1] + inside, knots[1:] - inside])
    times = times[times < end_s - grid_s]
    sounds = times[(wanted.amplitude.at(times) > 0.0) & (wanted.amplitude.before(times) > 0.0)]
    return (
        _apart(wanted.amplitude, written.amplitude, times, grid_s),
        _apart(wanted.frequency_hz, written.frequency_hz, sounds, grid_s),
    )


def _apart(one: Curve, other: Curve, times: F64, grid_s: float) -> float:
    """Largest distance of one curve's values from those that the other has near, both ways."""
    most = 0.0
    for curve, near in ((one, other), (other, one)):
        low, high = _range_near(near, times, grid_s)
        for values in (curve.at(times), curve.before(times)):
            most = max(most, float(np.maximum(low - values, values - high).max(initial=0.0)))
    return most


def _range_near(curve: Curve, times: F64, grid_s: float) -> tuple[F64, F64]:
    """Lowest and highest value of a curve within ``grid_s`` of each time, (n,) each."""
    ends = [side(times + off) for off in (-grid_s, grid_s) for side in (curve.at, curve.before)]
    first = np.searchsorted(curve.times_s, times - grid_s)
    stop = np.searchsorted(curve.times_s, times + grid_s, side="right")
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
    """Stretches so weak that nothing is left of them in simplified signals."""
    names, count = [], 0
    for before, after in zip(dense, simplified, strict=True):
        gone = sum(
            not _sounds(after, *before.amplitude.times_s[[first, last]].tolist())
            for first, last in bursts(before.amplitude)
        )
        if gone:
            names.append(before.name)
            count += gone
    return counted(
        names, f"what is weaker than the tolerance is silent, {count} times; vibrations with such"
    )


def _sounds(signal: Signal, start_s: float, end_s: float) -> bool:
    """Test for a part of an envelope that sounds strictly within a stretch of time."""
    times, values = signal.amplitude.times_s, signal.amplitude.values
    inside = (times > start_s) & (times < end_s)
    ends = signal.amplitude.at([start_s]), signal.amplitude.before([end_s])
    return bool((values[inside] > 0.0).any() or any((each > 0.0).any() for each in ends))


def several_frequencies(raster: Raster) -> tuple[str, ...]:
    """Actuators that are to play several frequencies at once, for a format that holds one."""
    shape = len(raster.values), len(raster.waveform_actuators)
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    for each in raster.partials:
        rows = slice(each.first_row, each.first_row + len(each.amplitudes))
        sounds = each.amplitudes > 0.0
        low[rows] = np.where(sounds, np.minimum(low[rows], each.frequencies_hz), low[rows])
        high[rows] = np.where(sounds, np.maximum(high[rows], each.frequencies_hz), high[rows])
    mixed = (high - low > _ALIKE_HZ).any(axis=0)
    names = [name for name, is_it in zip(raster.waveform_actuators, mixed, strict=True) if is_it]
    text = "it holds one frequency at a time, that of the strongest, and WAV all of them"
    return counted(names, f"{text}; actuators that play several at once")
