# SPDX-License-Identifier: GPL-3.0-or-later
"""Websocket server of raw bytes, for wrong handshakes and frames."""

from __future__ import annotations

import base64
import hashlib
import socket
import threading
import time
from typing import Any

from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports.websocket import WebSocket

RIGHT = (
    b"HTTP/1.1 101 Yes\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Accept: {}\r\n\r\n"
)
"""Answer to a handshake; braces stand for the key."""


class RawServer:
    """Server for one client: answers the handshake, sends bytes, and reads to the end (after a
    goodbye: until the client closes).

    Attributes
    ----------
    received : bytearray
        Bytes after the client's request.
    """

    def __init__(
        self,
        content: bytes = b"",
        answer: bytes = RIGHT,
        *,
        ends: bool = False,
        reads: bool = True,
        says_goodbye: bool = False,
    ) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.received = bytearray()
        self._content, self._answer = content, answer
        self._ends, self._reads, self._says_goodbye = ends, reads, says_goodbye
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        try:
            taken, _ = self._listener.accept()
            with taken:
                self._talk(taken)
        except OSError:
            pass  # the client has left

    def _talk(self, taken: socket.socket) -> None:
        request = b""
        while b"\r\n\r\n" not in request:
            request += taken.recv(4096)
        key = request.split(b"Sec-WebSocket-Key: ")[1].split(b"\r\n")[0]
        digest = hashlib.sha1(key + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11").digest()
        taken.sendall(self._answer.replace(b"{}", base64.b64encode(digest)) + self._content)
        if self._ends:
            taken.shutdown(socket.SHUT_WR)
        if not self._reads:
            self._is_over.wait()
            return
        while content := taken.recv(65536):
            self.received += content
            # The client's close frame with a code of two bytes comes last.
            if self._says_goodbye and self.received[-8:-6] == b"\x88\x82":
                return

    def connect(self, on_text: Any = lambda text: None, on_tick: Any = lambda: None) -> WebSocket:
        """Return a client of this server."""
        return WebSocket("127.0.0.1", self.port, "/", on_text, on_tick)

    def close(self) -> None:
        self._is_over.set()
        self._listener.close()
        self._thread.join(10.0)


def fault_of(connection: WebSocket, within_s: float = 30.0) -> str:
    """Wait for the loss of a connection and return the error message."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        try:
            connection.check()
        except OutputLostError as error:
            return str(error)
        time.sleep(0.002)
    raise AssertionError("the connection is not lost")
