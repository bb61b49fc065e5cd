# SPDX-License-Identifier: GPL-3.0-or-later
"""Writers of few keyframes; files are read back to state the error."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...errors import InputError
from ...files.strict_json import clean, read_bytes
from ..written import Written, part_path, silent_note, write_json
from . import losses
from .signals import FrequencyRange, Signal, simplified_signals

Decoder = Callable[[bytes, str], tuple[list[Signal], FrequencyRange]]
SignalWriter = Callable[[list[Signal], FrequencyRange, Path, float], Written]
WHOLE_MS: Final = 1e-3  # time resolution, seconds, of formats with whole milliseconds
_STEP_S: Final = 2e-6  # duration of a step in a simplified curve, with its rounding


def simplified_writer(
    write_few: Callable[[tuple[Signal, ...], FrequencyRange, Path], Written],
    suffix: str,
    decode: Decoder,
    grid_s: float = 0.0,
) -> SignalWriter:
    """Create a ``write_signals`` that reduces signals to few keyframes and writes these.

    The error allowed is the ``tolerance`` argument of the new function, a share of full scale. The
    result has a note on the largest error, measured on the written files with ``decode``, and
    notes on stretches that the tolerance silences. If a file exceeds the limits of ``decode``, a
    note says that the error is not measured. ``write_few`` writes signals to
    ``stem.<name><suffix>`` each, or all to ``stem<suffix>``; ``grid_s`` is the format's time
    resolution, seconds: a value that is met within this time is not an error.
    """

    def write_signals(
        signals: list[Signal], frequencies: FrequencyRange, stem: Path, tolerance: float
    ) -> Written:
        few = simplified_signals(signals, tolerance, frequency_hz=pitch_tolerance(frequencies))
        written = write_few(few, frequencies, stem)
        try:
            note = error_note(_read_back(signals, written, stem, suffix, decode), grid_s)
        except InputError as error:  # beyond the limits of foreign files, which the reader holds
            note = f"the error of its keyframes is not measured: {str(error).rstrip('.')}"
        return written + Written(notes=(note, *losses.silenced(signals, few)))

    return write_signals


def error_note(pairs: Iterable[tuple[Signal, Signal]], grid_s: float = 0.0) -> str:
    """Sentence about the largest errors over pairs of original and decoded signals, rounded up.
    ``grid_s`` is the time resolution, as for :func:`~.losses.errors_of`."""
    errors = [losses.errors_of(*pair, max(grid_s, _STEP_S)) for pair in pairs]
    digits = np.array([1e4, 10.0])  # printed digits; rounded up, so the note is an upper bound
    worst = np.maximum(np.max([(0.0, 0.0), *errors], axis=0) * digits - 1e-6, 0.0)
    amplitude, hertz = np.ceil(worst) / digits
    grid = ", their times whole milliseconds" if grid_s == WHOLE_MS else ""
    return f"keyframes are within {amplitude:.2%} of full scale and {hertz:.1f} Hz{grid}"


def _read_back(
    signals: Sequence[Signal], written: Written, stem: Path, suffix: str, decode: Decoder
) -> Iterator[tuple[Signal, Signal]]:
    """Yield (signal, signal decoded from its file); signals without a file are skipped."""
    # One file holds all signals by name, or each signal has its own file.
    together = stem.with_name(stem.name + suffix)
    decoded: dict[str, Signal] = {}
    if together in written.files:
        decoded = {read.name: read for read in decode(read_bytes(together), together.name)[0]}
    for signal in signals:
        path = part_path(stem, signal.name, suffix)
        if path in written.files:
            yield signal, decode(read_bytes(path), path.name)[0][0]
        elif clean(signal.name) in decoded:
            yield signal, decoded[clean(signal.name)]


def write_audible(
    signals: Iterable[Signal], stem: Path, suffix: str, document: Callable[[Signal], Any]
) -> Written:
    """Write a JSON file per audible signal, ``stem.<name><suffix>``, and note silent signals."""
    files: list[Path] = []
    silent: list[str] = []
    for signal in signals:
        if signal.is_silent:
            silent.append(signal.name)
        else:
            files.append(part_path(stem, signal.name, suffix))
            write_json(document(signal), files[-1])
    return Written(tuple(files), notes=silent_note(silent))


def pitch_tolerance(frequencies: FrequencyRange) -> float:
    """Frequency tolerance of simplified signals: 1 % of the range, at least 1 Hz."""
    return max(1.0, (frequencies.highest_hz - frequencies.lowest_hz) / 100.0)
