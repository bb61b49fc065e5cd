# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the spatial core against a plain C loop posing the same vertices.

``python tests/manual/players/check_cost.py`` compiles ``cost.c`` as ``players/native/build.py``
does the core, and prints processor time and ratio for a walking body among volumes: at each level
of detail for volumes alone, and at level 1 with contact responses.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "players"))
from check_spatial import clip_of
from core_library import compiled
from walkers import walk

OPTIMIZED = ("-fno-math-errno", "-fno-trapping-math")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        source = (Path(__file__).parent / "cost.c").read_text(encoding="utf-8")
        program = compiled(source, folder / "cost", "-std=c99", *OPTIMIZED)
        for level, responds in ((0, False), (1, False), (2, False), (1, True)):
            for volumes in (1, 4, 12, 48):
                created = walk(3, 1.0, volumes, responds=responds)
                clip, bones = clip_of(created, folder, level)
                frames = folder / "matrices"
                frames.write_bytes(created.matrices[:, bones].astype(np.float32).tobytes())
                completed = subprocess.run(
                    [str(program), str(clip), str(frames)], check=True, capture_output=True
                )
                kind = "with responses" if responds else "volumes alone"
                sys.stdout.write(f"level {level}, {kind}: {completed.stdout.decode()}")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
