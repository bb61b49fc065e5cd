# SPDX-License-Identifier: GPL-3.0-or-later
"""Envelope of an impact: a leaky integrator's response to the impact's speed.

Politis, Pugliese, Takala (audio-tactile belt), section 4.4: the relative speed at the moment of a
collision is the input of a leaky integrator, a first-order recursive filter, whose decay is felt as
stiffness. A second filter smooths the attack. The closed form is independent of the sampling rate
and of how time is split, and has a known end.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import F64, Bool

SILENCE: Final = 1e-3  # fraction of the peak at which an impact's envelope ends
LOUD: Final = 4.0
"""Multiple of attack plus decay after which an envelope is below a fiftieth of the peak."""

_SAME: Final = 1e-6  # relative difference of time constants counted as equal
_EQUAL_ENDS: Final = (
    12.0  # time constants; t e^(1 - t) is 2e-4 there, and unequal constants end sooner
)


@dataclass(frozen=True)
class RingingImpact:
    """Impact, possibly still felt."""

    time_s: float
    strength: float  # peak of the envelope, 0..1
    attack_s: float
    decay_s: float

    @property
    def ends_s(self) -> float:
        """End of the decay, seconds on the time line of ``time_s``."""
        return self.time_s + duration_s(self.attack_s, self.decay_s)

    @property
    def loud_until_s(self) -> float:
        """Time until which the impact is loud, :data:`LOUD` times attack plus decay after
        ``time_s``, seconds."""
        return self.time_s + LOUD * (self.attack_s + self.decay_s)

    @property
    def peaks_s(self) -> float:
        """Time of the envelope's peak, seconds on the time line of ``time_s``."""
        return self.time_s + peak_s(self.attack_s, self.decay_s)

    def rings(self, times_s: F64, before_s: F64) -> Bool:
        """Mask (n,) of times at which the impact is felt: from its time until its end, and the
        first time after the peak, if later. ``before_s`` (n,) are the times of the samples
        before."""
        rings: Bool = (times_s >= self.time_s) & (times_s < self.ends_s)
        return rings | self._peaks(times_s, before_s)

    def envelope(self, times_s: F64, before_s: F64) -> F64:
        """Envelope (n,) at times, 0 after the end; the first time after the peak has the peak
        value, at every rate. ``before_s`` (n,) are the times of the samples before."""
        since = times_s - self.time_s
        values = self.strength * kernel(since, self.attack_s, self.decay_s)
        values = np.where(times_s < self.ends_s, values, 0.0)
        return np.where(self._peaks(times_s, before_s), self.strength, values)

    def _peaks(self, times_s: F64, before_s: F64) -> Bool:
        """Mask (n,) of times with the peak after ``before_s`` (n,), not after the time itself."""
        return np.asarray((before_s < self.peaks_s) & (self.peaks_s <= times_s))


def kernel(since_s: F64, attack_s: float, decay_s: float) -> F64:
    """Envelope (n,) of an impact of strength 1: 0 before the impact, peak 1.

    Without an attack y = exp(-t / decay), which equals the recursion y[n] = exp(-dt / decay)
    y[n-1] + x[n] at the samples. With an attack another filter smooths the input: exp(-t /
    decay) - exp(-t / attack), scaled to the peak.
    """
    t = np.maximum(since_s, 0.0)
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    if fast <= _SAME * slow:
        values = np.exp(-t / slow)
    elif slow - fast <= _SAME * slow:
        # Limit of the difference below for equal times, where rounding would dominate.
        values = t / slow * np.exp(1.0 - t / slow)
    else:
        at = _peak_s(slow, fast)
        values = (np.exp(-t / slow) - np.exp(-t / fast)) / (
            math.exp(-at / slow) - math.exp(-at / fast)
        )
    return np.where(since_s >= 0.0, values, 0.0)


def duration_s(attack_s: float, decay_s: float) -> float:
    """Duration of an impact, seconds; afterwards the envelope stays below :data:`SILENCE` of the
    peak. At most twelve times the slower time constant, also for equal constants."""
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
    """Upper bound of an impact's duration, seconds, for all time constants up to ``attack_s`` and
    ``decay_s``: twelve times the larger, or ln(1000) times if the smaller is 0."""
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    return slow * (_EQUAL_ENDS if fast > 0.0 else -math.log(SILENCE))


def peak_s(attack_s: float, decay_s: float) -> float:
    """Time from an impact's beginning to the peak, seconds; 0 without an attack, symmetric in
    both."""
    slow, fast = max(attack_s, decay_s), min(attack_s, decay_s)
    if fast <= _SAME * slow:
        return 0.0
    return slow if slow - fast <= _SAME * slow else _peak_s(slow, fast)


def _peak_s(slow: float, fast: float) -> float:
    """Time of the peak for two different positive time constants, seconds."""
    return math.log(slow / fast) * slow * fast / (slow - fast)
