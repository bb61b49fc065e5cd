# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a multichannel sound card through PortAudio: one channel for each vibration actuator.

Actuators with a waveform play the sum of their tones, the rest a single tone of the values.
A tone is a sine, or the waveform of the actuator's type. The package ``sounddevice`` contains
PortAudio for Windows and macOS and uses the system's library on Linux.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64
from ...engine.rendering.conditioning.drive import driven
from ...engine.rendering.device_config import DeviceConfig
from ..host.oscillators import SumOfTones
from ..host.output import OutputLostError
from ..host.tones import LONE, Tones
from .reservations import Keys, release, reserve

DEAD_MAN_S: Final = 0.25
"""Time without values after which a card falls silent, seconds; checked in PortAudio's thread,
which goes on if a device thread hangs."""

MAX_FREQUENCY_HZ: Final = 1000.0
RATE_HZ: Final = 48_000
"""Sample rate."""


class SoundCard:
    """Output of a device's vibration actuators to successive channels of a sound card.

    Full scale is the largest amplitude limit of the actuators.

    ``interface``: part of the card's name, or the number; "": the system's default.
    ``first_channel``: channel of the first actuator, from 1.

    Raises OutputLostError: PortAudio is not installed, no actuator vibrates, no card or several
    match, or a channel is in use by another device.
    """

    def __init__(self, device: DeviceConfig, interface: str = "", first_channel: int = 1) -> None:
        self._amplitude_columns, self._frequency_columns = _columns(device)
        kinds = [a.type for a in device.actuators if a.type.modality == "vibration"]
        self._full_scale = max((kind.strength.highest for kind in kinds), default=0.0)
        if self._full_scale <= 0.0:
            raise OutputLostError(f"Device '{device.id}' has nothing that vibrates: no sound card.")
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
        library = _library()
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
        shares of full scale, and frequencies of at most 1000 Hz.
        """
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
        """Fade to silence within 5 ms."""
        with self._lock:
            self._silence()

    def close(self) -> None:
        """Close the stream and release the channels; never raises; may be called again."""
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
        """Fill PortAudio's ``outdata`` (frames, channels); fade out 0.25 s after the last send."""
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


def _library() -> Any:
    """Module ``sounddevice``; OutputLostError with instructions if a library is missing."""
    try:
        import sounddevice
    except ImportError as error:
        raise OutputLostError(
            "Sound cards need the Python package sounddevice: install the extension's zip for your "
            f"platform, which brings it; with pip, 'hfx-blender[audio]' ({error})."
        ) from None
    except OSError as error:  # the wheel for Linux does not contain PortAudio
        raise OutputLostError(
            "Sound cards need the library PortAudio, which this system lacks: install its package, "
            f"on Debian and Ubuntu libportaudio2, on Fedora and Arch portaudio ({error})."
        ) from None
    return sounddevice


def _columns(device: DeviceConfig) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Columns of the amplitudes and of the frequencies of the vibration actuators, in order."""
    vibrates = [actuator.type.modality == "vibration" for actuator in device.actuators]
    columns = device.strength_columns[vibrates]
    return columns, columns + 1
