# SPDX-License-Identifier: GPL-3.0-or-later
"""Output to a multichannel sound card through PortAudio: one channel for each vibration actuator.

An actuator that takes a waveform plays the sum of its tones, any other the one sine of its values;
a tone is a sine, or the waveform that the actuator's type names.
The package ``sounddevice`` speaks to PortAudio: in the extension, or by pip's extra ``audio``. For
Windows and macOS it brings PortAudio, on Linux it uses the system's.
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
"""Time without values after which a card falls silent by itself, seconds: its thread
outlives ours."""

MAX_FREQUENCY_HZ: Final = 1000.0
RATE_HZ: Final = 48_000


class SoundCard:
    """A device on a sound card.

    Full scale is the largest amplitude that any of its actuators may be given.

    Parameters
    ----------
    interface : str
        Part of the card's name, or its number; empty: the system's own.
    first_channel : int
        From 1.

    Raises
    ------
    OutputLostError
        PortAudio is not installed, the device vibrates nowhere, there is no such card or more than
        one, or another device has one of the channels.
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
        self._sounding = np.array(sounding, np.int64)  # channels
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
            # Two names may lead to one card: PortAudio knows its number.
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
            # PortAudioError; ValueError for a name of no card, or of several.
            release(self._reserved)
            told = " ".join(str(error).split())
            raise OutputLostError(f"{self._name} cannot be opened ({told}).") from None

    def send(self, values: F64) -> None:
        """Hand over values (columns,).

        Raises
        ------
        OutputLostError
            The card is gone.
        """
        self._play_on(self._of_values(values))

    def send_tones(self, values: F64, tones: Tones) -> None:
        """Hand over values (columns,), and tones of the actuators that take a waveform.

        Raises
        ------
        OutputLostError
            The card is gone.
        """
        found = self._of_values(values)
        found.amplitudes[:, self._sounding] = 0.0
        rest = np.zeros((2, len(tones.numbers), found.amplitudes.shape[1]))
        rest[0][:, self._sounding] = tones.amplitudes
        rest[1][:, self._sounding] = np.minimum(tones.frequencies_hz, MAX_FREQUENCY_HZ)
        totals = np.broadcast_to(rest[0].sum(axis=0), rest[0].shape)
        rest[0] = driven(self._curves, rest[0], rest[1], self._full_scale, totals)
        # Plain values have a number of their own beside the tones'.
        self._play_on(
            Tones(
                np.append(found.numbers - 1, tones.numbers),
                np.vstack([found.amplitudes, rest[0]]),
                np.vstack([found.frequencies_hz, rest[1]]),
            )
        )

    def _of_values(self, values: F64) -> Tones:
        frequencies = np.minimum(values[self._frequency_columns], MAX_FREQUENCY_HZ)
        asked = values[self._amplitude_columns]
        amplitudes = driven(self._curves, asked, frequencies, self._full_scale)
        return Tones(np.array([LONE], np.int64), amplitudes[None], frequencies[None])

    def _play_on(self, tones: Tones) -> None:
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
        """Give the card back."""
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
        """Fill PortAudio's buffer; called in its thread."""
        outdata[:] = 0.0
        with self._lock:
            if time.monotonic() - self._values_s > DEAD_MAN_S:
                self._silence()
            outdata[:, self._first :] = self._waves.block(frames)

    def _finished(self) -> None:
        """Note the end of the stream; unless it was closed, the card is lost."""
        release(self._reserved)
        if not self._is_closed:
            self._lost = "it was unplugged, or another program took it"


def _library() -> Any:
    try:
        import sounddevice
    except ImportError as error:
        raise OutputLostError(
            "Sound cards need the Python package sounddevice: install the extension's zip for your "
            f"platform, which brings it; with pip, 'hfx-blender[audio]' ({error})."
        ) from None
    except OSError as error:  # its wheel for Linux brings no PortAudio
        raise OutputLostError(
            "Sound cards need the library PortAudio, which this system lacks: install its package, "
            f"on Debian and Ubuntu libportaudio2, on Fedora and Arch portaudio ({error})."
        ) from None
    return sounddevice


def _columns(device: DeviceConfig) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Columns of the amplitudes and frequencies of vibration actuators."""
    vibrates = [actuator.type.modality == "vibration" for actuator in device.actuators]
    found = device.strength_columns[vibrates]
    return found, found + 1
