# SPDX-License-Identifier: GPL-3.0-or-later
"""Kill sessions at random moments: every stored answer stays, and sessions continue.

``python tests/manual/study/check_kills.py --kills 1000`` takes some minutes; needs os.fork.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "study"))
from study_doubles import make, session_of

from hfx_tools.study.folder import Study
from hfx_tools.study.tables import table_of

PLAN = {
    "name": "kills",
    "design": "paired",
    "compare": {"strength": [0.25, 0.5]},
    "repetitions": 400,
    "stimulus": {"duration_ms": 20},
}


def run_session(folder: Path, acknowledged: int) -> None:
    """Run a session, and write a byte to a pipe after each stored answer."""
    session, _, _, answers = session_of(Study(folder))
    append = answers.append

    def counted_append(row: Any) -> None:
        append(row)
        os.write(acknowledged, b".")

    answers.append = counted_append  # type: ignore[method-assign]
    os.write(acknowledged, b"!")
    session.run()


def killed(folder: Path, seconds: float) -> int:
    """Kill a session after some seconds; returns the number of acknowledged answers."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            run_session(folder, writing)
        finally:
            os._exit(0)
    os.close(writing)
    assert os.read(reading, 1) == b"!"
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    count = 0
    while chunk := os.read(reading, 65536):
        count += len(chunk)
    os.close(reading)
    return count


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=1000)
    options = parser.parse_args()
    rng, lost, repeated, incomplete = random.Random(1), 0, 0, 0
    with tempfile.TemporaryDirectory() as name:
        number, study = 0, make(Path(name) / "0", PLAN)
        for _ in range(options.kills):
            path = study.data_file("01")
            before = path.read_bytes() if path.exists() else b""
            # An incomplete line of the last kill is removed by the next session.
            complete = before[: before.rfind(b"\n") + 1]
            count = killed(study.folder, rng.uniform(0.0, 0.03))
            after = path.read_bytes()
            assert after.startswith(complete)
            end = after.rfind(b"\n") + 1
            incomplete += end < len(after)
            stored = after[:end].count(b"\n") - max(complete.count(b"\n"), 1)
            lost += max(count - stored, 0)
            trials = [row["trial"] for row in table_of(after[:end], str(path))]
            repeated += trials != [str(k) for k in range(1, len(trials) + 1)]
            if len(trials) > 700:
                number += 1
                study = make(Path(name) / str(number), PLAN)
    sys.stdout.write(
        f"{options.kills} kills: {lost} stored answers lost, {repeated} lists with a gap or a "
        f"repetition, {incomplete} incomplete last lines\n"
    )
    return 1 if lost or repeated else 0


if __name__ == "__main__":
    sys.exit(main())
