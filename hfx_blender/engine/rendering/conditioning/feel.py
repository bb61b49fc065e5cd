# SPDX-License-Identifier: GPL-3.0-or-later
"""Perception of the wearer: equal strength at all places, adaptation and persistence."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from ....errors import InputError
from ...arrays import F64, I64
from ...samples import SampleRun, Stream, joined_runs

SETTING: Final = "feel"
"""Key of a track's settings, with the fields of :class:`Feel`; missing with all defaults."""

RISE: Final = 0.6
"""Rise of thresholds by complete adaptation, the least of several (Kaczmarek, IEEE Transactions on
Rehabilitation Engineering 2000; vibration adapts alike: Graczyk et al., J. Neural Eng. 2018)."""

_FAINTEST: Final = 0.01  # share of a level at which persistence ends


@dataclass(frozen=True)
class Feel:
    """Settings of perception; time constants in s, 0: off."""

    is_equal: bool = False
    adaptation_s: float = 0.0
    persistence_s: float = 0.0

    @classmethod
    def of_settings(cls, settings: Mapping[str, Any]) -> "Feel":
        """Perception of a track's settings. Raises InputError for a malformed entry."""
        try:
            feel = cls(**settings.get(SETTING, {}))
            if 0.0 <= feel.adaptation_s < 1e4 and 0.0 <= feel.persistence_s < 1e4:
                if isinstance(feel.is_equal, bool):
                    return feel
        except TypeError:
            pass
        raise InputError(f"Track: settings.{SETTING} is {settings[SETTING]!r:.80}, no perception.")

    @property
    def has_memory(self) -> bool:
        """True with adaptation or persistence."""
        return bool(self.adaptation_s or self.persistence_s)

    def as_setting(self) -> dict[str, Any]:
        """Entry of a track's settings; empty with all defaults."""
        return {} if self == Feel() else {SETTING: asdict(self)}


class SkinMemory:
    """Adaptation and persistence of streams as first-order gains, advanced in order of time.

    The adaptation of a stream that is on rises to 1 with the time constant, and falls as fast
    afterwards; the gain is ``1 / (1 + RISE * adaptation)``. With persistence, levels before this
    gain fall exponentially at most: further samples follow the last one, to 1 % of its level.
    """

    def __init__(self, feel: Feel) -> None:
        self._feel = feel
        # Time, adaptation, level before adaptation, and a run of the last sample with such a level.
        self._last: dict[Stream, tuple[float, float, float, SampleRun]] = {}

    def felt(self, runs: Sequence[SampleRun], indices: I64, times_s: F64) -> list[SampleRun]:
        """Runs at the next sample indices (T,), at times (T,), with new levels. A time before those
        of the last call begins anew."""
        if any(times_s[0] < time_s for time_s, *_ in self._last.values()):
            self._last.clear()
        given = {run.stream: run for run in runs}
        streams = list(dict.fromkeys([*self._last, *given]))
        pieces: list[list[SampleRun]] = []
        for stream in streams:
            run = given.get(stream)
            # A sample of level 0 is silence.
            at = [] if run is None else np.flatnonzero(run.levels > 0.0).tolist()
            own = {} if run is None else dict(zip(run.indices[at].tolist(), at, strict=True))
            pieces.append([])
            for row, index in enumerate(indices.tolist()):
                sample = run.one(own[index]) if run is not None and index in own else None
                self._advance(stream, float(times_s[row]), sample)
                if stream in self._last and self._last[stream][2] > 0.0:
                    _, adapted, level, last = self._last[stream]
                    levels = np.array([level / (1.0 + RISE * adapted)])
                    moment = replace(last, levels=levels, times_s=times_s[[row]])
                    pieces[-1].append(replace(moment, indices=indices[[row]]))
        return joined_runs(pieces, streams)

    def _advance(self, stream: Stream, time_s: float, sample: SampleRun | None) -> None:
        """Advance a stream to a time with the effect's sample, None in silence."""
        if stream not in self._last:
            if sample is not None:
                self._last[stream] = time_s, 0.0, float(sample.levels[0]), sample
            return
        before_s, adapted, level, last = self._last[stream]
        elapsed_s = time_s - before_s
        if self._feel.adaptation_s:
            share = math.exp(-elapsed_s / self._feel.adaptation_s)
            adapted = share * adapted + (1.0 - share) * (sample is not None)
        # At an unchanged time, as in a paused scene, nothing persists.
        persists = self._feel.persistence_s > 0.0 and elapsed_s > 0.0
        level *= math.exp(-elapsed_s / self._feel.persistence_s) if persists else 0.0
        if sample is not None:
            level = max(level, float(sample.levels[0]))
            last = replace(sample, levels=np.array([level]))
        level *= level > _FAINTEST * float(last.levels[0])
        self._last[stream] = time_s, adapted, level, last
