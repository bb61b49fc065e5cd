# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF of a device's output: a channel per actuator, a perception per modality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.files.strict_json import clean, read_bytes
from hfx_blender.formats.hjif.body_parts import place_mask
from hfx_blender.formats.hjif.envelopes import Dense, timescale_of
from hfx_blender.formats.hjif.perceptions import (
    DATE,
    SUFFIX,
    TOO_WEAK,
    Place,
    document_of,
    perception_of,
    too_weak_places,
)
from hfx_blender.formats.hjif.semantics import is_date
from hfx_blender.formats.signals import losses
from hfx_blender.formats.signals.curves import clipped
from hfx_blender.formats.signals.signals import (
    DEFAULT_TOLERANCE,
    MAX_HZ,
    Credits,
    FrequencyRange,
    Signal,
    frequencies_through_silence,
    joined_times,
)
from hfx_blender.formats.signals.simplified_writer import error_note
from hfx_blender.formats.written import Written, write_json
from hfx_blender.text import counted

from . import hjif_signals

_TICK_S: Final = 1e-4
_SAMPLING_HZ: Final = 8000  # unit of the stored duration


def write(
    raster: Raster, device: DeviceConfig, stem: Path, tolerance: float = DEFAULT_TOLERANCE
) -> Written:
    """Write ``stem.hjif`` with a channel per actuator; strengths are relative to neutral values.
    Actuators silenced by the tolerance are noted. Raises OutputError for an unwritable file; no
    partial file remains."""
    columns = {(column.actuator, column.parameter): k for k, column in enumerate(raster.columns)}
    times = raster.times_s - raster.times_s[0]
    # The last row lasts a whole period, as in all formats.
    times = np.append(times, times[-1] + 1.0 / float(raster.rate_hz))
    timescale = timescale_of(raster.rate_hz, seconds=float(times[-1]))
    perceptions: list[dict[str, Any]] = []
    weak: list[str] = []
    for modality in device.modalities:
        places = []
        for actuator in device.actuators:
            kind = actuator.type
            if kind.modality != modality:
                continue
            column = columns[actuator.id, kind.strength.name]
            strength = raster.values[:, column] - raster.neutral[column]
            pitch = None
            if modality == "vibration":
                hertz = raster.values[:, columns[actuator.id, "frequency_hz"]]
                pitch = frequencies_through_silence(strength, np.clip(hertz, 0.0, MAX_HZ))
                pitch = np.append(pitch, pitch[-1])
            mask = place_mask(actuator.place, is_mirrored=device.is_mirrored)
            dense = Dense(times, np.append(strength, strength[-1]), pitch)
            places.append(Place(actuator.id, 1.0, mask, dense))
        perceptions.append(
            perception_of(len(perceptions), modality, places, (device,), timescale, tolerance)
        )
        weak += too_weak_places(perceptions[-1], places)
    path = stem.with_name(stem.name + SUFFIX)
    write_json(document_of(clean(stem.name), perceptions, timescale), path)
    left_out = losses.beyond_limits(raster, device, highest_m_s2=np.inf)
    within = f"curves are within {tolerance:.1%} of full scale"
    return Written((path,), left_out, (within, *counted(weak, TOO_WEAK)))


def write_signals(
    signals: Sequence[Signal],
    frequencies: FrequencyRange,
    stem: Path,
    tolerance: float = DEFAULT_TOLERANCE,
) -> Written:
    """Write vibration signals of another format as ``stem.hjif``, with an unknown full scale and
    the format's whole range of frequencies: ``frequencies`` is ignored, as for formats in Hz. The
    file is read back to measure the error. Raises OutputError for an unwritable file; no partial
    file remains."""
    timescale = timescale_of(Fraction(1000))
    places = [
        Place(signal.name, 1.0, 0, _dense(signal), transients=signal.transients)
        for signal in signals
    ]
    perception = perception_of(0, "vibration", places, (), timescale, tolerance, has_units=False)
    duration_s = max((signal.duration_s for signal in signals), default=0.0)
    # Keyframes end with the last sound.
    for channel in perception["channels"]:  # includes the silence at the end
        channel["frequency_sampling"] = _SAMPLING_HZ
        channel["sample_count"] = round(duration_s * _SAMPLING_HZ)
    credits = signals[0].credits if signals else Credits()
    date = credits.created if is_date(credits.created) else DATE
    title = clean(credits.description or stem.name)
    document = document_of(title, [perception], timescale, date=date)
    left_out = losses.off_range(signals, FrequencyRange(0.0, MAX_HZ))
    notes = counted(too_weak_places(perception, places), TOO_WEAK)
    path = stem.with_name(stem.name + SUFFIX)
    write_json(document, path)
    stored = {signal.name: signal for signal in hjif_signals.decode(read_bytes(path), path.name)[0]}
    pairs = [
        (
            replace(signal, frequency_hz=clipped(signal.frequency_hz, 0.0, MAX_HZ)),
            stored[clean(signal.name)],
        )
        for signal in signals
        if clean(signal.name) in stored
    ]
    return Written((path,), left_out, (error_note(pairs, 2.0 / timescale), *notes))


def _dense(signal: Signal) -> Dense:
    """Envelope at the keyframes of both curves; steps become ramps of 0.1 ms. Frequencies are
    clipped to 0..1000 Hz; rows are added 0.1 ms before and after silence."""
    end = float(signal.amplitude.times_s[-1])
    frequency = clipped(signal.frequency_hz, 0.0, MAX_HZ)
    times = joined_times([signal.amplitude, frequency], 0.0, end)
    knots, steps = signal.amplitude.times_s, np.diff(signal.amplitude.times_s) <= 0.0
    # Rows next to silence keep the signal's frequency exactly instead of ramping towards it.
    silent = times[(signal.amplitude.at(times) == 0.0) | (signal.amplitude.before(times) == 0.0)]
    beside = np.concatenate([knots[1:][steps] - _TICK_S, silent - _TICK_S, silent + _TICK_S])
    times = np.unique(np.concatenate([times, beside[(beside > 0.0) & (beside < end)]]))
    levels = signal.amplitude.at(times)
    # A step at the end has no duration after the jump: the value before counts.
    levels[-1] = signal.amplitude.before(times[-1])
    return Dense(times, levels, frequency.at(times))
