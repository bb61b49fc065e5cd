# SPDX-License-Identifier: GPL-3.0-or-later
"""The firmware's C core, compiled for this computer, with a clock that the test moves."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

from hfx_blender.devices.live import wire

SOURCES = Path(__file__).parents[3] / "firmware" / "hfx_pwm"
_GLUE = """
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
_WRITE = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_uint8), ctypes.c_uint8)


def compiler():
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def built(folder):
    """The core as a library; with checks for memory and undefined behaviour trapping."""
    glue, library = folder / "glue.c", folder / "core.so"
    glue.write_text(_GLUE)
    subprocess.run(
        [
            *(compiler(), "-std=c11", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"),
            *("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error", f"-I{SOURCES}"),
            *(str(glue), str(SOURCES / "hfx_core.c"), "-o", str(library)),
        ],
        check=True,
        env={**os.environ, "LC_ALL": "C"},
    )
    found = ctypes.CDLL(str(library))
    found.make.restype = ctypes.c_void_p
    found.make.argtypes = [ctypes.c_uint8, _WRITE]
    found.level.argtypes = [ctypes.c_void_p, ctypes.c_int]
    found.begin_again.argtypes = found.lose_power.argtypes = [ctypes.c_void_p]
    found.hfx_receive.argtypes = [ctypes.c_void_p, ctypes.c_uint8, ctypes.c_uint32]
    found.hfx_tick.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
    return found


class Board:
    """A board with some channels."""

    def __init__(self, library, channels=6):
        self._library = library
        self._write = _WRITE(lambda at, count: self.sent.extend(at[:count]))
        self.sent = bytearray()
        self.channels = channels
        self.now_ms = 0
        self._receiver = wire.Receiver()
        self._core = library.make(channels, self._write)

    def restart(self):
        self._core = self._library.make(self.channels, self._write)

    def begin_again(self):
        """A restart whose memory is kept; its clock begins at 0."""
        self._library.begin_again(self._core)
        self.now_ms = 0

    def lose_power(self):
        """Change a bit of what memory holds."""
        self._library.lose_power(self._core)

    def take(self, content):
        for byte in content:
            self._library.hfx_receive(self._core, byte, self.now_ms & 0xFFFFFFFF)

    def wait(self, ms):
        for _ in range(ms):
            self.now_ms += 1
            self._library.hfx_tick(self._core, self.now_ms & 0xFFFFFFFF)

    def replies(self):
        content, self.sent[:] = bytes(self.sent), b""
        return self._receiver.take(content)

    @property
    def levels(self):
        return [self._library.level(self._core, i) for i in range(self.channels)]
