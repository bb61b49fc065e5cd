# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration that follows a sound: envelope, spectral centroid and onsets.

The spectrum is divided into bands an octave apart. A band is an analytic signal, so the power of a
steady tone is constant, at any frequency. The first moment of a spectrum is the mean of the
instantaneous frequency, weighted by power (Cohen, "Time-Frequency Analysis", 1995, section 1.4).
Onsets are rises of a band over the largest value shortly before, in this band and its neighbours
(Boeck and Widmer, "Maximum filter vibrato suppression for onset detection", DAFx 2013).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64, I64
from ...errors import InputError
from ...files import limits
from ..signals.curves import Curve
from ..signals.signals import FrequencyRange, Signal, Transient, frequencies_through_silence

DEFAULT_RANGE: Final = FrequencyRange(65.0, 300.0, is_stated=False)
"""Frequencies without a device, those of a phone in MPEG's reference software."""

FRAME_HZ: Final = 500  # frames a second of the analysis
_CORE_S: Final = 24  # seconds analysed at a time, and the context before and after
_MARGIN_S: Final = 2
_NEAR: Final = FRAME_HZ  # frames of the context of an onset, before and after
_KEYS_HZ: Final = 250  # keyframes a second of the result
_SILENT: Final = 1e-6  # amplitude that counts as silence, a share of full scale
_RATES_HZ: Final = (100, 768_000)
_QUIET_DB: Final = -40.0  # level that counts as silence, relative to the loudest nearby
_RISE_DB: Final = 9.5
_RISE_OF_ALL_DB: Final = 6.0  # the same for the mean level of all bands
_RARE: Final = 4.0  # multiple of the usual rises of a band that an onset exceeds
_RARE_BEAT: Final = 9.0  # the same, of a lower percentile, where the whole sound rises
_APART: Final = 25  # frames between two onsets, at least
_PERIOD: Final = 30  # frames: pulses closer than this are a tone
_FAST_PERIOD: Final = 10  # the same, where the whole sound beats fast
_DENSE: Final = 0.07  # share of frames in beats from which on they are fast
_LAG: Final = 4  # frames of the rise of an onset, at least
_CUT: Final = 15  # frames before the end of a sound that its end disturbs
_GAP: Final = 12  # frames around a gap without onsets
_PART: Final = 0.002  # least share of the power in bands with an onset


@dataclass(frozen=True)
class SoundSettings:
    """How vibration follows a sound."""

    strength: float = 1.0  # largest amplitude, a share of full scale
    smoothing_s: float = 0.012  # length of the window that smooths the envelope
    band_hz: tuple[float, float] = (20.0, 8000.0)  # part of the sound that is followed
    threshold_db: float = -40.0  # silent below this level, relative to the loudest moment
    frequencies: FrequencyRange = DEFAULT_RANGE  # of the device

    def __post_init__(self) -> None:
        """Raise ValueError for a setting out of range; it names the option of ``hfx convert``."""
        low, high = self.band_hz
        for option, is_valid, allowed in (
            ("strength", 0.0 < self.strength <= 1.0, "more than 0, up to 100 %"),
            ("smoothing", 0.002 <= self.smoothing_s <= 1.0, "2 to 1000 ms"),
            ("band", 10.0 <= low <= 0.7 * high < 48e3, "LOW:HIGH, 10 to 48000 Hz, half an octave"),
            ("threshold", -80.0 <= self.threshold_db <= 0.0, "-80 to 0 dB"),
        ):
            if not is_valid:
                raise ValueError(f"--{option}: expected {allowed}")

    def vibration_hz(self, pitch_hz: npt.ArrayLike) -> F64:
        """Frequencies of the vibration for frequencies of the sound."""
        low, high = self.band_hz
        return self.frequencies.hertz(np.log(np.divide(pitch_hz, low)) / np.log(high / low))


def followed(
    blocks: Iterable[npt.NDArray[np.float32]], rate_hz: int, name: str, settings: SoundSettings
) -> Signal:
    """Vibration that follows a sound, streamed as blocks (n, channels) of full scale 1.

    The loudest moment gets the amplitude ``settings.strength``. The logarithm of the centroid, over
    the band, spans the frequencies of the device. Powers of channels are averaged, so opposite
    channels do not cancel. Samples that are not finite are bridged by lines, and noted. Raises
    InputError for no samples, a rate that is not 100 to 768,000 Hz, or a band above half the rate,
    and TooLargeError for too many channels; ``name`` begins the message.
    """
    from scipy.ndimage import convolve1d, maximum_filter1d, uniform_filter1d

    if not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        raise InputError(f"{name}: has {rate_hz} samples a second; allowed are 100 to 768000.")
    low, high = settings.band_hz[0], min(settings.band_hz[1], rate_hz / 2.0)
    if low >= high:
        raise InputError(f"{name}: has {rate_hz} samples a second, so it ends below {low:g} Hz.")
    counts = np.zeros(2, np.int64)
    core = slice(_MARGIN_S * FRAME_HZ, (_MARGIN_S + _CORE_S) * FRAME_HZ)
    window = np.hanning(2 * round(settings.smoothing_s * FRAME_HZ / 2.0) + 3)[1:-1]
    short = np.hanning(len(window) // 2 + 2)[1:-1]  # of beats
    levels, pitches = [np.zeros(0)], [np.zeros(0)]
    centres, _ = _centres((low, high))
    ticks: list[tuple[int, float]] = []
    gaps: set[int] = set()
    for number, part in enumerate(_parts(blocks, rate_hz, name, counts, gaps)):
        powers, moments = _bands(part, rate_hz, (low, high))
        whole, powers, moments = powers[:, -1], powers[:, :-1], moments[:, :-1]
        first = number * _CORE_S * FRAME_HZ - core.start  # in the sound, of the part
        span = max(-first, 0), min(ceil(counts[0] / rate_hz * FRAME_HZ) - first, len(powers))
        onsets = list(_onsets(powers, centres, *span))
        # The sum of bands has no ripple, and blurs beats; the whole is sharp, and ripples.
        share = np.zeros(len(powers))
        share[[k for k, _ in onsets]] = 1.0
        share = uniform_filter1d(maximum_filter1d(share, 2 * _PERIOD + 1), _PERIOD)
        power, moment = (convolve1d(p.sum(1), window / window.sum()) for p in (powers, moments))
        level = share * convolve1d(whole, short / short.sum()) + (1.0 - share) * power
        levels.append(np.sqrt(level[core]))
        pitches.append((moment[core] / power[core].clip(1e-20)).clip(low, high))
        peaks = np.sqrt(_largest(level, 0, _APART // 2))
        onsets = [(k, max(peak, float(peaks[k]))) for k, peak in onsets]
        ticks += [(first + k, peak) for k, peak in onsets if core.start <= k < core.stop]
    if not counts[0]:
        raise InputError(f"{name}: holds no sound.")
    duration_s = float(counts[0] / rate_hz)
    # Frame k is the mean from k / FRAME_HZ on; the envelope ends with the sound.
    times = np.arange(ceil(duration_s * FRAME_HZ)) / FRAME_HZ + 0.5 / FRAME_HZ
    level, pitch = np.concatenate(levels)[: len(times)], np.concatenate(pitches)[: len(times)]
    loudest = max(float(level.max()), _SILENT)
    gate = max(loudest * 10.0 ** (settings.threshold_db / 20.0), _SILENT)
    amplitude = np.where(level > gate, settings.strength * level / loudest, 0.0)
    hertz = frequencies_through_silence(amplitude, settings.vibration_hz(pitch))
    keys = slice(FRAME_HZ // _KEYS_HZ, None, FRAME_HZ // _KEYS_HZ)
    ends = max(duration_s, times[-1])
    transients = tuple(
        Transient(
            (frame + 1) / FRAME_HZ,
            min(settings.strength * peak / loudest, 1.0),
            float(hertz[min(frame + 5, len(hertz) - 1)]),
        )
        for frame, peak in ticks
        if frame < len(times)
        and peak > gate
        # A gap ends with a rise; nothing begins there.
        and gaps.isdisjoint(range(frame - _GAP, frame + _GAP))
    )
    notes = (f"{counts[1]} samples are no finite numbers: lines bridge them, silent if long",)
    return Signal(
        name,
        Curve(np.r_[0.0, times[keys], ends], np.r_[amplitude[0], amplitude[keys], 0.0]),
        Curve(np.r_[0.0, times[keys]], np.r_[hertz[0], hertz[keys]]),
        transients,
        notes=notes if counts[1] else (),
    )


def _parts(
    blocks: Iterable[npt.NDArray[np.float32]], rate_hz: int, name: str, counts: I64, gaps: set[int]
) -> Iterator[npt.NDArray[np.float32]]:
    """Yield parts (n, channels) of core and margins, silent before the begin and after the end of
    the sound. Adds in place to ``counts`` the samples read and values that are not finite, and to
    ``gaps`` the first and last frames of gaps of such values."""
    core, length = _CORE_S * rate_hz, (_CORE_S + 2 * _MARGIN_S) * rate_hz
    begun, joined = 0, np.zeros((0, 0), np.float32)
    for block in blocks:
        if not joined.size:
            limits.MEMORY.check(8.0 * length * block.shape[1], name, "half a minute would take")
            joined = np.zeros((_MARGIN_S * rate_hz, block.shape[1]), np.float32)
        is_lost = np.pad(~np.isfinite(block).all(1), 1)
        ends = np.flatnonzero(is_lost[1:] != is_lost[:-1]) + counts[0]
        gaps |= set((ends * FRAME_HZ // rate_hz).tolist())
        counts += len(block), np.count_nonzero(~np.isfinite(block))
        joined = np.concatenate([joined, block])
        while len(joined) >= length:
            yield _mended(joined[:length], begun, rate_hz)
            begun, joined = begun + core, joined[core:]
    while begun < counts[0]:
        yield _mended(joined[:length], begun, rate_hz)
        begun, joined = begun + core, joined[core:]


def _mended(part: npt.NDArray[np.float32], begun: int, rate_hz: int) -> npt.NDArray[np.float32]:
    """Part (n, channels) without the sound's offset and drift; gaps become lines."""
    from scipy.signal import detrend

    margin, length = max(_MARGIN_S * rate_hz - begun, 0), (_CORE_S + 2 * _MARGIN_S) * rate_hz
    sound = part[margin:].copy()
    for column in sound.T:
        known = np.flatnonzero(np.isfinite(column))
        if len(known) < len(column):
            column[:] = np.interp(range(len(column)), known, column[known]) if len(known) else 0.0
    # The step from an offset, also a drifting one, to the silence around would be a click.
    if len(sound):
        sound = detrend(sound, axis=0).astype(np.float32)
    return np.pad(sound, ((margin, length - len(part)), (0, 0)))


def _bands(
    part: npt.NDArray[np.float32], rate_hz: int, band_hz: tuple[float, float]
) -> tuple[F64, F64]:
    """Power of octave bands and of the whole (frames, bands + 1), 1 for a sine of full scale, and
    its product with the mean frequency (Hz), of a part (n, channels) of whole seconds."""
    from scipy.fft import ifft, rfft

    (low, high), seconds, channels = band_hz, len(part) // rate_hz, part.shape[1]
    centres, step = _centres(band_hz)
    powers = np.zeros((2, seconds * FRAME_HZ, len(centres) + 1))
    for channel in range(channels):
        spectrum = rfft(part[:, channel]) * (2.0 / len(part))
        for k, centre in enumerate([*centres.tolist(), 0.0]):
            # Neighbours overlap, and the squares of their gains add to 1; the outer ends are flat.
            width = step if k < len(centres) else np.inf
            first = int(max(low, 2.0 ** (centre - width)) * seconds)
            stop = min(int(min(high, 2.0 ** (centre + width)) * seconds) + 1, len(spectrum))
            hertz = np.arange(first, stop) / seconds
            way = (np.log2(hertz) - centre) / width
            way = np.clip(way, -1.0 if k else 0.0, 1.0 if k + 1 < len(centres) else 0.0)
            bins = spectrum[first:stop] * np.cos(np.pi / 2.0 * way)
            # The band is moved to 0 Hz, where few samples a frame hold its power.
            fold = max(1, ceil(2 * (stop - first) / (seconds * FRAME_HZ)))
            size = seconds * FRAME_HZ * fold
            signal, product = ifft(bins, size) * size, ifft(bins * hertz, size) * size
            values = np.stack((abs(signal) ** 2, (signal.conj() * product).real))
            powers[:, :, k] += values.reshape(2, -1, fold).mean(2) / channels
    return powers[0], powers[1]


def _centres(band_hz: tuple[float, float]) -> tuple[F64, float]:
    """Binary logarithms of the centres (Hz) of bands of about an octave, and their step."""
    octaves = float(np.log2(band_hz[1] / band_hz[0]))
    step = octaves / max(1, round(octaves))
    return np.log2(band_hz[0]) + np.arange(step / 2.0, octaves, step), step


def _onsets(powers: F64, centres: F64, begin: int, end: int) -> Iterator[tuple[int, float]]:
    """Yield frame and following peak amplitude of the onsets in band powers (frames, bands).

    An onset is a rise, of some band, that is fast for the band, rare for its last and next second,
    and no fall of the total. The sound has the frames ``begin`` to ``end``. At its first frame, if
    not 0, only a sound that decays has an onset: a recording of a steady sound begins anywhere.
    """
    from scipy.ndimage import convolve1d, maximum_filter1d, uniform_filter1d
    from scipy.signal import find_peaks

    window = np.hanning(7)[1:-1]
    power = convolve1d(powers, window / window.sum(), axis=0)
    total = power.sum(1)
    # Silence is relative to the loudest nearby. It changes slowly: its step, a second before a loud
    # moment, would be a rise of all quiet bands.
    near = maximum_filter1d(total, 3 * _NEAR + 1)
    near_db = 10.0 * np.log10(near.clip(max(1e-6 * near.max(), 1e-12)))
    silence = 10.0 ** ((_QUIET_DB + uniform_filter1d(near_db, _NEAR)) / 10.0)
    level = 10.0 * np.log10(power + silence[:, None])
    # The mean level of all bands is a further band: it is steady in noise, so a small rise counts.
    level = np.append(level, level.mean(1, keepdims=True), axis=1)
    power = np.append(power, total[:, None], axis=1)
    least = np.append(np.full(len(centres), _RISE_DB), _RISE_OF_ALL_DB)
    # A band of width B needs 1 / B seconds to rise.
    lags = [*np.ceil(0.6 * FRAME_HZ / 2.0**centres).astype(int).tolist(), _LAG]
    # Where the whole sound rises at once, as it does not in noise, regular beats are rare enough.
    total_db = 10.0 * np.log10(total + silence)
    is_beat = total_db - _largest(total_db, -_FAST_PERIOD, -2 * _LAG) >= _RISE_DB
    is_near = maximum_filter1d(is_beat, 21)[:, None]
    is_dense = uniform_filter1d(is_beat.astype(float), _NEAR // 2)[:, None] > _DENSE
    slow, fast = (
        np.stack(
            [
                _largest(level[:, k], -max(n, lag + 2), -max(lag, _LAG))
                for k, lag in enumerate(lags)
            ],
            axis=1,
        )
        for n in (_PERIOD, _FAST_PERIOD)
    )
    rise = np.maximum(level - np.where(is_dense, fast, slow), 0.0)
    amplitude = 10.0 ** (level / 20.0)
    # Half of the coming peak is reached within the rise time: a swell is no onset.
    is_attack = amplitude >= 0.5 * _largest(amplitude, 0, _APART)
    starts = np.arange(0, len(rise), _NEAR // 4)
    # The silence before and after the sound does not count as usual.
    firsts = np.clip(starts - _NEAR, begin, max(end - 2 * _NEAR, begin))
    usual = np.zeros((len(starts), 3, len(lags)))
    for k, first in enumerate(firsts):
        part = slice(first, min(first + 2 * _NEAR, end))
        usual[k] = np.percentile(rise[part], (90, 90, 70), axis=0)
        # A low band rises for long, from before a beat on: these rises would count as usual.
        between = np.where(is_attack, rise, 0.0)[part][~is_near[part, 0]]
        if len(between):
            usual[k, 1] = np.percentile(between, 90, axis=0)
    rare, less_rare, dense = np.repeat(usual, _NEAR // 4, axis=0)[: len(rise)].transpose(1, 0, 2)
    beats = _RARE_BEAT * np.where(is_dense, dense, less_rare)
    usual_rise = np.where(is_near, beats, _RARE * rare)
    excess = np.where(is_attack, rise - least - usual_rise, 0.0).clip(0.0)
    is_part = (power * (excess > 0.0)).sum(1) >= _PART * _largest(total, 0, _APART // 2)
    # The end of a tone is a click, too, of all bands: the total does not rise there.
    earlier = _largest(total, -_APART, -_LAG)
    after = np.roll(uniform_filter1d(total, _APART), -_APART // 2 - 8)
    # The cut at the end of the sound is a click unless the total rises like an onset.
    is_cut = np.arange(len(total)) >= end - _CUT
    least_total = earlier * np.where(is_cut, 10.0 ** (_RISE_DB / 10.0), 1.25)
    is_kept = (_largest(total, -2, 8) >= least_total) | ~is_cut & (after >= 0.5 * earlier)
    frames, _ = find_peaks(np.where(is_part & is_kept, excess.sum(1), 0.0), distance=_APART)
    rest = total[begin + 2 * _APART : min(begin + 10 * _APART, end)]
    later = np.median(rest) if begin and len(rest) else 0.0
    stop = min([*frames[frames > begin + _APART].tolist(), end]) - _CUT
    is_struck = later <= 0.1 * total[begin : begin + _APART].max()
    is_struck |= _decays(total[begin + _APART : stop])
    for peak in frames[frames >= begin - _LAG].tolist():
        # The root of smoothed power rises steepest 1.5 frames early: the next frame's end counts.
        first = max(peak - 10, 0)
        rising = amplitude[first : peak + 10, excess[first : peak + 10].max(0) > 0.0]
        rising = (rising / rising.max(0)).sum(1)
        frame = max(first + int(np.gradient(rising).argmax()) + 1, begin)
        if abs(frame - begin) <= 3 * _LAG and not is_struck:
            continue
        yield frame, float(np.sqrt(total[frame : frame + _APART // 2].max()))


def _decays(power: F64) -> bool:
    """Test the power (frames,) of 0.25 s or more for a decay down to -20 dB, or to its end: the
    level falls along a line, by 1.5 dB and by eight times its deviation from the line."""
    power = power[: 4 * FRAME_HZ]
    is_low = np.append(power < 0.01 * power[:1].sum(), True)
    level = 10.0 * np.log10(power[: int(is_low.argmax())] + 1e-12)
    if len(level) < FRAME_HZ // 4:
        return False
    frames = np.arange(len(level))
    slope, height = np.polyfit(frames, level, 1)
    deviation = np.sqrt(np.mean((slope * frames + height - level) ** 2))
    return bool(-slope * len(level) >= max(1.5, 8.0 * deviation))


def _largest(values: F64, first: int, last: int) -> F64:
    """Largest of the values (frames, ...) from ``first`` to ``last`` frames after each frame."""
    from scipy.ndimage import maximum_filter1d

    centred = maximum_filter1d(values, last - first + 1, axis=0, mode="constant")
    return np.roll(centred, -(first + (last - first + 1) // 2), axis=0)
