# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of spatial sound, and the tones of sound sources."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from .hearing import Hearing
from .loudspeakers import LAYOUTS, LoudspeakerLayout, Scheme

_STEPS: Final = (0, 2, 4, 7, 9)  # major pentatonic


@dataclass(frozen=True)
class SoundSettings:
    """Settings of a scene's sound."""

    layout: LoudspeakerLayout = LAYOUTS["stereo"]
    scheme: Scheme = "vbap"
    hearing: Hearing = field(default_factory=Hearing)
    lowest_hz: float = 220.0  # of the tones, spread over a pentatonic scale
    octaves: int = 2
    tone: float = 0.015  # amplitude of sources that are on
    touch: float = 0.5  # additional amplitude at full contact
    reverberation_s: float = 1.4

    def tone_hz(self, number: int) -> float:
        """Frequency of the source with a number from 0, in Hz."""
        # Every second step of the scale, so that neighbouring sources are consonant.
        octave, step = divmod(number * 2 % (len(_STEPS) * self.octaves), len(_STEPS))
        # Detune by the golden ratio: equal tones of several sources would cancel.
        cents = (number * 0.618034 % 1.0 - 0.5) * 0.4
        return self.lowest_hz * float(2.0 ** (octave + (_STEPS[step] + cents) / 12.0))
