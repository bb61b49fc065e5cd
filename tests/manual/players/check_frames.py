# SPDX-License-Identifier: GPL-3.0-or-later
"""Play clips at random frame rates, and count lost peaks.

``python tests/manual/players/check_frames.py --sequences 10000`` takes about ten minutes: frames of
5 to 200 ms over whole clips made from seeds. A peak is lost where an actuator is given less than
the strongest row since the frame before; a value is wrong if farther from the raster's value by
``telling.py`` than a 65535th of the column's full scale.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "players"))
from clip_cases import SPECS, Case, case_of
from core_library import Clip, Player


@dataclass
class Counts:
    """Played frames, and errors of the frames."""

    frames: int = 0
    peaks: int = 0
    lost: int = 0
    wrong: int = 0


def play(case: Case, random: np.random.Generator, counts: Counts) -> None:
    """Play a clip once in random frames."""
    telling = case.telling
    telling.play()
    player = Player(Clip(case.path.read_bytes()))
    loudest = np.array([actuator.start for actuator in telling.actuators])
    deviation = np.abs(telling.values - telling.neutral)[:, loudest]
    slack = telling.slack
    lowest_s, highest_s = np.sort(random.uniform(0.005, 0.2, 2))
    while telling.playing:
        before = telling.shown
        step = random.uniform(lowest_s, highest_s)
        expected, actual = telling.advance(step), player.advance(step)
        rows = slice(before + 1, telling.shown + 1)
        samples = np.abs(actual - telling.neutral)[loudest]
        if rows.stop > rows.start:
            peaks = deviation[rows].max(axis=0)
            counts.peaks += int(np.count_nonzero(peaks))
            counts.lost += int(np.count_nonzero(samples < peaks - slack[loudest]))
        counts.wrong += int(np.count_nonzero(np.abs(actual - expected) > slack))
        counts.frames += 1
    assert not player.is_playing


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts = Counts()
    random = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory() as name:
        shortish = [spec for spec in SPECS if spec.samples / spec.rate_hz < 20]
        cases = [case_of(item, Path(name)) for item in shortish]
        for k in range(options.sequences):
            play(cases[k % len(cases)], random, counts)
    sys.stdout.write(
        f"{options.sequences} sequences, {counts.frames} frames, {counts.peaks} peaks: "
        f"{counts.lost} lost, {counts.wrong} values wrong\n"
    )
    return 1 if counts.lost or counts.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
