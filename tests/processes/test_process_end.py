# SPDX-License-Identifier: GPL-3.0-or-later
"""End of a command by a signal while the main thread is slow."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SLOW_FAREWELL = """
import os, signal, time
from hfx_blender import cli
from hfx_blender.commands.console import Console
from hfx_tools.command_process import signal_watch

write = Console.warn
def slow(self, text):
    write(self, text)
    time.sleep(2.0)
Console.warn = slow
signal_watch.UNWINDING_S = 0.2
cli.build_parser()  # imports all commands, which takes long
signal_watch.end_on_signals()
os.kill(os.getpid(), signal.SIGTERM)
cli.run(["device", "list"])
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_one_sentence_when_the_time_limit_ends_during_its_output() -> None:
    """Both the main thread and the watching thread are about to write the message."""
    command = [sys.executable, "-c", SLOW_FAREWELL]
    completed = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert completed.returncode == 143
    assert completed.stderr.splitlines() == [
        "hfx: ended by SIGTERM; nothing half written was left behind"
    ]


FORCED_END = """
import os, signal, sys, threading, time
from pathlib import Path
from hfx_blender.files import atomic
from hfx_blender.files.staging import place, stage_folder, staging
from hfx_tools.command_process import signal_watch
from hfx_tools.command_process.temporary_folder import temporary_folder

folder, moment = Path(sys.argv[1]), sys.argv[2]
makers = {
    "stage_folder": lambda: stage_folder(folder, "name"),
    "staging": lambda: staging(folder / "new", "name"),
    "place": lambda: place([folder / "sub" / "missing"], folder / "new", folder),
    "atomic_file": lambda: atomic.atomic_file(folder / "name"),
    "temporary_folder": temporary_folder,
}
tidy, tidied = signal_watch._tidy, threading.Event()

def tidied_late():
    tidy()
    tidied.set()
    time.sleep(0.3)  # the main thread runs on until the exit

def strike_after(make):
    def made(*arguments, **settings):
        result = make(*arguments, **settings)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.6)
        return result
    return made

signal_watch._tidy, signal_watch.UNNOTICED_S = tidied_late, 0.1
signal_watch.end_on_signals()
if moment == "after the removal":
    os.kill(os.getpid(), signal.SIGTERM)
    tidied.wait()
else:
    os.mkdir, atomic.WatchedFile = strike_after(os.mkdir), strike_after(atomic.WatchedFile)
sys.modules["hfx_blender.files.staging"].move = lambda *_: time.sleep(60)
try:
    with makers[sys.argv[3]]():
        time.sleep(60)
except Exception:  # the folder is removed before the exit
    time.sleep(60)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize(
    "maker", ["stage_folder", "staging", "place", "atomic_file", "temporary_folder"]
)
@pytest.mark.parametrize("moment", ["after the making", "after the removal"])
def test_a_forced_end_leaves_no_file_of_the_running_main_thread(
    moment: str, maker: str, tmp_path: Path
) -> None:
    """The watching thread ends the process while the main thread makes a file, or just before."""
    completed = subprocess.run(
        [sys.executable, "-c", FORCED_END, tmp_path, moment, maker],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert completed.returncode == 143
    assert completed.stderr == "hfx: ended by SIGTERM; nothing half written was left behind\n"
    assert list(tmp_path.iterdir()) == []
