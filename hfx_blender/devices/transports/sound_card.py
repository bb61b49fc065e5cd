# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a multichannel sound card through PortAudio: one channel for each vibration actuator.

Actuators with a waveform play the sum of their tones, the rest a single tone of the values.
A tone is a sine, or the waveform of the actuator's type, of a phase-continuous oscillator whose
samples are equal for any size of blocks. The package ``sounddevice`` contains PortAudio for Windows
and macOS and uses the system's library on Linux.
"""

import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.rendering.conditioning.waveform import (
    Waveform,
    cycles_on_the_way,
    cycles_since_the_beginning,
    cycles_until_it_repeats,
    driven,
    kept_through_silence,
    kinds_of,
    waves,
)
from ...engine.rendering.device_config import DeviceConfig
from ..host.output import OutputLostError
from ..host.tones import LONE, Tones
from .reservations import Keys, release, reserve

DEAD_MAN_S: Final = 0.25
"""Time without values after which a card falls silent, seconds; checked in PortAudio's thread,
which goes on if a device thread hangs."""

MAX_FREQUENCY_HZ: Final = 1000.0
RATE_HZ: Final = 48_000
"""Sample rate."""

RAMP_S: Final = 0.005  # duration of ramps to new amplitudes and frequencies, seconds; avoids clicks


class Oscillators:
    """Oscillators of C channels, all silent at first.

    ``waveforms``: waveform of each channel: sine, square or noise.
    ``rate_hz``: sample rate.
    ``begins_at``: number of samples played before, for the phase at a start from silence:
    oscillators of equal frequency are in phase.
    """

    def __init__(
        self, waveforms: Sequence[Waveform], rate_hz: float, *, begins_at: int = 0
    ) -> None:
        self._rate_hz = rate_hz
        self._kinds = kinds_of(waveforms)
        # Phases are kept modulo the period of the waveform, as large numbers lose precision.
        self._repeats = cycles_until_it_repeats(self._kinds)
        channels = len(waveforms)
        self._steps = max(1, round(RAMP_S * rate_hz))
        self._played = begins_at  # samples altogether
        self._cycles = np.zeros(channels)  # phase at the start of the ramp, modulo repeats
        # Start and target of the ramp: rows of amplitude and frequency.
        self._from = np.zeros((2, channels))
        self._to = np.zeros((2, channels))
        self._done = self._steps  # samples since the start of the ramp

    @property
    def is_silent(self) -> bool:
        """Test that all channels are silent and no ramp goes on."""
        return self._done >= self._steps and not self._to[0].any()

    def aim(self, amplitudes: F64, frequencies_hz: F64) -> None:
        """Start a ramp to new amplitudes and frequencies.

        ``amplitudes`` (C,): clipped to 0..1 of full scale.
        ``frequencies_hz`` (C,): clipped to 0..half the sample rate.
        A channel with a non-finite entry is silent.
        """
        target = np.array([amplitudes, frequencies_hz], np.float64)
        target[:, ~np.isfinite(target).all(axis=0)] = 0.0
        target[0] = np.clip(target[0], 0.0, 1.0)
        target[1] = np.clip(target[1], 0.0, 0.5 * self._rate_hz)
        # A new target within a ramp starts from the present values, without a step.
        share = min(self._done / self._steps, 1.0)
        here = self._from * (1.0 - share) + self._to * share
        # The phase goes on through the change; a start from silence takes that of the time since
        # 0.
        cycles = self._cycles_at(np.array([self._done]))[0] % self._repeats
        is_start = here[0] == 0.0
        # A silent end of a ramp gets the frequency of the sounding end: no glide in fades.
        here[1], target[1] = kept_through_silence((here[0], target[0]), (here[1], target[1]))
        since = cycles_since_the_beginning(target[1], self._played / self._rate_hz, self._repeats)
        self._cycles = np.where(is_start, since, cycles)
        self._from, self._to, self._done = here, target, 0

    def block(self, count: int) -> F64:
        """Next ``count`` samples (count, C), -1..1, in the ramp and then at the last targets."""
        steps = self._done + np.arange(1, count + 1)
        self._done += count
        self._played += count
        share = np.minimum(steps / self._steps, 1.0)[:, None]
        amplitudes = self._from[0], self._to[0]
        hz = self._from[1], self._to[1]
        return waves(self._kinds, amplitudes, hz, share, self._cycles_at(steps), self._rate_hz)

    def _cycles_at(self, steps: npt.NDArray[np.int64]) -> F64:
        """Phase (n, C) in cycles at ``steps`` (n,) samples after the start of the ramp: frequencies
        change linearly on the ramp and stay afterwards."""
        share = np.minimum(steps / self._steps, 1.0)[:, None]
        beyond_s = np.maximum(steps - self._steps, 0)[:, None] / self._rate_hz
        frequencies = self._from[1], self._to[1]
        on_ramp = cycles_on_the_way(frequencies, share, self._steps / self._rate_hz)
        return np.asarray(self._cycles + on_ramp + frequencies[1] * beyond_s)


class SumOfTones:
    """Sum of several tones on each of C channels, with a set of oscillators by tone number.

    ``waveforms``: waveform of all tones of each channel.
    """

    def __init__(self, waveforms: Sequence[Waveform], rate_hz: float) -> None:
        self._waveforms = tuple(waveforms)
        self._channels = len(self._waveforms)
        self._rate_hz = rate_hz
        self._played = 0
        self._sounding: dict[int, Oscillators] = {}

    def aim(self, tones: Tones) -> None:
        """Start 5 ms ramps to new tones, amplitudes (K, C) 0..1 of full scale; sounding tones whose
        number is missing fade out, new numbers start from silence."""
        nothing = np.zeros(self._channels)
        numbers = tones.numbers.tolist()
        for number, oscillators in self._sounding.items():
            if number not in numbers:
                oscillators.aim(nothing, nothing)
        for number, amplitudes, hz in zip(
            numbers, tones.amplitudes, tones.frequencies_hz, strict=True
        ):
            if number not in self._sounding:
                self._sounding[number] = Oscillators(
                    self._waveforms, self._rate_hz, begins_at=self._played
                )
            self._sounding[number].aim(amplitudes, hz)

    def block(self, count: int) -> F64:
        """Next samples (count, C); sums of tones may exceed -1..1."""
        samples = np.zeros((count, self._channels))
        for bank in self._sounding.values():
            samples += bank.block(count)
        self._played += count
        # Silent tones are dropped: a next start gets the phase from the count of samples.
        self._sounding = {n: bank for n, bank in self._sounding.items() if not bank.is_silent}
        return samples


class SoundCard:
    """Output of a device's vibration actuators to successive channels of a sound card.

    Full scale is the largest amplitude limit of the actuators.

    ``interface``: part of the card's name, or the number; "": the system's default.
    ``first_channel``: channel of the first actuator, from 1.

    Raises OutputLostError: PortAudio is not installed, no actuator vibrates, no card or several
    match, or a channel is in use by another device.
    """

    def __init__(self, device: DeviceConfig, interface: str = "", first_channel: int = 1) -> None:
        vibrates = [actuator.type.modality == "vibration" for actuator in device.actuators]
        self._amplitude_columns = device.strength_columns[vibrates]
        self._frequency_columns = self._amplitude_columns + 1
        kinds = [a.type for a in device.actuators if a.type.modality == "vibration"]
        self._full_scale = max((kind.strength.highest for kind in kinds), default=0.0)
        if self._full_scale <= 0.0:
            raise OutputLostError(
                f"Device '{device.name}' has nothing that vibrates: no sound card."
            )
        self._name = interface or "the sound card"
        self._first = first_channel - 1
        self._lock = threading.Lock()
        self._curves = [kind.drive for kind in kinds]
        sounding = [k for k, kind in enumerate(kinds) if kind.takes_waveform]
        self._sounding = np.array(sounding, np.int64)  # channels of actuators with a waveform
        self._waves = SumOfTones([kind.waveform for kind in kinds], RATE_HZ)
        self._values_s = time.monotonic()
        self._is_silent = True
        self._lost = ""
        self._is_closed = False
        self._reserved: Keys = frozenset()
        library = sound_library()
        try:
            chosen = int(interface) if interface.isdecimal() else (interface or None)
            self._stream: Any = library.OutputStream(
                device=chosen,
                samplerate=RATE_HZ,
                channels=self._first + len(kinds),
                dtype="float32",
                latency="low",
                callback=self._play,
                finished_callback=self._finished,
            )
            # By PortAudio's number, as a card has several names.
            card = getattr(self._stream, "device", interface)
            channels = range(self._first, self._first + len(kinds))
            self._reserved = reserve(
                (("sound card", card, channel) for channel in channels),
                f"A channel from {first_channel} on of {self._name}",
            )
            self._stream.start()
        except OutputLostError:
            self._stream.close()
            raise
        except Exception as error:
            # PortAudioError; ValueError if no card, or several cards, match the name.
            release(self._reserved)
            reason = " ".join(str(error).split())
            raise OutputLostError(f"{self._name} cannot be opened ({reason}).") from None

    def send(self, values: F64) -> None:
        """Play values (columns,); OutputLostError if the card is lost."""
        self._play_on(self._of_values(values))

    def send_tones(self, values: F64, tones: Tones) -> None:
        """Play tones at actuators with a waveform, and values (columns,) at the rest.

        Raises OutputLostError: the card is lost.
        """
        plain = self._of_values(values)
        plain.amplitudes[:, self._sounding] = 0.0
        # From actuators with a waveform to all channels of the card.
        shape = len(tones.numbers), plain.amplitudes.shape[1]
        amplitudes, hz = np.zeros(shape), np.zeros(shape)
        amplitudes[:, self._sounding] = tones.amplitudes
        hz[:, self._sounding] = np.minimum(tones.frequencies_hz, MAX_FREQUENCY_HZ)
        # Drive curves depend on the total output of an actuator, not on a single tone.
        totals = np.broadcast_to(amplitudes.sum(axis=0), shape)
        amplitudes = driven(self._curves, amplitudes, hz, self._full_scale, totals)
        # The tone of plain values gets a number below that of any tone: LONE may be in use.
        self._play_on(
            Tones(
                np.append(plain.numbers - 1, tones.numbers),
                np.vstack([plain.amplitudes, amplitudes]),
                np.vstack([plain.frequencies_hz, hz]),
            )
        )

    def _of_values(self, values: F64) -> Tones:
        """One tone :data:`LONE` (1, C) of values (columns,): amplitudes after the drive curves, as
        shares of full scale, and frequencies of at most 1000 Hz."""
        hz = np.minimum(values[self._frequency_columns], MAX_FREQUENCY_HZ)
        strengths = values[self._amplitude_columns]
        amplitudes = driven(self._curves, strengths, hz, self._full_scale)
        return Tones(np.array([LONE], np.int64), amplitudes[None], hz[None])

    def _play_on(self, tones: Tones) -> None:
        """Start ramps to ``tones`` of all channels, amplitudes 0..1; OutputLostError if lost."""
        if self._lost:
            raise OutputLostError(f"{self._name} is lost ({self._lost}).")
        with self._lock:
            self._values_s, self._is_silent = time.monotonic(), False
            self._waves.aim(tones)

    def stop(self) -> None:
        """Fade to silence within 5 ms, in PortAudio's thread; does not wait."""
        with self._lock:
            self._silence()

    def close(self) -> None:
        """Close the stream without a fade and release the channels; never raises; may be called
        again."""
        self._is_closed = True
        with suppress(Exception):
            self._stream.stop()
        with suppress(Exception):
            self._stream.close()
        release(self._reserved)

    def _silence(self) -> None:
        if not self._is_silent:
            self._is_silent = True
            self._waves.aim(Tones.none(len(self._amplitude_columns)))

    def _play(self, outdata: Any, frames: int, _time: Any, _status: Any) -> None:
        """Fill PortAudio's ``outdata`` (frames, channels): silence before the first channel, then
        the tones; fade out 0.25 s after the last send."""
        outdata[:] = 0.0
        with self._lock:
            # Dead-man switch: this thread goes on when the device thread hangs.
            if time.monotonic() - self._values_s > DEAD_MAN_S:
                self._silence()
            outdata[:, self._first :] = self._waves.block(frames)

    def _finished(self) -> None:
        """Mark the card as lost, unless the stream was closed; called in PortAudio's thread."""
        release(self._reserved)
        if not self._is_closed:
            self._lost = "it was unplugged, or another program took it"


@dataclass(frozen=True)
class Card:
    """Output of PortAudio's list."""

    name: str  # with the name of the sound system, as PortAudio accepts
    channels: int
    is_default: bool


def cards() -> list[Card]:
    """Sound cards with output, as PortAudio listed them at the first call in this process.
    OutputLostError with instructions if a library is missing."""
    library = sound_library()
    systems = library.query_hostapis()
    default = library.default.device[1]
    return [
        Card(f"{facts['name']}, {systems[facts['hostapi']]['name']}", channels, k == default)
        for k, facts in enumerate(library.query_devices())
        if (channels := facts["max_output_channels"]) > 0
    ]


def sound_library() -> Any:
    """Module ``sounddevice``; OutputLostError with instructions if a library is missing."""
    try:
        import sounddevice
    except ImportError:
        raise OutputLostError(
            "Sound cards need the Python package sounddevice: install the extension's zip for your "
            "platform, which brings it; with pip, 'hfx-blender[audio]'."
        ) from None
    except OSError as error:  # the wheel for Linux does not contain PortAudio
        raise OutputLostError(
            "Sound cards need the library PortAudio, which this system lacks: install its package, "
            f"on Debian and Ubuntu libportaudio2, on Fedora and Arch portaudio ({error})."
        ) from None
    return sounddevice
