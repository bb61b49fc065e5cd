# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender's window, started by ``run.py``: takes the steps of a single journey.

Arguments after ``--``: a JSON object with ``journey``, ``out``, ``input``, ``screen``,
``zips``, ``args``, ``pictures``.
"""

from __future__ import annotations

import json
import runpy
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from driver import Driver
from inputs import RealInput, SimulatedInput

REQUEST = json.loads(sys.argv[sys.argv.index("--") + 1])
OUT = Path(REQUEST["out"])


def _end(code: int, text: str) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    temporary = OUT / "status.tmp"
    temporary.write_text(f"{code}\n{text}", encoding="utf-8")
    temporary.replace(OUT / "status")


def _steps() -> Iterator[float]:
    yield 1.0  # the window is up and drawn
    window = bpy.context.window_manager.windows[0]
    use = RealInput() if REQUEST["input"] == "real" else SimulatedInput(window)
    screen = Path(REQUEST["screen"]) if REQUEST["screen"] else None
    zips = [Path(item) for item in REQUEST["zips"]]
    documented = Path(REQUEST["pictures"]) if REQUEST["pictures"] else None
    driver = Driver(OUT, REQUEST["args"], zips, use, screen, documented)
    journey = Path(REQUEST["journey"])
    sys.path.insert(0, str(journey.parent))
    try:
        yield from runpy.run_path(str(journey), run_name="journey")["steps"](driver)
    finally:
        driver.shot("end.png")


_running = _steps()


def _tick() -> float | None:
    try:
        return max(next(_running) or 0.0, 0.001)
    except StopIteration:
        _end(0, "")
    except BaseException:
        _end(1, traceback.format_exc())
    return None


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(_tick, persistent=True)
