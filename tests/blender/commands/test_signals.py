# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C, SIGTERM and SIGHUP at any moment: exit code, one sentence, no left-over files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import check_signals
import hfx_scenes
import pytest

posix = pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
pytestmark = posix

CODES = {"SIGTERM": 143, "SIGHUP": 129, "SIGINT": 130}
FAREWELL = {
    "SIGTERM": "hfx: ended by SIGTERM; nothing half written was left behind",
    "SIGHUP": "hfx: ended by SIGHUP; nothing half written was left behind",
    "SIGINT": "hfx: interrupted; nothing half written was left behind",
}

PROGRAM = """
import os, signal, sys, threading, time
NUMBER = signal.{number}
def strike():
    os.kill(os.getpid(), NUMBER)
{when}
from hfx_blender.__main__ import main
main()
"""

WHILE_BLENDER_CALLS = """
from hfx_blender.processes import blender_session
start = blender_session.start
def started():
    bpy = start()
    handlers = bpy.app.handlers
    handlers.load_post.append(handlers.persistent(lambda *_: strike()))
    blender_session.start = start
    return bpy
blender_session.start = started
"""

WITHIN_A_LOCK = """
from hfx_blender.export.batch import work
lock = threading.Lock()
def done(unit, progress):
    with lock:
        threading.Timer(0.2, strike).start()
        threading.Event().wait(60)
work.run_safely = done
"""

IN_C = """
from hfx_blender.export.batch import work
def done(unit, progress):
    import numpy
    threading.Timer(0.2, strike).start()
    time.sleep(60)
work.run_safely = done
"""

AT_A_CALLBACK_OF_C = """
import ctypes
from hfx_blender.export.batch import work
def done(unit, progress):
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    def compare(a, b):
        strike()
        return 0
    numbers = (ctypes.c_int * 100)()
    sort = ctypes.CDLL(None).qsort
    for _ in range(60):
        sort(numbers, 100, 4, kind(compare))
        progress(0.5)
        time.sleep(1)
work.run_safely = done
"""

WHILE_MODULES_ARE_IMPORTED = """
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "hfx_blender.commands.console":
            strike()
sys.meta_path.insert(0, Finder())
"""

WHEN = {
    "Blender calls": WHILE_BLENDER_CALLS,
    "a lock": WITHIN_A_LOCK,
    "C": IN_C,
    "a callback of C": AT_A_CALLBACK_OF_C,
    "imports": WHILE_MODULES_ARE_IMPORTED,
}


@pytest.fixture(scope="module")
def scene(registered: object, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene()
    return hfx_scenes.save(tmp_path_factory.mktemp("scene") / "small.blend")


@pytest.mark.parametrize(
    ("when", "number"),
    [
        *(("Blender calls", number) for number in CODES),
        ("a lock", "SIGTERM"),
        ("C", "SIGTERM"),
        ("a callback of C", "SIGINT"),
        ("imports", "SIGINT"),
        ("imports", "SIGTERM"),
    ],
)
def test_a_signal_is_never_lost(when: str, number: str, scene: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    program = PROGRAM.format(number=number, when=WHEN[when])
    done = subprocess.run(
        [sys.executable, "-c", program, "export", scene, "-o", tmp_path / "out"],
        env={**hfx_scenes.environment(), "TMPDIR": str(temporary)},
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=_heeds_signals,
    )
    assert done.stderr.splitlines() == [FAREWELL[number]] and done.stdout == ""
    assert done.returncode == CODES[number]
    assert not (tmp_path / "out").exists()
    assert hfx_scenes.names_in(temporary) == []


def _heeds_signals() -> None:
    """Restore default signal handlers: the tests may run under ``nohup`` or in the background."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_a_signal_that_another_program_handles_is_its_own(scene: Path, tmp_path: Path) -> None:
    program = PROGRAM.format(number="SIGTERM", when=WHILE_BLENDER_CALLS).replace(
        "from hfx_blender.__main__",
        "signal.signal(NUMBER, lambda *_: None)\nfrom hfx_blender.__main__",
    )
    words = ["export", scene, "-o", tmp_path / "out", "--frames", "0:2", "--device", "none"]
    done = subprocess.run(
        [sys.executable, "-c", program, *words], env=hfx_scenes.environment(), capture_output=True
    )
    assert done.returncode == 0 and (tmp_path / "out" / "small.hfxtrack").exists()


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc")
def test_signals_at_random_moments(tmp_path: Path) -> None:
    commands = check_signals.prepare(tmp_path / "made", is_short=True)
    names = ("export", "convert", "play", "validate")
    quick = {name: commands[name] for name in names}
    actual = check_signals.check(quick, tmp_path / "made", 24, seed=7)
    assert not actual.faults, actual.text()
