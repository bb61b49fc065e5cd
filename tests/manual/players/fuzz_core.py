# SPDX-License-Identifier: GPL-3.0-or-later
"""Throw damaged clips at the core, compiled with address and undefined-behaviour sanitizers.

``python tests/manual/players/fuzz_core.py --inputs 10_000_000 --folder F`` changes small clips of
``players/conformance``, and a clip with a spatial part; bodies feel effects of other clips, too.
Finished inputs are counted in ``F/totals.json`` after each slice; the same command goes on there.
A finding ends the run, with a message and a seed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "players"))
from core_library import ROOT, compiled
from small_clip import write_small_clip

_SLICE = 100_000
_SANITIZERS = "-fsanitize=address,undefined,float-cast-overflow"
_STRICT = ("-fno-sanitize-recover=all", "-g", "-std=c99")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=lambda text: int(text.replace("_", "")), default=_SLICE)
    parser.add_argument("--folder", type=Path, required=True)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    path = options.folder / "totals.json"
    totals = json.loads(path.read_text()) if path.is_file() else {"inputs": 0, "opened": 0}
    known = sorted((ROOT / "players/conformance").glob("*.hfxclip"), key=lambda p: p.stat().st_size)
    with tempfile.TemporaryDirectory() as name:
        source = (Path(__file__).parent / "fuzz.c").read_text(encoding="utf-8")
        program = compiled(source, Path(name, "fuzz"), _SANITIZERS, *_STRICT)
        by_hand = sorted((ROOT / "players/conformance/behaviour").glob("*.hfxclip"))
        small = [write_small_clip(Path(name), item) for item in ("walk", "walk2")]
        small.append(write_small_clip(Path(name), "still", all_move=False))
        clips = [*known[:6], *by_hand, *small]
        while totals["inputs"] < options.inputs:
            seed = totals["inputs"] // _SLICE + 1
            count = min(_SLICE, options.inputs - totals["inputs"])
            command = [str(program), str(seed), str(count), *map(str, clips)]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                sys.stdout.write(f"finding with seed {seed}:\n{done.stderr}\n")
                return 1
            inputs, opened = map(int, done.stdout.split())
            totals = {"inputs": totals["inputs"] + inputs, "opened": totals["opened"] + opened}
            path.write_text(json.dumps(totals))
            sys.stdout.write(f"{totals['inputs']:,} inputs, {totals['opened']:,} opened\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
