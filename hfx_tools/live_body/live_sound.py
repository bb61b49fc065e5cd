# SPDX-License-Identifier: GPL-3.0-or-later
"""Sound of a clip's volumes around the head of a tracked body, on a sound card."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Final

import numpy as np

from hfx_blender.devices.transports.sound_card import sound_library
from hfx_blender.errors import DeviceError, InputError
from hfx_blender.formats.sound.wav import RATE_HZ

from ..spatial_sound.live_mix import LiveMix
from ..spatial_sound.loudspeakers import Panner
from ..spatial_sound.sound_settings import SoundSettings
from ..spatial_sound.spatial_mix import Reverberators
from .felt_bodies import FeltBodies

BLOCK: Final = 1024
"""Samples of a block, 21 ms."""


class LiveSound:
    """Stream to a sound card, open until :meth:`close`; the head is that of the first body.

    ``card``: part of the card's name; "": the default of the system. Raises DeviceError: PortAudio
    is missing or the card cannot be opened; InputError: the clip has no volume.
    """

    def __init__(self, bodies: FeltBodies, settings: SoundSettings, card: str = "") -> None:
        if not bodies.volumes:
            raise InputError("The clip has no volume that makes sound.")
        self._bodies, self._settings = bodies, settings
        tones = np.array([settings.tone_hz(n) for n in range(len(bodies.volumes))])
        channels = len(settings.layout)
        self._mix = LiveMix(
            tones,
            Panner(settings.layout, settings.hearing, settings.scheme),
            Reverberators(channels, RATE_HZ, settings.reverberation_s),
            RATE_HZ,
            BLOCK,
        )
        # Sums of many loud sources would clip.
        self._scale = 1.0 / max(1.0, len(tones) * (settings.tone + settings.touch))
        self._newest = np.zeros((len(tones), 3)), np.zeros(len(tones))
        try:
            self._stream: Any = sound_library().OutputStream(
                device=card or None,
                samplerate=RATE_HZ,
                channels=channels,
                dtype="float32",
                blocksize=BLOCK,
                callback=self._play,
            )
            self._stream.start()
        except DeviceError:
            raise
        except Exception as error:  # PortAudioError; ValueError for an unknown card
            reason = " ".join(str(error).split())
            raise DeviceError(f"{card or 'the sound card'} cannot be opened ({reason}).") from None
        bodies.heard = self._update

    def close(self) -> None:
        """Close the stream at once; never raises."""
        with suppress(Exception):
            self._stream.abort()
        with suppress(Exception):
            self._stream.close()

    def _update(self, now_s: float) -> None:
        # One assignment: the thread of the sound card reads whole pairs.
        self._newest = self._bodies.sources(now_s, self._settings.tone, self._settings.touch)

    def _play(self, outdata: Any, _frames: int, _time: Any, _status: Any) -> None:
        """Fill a block of PortAudio (BLOCK, channels), in PortAudio's thread."""
        places_m, amplitudes = self._newest
        outdata[:] = np.clip(self._mix.block(places_m, amplitudes) * self._scale, -1.0, 1.0)
