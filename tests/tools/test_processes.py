# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of the demo and the measurements end, and clean up, with the parent process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PATIENCE_S = 20.0

_CHILD = """
import pathlib, signal, sys, time
def tidy(*_):
    pathlib.Path(sys.argv[1], "tidied").touch()
    sys.exit(143)
signal.signal(signal.SIGTERM, tidy)
pathlib.Path(sys.argv[1], "started").touch()
time.sleep(60.0)
"""
_PARENT = f"""
import sys
from hfx_blender.processes import process_end
from hfx_tools.command_process.signal_watch import end_on_signals
from hfx_tools import processes
end_on_signals()
try:
    processes.run(processes.program({_CHILD!r}, sys.argv[1]))
except process_end.TerminatedError as error:
    print(error.exit_code)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
def test_a_signal_ends_the_child_process_after_its_cleanup(tmp_path: Path) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", _PARENT, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    until_s = time.monotonic() + PATIENCE_S
    while not (tmp_path / "started").exists():
        assert time.monotonic() < until_s and parent.poll() is None
        time.sleep(0.01)
    parent.send_signal(signal.SIGTERM)
    out, _ = parent.communicate(timeout=PATIENCE_S)
    assert out.split() == ["143"]
    assert (tmp_path / "tidied").exists()
