# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster of a device from the vibration envelopes of a file."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import ceil
from typing import Final

import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.rendering.device_config import Actuator, DeviceConfig
from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.formats.device_files.tact_layouts import motors_of
from hfx_blender.formats.signals.signals import TICK_S, Signal

RATE_HZ: Final = 500


def raster_of(
    signals: Sequence[Signal], device: DeviceConfig, name: str
) -> tuple[Raster, tuple[str, ...], tuple[str, ...]]:
    """Sample signals at ``RATE_HZ`` as the raster of a device; returns raster, losses and notes.

    A signal plays on the vibration actuator of the same name, or on the actuator with a bHaptics
    dot of this name. A single signal without such an actuator plays on all vibration actuators;
    everything else stays neutral. Full scale is the largest amplitude of each actuator. Raises
    InputError for a device without vibration actuators or without matching names, and TooLargeError
    for too long signals; ``name`` is the file's name in messages.
    """
    played = _played(signals, device, name)
    columns = [
        (actuator, control) for actuator in device.actuators for control in actuator.type.controls
    ]
    # A tick at the end of a signal lasts beyond it.
    lasts_s = max(
        max([signal.duration_s, *(tick.time_s + TICK_S for tick in signal.transients)])
        for signal in signals
    )
    values_bytes = 8.0 * lasts_s * RATE_HZ * (len(columns) + 1)
    limits.MEMORY.check(values_bytes, name, f"values for '{device.id}' would take")
    times = np.arange(max(ceil(lasts_s * RATE_HZ - 1e-6), 1)) / RATE_HZ
    neutral = np.array([control.neutral for _, control in columns])
    values = np.tile(neutral, (len(times), 1))
    is_limited = False
    hidden: dict[str, int] = {}  # ticks weaker than the envelope, by signal
    for k, (actuator, control) in enumerate(columns):
        signal = played.get(actuator.id)
        if signal is None:
            continue
        # Each control column samples its signal; controls other than these two stay
        # neutral.
        amplitude, hertz, hidden[signal.name] = _dense(signal, times)
        if control.name == "amplitude_m_s2":
            values[:, k] = amplitude * control.highest
        elif control.name == "frequency_hz":
            values[:, k] = np.clip(hertz, control.lowest, control.highest)
            off = np.abs(values[:, k] - hertz)[amplitude > 0.0]
            is_limited |= bool((off > 1e-6).any())
    left_out = []
    unused = [signal.name for signal in signals if signal not in played.values()]
    if unused:
        left_out.append(f"'{device.id}' has no actuators {', '.join(unused)}")
    if is_limited:
        left_out.append(f"frequencies beyond those that '{device.id}' plays are at its limits")
    left_out += [
        f"'{name}': {count} ticks weaker than the envelope are left out"
        for name, count in hidden.items()
        if count
    ]
    raster = Raster(
        device_id=device.id,
        body_id="",
        actuators=tuple(signal.id for signal in device.actuators),
        columns=tuple(
            Column(actuator.id, control.name, actuator.type.unit(control))
            for actuator, control in columns
        ),
        times_s=times,
        rate_hz=Fraction(RATE_HZ),
        values=values,
        neutral=neutral,
        shortfalls=(),
        felt=(),
    )
    return raster, tuple(left_out), (f"envelopes are sampled {RATE_HZ} times a second",)


def _played(signals: Sequence[Signal], device: DeviceConfig, name: str) -> dict[str, Signal]:
    """Signal of each vibration actuator with a signal, by actuator id: of the same name, else of
    its bHaptics dot, else a single signal for all. Names match in any case. Raises InputError
    without a vibration actuator or match."""
    vibrating: list[Actuator] = [a for a in device.actuators if a.type.modality == "vibration"]
    if not vibrating:
        raise InputError(f"Device '{device.id}' has no vibration actuators.")
    named = {signal.name.casefold(): signal for signal in signals}
    matching = {a.id: named[a.id.casefold()] for a in vibrating if a.id.casefold() in named}
    # Files of bHaptics name signals by dots instead of actuators.
    if not matching:
        dots = {key: f"{dot.position} {dot.index}" for key, dot in motors_of(device).items()}
        matching = {
            key: named[dot.casefold()] for key, dot in dots.items() if dot.casefold() in named
        }
    if not matching and len(signals) == 1:
        return {a.id: signals[0] for a in vibrating}
    if not matching:
        shown = ", ".join(signal.name for signal in signals[:6])
        raise InputError(
            f"{name}: holds signals for {shown}{', ...' * (len(signals) > 6)}; the vibration "
            f"actuators of '{device.id}' are {', '.join(a.id for a in vibrating)}."
        )
    return matching


def _dense(signal: Signal, times: F64) -> tuple[F64, F64, int]:
    """Amplitude (0..1) and Hz at times (T,) with ticks; third, the number of hidden ticks. A tick
    fades linearly over 22 ms; it is hidden if nowhere stronger than the envelope."""
    hidden = 0
    amplitude = np.where(times < signal.amplitude.times_s[-1], signal.amplitude.at(times), 0.0)
    hertz = signal.frequency_hz.at(times)
    for tick in signal.transients:
        # A tick starts at the next row: its peak would otherwise fall between two rows.
        first = ceil(tick.time_s * RATE_HZ - 1e-6)
        fade = np.linspace(tick.amplitude, 0.0, ceil(TICK_S * RATE_HZ), endpoint=False)
        part = slice(first, first + len(fade))
        fade = fade[: len(amplitude[part])]
        # The stronger of tick and envelope plays, with its own frequency.
        is_stronger = fade > amplitude[part]
        hidden += not is_stronger.any()
        amplitude[part] = np.where(is_stronger, fade, amplitude[part])
        hertz[part] = np.where(is_stronger, tick.frequency_hz, hertz[part])
    return amplitude, hertz, hidden
