# SPDX-License-Identifier: GPL-3.0-or-later
"""Output process: a failure silences the failed device or sender, and no more."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from live_process import BAND, PATIENCE_S, is_loud, play, playing, rows_of, wait

from hfx_blender.devices.host import host, process_watch
from hfx_blender.devices.live.client import LiveClient
from hfx_blender.devices.workers.message_bodies import encode_values
from hfx_blender.processes.messages import MessageKind, encode_json, message

SENDER = """
import sys, time
import patient_host
patient_host.use()
from live_process import BAND, playing
from hfx_blender.devices.live.client import LiveClient
client = LiveClient()
client.connect("band", BAND, {"kind": "simulator", "path": sys.argv[1]})
while True:
    client.send("band", playing())
    client.heartbeat()
    time.sleep(0.01)
"""


def is_silent(log: Path) -> bool:
    rows = rows_of(log)
    return "stop" in rows[-1] and any(map(is_loud, rows))


def until(happened) -> None:
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < end, "never happened"
        time.sleep(0.005)


@pytest.fixture
def sender(log: Path):
    """Start a process in the role of Blender, with one playing device."""
    here = Path(__file__)
    process = subprocess.Popen(
        [sys.executable, "-c", SENDER, str(log)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, here.parents[1:3]))},
    )
    until(lambda: any(map(is_loud, rows_of(log))))
    yield process
    process.kill()
    process.wait()


def test_stop_all_silences_until_armed(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    client.stop_all()
    wait(client, lambda: client.devices["band"].state == "stopped")
    count = len(rows_of(log))
    for _ in range(10):
        client.send("band", playing())
        client.heartbeat()
    assert is_silent(log)
    assert all("stop" in row for row in rows_of(log)[count:])
    client.arm()
    wait(client, lambda: is_loud(rows_of(log)[-1]), lambda: client.send("band", playing()))


def test_one_device_is_stopped_and_another_plays_on(client: LiveClient, tmp_path: Path) -> None:
    logs = tmp_path / "a", tmp_path / "b"
    for log in logs:
        play(client, log.name, log)
    client.stop("a")
    wait(client, lambda: client.devices["a"].state == "stopped")
    count = len(rows_of(logs[1]))
    wait(client, lambda: len(rows_of(logs[1])) > count + 5)
    assert is_silent(logs[0])
    assert is_loud(rows_of(logs[1])[-1])


def test_a_pause_is_silence_that_ends_by_itself(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    client.pause()
    until(lambda: not is_loud(rows_of(log)[-1]))
    assert client.devices["band"].is_armed
    assert not any("stop" in row for row in rows_of(log)[3:])  # without the stops at the opening
    wait(client, lambda: is_loud(rows_of(log)[-1]), lambda: client.send("band", playing()))


def test_closing_is_silence(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    client.close()
    assert is_silent(log)
    client.close()  # may be done again
    assert not client.pipe.is_running


def test_a_new_start_after_closing_plays(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    client.close()
    log.unlink()
    play(client, "band", log)
    assert is_loud(rows_of(log)[-1])


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="POSIX signals")
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_blender_killed_is_silence(sender: subprocess.Popen[bytes], log: Path, name: str) -> None:
    os.kill(sender.pid, getattr(signal, name))
    until(lambda: is_silent(log))


@pytest.mark.skipif(os.name == "nt", reason="Windows knows no SIGTERM")
def test_blender_killed_is_silence_though_its_pipe_stays_open(log: Path) -> None:
    # A second process holds the pipe open, as the system does while freeing memory.
    holding = SENDER.replace(
        "while True:",
        "import subprocess\n"
        "pipe = client.pipe.worker.process.stdin.fileno()\n"
        "held = subprocess.Popen([sys.executable, '-c', 'input()'], stdin=0, pass_fds=(pipe,))\n"
        "while True:",
    )
    here = Path(__file__)
    process = subprocess.Popen(
        [sys.executable, "-c", holding, str(log)],
        stdin=subprocess.PIPE,  # closing stdin ends the holder
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, here.parents[1:3]))},
    )
    try:
        until(lambda: any(map(is_loud, rows_of(log))))
        process.kill()
        until(lambda: is_silent(log))
    finally:
        process.kill()
        process.communicate()


def _stat(
    state: str = "S", flags: int = 0x400000, pending: int = 0, name: str = "blender"
) -> bytes:
    """Return a line of ``/proc/PID/stat`` with field numbers of proc(5): 2 comm, 3 state, 9 flags,
    31 signal.
    """
    fields = {number: "0" for number in range(1, 53)}
    fields |= {1: "77", 2: f"({name})", 3: state, 9: str(flags), 31: str(pending)}
    return " ".join(fields.values()).encode()


@pytest.mark.parametrize(
    ("stat", "is_ending"),
    [
        (_stat(), False),
        (_stat("R"), False),
        (_stat("T"), False),  # stopped: covered by the heartbeat
        (_stat(pending=1 << 14), False),  # SIGTERM, possibly handled by the process
        (_stat("Z"), True),
        (_stat("X"), True),
        (_stat(flags=0x40040C), True),
        (_stat(flags=0x40044C, pending=0), True),
        (_stat(pending=1 << 8), True),  # SIGKILL
        (_stat(name="a) Z (b"), False),
        (_stat(name=") X 4 4 4 4 4 4", flags=0x400004), True),
        (_stat(name="new\nline )", state="D"), False),
    ],
)
def test_the_system_reports_the_end_of_a_process(stat: bytes, is_ending: bool) -> None:
    assert process_watch.says_ending(stat) == is_ending


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
def test_a_process_that_lives_is_not_ending_and_one_that_has_gone_is() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        is_ending = process_watch.end_test(process.pid)
        assert not any(is_ending() for _ in range(50))
        process.kill()
        until(is_ending)
        process.wait()
        assert is_ending()  # the process id may be in use again
    assert not process_watch.await_end(process.pid)  # nothing to watch: the pipe closes


def test_the_output_process_is_silent_before_ending(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    os.kill(client.pipe.pid or 0, signal.SIGTERM)
    wait(client, lambda: client.devices["band"].state == "lost")
    assert is_silent(log)


def test_garbage_instead_of_messages_is_silence(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    client.pipe.worker.process.stdin.write(b"\xff" * 64)
    until(lambda: is_silent(log))


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (MessageKind.CONNECT, b"{"),
        (MessageKind.PULSE, b'{"actuator": null}'),
        (MessageKind.SETTINGS, b"[]"),
        (MessageKind.HAPTICS, b"nonsense"),
    ],
)
def test_nonsense_inside_a_message_does_not_leave_anything_on(
    client: LiveClient, log: Path, kind: MessageKind, body: bytes
) -> None:
    play(client, "band", log)
    client.pipe.worker.process.stdin.write(message(kind, client.devices["band"].number, body))
    time.sleep(0.1)
    client.close()
    assert is_silent(log)


def test_a_failure_to_open_is_reported_and_other_devices_play(
    client: LiveClient, log: Path
) -> None:
    client.connect("none", "no_such_device", {"kind": "simulator"})
    client.connect("odd", BAND, {"kind": "telepathy"})
    client.connect("closed", BAND, {"kind": "simulator", "path": str(log / "no" / "folder")})
    play(client, "band", log)
    wait(
        client,
        lambda: all(client.devices[n].state == "lost" for n in ("none", "odd", "closed")),
        lambda: client.send("band", playing()),
    )
    assert "unknown" in client.devices["none"].text
    assert "telepathy" in client.devices["odd"].text
    assert "closed" in client.devices["closed"].name
    wait(client, lambda: client.devices["band"].is_armed)


class Stalling:
    """Output blocking every send until released."""

    def __init__(self) -> None:
        self.go = threading.Event()

    def send(self, _values: np.ndarray) -> None:
        self.go.wait(PATIENCE_S)

    def stop(self) -> None: ...

    def close(self) -> None: ...


def test_a_port_that_stalls_stops_its_device_only(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs inside the test process, as no real output stalls on demand."""
    stalling, opened = Stalling(), host.open_output
    monkeypatch.setattr(
        host,
        "open_output",
        lambda device, to: stalling if to["kind"] == "stalling" else opened(device, to),
    )
    messages: list[tuple[str, int, str]] = []
    script_host = host.Host(
        lambda event, number=0, text="", **_: messages.append((event, number, text))
    )  # type: ignore[arg-type]
    reading, writing = os.pipe()
    threads = [
        threading.Thread(target=script_host.read, args=(os.fdopen(reading, "rb"),)),
        threading.Thread(target=script_host.watch),
    ]
    for thread in threads:
        thread.start()
    end = time.monotonic() + PATIENCE_S

    def live_until(is_true: Callable[[], object]) -> None:
        while not is_true():
            assert time.monotonic() < end, messages
            for number in (1, 2):
                os.write(writing, message(MessageKind.VALUES, number, encode_values(playing())))
            if any(event == "frozen" and number == 1 for event, number, _ in messages):
                os.write(writing, message(MessageKind.ARM, 1))  # this process was late itself
                messages[:] = [finding for finding in messages if finding[0] != "frozen"]
            time.sleep(0.005)

    try:
        wishes = {1: {"kind": "simulator", "path": str(log)}, 2: {"kind": "stalling"}}
        for number, output in wishes.items():
            wish = encode_json({"configuration": BAND, "output": output})
            os.write(
                writing,
                message(MessageKind.CONNECT, number, wish) + message(MessageKind.ARM, number),
            )
        live_until(lambda: any(event == "fault" and number == 2 for event, number, _ in messages))
        assert any(number == 2 and "stalls" in text for _, number, text in messages)
        count = len(rows_of(log))
        live_until(lambda: len(list(filter(is_loud, rows_of(log)[count:]))) > 5)
    finally:
        stalling.go.set()
        os.close(writing)
        for thread in threads:
            thread.join(PATIENCE_S)
    script_host.silence("the end")
    assert not is_loud(rows_of(log)[-1])


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="POSIX signals")
def test_an_output_process_that_confirms_no_stop_is_ended(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    assert client.pipe.pid is not None
    os.kill(client.pipe.pid, signal.SIGSTOP)
    # On a busy machine a thread may run on and confirm the stop; this waits for all threads.
    os.waitpid(client.pipe.pid, os.WUNTRACED)
    client.stop_all()
    wait(client, lambda: not client.pipe.is_running)
    wait(client, lambda: client.devices["band"].state == "lost")
    assert "ended" in client.devices["band"].text


def _large(number: int) -> bytes:
    """Begin of a message of 8 MB, whose rest is never sent."""
    return message(MessageKind.VALUES, number, bytes(8 << 20))[: 1 << 16]


@pytest.mark.parametrize("silence", ["stop_all", "stop", "pause", "mute", "close_port"])
def test_a_silence_waits_for_no_message_on_its_way(
    client: LiveClient, log: Path, silence: str
) -> None:
    play(client, "band", log)
    state = client.devices["band"]
    client.pipe.worker.process.stdin.write(_large(state.number))
    if silence == "mute":
        client.set_gains({state.number: 0.0})
    else:
        getattr(client, silence)(*(["band"] if silence in ("stop", "close_port") else []))
    until(lambda: not is_loud(rows_of(log)[-1]))
    os.kill(client.pipe.pid or 0, signal.SIGTERM)  # the rest of the message never comes


def test_many_silences_that_nothing_reads_cost_nothing(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    os.kill(client.pipe.pid or 0, signal.SIGSTOP)
    os.waitpid(client.pipe.pid or 0, os.WUNTRACED)
    begun = time.monotonic()
    for _ in range(5000):  # more than a pipe takes
        client.stop("band")
        client.pause()
    assert time.monotonic() - begun < PATIENCE_S
    os.kill(client.pipe.pid or 0, signal.SIGKILL)


def test_sending_never_waits_for_an_output_process_that_sleeps(
    client: LiveClient, log: Path
) -> None:
    play(client, "band", log)
    os.kill(client.pipe.pid or 0, signal.SIGSTOP)
    begun = time.monotonic()
    for _ in range(20000):  # far more than a pipe takes
        client.send("band", playing())
        client.heartbeat()
    assert time.monotonic() - begun < PATIENCE_S
    assert len(client.pipe.newest) <= 1
    assert len(client.pipe.urgent) <= 1
    os.kill(client.pipe.pid or 0, signal.SIGKILL)


def test_without_blender_no_device_is_left_behind(client: LiveClient, log: Path) -> None:
    play(client, "band", log)
    process = client.pipe.worker.process
    process.stdin.close()
    assert process.wait(PATIENCE_S) == 0
    assert is_silent(log)
