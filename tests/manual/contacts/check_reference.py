# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare the engine with the reference on many random scenes of one volume and one body.

``python tests/manual/contacts/check_reference.py -o reference.csv`` writes a line for each of
10,000 scenes, with the differences of weights and details, and continues at the end of an existing
file. ``--first`` begins at another seed, for several runs at once; ``--without-library`` compares
contacts without the native library. Not part of the test suite: ``test_reference.py`` covers a few
such scenes.
"""

from __future__ import annotations

import argparse
import csv
import sys
from contextlib import nullcontext
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "engine"))
from both_ways import by_reference
from random_contacts import NEAR, RandomContact

_COLUMNS = ("seed", "difference", "scene")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    parser.add_argument("--scenes", type=int, default=10_000, metavar="N")
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--without-library", action="store_true", help="as where it is missing")
    options = parser.parse_args()
    done = _rows(options.output)
    with options.output.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if not done:
            writer.writerow(_COLUMNS)
        for seed in range(options.first, options.first + options.scenes):
            if seed not in done:
                case = RandomContact(seed)
                with by_reference() if options.without_library else nullcontext():
                    done[seed] = case.difference
                writer.writerow((seed, f"{done[seed]:.3g}", str(case)))
                file.flush()
    off = sorted(seed for seed, difference in done.items() if not difference < NEAR)
    most = max(done.values(), default=0.0)
    messages = [f"{len(done)} scenes, {len(off)} differ by {NEAR} or more, at most {most:.3g}"]
    messages += [f"seed {seed}: {done[seed]:.3g}" for seed in off]
    sys.stdout.write("\n".join(messages) + "\n")
    return int(bool(off))


def _rows(path: Path) -> dict[int, float]:
    """Differences by seed, of complete lines."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {int(row["seed"]): float(row["difference"]) for row in csv.DictReader(file)}


if __name__ == "__main__":
    sys.exit(main())
