# SPDX-License-Identifier: GPL-3.0-or-later
"""Silence of a board after each ending of ``hfx feel``, ``hfx play`` and a tracking Blender.

``python tests/manual/processes/silence_trials.py CLIP --trials 300`` starts a session for each
trial, ends the session at a random moment, and prints the times from the ending to the first
silence at the port, by kind. CLIP: 60 s of vibration on a body with the shipped ``waist_belt``.
``--only KIND`` (as ``feel:SIGHUP``) runs one kind. ``--anytime`` sends the signals of ``feel``,
``osc`` and ``follow`` from the start of the command on. For an unplugged board the times are those
of the command's end; for a receiver of UDP that has gone and returns before Ctrl-C, those of the
last datagram other than silence. The board is the firmware compiled for this
computer; a silence by its own dead-man switch is listed apart. POSIX.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from check_signals import moment_of
from live_timing import (
    Board,
    DistantBoard,
    Sender,
    device_file,
    free_port,
    prioritize_session,
    shown,
    until,
)
from pythonosc.osc_message_builder import OscMessageBuilder

ROOT = Path(__file__).resolve().parents[3]
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL")
KINDS = (
    *(f"{command}:{name}" for command in ("feel", "osc", "follow") for name in SIGNALS),
    *("feel:error", "osc:error", "follow:error"),
    *("feel:end", "osc:end", "feel:lost", "follow:lost"),
    *("blender:quit", "blender:SIGTERM", "blender:SIGKILL"),
    *("feel:unplug", "osc:unplug", "udp:gone"),
)


def child(descriptor: int, arguments: list[str]) -> None:
    """Run ``hfx``; write the time of a raised error and of the first stop to a pipe. After SIGUSR1
    the receiver of OSC raises an error."""
    from hfx_blender.processes import startup

    startup.begin()  # from here on signals end the command
    from hfx_blender.__main__ import main
    from hfx_blender.devices.live.client import LiveClient
    from hfx_blender.devices.live.host_pipe import HostPipe
    from hfx_blender.tracking.receiver import OscReceiver

    taken, stopped, start = OscReceiver.take, LiveClient.stop_all, HostPipe.start
    broken: list[int] = []

    def note() -> None:
        os.write(descriptor, struct.pack("d", time.perf_counter()))

    def take(self: OscReceiver) -> Any:
        if broken:
            note()
            raise RuntimeError("broken")
        return taken(self)

    def stop_all(self: LiveClient, *reason: str) -> None:
        note()
        stopped(self, *reason)

    def start_host(self: HostPipe) -> None:
        start(self)
        prioritize_session(self.pid or 0)

    prioritize_session(os.getpid())
    OscReceiver.take, LiveClient.stop_all = take, stop_all  # type: ignore[method-assign]
    HostPipe.start = start_host  # type: ignore[method-assign]
    signal.signal(signal.SIGUSR1, lambda number, _frame: broken.append(number))
    sys.argv[1:] = arguments
    sys.exit(main())


class Clock(threading.Thread):
    """Other program that sends its time by OSC, 60 times a second."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.address, self.ended, self.sent_s = ("127.0.0.1", port), threading.Event(), 0.0

    def run(self) -> None:
        begun_s = time.perf_counter()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as outgoing:
            while not self.ended.wait(1 / 60):
                builder = OscMessageBuilder("/time")
                self.sent_s = time.perf_counter()
                builder.add_arg((self.sent_s - begun_s) % 50.0, "f")
                outgoing.sendto(builder.build().dgram, self.address)


@contextmanager
def session(kind: str, clip: Path, folder: Path, board: DistantBoard) -> Iterator[Any]:
    """Command or Blender with a board: (process, sender or None, reading end of the pipe of
    moments)."""
    command, _, ending = kind.partition(":")
    (reading, writing), sender = os.pipe(), None
    port = free_port()
    options = [str(clip), "--device", "waist_belt", "--port", board.port]
    if command == "feel":
        sender = Sender(port)
        line = ["feel", *options, "--vmc", str(port)]
        line += ["--seconds", f"{random.uniform(0.5, 1.0):.3f}"] if ending == "end" else []
    elif command == "udp":
        sender = Sender(port)
        device = device_file("udp", folder, board.port, "waist_belt")
        line = ["feel", str(clip), "--device", str(device), "--vmc", str(port)]
    elif command == "osc":
        line = ["play", *options, "--osc", str(port)]
        line += ["--from", f"{random.uniform(59.0, 59.4):.3f}"] if ending == "end" else []
    elif command == "follow":
        sender = Clock(port)
        line = ["play", *options, "--follow", str(port)]
    program = [sys.executable, str(Path(__file__).resolve()), "--child", str(writing)]
    if command == "blender":
        program[1] = str(Path(__file__).resolve().with_name("track_body_stops.py"))
        line = ["--port", board.port]
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "HFX_USER_DATA": str(folder),
    }
    with open(folder / "output.txt", "w+b") as output:
        process = subprocess.Popen(
            [*program, *line],
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            pass_fds=[writing],
            start_new_session=True,
        )
        os.close(writing)
        if sender is not None:
            sender.start()
        try:
            yield process, sender, reading
        finally:
            if process.poll() is None:
                process.kill()
            process.wait()
            if sender is not None:
                sender.ended.set()
            until(lambda: board.strength == 0.0, 2.0)
            os.close(reading)


def trial_anytime(kind: str, clip: Path, folder: Path, board: DistantBoard) -> tuple[Any, str]:
    """Seconds from a signal at a random moment since the start to the silence, 0 before the first
    vibration, and ""; or None and the fault."""
    number = getattr(signal, kind.partition(":")[2])
    with session(kind, clip, folder, board) as (process, _sender, _reading):
        time.sleep(random.uniform(0.0, 2.5))
        os.kill(process.pid, signal.SIGSTOP)
        moment = moment_of(process.pid)
        began_s = time.perf_counter()
        os.kill(process.pid, number)
        os.kill(process.pid, signal.SIGCONT)
        if moment == "start":  # Python starts and imports this file
            return 0.0, ""
        if not until(lambda: process.poll() is not None, 20.0):
            text = (folder / "output.txt").read_text(errors="replace")
            return None, f"did not end, {moment}: {text[-600:]}"
        is_silent = until(lambda: board.strength == 0.0, 1.0)
        output = (folder / "output.txt").read_text(errors="replace")
        is_right = process.returncode == 128 + number
        if not is_silent or board.is_by_dead_man or not is_right:
            at_end = f"exit {process.poll()}, dead man {board.is_by_dead_man}"
            return None, f"{at_end}: {output[-600:]}"
        return max(board.changed_s - began_s, 0.0), ""


def trial_unplugged(kind: str, clip: Path, folder: Path) -> tuple[float | None, str]:
    """Seconds from the closing of the board's terminal to the exit with code 4 and "", or None and
    the fault."""
    board = DistantBoard()
    board.start()
    with session(kind, clip, folder, board) as (process, _sender, _reading):
        if not until(lambda: board.strength > 0.0 or process.poll() is not None, 60.0):
            return None, "did not start"
        time.sleep(random.uniform(0.02, 0.4))
        began_s = time.perf_counter()
        board.close()
        board.strength = 0.0
        is_ended = until(lambda: process.poll() is not None, 20.0)
        ended_s = time.perf_counter()
        output = (folder / "output.txt").read_text(errors="replace")
        if not is_ended or process.returncode != 4 or " is lost " not in output:
            return None, f"exit {process.poll()}: {output[-600:]}"
        return ended_s - began_s, ""


def trial_gone(kind: str, clip: Path, folder: Path) -> tuple[float | None, str]:
    """Seconds from Ctrl-C to the last vibration at a receiver of UDP that went and came back before
    Ctrl-C and "", or None and the fault."""
    board = Board("udp")
    board.start()
    with session(kind, clip, folder, board) as (process, _sender, _reading):  # type: ignore[arg-type]
        if not until(lambda: board.strength > 0.0 or process.poll() is not None, 60.0):
            return None, "did not start"
        board.close()
        board.strength = 0.0
        time.sleep(random.uniform(0.02, 0.4))
        again = Board("udp", int(board.port))
        again.start()
        if not until(lambda: again.strength > 0.0, 5.0):
            return None, "does not return"
        time.sleep(random.uniform(0.02, 0.4))
        began_s = time.perf_counter()
        process.send_signal(signal.SIGINT)
        is_ended = until(lambda: process.poll() is not None, 20.0)
        time.sleep(0.1)
        output = (folder / "output.txt").read_text(errors="replace")
        again.close()
        if not is_ended or process.returncode != 130 or again.strength:
            return None, f"exit {process.poll()}, strength {again.strength}: {output[-600:]}"
        return max(again.changed_s - began_s, 0.0), ""


def trial(kind: str, clip: Path, folder: Path, board: DistantBoard) -> tuple[float | None, str]:
    """Seconds from the ending to the silence and "", or None and the fault."""
    ending = kind.partition(":")[2]
    if ending == "unplug":
        return trial_unplugged(kind, clip, folder)
    if ending == "gone":
        return trial_gone(kind, clip, folder)
    with session(kind, clip, folder, board) as (process, sender, reading):

        def fault(text: str) -> tuple[None, str]:
            output = (folder / "output.txt").read_text(errors="replace").strip()
            at_end = f"exit {process.poll()}, dead man {board.is_by_dead_man}"
            return None, f"{text} ({at_end}): {output[-600:]}"

        started = until(lambda: board.strength > 0.0 or process.poll() is not None, 60.0)
        if not started or board.strength == 0.0:
            return fault("did not start")
        if ending != "end":
            time.sleep(random.uniform(0.02, 0.4))
        began_s = time.perf_counter()
        if ending in SIGNALS:
            process.send_signal(getattr(signal, ending))
        elif ending == "lost":
            sender.ended.set()
            sender.join()
            began_s = time.perf_counter()
        elif ending in ("error", "quit"):
            process.send_signal(signal.SIGUSR1)
        if not until(lambda: board.strength == 0.0, 4.0):
            return fault("no silence")
        silent_s = board.changed_s
        if ending in ("error", "quit", "end"):
            began_s = struct.unpack("d", os.read(reading, 8))[0]
        if ending != "lost" and not until(lambda: process.poll() is not None, 20.0):
            return fault("did not end")
        if board.strength or board.changed_s > silent_s:
            return fault("not silent until its end")
        if board.is_by_dead_man:
            halted = f"the board's process halted for {1000.0 * board.halted_s:.1f} ms"
            return fault(f"dead-man switch after {1000.0 * (silent_s - began_s):.1f} ms; {halted}")
        return silent_s - began_s, ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("--trials", type=int, default=len(KINDS))
    parser.add_argument("--anytime", action="store_true")
    parser.add_argument("--only", choices=KINDS, action="append", default=[])
    options = parser.parse_args()
    seconds: dict[str, list[float]] = {}
    faults = 0
    board = DistantBoard()
    board.start()
    kinds = options.only or KINDS
    with suppress(KeyboardInterrupt):  # Ctrl-C shows the trials so far
        for number in range(options.trials):
            kind = kinds[number % len(kinds)]
            # A killed command leaves its output process behind, which writes files for a moment.
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                is_anytime = options.anytime and kind.partition(":")[2] in SIGNALS[:3]
                run = trial_anytime if is_anytime else trial
                taken_s, fault = run(kind, options.clip, Path(folder), board)
            if taken_s is None:
                faults += 1
                print(f"trial {number}, {kind}: {fault}", flush=True)  # noqa: T201
            else:
                seconds.setdefault(kind, []).append(taken_s)
                if taken_s > 0.05 and not kind.endswith(("lost", "unplug")):
                    halted = f"the board's process halted for {1000.0 * board.halted_s:.1f} ms"
                    text = f"trial {number}, {kind}: {1000.0 * taken_s:.1f} ms; {halted}"
                    print(text, flush=True)  # noqa: T201
    for kind in kinds:
        if kind in seconds:
            shown(f"{kind} to silence", seconds[kind])
    print(f"{faults} faults")  # noqa: T201
    board.close()
    return int(faults > 0)


if __name__ == "__main__":
    if sys.argv[1] == "--child":
        child(int(sys.argv[2]), sys.argv[3:])
    sys.exit(main())
