# SPDX-License-Identifier: GPL-3.0-or-later
"""Pseudo-terminals as serial ports."""

import os
import select
import termios
import tty

import pytest

from hfx_blender.devices.transports import buttplug, reservations


class Terminal:
    """Far end of a serial port, as a pseudo-terminal."""

    def __init__(self):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave, termios.TCSANOW)
        self.name = os.ttyname(self.slave)

    def read(self, wait_s=0.2, least=1):
        content = b""
        while len(content) < least and select.select([self.master], [], [], wait_s)[0]:
            content += os.read(self.master, 65536)
        return content

    def close(self):
        for item in (self.master, self.slave):
            if item is not None:
                os.close(item)
        self.master = self.slave = None

    def vanish(self):
        self.close()


@pytest.fixture
def terminal():
    actual = Terminal()
    yield actual
    if actual.master is not None:
        actual.close()


@pytest.fixture(autouse=True)
def nothing_stays_reserved():
    yield
    reservations.reserved.clear()  # terminals' names and ports are used again
    buttplug.had_before.clear()
