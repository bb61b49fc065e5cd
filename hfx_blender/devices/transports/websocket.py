# SPDX-License-Identifier: GPL-3.0-or-later
"""Websocket client for text messages, without TLS: frames by ``websockets``, sockets by us.

Only the part of ``websockets`` that does no input and output is used: no proxy of the environment
is asked, and the sockets are ours. Opening waits, for a few seconds at most. After that nothing
does: a thread answers pings and takes what comes in, and text that finds no room waits, or is left
out.
"""

from __future__ import annotations

import select
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from websockets.client import ClientProtocol
from websockets.exceptions import PayloadTooBig, WebSocketException
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.uri import parse_uri

from ..host.output import OutputLostError, shown

OPEN_S: Final = 3.0
MAX_MESSAGE: Final = 1 << 20
MAX_WAITING: Final = 1 << 16
"""Bytes that may wait to be written; stop messages are let in up to twice as many."""

STALLED_S: Final = 1.0
"""A server that reads nothing for so long is left: it then stops what we used."""

_STALLED: Final = "the server does not read any more"
_UPKEEP_S: Final = 0.05
_RECEIVED: Final = 4096
"""Bytes that are read at once: the pongs that they may ask for are few."""


class WebSocket:
    """An open connection.

    Parameters
    ----------
    host, port
        Where the server is.
    path : str
        With a query, if any.
    on_text : callable
        Called with each message, in the upkeep's thread.
    on_tick : callable, optional
        Called by the upkeep about 20 times a second.

    Raises
    ------
    OutputLostError
        Nobody answers, or not as a websocket server does.
    """

    def __init__(
        self,
        host: str,
        port: int,
        path: str,
        on_text: Callable[[str], None],
        on_tick: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
        self._on_text = on_text
        self._on_tick = on_tick
        self._lock = threading.Lock()  # of the protocol and the bytes to be written
        self._protocol = ClientProtocol(parse_uri(self.name + path), max_size=MAX_MESSAGE)
        self._waiting = bytearray()  # to be written
        self._moved_s = 0.0  # when the server took something of it last, or it was empty
        self._message = bytearray()  # of fragments so far
        self._lost = ""
        self._is_closed = False
        self._is_left = False  # by the server: it said goodbye, or sends nothing any more
        try:
            self._socket = socket.create_connection((host, port), timeout=OPEN_S)
        except OSError as error:
            raise OutputLostError(f"{self.name} does not answer ({error}).") from None
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._shake_hands()
            self._socket.setblocking(False)
        except OSError as error:
            self._socket.close()
            raise OutputLostError(f"{self.name} does not answer ({error}).") from None
        except OutputLostError:
            self._socket.close()
            raise
        self._thread = threading.Thread(target=self._keep_alive, name=self.name, daemon=True)
        self._thread.start()

    @property
    def has_room(self) -> bool:
        """Test for an empty write queue; a sender of newest values waits for it."""
        return not self._waiting

    @property
    def waiting(self) -> int:
        """Bytes that wait to be written."""
        return len(self._waiting)

    def send(self, text: str, *, is_urgent: bool = False) -> None:
        """Write a message now, or as soon as there is room.

        Raises
        ------
        OutputLostError
            The connection is lost, or the server has not read for long.
        """
        with self._lock:
            self.check()
            if self.waiting > (2 if is_urgent else 1) * MAX_WAITING:
                raise OutputLostError(f"{self.name} does not read any more.")
            self._protocol.send_text(text.encode())
            self._write()

    def check(self) -> None:
        """Raise ``OutputLostError`` if the connection is lost."""
        if self._lost or self._is_closed:
            raise OutputLostError(f"{self.name}: {self._lost or 'is closed'}.")

    def finish(self) -> None:
        """Say goodbye and wait, at most :data:`STALLED_S`, for the server's own goodbye, which
        comes only after the server has read all messages. :meth:`close` follows.

        Raises
        ------
        OutputLostError
            The connection was lost before, or the server does not read.
        """
        with self._lock:
            self.check()
            self._protocol.send_close(1000)
            self._write()
        until = time.monotonic() + STALLED_S
        while not self._lost and time.monotonic() < until:
            time.sleep(0.002)
        if self._waiting or not self._is_left:
            raise OutputLostError(f"{self.name}: {self._lost or _STALLED}.")

    def close(self) -> None:
        """Close the connection, after pending data if that takes no time; may be called again."""
        if not self._is_closed:
            self._is_closed = True
            with self._lock, suppress(OutputLostError, WebSocketException):
                self._protocol.send_close(1000)
                self._write()
        with suppress(OSError):
            self._socket.close()

    def _shake_hands(self) -> None:
        until = time.monotonic() + OPEN_S
        self._protocol.send_request(self._protocol.connect())
        self._socket.sendall(b"".join(self._protocol.data_to_send()))
        content = b""
        while self._protocol.state is State.CONNECTING:
            self._socket.settimeout(max(until - time.monotonic(), 0.001))
            try:
                content = self._socket.recv(_RECEIVED)
            except TimeoutError:
                if content:  # a greeting that does not end
                    break
                raise
            self._protocol.receive_data(content) if content else self._protocol.receive_eof()
            if self._protocol.handshake_exc or time.monotonic() > until:
                break
        else:
            return
        reason = shown(str(self._protocol.handshake_exc or "its answer does not end"))
        raise OutputLostError(
            f"{self.name} is not a websocket server: the handshake got no answer 101 "
            f"Switching Protocols ({reason}). Check the port."
        )

    def _write(self) -> None:
        """Add what the protocol has to say to the bytes that wait, and write what finds room."""
        if not self._waiting:
            self._moved_s = time.monotonic()
        self._waiting += b"".join(self._protocol.data_to_send())
        while self._waiting:
            try:
                sent = self._socket.send(self._waiting)
            except BlockingIOError:
                return
            except OSError as error:
                self._lost = self._lost or f"the connection is lost ({error})"
                raise OutputLostError(f"{self.name}: {self._lost}.") from None
            self._moved_s = time.monotonic()
            del self._waiting[:sent]

    def _keep_alive(self) -> None:
        while not self._is_closed and not self._lost:
            try:
                self._serve()
            except BlockingIOError:
                continue
            except OutputLostError as error:
                self._lost = self._lost or str(error).rstrip(".")
            except Exception as error:  # data from a server must not raise in a thread
                self._lost = self._lost or f"the connection is lost ({error})"
        with suppress(OSError):  # a server that said goodbye waits for this
            self._socket.close()

    def _serve(self) -> None:
        writing = [self._socket] if self._waiting else []
        readable, _, _ = select.select([self._socket], writing, [], _UPKEEP_S)
        content = self._socket.recv(_RECEIVED) if readable else b""
        self._take(content)
        if readable and not content:
            self._is_left = True
            self._lost = self._lost or "the connection was closed by the server"
            return
        self._on_tick()
        if self._waiting and time.monotonic() - self._moved_s > STALLED_S:
            self._lost = _STALLED

    def _take(self, content: bytes) -> None:
        """Take bytes of the server: answer its pings, and hand over its messages.

        Without bytes, those that came with its answer to the handshake.
        """
        with self._lock:
            if content:
                self._protocol.receive_data(content)
            frames = [each for each in self._protocol.events_received() if isinstance(each, Frame)]
            fault = self._protocol.parser_exc
            if self._protocol.close_rcvd is not None:
                self._is_left = True
                self._lost = self._lost or "the server closed the connection"
            if isinstance(fault, PayloadTooBig):
                self._lost = "the server sent too long a message"
            elif fault is not None:
                self._lost = f"the server sent data that is not a frame ({fault})"
            if self.waiting > MAX_WAITING:  # it does not read the pongs that it asks for
                self._protocol.data_to_send()
            self._write()
        for frame in frames:
            if frame.opcode is Opcode.BINARY:
                raise OutputLostError(
                    f"the server sent a binary message, 0x{frame.data[:8].hex()}; expected is text."
                )
            if frame.opcode in (Opcode.TEXT, Opcode.CONT):
                self._message += frame.data
                if frame.fin:
                    try:
                        text = self._message.decode("utf-8")
                    except UnicodeDecodeError as error:
                        sent = shown(self._message.decode("utf-8", "backslashreplace"))
                        raise OutputLostError(
                            f"the server sent text that is not UTF-8 ({sent}; {error.reason})."
                        ) from None
                    self._message.clear()
                    self._on_text(text)
