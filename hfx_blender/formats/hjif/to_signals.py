# SPDX-License-Identifier: GPL-3.0-or-later
"""Envelopes of HJIF, for other formats and for effects of our own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from ... import file_limits
from ...errors import InputError
from ..curves import Curve
from ..signals import FrequencyRange, Piece, Signal, Transient, mixed
from .model import Band, Channel, Effect, Hjif, Keyframe, Perception
from .reader import decode as decode_document

DEFAULT_HZ: Final = 100.0
_DEEPEST: Final = 8


@dataclass(frozen=True, eq=False)
class Envelope:
    """Envelope of one channel, its gain included."""

    perception: str
    modality: str  # of the standard, such as "Vibrotactile"
    channel: str
    body_part_mask: int
    vertices: tuple[int, ...]
    strength: Curve  # times gain; of a curve band -1..1 of full scale
    frequency_hz: Curve | None  # None: curves have no pitch
    transients: tuple[Transient, ...]
    full_scale: float | None  # of its reference device, where that is known
    left_out: tuple[str, ...] = ()  # left-out parts, one sentence each


def decode(content: bytes, name: str) -> tuple[list[Signal], FrequencyRange]:
    """The vibration of a file, a signal a channel.

    Raises
    ------
    InputError
        It cannot be read, breaks the standard, or unfolds to more effects than is sane.
    """
    document = decode_document(content, name)
    signals = []
    lost: Counter[str] = Counter()  # channels that are no signal, by the reason
    for each in envelopes(document, name):
        if each.modality == "Vibrotactile" and each.frequency_hz is not None:
            values = np.clip(np.abs(each.strength.values), 0.0, 1.0)
            lost_here = each.left_out
            if values.any() and (np.abs(each.strength.values) > 1.0).any():
                lost_here += (f"'{each.channel}': is louder than full scale: cut to it",)
            signals.append(
                Signal(
                    each.channel,
                    Curve(each.strength.times_s, values),
                    each.frequency_hz,
                    each.transients,
                    lost_here,
                )
            )
        elif each.modality == "Vibrotactile":
            lost["vibration as curves without frequency"] += 1
        else:
            lost[f"modality {each.modality}"] += 1
    if signals and lost:
        told = tuple(f"{count} channels: {reason}" for reason, count in lost.items())
        signals[0] = replace(signals[0], left_out=told + signals[0].left_out)
    hertz = [
        float(f)
        for each in signals
        for f in (each.frequency_hz.values.min(), each.frequency_hz.values.max())
    ]
    hertz += [tick.frequency_hz for each in signals for tick in each.transients]
    return signals, FrequencyRange(min(hertz, default=0.0), max(hertz, default=1.0))


def envelopes(document: Hjif, name: str = "HJIF") -> Iterator[Envelope]:
    """Envelopes of all channels: all bands, references resolved, compositions unfolded.

    Wavelet bands are left out, which each envelope tells. ``name`` is the file's, for messages.

    Raises
    ------
    TooLargeError
        References unfold to more effects, or envelopes last longer, than a file may ask for.
    """
    unfolding = _Unfolding(name)
    timescale = document.timescale or 1000
    for perception in document.perceptions:
        devices = {each.id: each for each in perception.reference_devices or ()}
        for channel in perception.channels:
            device = devices.get(channel.reference_device_id or 0)
            full_scale = device.maximum_amplitude if device else None
            found = _envelope(perception, channel, timescale, full_scale, unfolding)
            ends = [float(found.strength.times_s[-1]), *(t.time_s for t in found.transients)]
            where = f"{name}: channel '{found.channel[:60]}'"
            file_limits.SECONDS.check(max(ends), where, "lasts")
            yield found


def _envelope(
    perception: Perception,
    channel: Channel,
    timescale: int,
    full_scale: float | None,
    unfolding: _Unfolding,
) -> Envelope:
    unfolding.library = {effect.id: effect for effect in perception.effect_library}
    lost: Counter[str] = Counter()
    pieces: list[Piece] = []
    transients: list[Transient] = []
    curves: list[Curve] = []
    for band in channel.bands:
        for start, effect in unfolding.effects(band.effects, 0, 0):
            frames = effect.keyframes or ()
            if band.band_type == "Transient":
                ticks = list(_ticks(frames, start, timescale, channel.gain, band))
                loud = sum(each.amplitude > 1.0 for each in ticks)
                if loud:
                    lost["are ticks louder than full scale: cut to it"] += loud
                transients += [replace(t, amplitude=min(t.amplitude, 1.0)) for t in ticks]
            elif band.band_type == "Curve" and frames:
                curves.append(_curve(frames, start, timescale, channel.gain))
            elif band.band_type == "VectorialWave" and frames:
                pieces.append(_piece(frames, start, timescale, channel.gain, band))
            else:
                lost[f"of a {band.band_type} band have no keyframes"] += 1
    name = channel.description or f"channel {channel.id}"
    if curves and (pieces or transients):
        lost["are curves beside waves or ticks"] += len(curves)
    left_out = tuple(f"'{name}': {count} effects {why}" for why, count in lost.items())
    shared = (
        perception.description,
        perception.perception_modality,
        name,
        channel.body_part_mask or 0,
        channel.vertices or (),
    )
    if curves and not pieces and not transients:
        strength = _one_after_another(curves)
        return Envelope(*shared, strength, None, (), full_scale, left_out)
    signal = mixed(name, pieces, transients)
    return Envelope(
        *shared,
        signal.amplitude,
        signal.frequency_hz,
        signal.transients,
        full_scale,
        left_out + signal.left_out,
    )


class _Unfolding:
    """Expansion of a file's effects with all references, counted."""

    def __init__(self, name: str) -> None:
        self.library: dict[int | None, Effect] = {}
        self._name = name
        self._count = 0

    def effects(
        self, effects: tuple[Effect, ...], start: int, depth: int
    ) -> Iterator[tuple[int, Effect]]:
        """Basis effects and their positions, ticks."""
        if depth > _DEEPEST:
            raise InputError(
                f"{self._name}: effects refer to each other more than {_DEEPEST} levels deep."
            )
        for effect in effects:
            self._count += 1 + len(effect.keyframes or ())
            file_limits.UNFOLDED.check(self._count, self._name, "its references unfold to")
            position = start + (effect.position or 0)
            if effect.effect_type == "Reference":
                target = self.library.get(effect.id)
                if target is not None:
                    yield from self.effects((target,), position, depth + 1)
            elif effect.effect_type == "Composite":
                yield from self.effects(effect.composition or (), position, depth + 1)
            else:
                yield position, effect


def _columns(
    frames: tuple[Keyframe, ...], start: int, timescale: int, gain: float
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Amplitudes and frequencies with their times; a keyframe need not have both."""
    levels, hertz = [], []
    for frame in frames:
        time = (start + (frame.relative_position or 0)) / timescale
        if frame.amplitude_modulation is not None:
            levels.append((time, gain * frame.amplitude_modulation))
        if frame.frequency_modulation is not None:
            hertz.append((time, float(frame.frequency_modulation)))
    return sorted(levels, key=_time), sorted(hertz, key=_time)


def _time(point: tuple[float, float]) -> float:
    return point[0]


def _points(points: list[tuple[float, float]], otherwise: tuple[float, float]) -> Curve:
    times, values = np.array(points or [otherwise], np.float64).T
    return Curve(times, values)


def _curve(frames: tuple[Keyframe, ...], start: int, timescale: int, gain: float) -> Curve:
    levels, _ = _columns(frames, start, timescale, gain)
    return _points(levels, (start / timescale, 0.0))


def _piece(
    frames: tuple[Keyframe, ...], start: int, timescale: int, gain: float, band: Band
) -> Piece:
    levels, hertz = _columns(frames, start, timescale, gain)
    begin = start / timescale
    middle = (band.lower_frequency_limit + band.upper_frequency_limit) / 2.0
    amplitude = _points([(time, abs(level)) for time, level in levels], (begin, gain))
    pitch = _points(hertz, (begin, middle or DEFAULT_HZ))
    ends = [float(amplitude.times_s[-1]), float(pitch.times_s[-1])]
    first = min(float(amplitude.times_s[0]), float(pitch.times_s[0]))
    return Piece(first, max(ends), amplitude, pitch)


def _ticks(
    frames: tuple[Keyframe, ...], start: int, timescale: int, gain: float, band: Band
) -> Iterator[Transient]:
    middle = (band.lower_frequency_limit + band.upper_frequency_limit) / 2.0
    for frame in frames:
        time = (start + (frame.relative_position or 0)) / timescale
        level = 1.0 if frame.amplitude_modulation is None else abs(frame.amplitude_modulation)
        hertz = frame.frequency_modulation
        pitch = middle if hertz is None else float(hertz)
        yield Transient(time, gain * level, pitch)


def _one_after_another(curves: list[Curve]) -> Curve:
    """Join curves in the order of time; where they overlap the later one goes on."""
    curves = sorted(curves, key=lambda each: float(each.times_s[0]))
    times, values = [curves[0].times_s], [curves[0].values]
    for before, after in pairwise(curves):
        kept = times[-1] <= after.times_s[0]
        times[-1], values[-1] = times[-1][kept], values[-1][kept]
        gap = float(after.times_s[0]) > float(before.times_s[-1])
        if gap:  # silent in between
            times.append(np.array([before.times_s[-1], after.times_s[0]]))
            values.append(np.zeros(2))
        times.append(after.times_s)
        values.append(after.values)
    joined = np.concatenate(times)
    order = np.argsort(joined, kind="stable")
    return Curve(joined[order], np.concatenate(values)[order])
