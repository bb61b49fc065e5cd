# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration signals as envelopes: the content of most haptic file formats for an actuator.

Amplitude is a share of full scale, 0 to 1. Full scale is the largest amplitude accepted by any
vibration actuator of the device. Time 0 is the first row of the raster.
"""

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64, Bool
from ...engine.rendering.conditioning.actuator_limits import limited
from ...engine.rendering.device_config import Actuator, DeviceConfig
from ...engine.rendering.raster import Raster
from ...errors import InputError
from ...files import limits
from .curves import Curve, clipped, simplified

DEFAULT_TOLERANCE: Final = 0.01  # largest amplitude error, a share of full scale
MAX_HZ: Final = 1000.0  # upper limit of vibrotactile perception, hertz
TICK_S: Final = 0.022  # fade duration of a tick, seconds, as in HJIF's reference software
_SHOWN: Final = 60  # characters of a metadata text in a note


@dataclass(frozen=True)
class Credits:
    """Metadata about a file's origin; empty texts where the file states nothing.

    ``others`` are name and text of members specific to a format.
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
        """Non-empty metadata by name, ``others`` by their own; tags are joined by commas."""
        texts = {item.name: getattr(self, item.name) for item in fields(self)[:-2]}
        texts |= {"tags": ", ".join(self.tags), **dict(self.others)}
        return {name: text for name, text in texts.items() if text}

    def lost(self, held: Container[str], title: str) -> tuple[str, ...]:
        """Sentence about metadata outside the fields ``held`` of a format; empty without any."""
        others = dict(self.others)
        lost = [
            f"{name} '{text[:_SHOWN]}'"
            for name, text in self.texts.items()
            if ("others" if name in others else name) not in held
        ]
        return (f"{title} has no place for {', '.join(lost)}",) if lost else ()


def text_of(record: Any, key: str) -> str:
    """Stripped text of a document's member; empty for another type or a missing member."""
    value = record.get(key) if isinstance(record, dict) else None
    return value.strip() if isinstance(value, str) else ""


@dataclass(frozen=True)
class Transient:
    """Short tick at the same time."""

    time_s: float
    amplitude: float  # 0..1
    frequency_hz: float


@dataclass(frozen=True, eq=False)
class Signal:
    """Vibration signal of an actuator."""

    name: str
    amplitude: Curve  # 0..1; the last keyframe is the end of the signal
    frequency_hz: Curve
    transients: tuple[Transient, ...] = ()
    left_out: tuple[str, ...] = ()  # losses of reading, a sentence each
    notes: tuple[str, ...] = ()  # interpretations of the reader, a sentence each
    is_kept: bool = False  # write a file even if silent
    credits: Credits = field(default_factory=Credits)  # of the source file

    @property
    def duration_s(self) -> float:
        """The later time of the envelope's last keyframe and the last tick, seconds from time 0."""
        ends = [float(self.amplitude.times_s[-1]), *(tick.time_s for tick in self.transients)]
        return max(ends)

    @property
    def is_silent(self) -> bool:
        """True if no file is written: no tick, no positive keyframe, and not ``is_kept``."""
        is_felt = bool(self.transients) or bool((self.amplitude.values > 0.0).any())
        return not is_felt and not self.is_kept


@dataclass(frozen=True)
class FrequencyRange:
    """Frequencies of the values 0 and 1 in formats without hertz.

    Raises ValueError for a descending, negative or infinite range.
    """

    lowest_hz: float
    highest_hz: float
    is_stated: bool = field(default=True, compare=False)  # False: default of a format

    def __post_init__(self) -> None:
        if not 0.0 <= self.lowest_hz <= self.highest_hz < np.inf:
            raise ValueError(f"not a range of frequencies: {self}")

    def held(self, requested: "FrequencyRange") -> "FrequencyRange":
        """Range to store for a requested range, in a format with this default range.

        A stated range is kept. A single stated frequency widens the default range if outside; an
        unstated range becomes the default.
        """
        if not requested.is_stated:
            return self
        if requested.highest_hz > requested.lowest_hz:
            return requested
        return FrequencyRange(
            min(self.lowest_hz, requested.lowest_hz), max(self.highest_hz, requested.highest_hz)
        )

    def share(self, frequency_hz: npt.ArrayLike) -> F64:
        """Convert hertz to shares 0..1 of the range, clipped; 0 for a single frequency."""
        # A single frequency has no width to divide by.
        width = self.highest_hz - self.lowest_hz
        shares = (np.asarray(frequency_hz, np.float64) - self.lowest_hz) / (width or 1.0)
        return np.clip(shares, 0.0, 1.0) if width else np.zeros_like(shares)

    def hertz(self, share: npt.ArrayLike) -> F64:
        """Convert shares, clipped to 0..1, to hertz."""
        clipped = np.clip(np.asarray(share, np.float64), 0.0, 1.0)
        return self.lowest_hz + clipped * (self.highest_hz - self.lowest_hz)


def signals_of(raster: Raster, device: DeviceConfig) -> tuple[list[Signal], FrequencyRange]:
    """Convert the vibration of a raster to a signal per actuator, with a keyframe for each row.

    Values are linear between rows, as in a WAV file; the last row lasts one period. Silent rows
    take the frequency of the sounding row before (or else after). Raises InputError for a device
    without vibration actuators, and ValueError for a raster of another device.
    """
    if raster.device_id != device.id:
        raise ValueError(f"raster is for '{raster.device_id}', not for '{device.id}'")
    vibrating, pairs, full_scale = vibration_of(raster, device)
    if not full_scale:
        raise InputError(f"Device '{device.id}' has no vibration actuators.")
    times = raster.times_s - raster.times_s[0]
    # The last row lasts one period, so there is a keyframe after it.
    times = np.append(times, times[-1] + 1.0 / float(raster.rate_hz))
    signals = []
    for k, actuator in enumerate(vibrating):
        # Non-finite values become 0, others are clipped to full scale and MAX_HZ.
        safe = limited(pairs[:, k], 0.0, [full_scale, MAX_HZ], 0.0)
        amplitude, frequency = safe[:, 0] / full_scale, safe[:, 1]
        frequency = frequencies_through_silence(amplitude, frequency)
        signals.append(
            Signal(
                actuator.id,
                Curve(times, np.append(amplitude, amplitude[-1])),
                Curve(times, np.append(frequency, frequency[-1])),
            )
        )
    ranges = [actuator.type.controls[1] for actuator in vibrating]
    return signals, FrequencyRange(
        min(control.lowest for control in ranges),
        min(MAX_HZ, max(control.highest for control in ranges)),
    )


def vibration_of(raster: Raster, device: DeviceConfig) -> tuple[list[Actuator], F64, float]:
    """Vibration actuators, copies of their columns (T, C, 2), and their full scale, m/s^2. Columns
    are amplitude (m/s^2) and frequency (hertz). Without such actuators C is 0 and full scale 0."""
    vibrating = [actuator for actuator in device.actuators if actuator.type.modality == "vibration"]
    numbers = {(column.actuator, column.parameter): k for k, column in enumerate(raster.columns)}
    names = ("amplitude_m_s2", "frequency_hz")
    columns = [numbers[actuator.id, name] for actuator in vibrating for name in names]
    full_scale = max((actuator.type.strength.highest for actuator in vibrating), default=0.0)
    pairs = raster.values[:, columns].reshape(len(raster.values), len(vibrating), 2)
    return vibrating, pairs, full_scale


def frequencies_through_silence(amplitude: F64, frequency: F64) -> F64:
    """Replace the frequency of rows without amplitude by that of the sounding row before, or after.
    All (T,); unchanged for silence throughout."""
    sounds = np.flatnonzero(amplitude > 0.0)
    if not len(sounds):  # silence throughout: any frequency is right
        return frequency
    before = np.searchsorted(sounds, np.arange(len(amplitude)), side="right") - 1
    return np.asarray(frequency[sounds[np.maximum(before, 0)]])


def simplified_signals(
    signals: Iterable[Signal], tolerance: float = DEFAULT_TOLERANCE, *, frequency_hz: float = 1.0
) -> tuple[Signal, ...]:
    """Reduce signals to the fewest keyframes within a tolerance; silence stays exactly 0.

    ``tolerance`` is of the amplitude, a share of full scale; ``frequency_hz`` of the frequency,
    wherever the signal sounds.
    """
    reduced = []
    for signal in signals:
        amplitude = simplified(
            signal.amplitude, tolerance, lowest=0.0, highest=1.0, keeps_silence=True
        )
        # The frequency of silence is arbitrary, which leaves the simplification more freedom: only
        # keyframes before and after any time with sound matter.
        pitch = signal.frequency_hz
        knots = np.union1d(pitch.times_s, signal.amplitude.times_s)
        sounds = signal.amplitude.at(knots[:-1]) > 0.0
        sounds |= signal.amplitude.before(knots[1:]) > 0.0
        before = np.searchsorted(pitch.times_s, knots[:-1][sounds], side="right") - 1
        is_heard = np.zeros(len(pitch), np.bool_)
        is_heard[np.clip(np.concatenate((before, before + 1)), 0, len(pitch) - 1)] = True
        frequency = simplified(
            pitch,
            frequency_hz,
            lowest=float(pitch.values.min()),
            highest=float(pitch.values.max()),
            is_free=~is_heard if is_heard.any() and not is_heard.all() else None,
        )
        reduced.append(replace(signal, amplitude=amplitude, frequency_hz=frequency))
    return tuple(reduced)


def bursts(curve: Curve) -> list[tuple[int, int]]:
    """Sounding stretches as indices (first, last) of keyframes at their ends, of value 0. A stretch
    at the curve's own begin or end may begin or end above 0."""
    loud = curve.values > 0.0
    return stretches(loud[:-1] | loud[1:])  # pieces between two keyframes


def stretches(is_true: Bool, gap: int = 1) -> list[tuple[int, int]]:
    """Runs of True as (first, stop); runs with fewer than ``gap`` False between are joined."""
    true = np.flatnonzero(is_true)
    if not len(true):
        return []
    # Successive indices of True differ by 1 within a run, and by more across a gap.
    cuts = np.flatnonzero(np.diff(true) > gap)
    firsts, lasts = true[np.append(0, cuts + 1)], true[np.append(cuts, len(true) - 1)]
    return list(zip(firsts.tolist(), (lasts + 1).tolist(), strict=True))


def joined_times(curves: Sequence[Curve], start_s: float, end_s: float) -> F64:
    """Ascending distinct times: ``start_s``, ``end_s``, and keyframes of all curves between."""
    inside = [c.times_s[(c.times_s > start_s) & (c.times_s < end_s)] for c in curves]
    return np.unique(np.concatenate([[start_s], *inside, [end_s]]))


@dataclass(frozen=True, eq=False)
class Piece:
    """Part of a signal, silent before ``start_s`` and after ``end_s``."""

    start_s: float
    end_s: float
    amplitude: Curve
    frequency_hz: Curve


def mixed(
    name: str, pieces: Sequence[Piece], transients: Iterable[Transient] = (), end_s: float = 0.0
) -> Signal:
    """Mix overlapping pieces into a signal: amplitudes add, the strongest sets the frequency.

    Sums above 1 are clipped and reported in ``left_out``. ``end_s`` extends the signal with
    silence. Raises TooLargeError for too many overlapping keyframes.
    """
    # Pieces without duration are imperceptible, so dropping them loses nothing.
    sounding = [piece for piece in pieces if piece.end_s > piece.start_s]
    end_s = max([end_s, *(piece.end_s for piece in sounding)])
    bounds = [time for piece in sounding for time in (piece.start_s, piece.end_s)]
    # At least a millisecond, as a curve needs a duration.
    times = np.unique(np.concatenate([[0.0, end_s or 1e-3], bounds, *_times_inside(sounding)]))
    spans = [np.searchsorted(times, (piece.start_s, piece.end_s)).tolist() for piece in sounding]
    together = sum(last - first for first, last in spans)
    limits.OVERLAP.check(together, f"'{name}'", "what sounds at the same time has")
    # Row 0 holds the limits from the left, row 1 the values from each time on: pieces begin and
    # end with steps. An amplitude of 0 beats -1, so a silent begin of a piece has its frequency.
    sums, pitch = np.zeros((2, 2, len(times)))
    best = np.full((2, len(times)), -1.0)
    for piece, (first, last) in zip(sounding, spans, strict=True):
        for side, part in ((0, slice(first + 1, last + 1)), (1, slice(first, last))):
            at = times[part]
            value = piece.amplitude.at(at) if side else piece.amplitude.before(at)
            hertz = piece.frequency_hz.at(at) if side else piece.frequency_hz.before(at)
            stronger = value > best[side, part]
            sums[side, part] += value
            best[side, part] = np.where(stronger, value, best[side, part])
            pitch[side, part] = np.where(stronger, hertz, pitch[side, part])
    left_out: tuple[str, ...] = ()
    if sums.max(initial=0.0) > 1.0 + 1e-9:
        left_out = (f"'{name}': overlapping vibrations exceed full scale: clipped",)
    amplitude = clipped(_stepped(times, sums), 0.0, 1.0)
    # In time order, gaps between pieces (0 Hz) take the frequency of the last piece.
    flat = pitch.T.ravel()
    pitch = frequencies_through_silence(flat, flat).reshape(-1, 2).T
    return Signal(name, amplitude, _stepped(times, pitch), tuple(transients), left_out)


def _times_inside(pieces: Sequence[Piece]) -> list[F64]:
    """Arrays of the keyframe times of the pieces' curves, only within a piece using them."""
    # Thousands of pieces may share one control curve, whose times are searched only once.
    sharing: dict[int, tuple[F64, list[Piece]]] = {}
    for piece in pieces:
        for curve in (piece.amplitude, piece.frequency_hz):
            sharing.setdefault(id(curve.times_s), (curve.times_s, []))[1].append(piece)
    inside = []
    for times, users in sharing.values():
        begun = np.searchsorted(np.sort([piece.start_s for piece in users]), times, side="left")
        ended = np.searchsorted(np.sort([piece.end_s for piece in users]), times, side="right")
        inside.append(times[begun > ended])
    return inside


def _stepped(times: F64, sides: F64) -> Curve:
    """Curve through left and right limits (2, n) at ``times`` (n,), with steps where these differ.
    At the ends only the right limit of the first and the left limit of the last time count."""
    is_step = np.abs(sides[0] - sides[1]) > 1e-9
    is_step[[0, -1]] = False
    counts = 1 + is_step
    doubled = np.repeat(times, counts)
    values = np.repeat(sides[1], counts)
    first = np.cumsum(counts) - counts
    values[first[is_step]] = sides[0, is_step]
    values[-1] = sides[0, -1]  # the end has no right limit
    return Curve(doubled, values)
