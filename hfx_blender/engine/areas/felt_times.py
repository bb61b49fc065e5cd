# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples at which effects are on, and at which bodies receive a strength above 0."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Bool
from ..body.detection import REFERENCE_HZ, equal_feel_factors, level_db, threshold
from ..body.model import load_model
from ..body.parts import PARTS
from ..modality import MODALITIES, neutral_temperature_c
from ..samples import SampleRun
from ..scene import AnimationBlock, EffectBlock, EffectDescription

NEUTRAL_WITHIN_C = 1e-3
"""Largest deviation of a temperature treated as neutral, degrees Celsius."""


@dataclass
class FeltTimes:
    """Samples of a recording by effect id; plain data for transfer between processes.

    Effects missing in ``is_on`` have level 0 or non-finite values at all samples.
    """

    is_on: dict[str, bool] = field(default_factory=dict)  # level above 0 at any sample
    # Non-finite quantity of an effect never on: "a value" or "a place".
    no_number: dict[str, str] = field(default_factory=dict)
    touched: dict[str, bool] = field(default_factory=dict)  # volumes with a response, surfaces
    # By effect and body: number, first and last index of the samples with strength.
    felt: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    # Largest dB SL by effect; not raised further once at the detection threshold, 0 dB.
    strongest_db: dict[str, float] = field(default_factory=dict)

    def add_levels(self, effects: Sequence[EffectDescription], block: AnimationBlock) -> None:
        """Record a block's levels, of its own samples without the overlap of blocks.

        An effect goes to ``is_on`` if at any sample its level is above 0 with finite parameters and
        a finite placement. Otherwise an effect with a level above 0 or NaN goes to ``no_number``:
        as "a place" if only its placement is not finite, else as "a value".
        """
        silent: EffectBlock | None = None  # many far volumes share one
        for effect, animated in zip(effects, block.effects, strict=True):
            if animated is silent or effect.id in self.is_on:
                continue
            levels = animated.levels[block.own]
            is_off = levels <= 0.0
            if is_off.all():
                silent = animated
                continue
            parameters = animated.parameters[block.own]
            is_finite = ~is_off & np.isfinite(levels) & np.isfinite(parameters).all(axis=1)
            # A volume without a finite placement is silent at any level.
            is_placed = is_finite.copy()
            if animated.matrices is not None:
                is_placed &= np.isfinite(animated.matrices[block.own]).all(axis=(1, 2))
            if is_placed.any():
                self.is_on[effect.id] = True
            else:
                self.no_number[effect.id] = "a place" if is_finite.any() else "a value"

    def add_runs(
        self, runs: Iterable[SampleRun], touching: Collection[str], *, is_equal: bool = False
    ) -> None:
        """Add samples with strength to ``felt`` by effect and body; runs of a stream must be in the
        order of time. ``touching`` has the ids of temperature effects of touched objects.
        ``is_equal``: the largest dB SL is that with Equal Feel."""
        for run in runs:
            stream = run.stream
            indices = run.indices[has_strength(run, stream.effect_id in touching)]
            if len(indices):
                span = [len(indices), int(indices[0]), int(indices[-1])]
                self._count(stream.effect_id, stream.body_id, span)
                if self.strongest_db.get(stream.effect_id, -np.inf) < 0.0:
                    is_contact = stream.effect_id in touching
                    self._raise(stream.effect_id, strongest_db(run, is_contact, is_equal))

    def _raise(self, effect_id: str, level_db: float) -> None:
        """Raise the largest level of an effect; NaN, of a modality without thresholds, is none."""
        if not np.isnan(level_db):
            self.strongest_db[effect_id] = max(self.strongest_db.get(effect_id, level_db), level_db)

    def add(self, later: "FeltTimes") -> None:
        """Add the counts of another part of the recording, in place."""
        self.is_on |= later.is_on
        self.no_number |= later.no_number
        self.touched |= later.touched
        for effect_id, spans in later.felt.items():
            for body_id, span in spans.items():
                self._count(effect_id, body_id, span)
        for effect_id, level in later.strongest_db.items():
            self._raise(effect_id, level)

    def _count(self, effect_id: str, body_id: str, span: list[int]) -> None:
        """Add a span (number, first, last sample index) to that of an effect and body."""
        spans = self.felt.setdefault(effect_id, {})
        # Minimum and maximum: parts of a recording may be added in any order.
        count, first, last = spans.get(body_id, [0, *span[1:]])
        spans[body_id] = [count + span[0], min(first, span[1]), max(last, span[2])]


def strongest_db(run: SampleRun, is_contact: bool, is_equal: bool = False) -> float:
    """Largest level of a run, dB SL, over its samples and all body parts; NaN for a modality
    without thresholds and for a run without vertices, -inf in silence. ``is_equal``: with the
    factors of Equal Feel at the run's own frequencies."""
    modality, strengths = run.stream.modality, run.parameters[:, 0]
    if modality == "temperature":
        strengths = np.abs(strengths - neutral_temperature_c(is_contact))
    # The strongest weight of each set on each part: the vertices of a part share a threshold.
    weights = np.zeros((len(run.offsets) - 1, len(PARTS)))
    sets = np.repeat(np.arange(len(weights)), np.diff(run.offsets))
    part_of = load_model(run.stream.model_id).part
    # A flat index and one type of numbers: numpy is many times as fast.
    places = sets * weights.shape[1] + part_of[run.vertices]
    np.maximum.at(weights.reshape(-1), places, run.weights.astype(np.float64))
    hz = run.parameters[:, 1] if modality == "vibration" else np.full(len(run), REFERENCE_HZ)
    felt = (run.levels * strengths)[:, None] * weights[run.set_of]
    thresholds = threshold(modality, hz)
    if is_equal:
        felt *= equal_feel_factors(modality, thresholds)
    levels = level_db(felt, thresholds)
    return float(levels.max()) if len(run.vertices) else np.nan


def has_strength(run: SampleRun, is_contact: bool) -> Bool:
    """Mask (n,) of samples with a level above 0 and a strength: a strength parameter above 0, or a
    temperature at least 0.001 degrees off neutral (of touched objects if ``is_contact``, else of
    air)."""
    modality = MODALITIES[run.stream.modality]
    values = run.parameters[:, modality.parameter_names.index(modality.strength)]
    if modality.name == "temperature":
        deviation = np.abs(values - neutral_temperature_c(is_contact))
        return np.asarray((run.levels > 0.0) & (deviation >= NEUTRAL_WITHIN_C))
    return np.asarray((run.levels > 0.0) & (values > 0.0))
