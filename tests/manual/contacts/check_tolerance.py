# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the stated error of random settings on many random scenes.

``python tests/manual/contacts/check_tolerance.py -o tolerance.csv --scenes 5000`` writes a line for
each scene, with the error of the result beyond the setting's stated error, and continues at the end
of an existing file. ``--first`` begins at another seed, for several runs at once. Not part of the
test suite: ``test_trade_poses.py`` covers a few such scenes.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "engine"))
from distorted_scenes import Case

ACCEPTED = (
    0.02  # share of full strength: allowed error of the exact reference, because of sampled skin
)
_COLUMNS = ("seed", "model", "distorted", "strength", "tolerance", "excess")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    parser.add_argument("--scenes", type=int, default=5000, metavar="N")
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    options = parser.parse_args()
    done = _rows(options.output)
    with options.output.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if not done:
            writer.writerow(_COLUMNS)
        for seed in range(options.first, options.first + options.scenes):
            if seed in done:
                continue
            case = Case.of(seed)
            excess = done[seed] = case.excess
            described = case.modality, int(case.is_distorted), f"{case.strength:.3f}"
            writer.writerow((seed, *described, case.tolerance.name, f"{excess:.4f}"))
            file.flush()
    off = sorted(seed for seed, excess in done.items() if not excess <= ACCEPTED)
    most = max(done.values(), default=0.0)
    messages = [f"{len(done)} scenes, {len(off)} off by more than {ACCEPTED}, at most {most:+.4f}"]
    messages += [f"seed {seed}: {done[seed]:+.4f}" for seed in off]
    sys.stdout.write("\n".join(messages) + "\n")
    return int(bool(off))


def _rows(path: Path) -> dict[int, float]:
    """Errors by seed, of complete lines."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {int(row["seed"]): float(row["excess"]) for row in rows if row["excess"]}


if __name__ == "__main__":
    sys.exit(main())
