# SPDX-License-Identifier: GPL-3.0-or-later
"""The contact envelope: the speed of an impact through leaky integrators.

Politis, Pugliese, Takala (audio-tactile belt), section 4.4: the magnitude of the relative speed
at the moment of a collision is fed to a leaky integrator, a first-order recursive filter,
whose decay is felt as the object's stiffness. A second one smooths the attack. Written as the
filters' response to each impact it depends neither on the sampling rate nor on how time is
split, and ends after a known time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, Bool

SILENCE: Final = 1e-3
"""An impact's envelope has ended when it has fallen to this share of its peak."""

LOUD: Final = 4.0
"""Sums of attack and decay after which an envelope is below a fiftieth of its peak."""

_SAME: Final = 1e-6  # relative difference of time constants that count as one
_EQUAL_ENDS: Final = 12.0  # time constants; t e^(1 - t) is 2e-4 there, and others end sooner


@dataclass(frozen=True)
class Impact:
    """Impact that may still be felt."""

    time_s: float
    strength: float  # at its peak, in 0..1
    attack_s: float
    decay_s: float

    @property
    def ends_s(self) -> float:
        """End of the impact's decay, seconds."""
        return self.time_s + duration_s(self.attack_s, self.decay_s)

    @property
    def loud_until_s(self) -> float:
        """Time until which moments between samples matter, seconds."""
        return self.time_s + LOUD * (self.attack_s + self.decay_s)

    @property
    def peaks_s(self) -> float:
        """Time of the envelope's peak, seconds."""
        return self.time_s + peak_s(self.attack_s, self.decay_s)

    def rings(self, times_s: F64, before_s: F64) -> Bool:
        """Test for times (n,) at which the impact is felt, until it has peaked and decayed.

        ``before_s`` (n,) are the times of the samples before.
        """
        rings: Bool = (times_s >= self.time_s) & (times_s < self.ends_s)
        return rings | self._peaks(times_s, before_s)

    def envelope(self, times_s: F64, before_s: F64) -> F64:
        """Values (n,): its peak at the sample after it, so that no rate misses that."""
        since = times_s - self.time_s
        values = self.strength * kernel(since, self.attack_s, self.decay_s)
        values = np.where(times_s < self.ends_s, values, 0.0)
        return np.where(self._peaks(times_s, before_s), self.strength, values)

    def _peaks(self, times_s: F64, before_s: F64) -> Bool:
        peaks: Bool = (before_s < self.peaks_s) & (self.peaks_s <= times_s)
        return peaks


def kernel(since_s: F64, attack_s: float, decay_s: float) -> F64:
    """Envelope of one impact of strength 1, (n,): its peak is 1, and 0 before it.

    Without an attack y = exp(-t / decay), which the recursion y[n] = exp(-dt / decay) y[n-1]
    + x[n] has at its samples. With one, the input of that filter is smoothed by another:
    exp(-t / decay) - exp(-t / attack), scaled to its peak.
    """
    t = np.maximum(since_s, 0.0)
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    if fast <= _SAME * slow:
        values = np.exp(-t / slow)
    elif slow - fast <= _SAME * slow:
        values = t / slow * np.exp(1.0 - t / slow)
    else:
        at = _peak_s(slow, fast)
        values = (np.exp(-t / slow) - np.exp(-t / fast)) / (
            math.exp(-at / slow) - math.exp(-at / fast)
        )
    return np.where(since_s >= 0.0, values, 0.0)


def duration_s(attack_s: float, decay_s: float) -> float:
    """Duration of an impact: its tail stays below :data:`SILENCE` afterwards, seconds."""
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    if fast <= _SAME * slow:
        return -slow * math.log(SILENCE)
    longest = _EQUAL_ENDS * slow
    if slow - fast <= _SAME * slow:
        return longest
    at = _peak_s(slow, fast)
    peak = math.exp(-at / slow) - math.exp(-at / fast)
    return min(-slow * math.log(SILENCE * peak), longest)


def longest_s(attack_s: float, decay_s: float) -> float:
    """Upper bound of the duration for time constants up to these, seconds."""
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    return slow * (_EQUAL_ENDS if fast > 0.0 else -math.log(SILENCE))


def peak_s(attack_s: float, decay_s: float) -> float:
    """Time from an impact's beginning to its peak, seconds."""
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    if fast <= _SAME * slow:
        return 0.0
    return slow if slow - fast <= _SAME * slow else _peak_s(slow, fast)


def _peak_s(slow: float, fast: float) -> float:
    return math.log(slow / fast) * slow * fast / (slow - fast)
