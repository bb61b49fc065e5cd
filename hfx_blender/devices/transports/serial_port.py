# SPDX-License-Identifier: GPL-3.0-or-later
"""Serial port, opened exclusively and never waited for."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from typing import Any, Final

from ...engine.arrays import F64
from ..host.encoders import FrameEncoder
from ..host.output import OutputLostError
from .reservations import Keys, release, reserve

STOPS: Final = 3
"""Number of times that stop bytes are sent: a device in the middle of a frame loses the first."""

# pyserial's URLs (socket://, spy://...) reach out or write files; only names of ports pass.
_PORT: Final = re.compile(
    r"COM[1-9][0-9]{0,2}"
    r"|/dev/tty[A-Za-z0-9._-]{1,64}"
    r"|/dev/cu\.[A-Za-z0-9._-]{1,64}"
    r"|/dev/serial/by-id/[A-Za-z0-9._:+-]{1,200}"
    r"|/dev/pts/[0-9]{1,6}"  # pseudo-terminals of simulated boards
)


def is_port_name(name: str) -> bool:
    """Test a text for the name of a serial port, and nothing else."""
    return _PORT.fullmatch(name) is not None


class SerialPort:
    """Byte stream of one port.

    A frame that was begun is finished before the next; of frames that wait only the newest
    counts, so a port that stalls costs no memory and no time.

    Parameters
    ----------
    name : str
        As :func:`is_port_name` allows.

    Raises
    ------
    OutputLostError
        The name is not a port's, the port is open already, or cannot be opened.
    """

    def __init__(self, name: str, baud: int) -> None:
        if not is_port_name(name):
            raise OutputLostError(
                f"'{name[:100]}' is not a serial port; allowed are names such as COM3, "
                "/dev/ttyACM0, /dev/cu.usbmodem1 and /dev/serial/by-id/..."
            )
        try:
            import serial
        except ImportError:
            raise OutputLostError(
                "Serial ports need the Python package pyserial, which this installation lacks: "
                "install the extension's zip anew."
            ) from None
        self.name = name
        self._rest = b""  # of a frame that was begun
        self._next = b""
        self._keys = reserve_port(name)
        try:
            # write_timeout=0: pyserial returns at once on Windows. Elsewhere bytes go straight
            # to the descriptor, because pyserial 3.5 spins while a port is stalled.
            self._port: Any = serial.Serial(
                os.path.realpath(name) if self._is_posix else name,
                baud,
                timeout=0,
                write_timeout=0,
                exclusive=True if self._is_posix else None,
            )
            if self._is_posix:
                os.set_blocking(self._port.fileno(), False)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            release(self._keys)
            raise OutputLostError(f"{name} cannot be opened ({error}).") from None
        except BaseException:  # a bare termios.error, for one
            release(self._keys)
            raise OutputLostError(f"{name} cannot be opened: it is not a serial port.") from None

    _is_posix: Final = os.name == "posix"

    def write_newest(self, frame: bytes) -> None:
        """Write a frame, or let it replace one that waits.

        Raises
        ------
        OutputLostError
        """
        self._next = frame
        self._push()

    def write_first(self, content: bytes) -> None:
        """Drop whatever waits, also in the system's queue, and write this.

        Raises
        ------
        OutputLostError
        """
        self._rest, self._next = b"", b""
        with suppress(Exception):  # termios.error is not an OSError; the bytes go out anyway
            self._port.reset_output_buffer()
        self._next = content
        self._push()

    def read(self) -> bytes:
        """Received bytes, at most 4 KiB.

        Raises
        ------
        OutputLostError
        """
        try:
            if self._is_posix:
                return os.read(self._port.fileno(), 4096)
            return bytes(self._port.read(4096))
        except BlockingIOError:
            return b""
        except Exception as error:
            raise OutputLostError(f"{self.name} is lost ({error}).") from None

    def close(self) -> None:
        """Give the port back; it may be called again."""
        with suppress(Exception):
            self._port.close()
        release(self._keys)

    def _push(self) -> None:
        while self._rest or self._next:
            if not self._rest:
                self._rest, self._next = self._next, b""
            written = self._written(self._rest)
            if not written:
                return
            self._rest = self._rest[written:]

    def _written(self, content: bytes) -> int:
        try:
            if self._is_posix:
                return os.write(self._port.fileno(), content)
            return int(self._port.write(content) or 0)
        except BlockingIOError:
            return 0
        except Exception as error:  # OSError, SerialException, termios.error, TypeError if closed
            raise OutputLostError(f"{self.name} is lost ({error}).") from None


class SerialFrames:
    """Output to a device on a serial port that takes frames of its own kind."""

    def __init__(self, port: SerialPort, encoder: FrameEncoder) -> None:
        self._port = port
        self._encoder = encoder

    def send(self, values: F64) -> None:
        """Hand over values (columns,)."""
        self._port.read()  # a board that chatters must not fill the queue
        self._port.write_newest(self._encoder.frame(values))

    def stop(self) -> None:
        """Send the stop bytes, before anything that waits."""
        with suppress(OutputLostError):
            self._port.write_first(self._encoder.stop * STOPS)

    def close(self) -> None:
        """Give the port back."""
        self._port.close()


def reserve_port(name: str) -> Keys:
    """Register a port as open, by its real path and its device number.

    Two names may lead to one port, and the system lets two programs open it.
    """
    real = os.path.realpath(name) if os.name == "posix" else name.upper()
    if os.name == "posix" and not is_port_name(real):
        raise OutputLostError(f"{name} leads to {real}, which is not a serial port.")
    try:
        number = os.stat(real).st_rdev if os.name == "posix" else 0
    except OSError as error:
        raise OutputLostError(f"{name} is not there ({error.strerror}).") from None
    keys = {("port", real), *([("port number", number)] if number else [])}
    return reserve(keys, name)
