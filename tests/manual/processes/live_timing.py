# SPDX-License-Identifier: GPL-3.0-or-later
"""Times of ``hfx feel`` between a sender of poses and the port of a device, measured from outside.

``python tests/manual/processes/live_timing.py CLIP --changes 300`` sends a body of 60 poses 60
times a second, and prints the times from the datagram of a new pose to the frame at the port.
``--transport pty`` is a serial board, ``udp`` a board that receives OSC. CLIP: a volume round the
trunk of a body with the shipped ``waist_belt``. ``--bodies 2 --transport udp`` needs a clip of two
bodies with copies of the belt that are named belt_a and belt_b, and their names. POSIX.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import select
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.tracking.vmc_body import PARENTS
from hfx_tools.bench.safety.firmware_core import Board as FirmwareBoard
from hfx_tools.bench.safety.firmware_core import built

ROOT = Path(__file__).resolve().parents[3]
AWAY_M = 50.0  # beyond the volume


def body(x_m: float) -> bytes:
    """Bundle of 55 bones and five trackers, hips at ``x_m``."""
    bundle = OscBundleBuilder(IMMEDIATELY)
    names = [("Bone", name) for name in PARENTS] + [("Tra", f"T{k}") for k in range(5)]
    for kind, name in names:
        message = OscMessageBuilder(f"/VMC/Ext/{kind}/Pos")
        message.add_arg(name)
        # Thigh and shin of 0.45 m, as the hips move in proportion to the legs.
        place = (x_m, 0.95, 0.0) if name == "Hips" else (0.0, -0.45, 0.0)
        for number in (*place, 0.0, 0.0, 0.0, 1.0):
            message.add_arg(number, "f")
        bundle.add_content(message.build())
    return bundle.build().dgram


HERE, AWAY = body(0.0), body(AWAY_M)


class Sender(threading.Thread):
    """Person who sends 60 poses a second; :meth:`change` moves at once."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.address = ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.is_here, self.changed_s, self.ended = True, 0.0, threading.Event()
        self._is_changed = False

    def change(self) -> None:
        """Move with the next pose, whose time is then in ``changed_s``."""
        self.is_here, self._is_changed = not self.is_here, True

    def run(self) -> None:
        due_s = time.perf_counter()
        while not self.ended.is_set():
            is_changed, self._is_changed = self._is_changed, False
            if is_changed:
                self.changed_s = time.perf_counter()
            self.socket.sendto(HERE if self.is_here else AWAY, self.address)
            due_s += 1 / 60
            time.sleep(max(due_s - time.perf_counter(), 0.0))


class Board(threading.Thread):
    """Double of a device: the strength of its strongest motor, as of the newest frame.

    ``pty``: the board's firmware, compiled for this computer, with its dead-man switch of 250 ms.
    """

    def __init__(self, transport: str, port: int = 0) -> None:
        super().__init__(daemon=True)
        self.transport, self.strength, self.changed_s = transport, 0.0, 0.0
        self.first_s: float | None = None  # of the first change after clearing
        self.is_by_dead_man = False  # the last silence, by the board's own clock
        self.halted_s = 0.0  # longest turn of this thread since the last change: 5 ms at most, but
        # on a computer that stands still
        self.chunks: deque[tuple[float, bytes]] = deque(maxlen=20)  # received, with their times
        self._turn_s = time.perf_counter()
        self.changed: Callable[[], object] = lambda: None  # called after each change
        self._is_over = False
        if transport == "pty":
            self.end, self._device_end = os.openpty()
            tty.setraw(self._device_end)
            self.port = os.ttyname(self._device_end)
            self.firmware = FirmwareBoard(_firmware(), 32)
        else:
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.bind(("127.0.0.1", port))
            self.socket.settimeout(0.05)
            self.port = str(self.socket.getsockname()[1])
            self._motors: dict[bytes, float] = {}

    def close(self) -> None:
        """End the thread and close the terminal or socket."""
        self._is_over = True
        self.join()
        if self.transport == "udp":
            self.socket.close()
            return
        os.close(self.end)
        os.close(self._device_end)

    def run(self) -> None:
        while not self._is_over:
            if self.transport == "udp":
                with suppress(TimeoutError):
                    self._take_osc(self.socket.recv(65536), time.perf_counter())
                continue
            is_readable = select.select([self.end], [], [], 0.005)[0]
            content, now_s = os.read(self.end, 4096) if is_readable else b"", time.perf_counter()
            self.halted_s = max(self.halted_s, now_s - self._turn_s)
            self._turn_s = now_s
            board = self.firmware
            if content:
                self.chunks.append((now_s, content))
                board.now_ms = int(1000.0 * now_s)
                board.take(content)
            # The board's own clock runs only while no frame waits for this thread.
            elif not select.select([self.end], [], [], 0.0)[0]:
                board.now_ms = int(1000.0 * now_s) - 1
                board.wait(1)
            if self.strength and not max(board.levels):
                self.is_by_dead_man = not content
            self._set(max(board.levels), now_s)
            if board.sent:
                replies, board.sent[:] = bytes(board.sent), b""
                os.write(self.end, replies)

    def _take_osc(self, datagram: bytes, now_s: float) -> None:
        for address, number in re.findall(rb"(/[a-z_]+\d?)\0+,f\0\0(....)", datagram, re.DOTALL):
            self._motors[address] = struct.unpack(">f", number)[0]
        self._set(max(self._motors.values(), default=0.0), now_s)

    def _set(self, strength: float, now_s: float) -> None:
        if strength != self.strength:
            self.strength, self.changed_s = strength, now_s
            if self.first_s is None:
                self.first_s = now_s
            self.changed()
            self.halted_s = 0.0


class DistantBoard(threading.Thread):
    """:class:`Board` on a terminal in a process of its own: its times do not wait for this one."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        command = [sys.executable, str(Path(__file__).resolve()), "--board"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, bufsize=0)
        assert process.stdout is not None
        self._process, self._output = process, process.stdout
        self.port = b"".join(iter(lambda: self._output.read(1), b"\n")).decode()
        self.strength, self.changed_s, self.is_by_dead_man = 0.0, 0.0, False
        self.halted_s = 0.0  # of the board's process, before the last change

    def close(self) -> None:
        """End the process of the board."""
        self._process.kill()
        self._process.wait()

    def run(self) -> None:
        while record := self._output.read(_CHANGE.size):
            strength, self.changed_s, self.halted_s, self.is_by_dead_man = _CHANGE.unpack(record)
            self.strength = strength  # last, as readers wait for it


_CHANGE = struct.Struct("ddd?")


def print_changes() -> None:
    """Run a board, and write its port and each change to standard output, until a kill."""
    # A real board has a processor of its own.
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    board = Board("pty")
    os.write(1, f"{board.port}\n".encode())

    def print_change() -> None:
        if board.is_by_dead_man and not board.strength:
            for received_s, content in board.chunks:
                before_ms = 1000.0 * (board.changed_s - received_s)
                print(f"{before_ms:.1f} ms before: {content.hex(' ')}", file=sys.stderr)  # noqa: T201
        change = board.strength, board.changed_s, board.halted_s, board.is_by_dead_man
        os.write(1, _CHANGE.pack(*change))

    board.changed = print_change
    board.start()
    owner = os.getppid()
    while os.getppid() == owner:
        time.sleep(0.5)


@cache
def _firmware() -> Any:
    with tempfile.TemporaryDirectory() as folder:
        return built(Path(folder))


def prioritize_session(pid: int) -> None:
    """Give the session of a process the nice value of this process: with ``autogroup`` (man sched)
    Linux compares nice values within a session only, and the output process has a session of its
    own."""
    with suppress(OSError):  # no autogroup, or not permitted
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        Path(f"/proc/{pid}/autogroup").write_text(str(nice), encoding="ascii")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(condition: Any, limit_s: float) -> bool:
    end_s = time.perf_counter() + limit_s
    while not condition():
        if time.perf_counter() > end_s:
            return False
        time.sleep(0.0005)
    return True


class Session:
    """``hfx feel`` with a sender and a board for each body."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.senders = [Sender(free_port()) for _ in range(options.bodies)]
        self.boards = [Board(options.transport) for _ in self.senders]
        command = [sys.executable, "-m", "hfx_blender", "feel", str(options.clip)]
        ids = ["waist_belt"] if options.bodies == 1 else ["belt_a", "belt_b"]
        for name, board in zip(ids, self.boards, strict=True):
            board.start()
            command += ["--device", str(device_file(options.transport, folder, board.port, name))]
        if options.transport == "pty":
            command += ["--port", self.boards[0].port]
        if options.bodies == 1:
            command += ["--vmc", str(self.senders[0].address[1])]
        for k, sender in enumerate(self.senders if options.bodies > 1 else ()):
            command += ["--body", f"{options.names[k]}={sender.address[1]}"]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=_environment(folder),
            start_new_session=True,
        )
        for sender in self.senders:
            sender.start()

    def prioritize(self) -> None:
        """Give the command and its output process the nice value of this process."""
        for pid in (self.process.pid, *_children(self.process.pid)):
            prioritize_session(pid)

    def close(self) -> str:
        """End all; returns the output of the command."""
        for sender in self.senders:
            sender.ended.set()
        if self.process.poll() is None:
            self.process.kill()
        assert self.process.stdout is not None
        if self.process.stdout.closed:
            return ""
        return self.process.communicate()[0].decode()


def _children(pid: int) -> list[int]:
    """Child processes of all threads of a process; empty without Linux's /proc."""
    texts = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    return [int(number) for text in texts for number in text.split()]


def device_file(transport: str, folder: Path, port: str, name: str) -> Path:
    """The shipped belt, or its copy of another name that sends OSC."""
    device = json.loads((ROOT / "device_configs/waist_belt.json").read_text(encoding="utf-8"))
    device["id"] = name
    if transport == "udp":
        device["output"] = {
            "encoder": {"kind": "osc", "address": "/motor{number}"},
            "transport": {"kind": "udp", "host": "127.0.0.1", "port": int(port)},
        }
    path = folder / f"{name}.json"
    path.write_text(json.dumps(device), encoding="utf-8")
    return path


def _environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "HFX_USER_DATA": str(folder)}


def shown(title: str, seconds: list[float]) -> None:
    """Print median, 99 % and largest of some times."""
    ordered = sorted(1000.0 * s for s in seconds)
    at = [ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99, 1.0)]
    print(  # noqa: T201
        f"{title}: median {at[0]:.1f} ms, 99 % {at[1]:.1f} ms, largest {at[2]:.1f} ms of "
        f"{len(ordered)}"
    )


def changes(options: argparse.Namespace, folder: Path) -> int:
    """Measure changes of the pose until the frame at the port."""
    session, seconds = Session(options, folder), []
    try:
        if not until(lambda: all(board.strength > 0.0 for board in session.boards), 30.0):
            print(session.close())  # noqa: T201
            return 1
        session.prioritize()
        time.sleep(1.0)
        for number in range(options.changes):
            sender = session.senders[number % options.bodies]
            board = session.boards[number % options.bodies]
            time.sleep(random.uniform(0.25, 0.35))
            sender.changed_s = 0.0
            board.first_s = None
            sender.change()
            if not until(lambda board=board: board.first_s is not None, 1.0):
                print(f"change {number} did not arrive: {session.close()}")  # noqa: T201
                return 1
            seconds.append((board.first_s or 0.0) - sender.changed_s)
    finally:
        session.close()
    shown(f"pose to {options.transport}, bodies {options.bodies}", seconds)
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("--changes", type=int, default=300)
    parser.add_argument("--transport", choices=("pty", "udp"), default="pty")
    parser.add_argument("--bodies", type=int, default=1)
    parser.add_argument("--names", nargs="*", default=["Avatar", "Avatar.001"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        return changes(options, Path(folder))


if __name__ == "__main__":
    if sys.argv[1:] == ["--board"]:
        print_changes()
    else:
        sys.exit(main())
