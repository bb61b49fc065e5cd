# SPDX-License-Identifier: GPL-3.0-or-later
"""Writers of signals with few keyframes, which read again what they wrote to tell its error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from ...errors import InputError
from ...files.strict_json import clean, read_bytes
from ..written import Written, beside
from . import losses
from .signals import FrequencyRange, Signal, simplified_signals

Decoder = Callable[[bytes, str], tuple[list[Signal], FrequencyRange]]
SignalWriter = Callable[[list[Signal], FrequencyRange, Path, float], Written]

WHOLE_MS: Final = 1e-3
"""Seconds that times may be off where they are whole milliseconds."""

_STEP_S: Final = 2e-6  # that a step of a simplified curve takes, with its rounding


def simplified_writer(
    write_few: Callable[[tuple[Signal, ...], FrequencyRange, Path], Written],
    suffix: str,
    decode: Decoder,
    grid_s: float = 0.0,
) -> SignalWriter:
    """Make a writer of signals that have few keyframes; its note tells the error of the files.

    Parameters
    ----------
    write_few : callable
        Writes simplified signals: ``stem.<name><suffix>`` each, or all in ``stem<suffix>``.
    suffix : str
    decode : callable
        Reader of the format.
    grid_s : float
        Steps of its times, seconds.
    """

    def write_signals(
        signals: list[Signal], frequencies: FrequencyRange, stem: Path, tolerance: float
    ) -> Written:
        few = simplified_signals(signals, tolerance, frequency_hz=pitch_tolerance(frequencies))
        written = write_few(few, frequencies, stem)
        try:
            note = error_note(_read_back(signals, written, stem, suffix, decode), grid_s)
        except InputError as error:  # larger than a file of strangers may be
            note = f"the error of its keyframes is not measured: {str(error).rstrip('.')}"
        return written + Written(notes=(note, *losses.silenced(signals, few)))

    return write_signals


def error_note(pairs: Iterable[tuple[Signal, Signal]], grid_s: float = 0.0) -> str:
    """Sentence about the largest error of signals, each with what was read again of it.

    ``grid_s`` is what their times may be off.
    """
    errors = [losses.errors_of(*pair, max(grid_s, _STEP_S)) for pair in pairs]
    digits = np.array([1e4, 10.0])  # that are told; rounded up, as nothing is to be beyond
    worst = np.maximum(np.max([(0.0, 0.0), *errors], axis=0) * digits - 1e-6, 0.0)
    amplitude, hertz = np.ceil(worst) / digits
    grid = ", their times whole milliseconds" if grid_s == WHOLE_MS else ""
    return f"keyframes are within {amplitude:.2%} of full scale and {hertz:.1f} Hz{grid}"


def _read_back(
    signals: Sequence[Signal], written: Written, stem: Path, suffix: str, decode: Decoder
) -> Iterator[tuple[Signal, Signal]]:
    """Signals, each with what a reader has of it in the files that were written."""
    together = stem.with_name(stem.name + suffix)
    found: dict[str, Signal] = {}
    if together in written.files:
        found = {each.name: each for each in decode(read_bytes(together), together.name)[0]}
    for each in signals:
        path = beside(stem, each.name, suffix)
        if path in written.files:
            yield each, decode(read_bytes(path), path.name)[0][0]
        elif clean(each.name) in found:
            yield each, found[clean(each.name)]


def pitch_tolerance(frequencies: FrequencyRange) -> float:
    """Hertz that a simplified frequency may be off: a hundredth of the range, 1 Hz at least."""
    return max(1.0, (frequencies.highest_hz - frequencies.lowest_hz) / 100.0)
