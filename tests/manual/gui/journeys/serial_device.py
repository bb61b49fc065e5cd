# SPDX-License-Identifier: GPL-3.0-or-later
"""A board on a serial port, with only the extension's own modules: added, connected, played.

The board is a pseudo-terminal with the answers of our firmware. Linux and macOS only.
"""

from __future__ import annotations

import os
import threading
import tty
import zlib
from collections.abc import Iterator
from typing import Any

import bpy
import hands

DEVICE = "arduino_uno_pwm"
BELOW = -4  # the panels of input, values, sound and video are below


class Board:
    """The board's end of a serial port, in a separate thread."""

    def __init__(self) -> None:
        self._wire = hands.module("devices.transports.wire_board")
        self._end, port = os.openpty()
        tty.setraw(port)
        self.name = os.ttyname(port)
        self.kinds: list[int] = []  # of received frames
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        receiver = self._wire.Receiver()
        while True:
            for frame in receiver.take(os.read(self._end, 4096)):
                self.kinds.append(frame.kind)
                if frame.kind == self._wire.FrameKind.CONFIGURE:
                    ready = zlib.crc32(frame.payload).to_bytes(4, "little") + b"\x20"
                    kind = self._wire.FrameKind.READY
                    os.write(self._end, self._wire.encode_frame(kind, frame.sequence, ready))


def steps(h: Any) -> Iterator[float]:
    yield from hands.empty_scene(h)
    with h.context():
        bpy.ops.hfx.add_avatar()
    bpy.context.view_layer.objects.active = None  # without the panel of the body
    yield 0.5
    discovery = hands.module("devices.live.discovery")
    import serial.tools.list_ports as list_ports

    h.check("site-packages" in list_ports.__file__, f"pyserial is there: {list_ports.__file__}")
    count = len(list_ports.comports())
    h.check(len(discovery.serial_ports()) == count, f"{count} ports are listed")

    panels = yield from h.panels(h.region("UI"))
    yield from h.click(h.region("UI").x + 60, panels[BELOW][1])
    yield 0.6
    menus = yield from h.choices(h.region("UI"))
    yield from h.click(*menus[-1])  # Add Device, in the lowest open panel
    yield 1.0
    h.shot("1_devices.png")
    yield from h.key("Escape")
    with h.context():
        bpy.ops.hfx.live_add(name=DEVICE)
    yield 1.0
    h.shot("2_added.png")
    bpy.context.scene.hfx.devices[DEVICE].is_expanded = False  # shows the state of the device

    board = Board()
    with h.context():
        bpy.ops.hfx.live_connect(name=DEVICE, kind="DEVICE", port=board.name)
    live = hands.module("playback.live.live").live
    state = lambda: live.states[DEVICE]  # noqa: E731
    yield from h.until(lambda: state().state != "connecting", "the port answers", 60)
    h.check(not state().text or state().state != "lost", f"{state().state}: {state().text}")
    h.check(1 in board.kinds, "the board was configured")
    h.shot("3_connected.png")
    yield 1.0
    with h.context():
        bpy.ops.hfx.live_disconnect(name=DEVICE)
    yield 1.0
    h.check(3 in board.kinds, "and is told to stop at the end")
    h.shot("4_disconnected.png")
