# SPDX-License-Identifier: GPL-3.0-or-later
"""Output process with deadlines far in the future, never missed on a busy machine.

Deadlines are tested on a simulated clock; for real processes, tests check order and content.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from hfx_blender.devices.host import device_thread, host
from hfx_blender.devices.workers import render_process, script_process
from hfx_blender.processes import start
from hfx_tools import processes

VARIABLE = "HFX_TEST_PATIENCE_S"
"""Seconds, where a test wants a deadline to be missed."""


def command(module: str, *arguments: str, of: Callable[..., list[str]]) -> list[str]:
    """Return the command line, in place of ``start.command``."""
    if module == "devices.host.host":
        return processes.program(Path(__file__).read_text(encoding="utf-8"), *arguments)
    return of(module, *arguments)


def use() -> None:
    """Disable deadlines of devices in this process from now on."""
    before = start.command
    start.command = lambda *which: command(*which, of=before)  # type: ignore[assignment]


if __name__ == "__main__":
    patience_s = float(os.environ.get(VARIABLE, "600"))
    device_thread.FREEZE_S = host.FREEZE_S = host.HEARTBEAT_S = 600.0  # type: ignore[misc]
    script_process.READY_S = render_process.MOMENT_S = 600.0  # type: ignore[misc]
    device_thread.PATIENCE_S = script_process.PATIENCE_S = patience_s  # type: ignore[misc]
    host.main()
