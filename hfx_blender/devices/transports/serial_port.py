# SPDX-License-Identifier: GPL-3.0-or-later
"""Serial port, opened exclusively and written without waiting."""

import os
import re
from contextlib import suppress
from typing import Any, Final

from ...engine.arrays import F64
from ..host.encoders import FrameEncoder
from ..host.output import OutputLostError
from .reservations import Keys, release, reserve

STOPS: Final = 3
"""Number of copies of the stop bytes: an incomplete frame before them garbles the first copy."""

# pyserial's URLs (socket://, spy://...) open connections or write files: not allowed.
_PORT: Final = re.compile(
    r"COM[1-9][0-9]{0,2}"
    r"|/dev/tty[A-Za-z0-9._-]{1,64}"
    r"|/dev/cu\.[A-Za-z0-9._-]{1,64}"
    r"|/dev/serial/by-id/[A-Za-z0-9._:+-]{1,200}"
    r"|/dev/pts/[0-9]{1,6}"  # pseudo-terminals of simulated boards
)


def is_port_name(name: str) -> bool:
    """Test that a text is COM1 to COM999 or a path as /dev/ttyACM0; the port need not exist."""
    return _PORT.fullmatch(name) is not None


class SerialPort:
    """Byte stream of a port, with at most one unsent frame.

    A partly written frame is completed first; an unsent frame is replaced by a newer frame. So a
    stalled port costs neither memory nor time.

    Raises OutputLostError: ``name`` is no port (:func:`is_port_name`), or the port is open already
    or cannot be opened.
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
        self._rest = b""  # of a frame that is partly written
        self._next = b""  # unsent frame
        self._keys = reserve_port(name)
        try:
            # write_timeout=0: pyserial returns at once on Windows. On other systems bytes are
            # written to the descriptor, because pyserial 3.5 spins while a port is stalled.
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
        """Write a frame, in place of an unsent frame; OutputLostError if the port is lost."""
        self._next = frame
        self._push()

    def write_first(self, content: bytes) -> None:
        """Drop unsent bytes, also of the system, and write ``content``; OutputLostError if lost."""
        self._rest, self._next = b"", b""
        with suppress(Exception):  # also termios.error; without the reset the bytes are sent later
            self._port.reset_output_buffer()
        self._next = content
        self._push()

    def read(self) -> bytes:
        """Received bytes, 0 to 4096, without waiting; OutputLostError if the port is lost."""
        try:
            if self._is_posix:
                return os.read(self._port.fileno(), 4096)
            return bytes(self._port.read(4096))
        except BlockingIOError:
            return b""
        except Exception as error:
            raise OutputLostError(f"{self.name} is lost ({error}).") from None

    def close(self) -> None:
        """Close the port, with errors ignored, and release its reservation; may be called again."""
        with suppress(Exception):
            self._port.close()
        release(self._keys)

    def _push(self) -> None:
        """Write the rest of a frame, then the unsent frame, as far as the port takes bytes now.
        OutputLostError if the port is lost."""
        while self._rest or self._next:
            if not self._rest:
                self._rest, self._next = self._next, b""
            try:
                if self._is_posix:
                    written = os.write(self._port.fileno(), self._rest)
                else:
                    written = int(self._port.write(self._rest) or 0)
            except BlockingIOError:
                return
            except Exception as error:  # OSError, SerialException, termios.error, TypeError: closed
                raise OutputLostError(f"{self.name} is lost ({error}).") from None
            # A stalled port writes nothing: the rest waits for the next call.
            if not written:
                return
            self._rest = self._rest[written:]


class SerialFrames:
    """Output to a device on a serial port, with frames as configured."""

    def __init__(self, port: SerialPort, encoder: FrameEncoder) -> None:
        self._port = port
        self._encoder = encoder

    def send(self, values: F64) -> None:
        """Send values (columns,); received bytes are discarded."""
        self._port.read()  # keeps the system's queue empty
        self._port.write_newest(self._encoder.frame(values))

    def stop(self) -> None:
        """Send three copies of the stop bytes in place of unsent frames; never raises."""
        with suppress(OutputLostError):
            self._port.write_first(self._encoder.stop * STOPS)

    def close(self) -> None:
        """Close the port without a stop; may be called again."""
        self._port.close()


def reserve_port(name: str) -> Keys:
    """Reserve a port by real path and device number, as a port may have several names.

    Raises OutputLostError: the port does not exist, is no serial port, or is reserved.
    """
    real = os.path.realpath(name) if os.name == "posix" else name.upper()
    if os.name == "posix" and not is_port_name(real):
        raise OutputLostError(f"{name} leads to {real}, which is not a serial port.")
    try:
        number = os.stat(real).st_rdev if os.name == "posix" else 0
    except OSError as error:
        raise OutputLostError(f"{name} is not there ({error.strerror}).") from None
    # The device number identifies a port with several device files.
    keys = {("port", real), *([("port number", number)] if number else [])}
    return reserve(keys, name)
