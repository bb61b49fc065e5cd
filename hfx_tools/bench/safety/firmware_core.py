# SPDX-License-Identifier: GPL-3.0-or-later
"""The firmware's C core, compiled for this computer, with the clock as a parameter."""

from __future__ import annotations

import ctypes
import os
import select
import shutil
import threading
import time
from pathlib import Path
from typing import Any, Final

from hfx_blender.devices.transports import wire_board as wire
from hfx_blender.errors import InputError

from ... import processes

SOURCES: Final = Path(__file__).resolve().parents[3] / "firmware" / "hfx_pwm"
"""Folder of the C sources; exists in a checkout only."""

_GLUE: Final = """
#include "hfx_core.h"
#include <stdlib.h>
hfx_core *make(unsigned char channels, hfx_write_fn write) {
    hfx_core *core = calloc(1, sizeof *core);
    hfx_begin(core, channels, write);
    return core;
}
void begin_again(hfx_core *core) { hfx_begin_again(core, core->channels, core->write); }
void lose_power(hfx_core *core) { core->filled[0] ^= 1; core->levels[0] = 7; }
unsigned level(hfx_core *core, int channel) { return core->levels[channel]; }
"""
_WRITE: Final = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_uint8), ctypes.c_uint8)
_CLOCK: Final = 0xFFFFFFFF
"""Bit mask of a board's clock, a 32-bit count of milliseconds."""


def compiler() -> str | None:
    """Path of a C compiler of this computer, or None."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def built(folder: Path) -> ctypes.CDLL:
    """Compile the core into a library in ``folder``; undefined behaviour traps.

    Raises
    ------
    InputError
        No C compiler, no checkout, or the core does not compile.
    """
    compile_with = compiler()
    if compile_with is None or not SOURCES.is_dir():
        raise InputError(f"The firmware's core needs a C compiler and its sources in {SOURCES}.")
    glue, library = folder / "glue.c", folder / "core.so"
    glue.write_text(_GLUE)
    done = processes.run(
        [
            *(compile_with, "-std=c11", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"),
            *("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error", f"-I{SOURCES}"),
            *(str(glue), str(SOURCES / "hfx_core.c"), "-o", str(library)),
        ]
    )
    if done.returncode:
        raise InputError(f"{SOURCES}: the firmware's core does not compile: {done.stderr.strip()}")
    cdll = ctypes.CDLL(str(library))
    cdll.make.restype = ctypes.c_void_p
    cdll.make.argtypes = [ctypes.c_uint8, _WRITE]
    cdll.level.argtypes = [ctypes.c_void_p, ctypes.c_int]
    cdll.begin_again.argtypes = cdll.lose_power.argtypes = [ctypes.c_void_p]
    cdll.hfx_receive.argtypes = [ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint32]
    cdll.hfx_tick.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
    return cdll


class Board:
    """Firmware of one board, called directly; time passes only in :meth:`wait`.

    ``library``: result of :func:`built`.
    """

    def __init__(self, library: Any, channels: int = 6) -> None:
        self._library = library
        self._write = _WRITE(lambda at, count: self.sent.extend(at[:count]))
        self.sent = bytearray()
        self.channels = channels
        self.now_ms = 0
        self._receiver = wire.Receiver()
        self._core = library.make(channels, self._write)

    def restart(self) -> None:
        """Start as after power on, with zeroed memory."""
        self._core = self._library.make(self.channels, self._write)

    def begin_again(self) -> None:
        """Start as after a reset without loss of memory; the clock starts at 0."""
        self._library.begin_again(self._core)
        self.now_ms = 0

    def lose_power(self) -> None:
        """Corrupt the memory: flip a bit of a level's copy and change the level."""
        self._library.lose_power(self._core)

    def take(self, content: bytes) -> None:
        """Receive bytes from the host."""
        for byte in content:
            self._library.hfx_receive(self._core, byte, self.now_ms & _CLOCK)

    def wait(self, ms: int) -> None:
        """Advance the clock by ``ms`` milliseconds, one tick each."""
        for _ in range(ms):
            self.now_ms += 1
            self._library.hfx_tick(self._core, self.now_ms & _CLOCK)

    def replies(self) -> list[wire.Frame]:
        """Decoded replies since the last call."""
        content, self.sent[:] = bytes(self.sent), b""
        return self._receiver.take(content)

    @property
    def levels(self) -> list[int]:
        """Levels at the pins, 0..65535."""
        return [self._library.level(self._core, i) for i in range(self.channels)]


class PluggedBoard(Board):
    """Board behind a pseudo-terminal, run in a thread on this computer's clock.

    Parameters
    ----------
    library, channels
        As of :class:`Board`.
    master : int
        File descriptor of the board's end of the terminal.
    """

    def __init__(self, library: Any, master: int, channels: int = 6) -> None:
        super().__init__(library, channels)
        self._master = master
        self._is_over = False
        self.is_deaf = False  # received bytes are lost
        self.is_cut = False  # in both directions
        self.silent_since_s = self._began_s = (
            time.monotonic()
        )  # infinite while any level is above 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def clock(self) -> int:
        """Milliseconds since the board was plugged in."""
        return int(1000.0 * (time.monotonic() - self._began_s))

    def _run(self) -> None:
        while not self._is_over:
            if select.select([self._master], [], [], 0.001)[0]:
                content = os.read(self._master, 4096)
                if not (self.is_deaf or self.is_cut):
                    self.take(content)
            self.wait(self.clock() - self.now_ms)
            if not any(self.levels):
                self.silent_since_s = min(self.silent_since_s, time.monotonic())
            else:
                self.silent_since_s = float("inf")
            if self.sent:
                content, self.sent[:] = bytes(self.sent), b""
                if not self.is_cut:
                    os.write(self._master, content)

    def close(self) -> None:
        """Stop and join the thread."""
        self._is_over = True
        self._thread.join()
