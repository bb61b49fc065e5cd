# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of spatial sound, and the tones of sound sources."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from hfx_blender.engine.arrays import F64

from .hearing import Hearing
from .loudspeakers import LAYOUTS, LoudspeakerLayout, Scheme

_STEPS: Final = (0, 2, 4, 7, 9)  # major pentatonic


Voices = Literal["scale", "own"]
"""Voices of volumes: tones of a scale by number; or Speakers, and the effects' own frequencies."""


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
    voices: Voices = "scale"
    ageing_s: float = 0.0  # time for each step of the scale downwards; 0: pitch stays

    def tone_hz(self, number: int) -> float:
        """Frequency of the source with a number from 0, in Hz."""
        # Every second step of the scale, so that neighbouring sources are consonant.
        octave, step = divmod(number * 2 % (len(_STEPS) * self.octaves), len(_STEPS))
        # Detune by the golden ratio: equal tones of several sources would cancel.
        cents = (number * 0.618034 % 1.0 - 0.5) * 0.4
        return self.lowest_hz * float(2.0 ** (octave + (_STEPS[step] + cents) / 12.0))

    def aged(self, ages_s: F64) -> F64:
        """Factors (n,) of frequencies at ages (n,) of a source: a step of the scale down for each
        :attr:`ageing_s`, at most all octaves."""
        if self.ageing_s <= 0.0:
            return np.ones(len(ages_s))
        steps = np.minimum(np.floor(ages_s / self.ageing_s), len(_STEPS) * self.octaves)
        octaves, step = np.divmod(-steps.astype(np.int64), len(_STEPS))
        return np.asarray(2.0 ** (octaves + np.array(_STEPS)[step] / 12.0))
