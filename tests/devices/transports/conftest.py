# SPDX-License-Identifier: GPL-3.0-or-later
"""Pseudo-terminals to drive devices through."""

import os
import select
import termios
import tty

import pytest

from hfx_blender.devices.transports import buttplug, reservations


class Terminal:
    """The other end of a serial port."""

    def __init__(self):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave, termios.TCSANOW)
        self.name = os.ttyname(self.slave)

    def read(self, wait_s=0.2, least=1):
        found = b""
        while len(found) < least and select.select([self.master], [], [], wait_s)[0]:
            found += os.read(self.master, 65536)
        return found

    def close(self):
        for each in (self.master, self.slave):
            if each is not None:
                os.close(each)
        self.master = self.slave = None

    def vanish(self):
        self.close()


@pytest.fixture
def terminal():
    found = Terminal()
    yield found
    if found.master is not None:
        found.close()


@pytest.fixture(autouse=True)
def nothing_stays_reserved():
    yield
    reservations.reserved.clear()  # terminals' names and ports are used again
    buttplug.had_before.clear()
