# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys pressed in a terminal, without waiting."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hfx_blender.errors import UsageError


@contextmanager
def terminal_keys() -> Iterator[Callable[[], str]]:
    """Context with a function that returns the keys since its last call. The terminal does not
    wait for Return, and Ctrl-C remains an interrupt. UsageError if input is no terminal."""
    if not sys.stdin.isatty():
        raise UsageError("profile make: needs a terminal, for the answers by key")
    if sys.platform == "win32":
        import msvcrt

        def pressed() -> str:
            keys = ""
            while msvcrt.kbhit():
                keys += msvcrt.getwch()
            return keys

        yield pressed
        return
    import termios
    import tty

    number = sys.stdin.fileno()
    before = termios.tcgetattr(number)

    def read() -> str:
        is_ready = select.select([number], [], [], 0.0)[0]
        return os.read(number, 64).decode(errors="replace") if is_ready else ""

    try:
        tty.setcbreak(number)
        yield read
    finally:
        termios.tcsetattr(number, termios.TCSADRAIN, before)
