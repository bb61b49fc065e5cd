# SPDX-License-Identifier: GPL-3.0-or-later
"""End of a command by a signal while the main thread is slow."""

from __future__ import annotations

import os
import subprocess
import sys

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
