# SPDX-License-Identifier: GPL-3.0-or-later
"""Times of ``hfx feel`` between a sender of poses and the port of a device, measured from outside.

``python tests/manual/processes/live_timing.py CLIP --changes 300`` sends a body of 60 poses 60
times a second, and prints the times from the datagram of a new pose to the frame at the port.
``--stops 100`` prints the times from a signal to the first frame without vibration.
``--transport pty`` is a serial board, ``udp`` a board that receives OSC; ``--bodies 2`` needs a
clip of two bodies. CLIP: a volume round the trunk of a body with the shipped ``waist_belt``. POSIX.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
import zlib
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder

from hfx_blender.devices.transports.wire_board import FrameKind, Receiver, encode_frame
from hfx_blender.tracking.vmc_body import PARENTS

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
    """Double of a device: the strength of its strongest motor, as of the newest frame."""

    def __init__(self, transport: str) -> None:
        super().__init__(daemon=True)
        self.transport, self.strength, self.changed_s = transport, 0.0, 0.0
        self.first_s: float | None = None  # of the first change after clearing
        if transport == "pty":
            self.end, port = os.openpty()
            tty.setraw(port)
            self.port = os.ttyname(port)
        else:
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.bind(("127.0.0.1", 0))
            self.port = str(self.socket.getsockname()[1])
            self._motors: dict[bytes, float] = {}

    def run(self) -> None:
        receiver = Receiver()
        while True:
            if self.transport == "udp":
                self._take_osc(self.socket.recv(65536), time.perf_counter())
                continue
            content, now_s = os.read(self.end, 4096), time.perf_counter()
            for frame in receiver.take(content):
                if frame.kind == FrameKind.CONFIGURE:
                    ready = zlib.crc32(frame.payload).to_bytes(4, "little") + b"\x20"
                    os.write(self.end, encode_frame(FrameKind.READY, frame.sequence, ready))
                elif frame.kind == FrameKind.VALUES:
                    # After the CRC of the configuration and the time to live.
                    levels = frame.payload[6:]
                    self._set(max(struct.unpack(f"<{len(levels) // 2}H", levels)), now_s)
                elif frame.kind == FrameKind.STOP:
                    self._set(0.0, now_s)

    def _take_osc(self, datagram: bytes, now_s: float) -> None:
        for address, number in re.findall(rb"(/[a-z_]+\d?)\0+,f\0\0(....)", datagram, re.DOTALL):
            self._motors[address] = struct.unpack(">f", number)[0]
        self._set(max(self._motors.values(), default=0.0), now_s)

    def _set(self, strength: float, now_s: float) -> None:
        if strength != self.strength:
            self.strength, self.changed_s = strength, now_s
            if self.first_s is None:
                self.first_s = now_s


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
        self.board = Board(options.transport)
        command = [sys.executable, "-m", "hfx_blender", "feel", str(options.clip)]
        command += ["--device", str(_device(options.transport, folder, self.board.port))]
        if options.transport == "pty":
            command += ["--port", self.board.port]
        if options.bodies == 1:
            command += ["--vmc", str(self.senders[0].address[1])]
        for k, sender in enumerate(self.senders if options.bodies > 1 else ()):
            command += ["--body", f"{options.names[k]}={sender.address[1]}"]
        self.board.start()
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=_environment(folder)
        )
        for sender in self.senders:
            sender.start()

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


def _device(transport: str, folder: Path, port: str) -> Path:
    """The shipped belt, or its copy that sends OSC."""
    device = json.loads((ROOT / "device_configs/waist_belt.json").read_text(encoding="utf-8"))
    if transport == "udp":
        device["output"] = {
            "encoder": {"kind": "osc", "address": "/motor{number}"},
            "transport": {"kind": "udp", "host": "127.0.0.1", "port": int(port)},
        }
    path = folder / "belt.json"
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
        if not until(lambda: session.board.strength > 0.0, 30.0):
            print(session.close())  # noqa: T201
            return 1
        time.sleep(1.0)
        for _ in range(options.changes):
            sender, board = session.senders[0], session.board
            time.sleep(random.uniform(0.25, 0.35))
            sender.changed_s = 0.0
            board.first_s = None
            sender.change()
            if not until(lambda board=board: board.first_s is not None, 1.0):
                print("a change did not arrive")  # noqa: T201
                return 1
            seconds.append((board.first_s or 0.0) - sender.changed_s)
    finally:
        session.close()
    shown(f"pose to {options.transport}, bodies {options.bodies}", seconds)
    return 0


def stops(options: argparse.Namespace, folder: Path) -> int:
    """Measure signals until the board is silent."""
    seconds: dict[str, list[float]] = {}
    for number in range(options.stops):
        session = Session(options, folder)
        name = random.choice(("SIGINT", "SIGTERM", "SIGHUP"))
        try:
            if not until(lambda board=session.board: board.strength > 0.0, 30.0):
                print(number, session.close())  # noqa: T201
                continue
            time.sleep(random.uniform(0.05, 0.4))
            sent_s = time.perf_counter()
            session.process.send_signal(getattr(signal, name))
            if not until(lambda board=session.board: board.strength == 0.0, 2.0):
                print(f"{name}: no silence")  # noqa: T201
                return 1
            seconds.setdefault(name, []).append(session.board.changed_s - sent_s)
            session.process.wait(10.0)
        finally:
            session.close()
    for name, times in sorted(seconds.items()):
        shown(f"{name} to silence at {options.transport}", times)
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("--changes", type=int, default=0)
    parser.add_argument("--stops", type=int, default=0)
    parser.add_argument("--transport", choices=("pty", "udp"), default="pty")
    parser.add_argument("--bodies", type=int, default=1)
    parser.add_argument("--names", nargs="*", default=["Avatar", "Avatar.001"])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.changes and changes(options, Path(folder)):
            return 1
        return stops(options, Path(folder)) if options.stops else 0


if __name__ == "__main__":
    sys.exit(main())
