# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals during ``hfx play``, ``hfx feel`` and ``hfx study run``: devices stop at once."""

from __future__ import annotations

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from hfx_blender.processes import process_end
from hfx_tools.study.device_player import DevicePlayer

BUSY = """
import os, signal, sys, time
from types import SimpleNamespace
from hfx_tools.command_process import signal_watch
from hfx_tools.commands import playback_loop

moments = []

def busy(moment):
    if moment == sys.argv[1] and not moments:
        os.kill(os.getpid(), signal.SIGHUP)
        time.sleep(0.5)  # goes on after the handler
        moments.append("end of " + moment)

class Client:
    devices = {"belt": SimpleNamespace(name="belt", state="stopped", text="", is_armed=True)}
    heartbeat = staticmethod(lambda: busy("heartbeat"))
    events = staticmethod(lambda: busy("events") or [])

    def stop_all(self, *reason):
        moments.append("stop")
        self.devices["belt"].is_armed = False

class Source:
    is_rendered, start_s, end_s, sample_s = False, 0.0, 60.0, 0.01
    begin = staticmethod(lambda client: busy("begin"))
    show = staticmethod(lambda client, time_s: busy("show"))

signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
signal_watch.end_on_signals()
try:
    playback_loop.play(Source(), Client())
except BaseException as error:
    moments.append(type(error).__name__)
print(", ".join(moments))
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("moment", ["begin", "heartbeat", "events", "show"])
def test_a_signal_stops_devices_while_the_main_thread_is_busy(moment: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BUSY, moment],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout == f"stop, end of {moment}, stop, TerminatedError\n", done.stderr


def test_devices_of_a_study_stopped_by_a_signal_have_no_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process_end, "state", process_end.SignalState())
    stopped = SimpleNamespace(name="belt", state="stopped", text="", is_armed=False)

    def stopped_by_signal() -> list[object]:
        process_end.state.number = 15
        return []

    client = SimpleNamespace(
        devices={"belt": stopped}, heartbeat=lambda: None, events=stopped_by_signal
    )
    for wait in (DevicePlayer(client, {}).idle, DevicePlayer(client, {}).wait_ready):
        process_end.state.number, process_end.state.is_unwinding = 0, False
        with pytest.raises(process_end.TerminatedError):
            wait()
