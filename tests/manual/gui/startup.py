# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the cost of the add-on at Blender's start.

``python tests/manual/gui/startup.py --blender BLENDER --zip EXTENSION.zip`` starts Blender in turn
without and with the extension, with new settings, and prints the difference of each pair:
processor time where the system reports processor time (hardly affected by further processes), and
elapsed time.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

from blender_process import BlenderProcess

LIMIT = 0.2  # seconds


def seconds(blender: BlenderProcess) -> tuple[float, float]:
    """Processor and elapsed time to start, load the start-up file and end again."""
    begin, worked = time.perf_counter(), _children()
    blender.background("--python-expr", "pass")
    elapsed = time.perf_counter() - begin
    return (_children() - worked) or elapsed, elapsed


def _children() -> float:
    times = os.times()  # zeros on Windows
    return times.children_user + times.children_system


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blender", type=Path, required=True)
    parser.add_argument("--zip", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hfx_startup_") as folder:
        plain = BlenderProcess(arguments.blender, Path(folder, "plain"))
        installed = BlenderProcess(arguments.blender, Path(folder, "with"))
        installed.install(arguments.zip)
        for item in (plain, installed):  # fills Blender's caches
            seconds(item)
        pairs = []
        for index in range(arguments.rounds):  # in turn, so a busy machine slows both
            order = (plain, installed) if index % 2 else (installed, plain)
            times = {id(item): seconds(item) for item in order}
            pairs.append((times[id(plain)], times[id(installed)]))
    costs = []
    for index, kind in enumerate(("processor", "elapsed")):
        differences = [b[index] - a[index] for a, b in pairs]
        fastest = min(b[index] for _, b in pairs) - min(a[index] for a, _ in pairs)
        costs.append(statistics.median(differences))
        sys.stdout.write(
            f"{kind} time: {costs[-1]:+.3f} s (median of {len(pairs)} pairs, "
            f"{min(differences):+.3f} to {max(differences):+.3f}; fastest starts {fastest:+.3f}; "
            f"Blender alone {statistics.median(a[index] for a, _ in pairs):.3f})\n"
        )
    return 0 if costs[0] <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
