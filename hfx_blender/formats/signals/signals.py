# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration as envelopes: the content of most haptic file formats for one actuator.

Amplitude is a share of full scale, 0 to 1; full scale is the largest amplitude that any
vibration actuator of the device may be given. Time 0 is the first row of the raster.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.rendering.conditioning.limits import limited
from ...engine.rendering.device import DeviceConfig
from ...engine.rendering.raster import Raster
from ...errors import InputError
from ...files import limits
from .curves import Curve, clipped, simplified

DEFAULT_TOLERANCE: Final = 0.01
"""Largest error of an amplitude, a share of full scale."""

MAX_HZ: Final = 1000.0
"""Skin feels no vibration above it."""

_SHOWN: Final = 60  # characters of a statement that a note repeats


@dataclass(frozen=True)
class Credits:
    """Statements about a file's origin; empty where it has none.

    ``others`` are members of its metadata that no other format has: name and text.
    """

    author: str = ""
    project: str = ""
    source: str = ""
    created: str = ""
    description: str = ""
    tags: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()

    @property
    def texts(self) -> dict[str, str]:
        """Statements that there are, by what they are about."""
        found = {each.name: getattr(self, each.name) for each in fields(self)[:-2]}
        found |= {"tags": ", ".join(self.tags), **dict(self.others)}
        return {name: text for name, text in found.items() if text}

    def lost(self, held: Container[str], title: str) -> tuple[str, ...]:
        """Sentence about statements that a format has no place for, if there are any."""
        others = dict(self.others)
        lost = [
            f"{name} '{text[:_SHOWN]}'"
            for name, text in self.texts.items()
            if ("others" if name in others else name) not in held
        ]
        return (f"{title} has no place for {', '.join(lost)}",) if lost else ()


def text_of(record: Any, key: str) -> str:
    """Text of a member of a document; empty if it has none, or no text."""
    found = record.get(key) if isinstance(record, dict) else None
    return found.strip() if isinstance(found, str) else ""


@dataclass(frozen=True)
class Transient:
    """A short tick."""

    time_s: float
    amplitude: float  # 0..1
    frequency_hz: float


@dataclass(frozen=True, eq=False)
class Signal:
    """Vibration of one actuator."""

    name: str
    amplitude: Curve  # 0..1; its last keyframe is the end
    frequency_hz: Curve
    transients: tuple[Transient, ...] = ()
    left_out: tuple[str, ...] = ()  # contents of the file left out here, one sentence each
    notes: tuple[str, ...] = ()  # how the file was read, one sentence each
    is_kept: bool = False  # its silence as well: a file of silence stays one
    credits: Credits = field(default_factory=Credits)  # of the file

    @property
    def duration_s(self) -> float:
        """End of the signal, seconds."""
        ends = [float(self.amplitude.times_s[-1]), *(each.time_s for each in self.transients)]
        return max(ends)

    @property
    def is_silent(self) -> bool:
        """Test that nothing of the signal would be felt, and that its silence is not kept."""
        is_felt = bool(self.transients) or bool((self.amplitude.values > 0.0).any())
        return not is_felt and not self.is_kept


def distinct(signals: Iterable[Signal]) -> list[Signal]:
    """Make the names of signals distinct, ignoring case: files are named after them."""
    taken: dict[str, int] = {}  # the last number that a name got
    found = []
    for each in signals:
        name, key = each.name, each.name.casefold()
        while name.casefold() in taken:
            taken[key] = taken.get(key, 1) + 1
            name = f"{each.name} {taken[key]}"
        taken[name.casefold()] = 1
        found.append(replace(each, name=name))
    return found


@dataclass(frozen=True)
class FrequencyRange:
    """Frequencies of 0 and 1 in formats without hertz: the range of the device's actuators."""

    lowest_hz: float
    highest_hz: float
    is_stated: bool = field(default=True, compare=False)  # of a device; else a format's own

    def __post_init__(self) -> None:
        if not 0.0 <= self.lowest_hz <= self.highest_hz < np.inf:
            raise ValueError(f"not a range of frequencies: {self}")

    def held(self, asked: FrequencyRange) -> FrequencyRange:
        """Range of a file for what is asked for, in a format that has this range of its own.

        A device's range stays. A device of a single frequency and what is of no device take the
        format's, for a device so wide that it holds its frequency.
        """
        if not asked.is_stated:
            return self
        if asked.highest_hz > asked.lowest_hz:
            return asked
        return FrequencyRange(
            min(self.lowest_hz, asked.lowest_hz), max(self.highest_hz, asked.highest_hz)
        )

    def share(self, frequency_hz: npt.ArrayLike) -> F64:
        """Convert frequencies to 0..1 of the range; 0 where the range is a single one."""
        width = self.highest_hz - self.lowest_hz
        shares = (np.asarray(frequency_hz, np.float64) - self.lowest_hz) / (width or 1.0)
        return np.clip(shares, 0.0, 1.0) if width else np.zeros_like(shares)

    def hertz(self, share: npt.ArrayLike) -> F64:
        """Convert shares of the range to frequencies."""
        clipped = np.clip(np.asarray(share, np.float64), 0.0, 1.0)
        return self.lowest_hz + clipped * (self.highest_hz - self.lowest_hz)


def signals_of(raster: Raster, device: DeviceConfig) -> tuple[list[Signal], FrequencyRange]:
    """The vibration of a raster, one signal an actuator, every row a keyframe.

    Values are straight from row to row, as in a WAV file; the last row lasts a row. Silent
    rows take over the frequency of what sounds next to them: theirs means nothing.

    Raises
    ------
    InputError
        The device has no vibration actuators.
    """
    if raster.device_id != device.id:
        raise ValueError(f"raster is for '{raster.device_id}', not for '{device.id}'")
    vibrating = [each for each in device.actuators if each.type.modality == "vibration"]
    full_scale = max((each.type.strength.highest for each in vibrating), default=0.0)
    if not full_scale:
        raise InputError(f"Device '{device.id}' has no vibration actuators.")
    columns = {(each.actuator, each.parameter): k for k, each in enumerate(raster.columns)}
    times = raster.times_s - raster.times_s[0]
    times = np.append(times, times[-1] + 1.0 / float(raster.rate_hz))
    signals = []
    for each in vibrating:
        pair = [columns[each.id, "amplitude_m_s2"], columns[each.id, "frequency_hz"]]
        safe = limited(raster.values[:, pair], 0.0, [full_scale, MAX_HZ], 0.0)
        amplitude, frequency = safe[:, 0] / full_scale, safe[:, 1]
        frequency = frequencies_through_silence(amplitude, frequency)
        signals.append(
            Signal(
                each.id,
                Curve(times, np.append(amplitude, amplitude[-1])),
                Curve(times, np.append(frequency, frequency[-1])),
            )
        )
    ranges = [each.type.controls[1] for each in vibrating]
    return signals, FrequencyRange(
        min(each.lowest for each in ranges), min(MAX_HZ, max(each.highest for each in ranges))
    )


def frequencies_through_silence(amplitude: F64, frequency: F64) -> F64:
    """Frequencies with silent rows filled from the sounding row before, or else after."""
    sounds = np.flatnonzero(amplitude > 0.0)
    if not len(sounds):
        return frequency
    before = np.searchsorted(sounds, np.arange(len(amplitude)), side="right") - 1
    return np.asarray(frequency[sounds[np.maximum(before, 0)]])


def simplified_signals(
    signals: Iterable[Signal],
    tolerance: float = DEFAULT_TOLERANCE,
    *,
    frequency_hz: float = 1.0,
) -> tuple[Signal, ...]:
    """Signals of the fewest keyframes within a tolerance; silence stays exactly silent.

    Parameters
    ----------
    tolerance : float
        Of the amplitude, as a share of full scale.
    frequency_hz : float
        Of the frequency while something sounds.
    """
    found = []
    for each in signals:
        amplitude = simplified(
            each.amplitude, tolerance, lowest=0.0, highest=1.0, keeps_silence=True
        )
        near = _is_heard(each)
        frequency = simplified(
            each.frequency_hz,
            frequency_hz,
            lowest=float(each.frequency_hz.values.min()),
            highest=float(each.frequency_hz.values.max()),
            is_free=~near if near.any() and not near.all() else None,
        )
        found.append(replace(each, amplitude=amplitude, frequency_hz=frequency))
    return tuple(found)


def _is_heard(signal: Signal) -> npt.NDArray[np.bool_]:
    """Mask of the frequency's keyframes beside which, before or after, something sounds."""
    times, amplitude = signal.frequency_hz.times_s, signal.amplitude
    knots = np.union1d(times, amplitude.times_s)
    sounds = (amplitude.at(knots[:-1]) > 0.0) | (amplitude.before(knots[1:]) > 0.0)
    before = np.searchsorted(times, knots[:-1][sounds], side="right") - 1
    found = np.zeros(len(times), np.bool_)
    for beside in (before, before + 1):
        found[np.clip(beside, 0, len(times) - 1)] = True
    return found


def bursts(curve: Curve) -> list[tuple[int, int]]:
    """Sounding stretches of keyframes, as (first, last): each begins and ends at 0.

    The first and the last stretch may begin or end loud, at the curve's own ends.
    """
    loud = curve.values > 0.0
    piece = loud[:-1] | loud[1:]  # between two keyframes something sounds
    edges = np.diff(np.concatenate([[0], piece.astype(np.int8), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return list(zip(begins.tolist(), ends.tolist(), strict=True))


def joined_times(curves: Sequence[Curve], start_s: float, end_s: float) -> F64:
    """All keyframe times of several curves from start to end, both included, each once."""
    inside = [c.times_s[(c.times_s > start_s) & (c.times_s < end_s)] for c in curves]
    return np.unique(np.concatenate([[start_s], *inside, [end_s]]))


@dataclass(frozen=True, eq=False)
class Piece:
    """Part of a signal: it sounds from start to end and is silent before and after."""

    start_s: float
    end_s: float
    amplitude: Curve
    frequency_hz: Curve


def mixed(
    name: str, pieces: Sequence[Piece], transients: Iterable[Transient] = (), end_s: float = 0.0
) -> Signal:
    """Mix pieces that may overlap into one signal: amplitudes add, the strongest gives the pitch.

    Raises
    ------
    TooLargeError
        So many pieces overlap that it is not the file of a sane tool.
    """
    # Pieces without duration are not felt: nothing is lost.
    kept = [each for each in pieces if each.end_s > each.start_s]
    end_s = max([end_s, *(each.end_s for each in kept)])
    bounds = [time for each in kept for time in (each.start_s, each.end_s)]
    times = np.unique(np.concatenate([[0.0, end_s or 1e-3], bounds, *_times_inside(kept)]))
    spans = [np.searchsorted(times, (each.start_s, each.end_s)).tolist() for each in kept]
    together = sum(last - first for first, last in spans)
    limits.OVERLAP.check(together, f"'{name}'", "what sounds at the same time has")
    sums, pitch = np.zeros((2, 2, len(times)))  # just before, and from each time on
    best = np.full((2, len(times)), -1.0)  # where a piece begins, it is silent but has a pitch
    for each, (first, last) in zip(kept, spans, strict=True):
        for side, part in ((0, slice(first + 1, last + 1)), (1, slice(first, last))):
            at = times[part]
            value = each.amplitude.at(at) if side else each.amplitude.before(at)
            hertz = each.frequency_hz.at(at) if side else each.frequency_hz.before(at)
            stronger = value > best[side, part]
            sums[side, part] += value
            best[side, part] = np.where(stronger, value, best[side, part])
            pitch[side, part] = np.where(stronger, hertz, pitch[side, part])
    left_out: tuple[str, ...] = ()
    if sums.max(initial=0.0) > 1.0 + 1e-9:
        left_out = (f"'{name}': what sounds together adds up to more than full scale: cut to it",)
    amplitude = clipped(_stepped(times, sums), 0.0, 1.0)
    pitch = _carried(pitch)
    return Signal(name, amplitude, _stepped(times, pitch), tuple(transients), left_out)


def _times_inside(pieces: Sequence[Piece]) -> list[F64]:
    """Keyframe times within the pieces whose curves have them.

    Thousands of pieces may share the times of one control: these are looked through once.
    """
    sharing: dict[int, tuple[F64, list[Piece]]] = {}
    for each in pieces:
        for curve in (each.amplitude, each.frequency_hz):
            sharing.setdefault(id(curve.times_s), (curve.times_s, []))[1].append(each)
    found = []
    for times, users in sharing.values():
        begun = np.searchsorted(np.sort([each.start_s for each in users]), times, side="left")
        ended = np.searchsorted(np.sort([each.end_s for each in users]), times, side="right")
        found.append(times[begun > ended])
    return found


def _carried(pitch: F64) -> F64:
    flat = pitch.T.ravel()
    return frequencies_through_silence(flat, flat).reshape(-1, 2).T


def _stepped(times: F64, sides: F64) -> Curve:
    """Curve with a step wherever the values before and after a time differ."""
    is_step = np.abs(sides[0] - sides[1]) > 1e-9
    is_step[[0, -1]] = False
    counts = 1 + is_step
    doubled = np.repeat(times, counts)
    values = np.repeat(sides[1], counts)
    first = np.cumsum(counts) - counts
    values[first[is_step]] = sides[0, is_step]
    values[-1] = sides[0, -1]  # the end is what was played up to it
    return Curve(doubled, values)
