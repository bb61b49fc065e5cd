# SPDX-License-Identifier: GPL-3.0-or-later
"""Websocket client for text messages; never blocks after the opening.

``websockets`` encodes and decodes frames. Its connections are not used, as calls may block and
proxies of the environment are used. A thread answers pings and receives messages; text without
room in the socket's buffer waits in a queue.
"""

import select
import socket
import ssl
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
"""Longest message of a server, bytes."""

MAX_WAITING: Final = 1 << 16  # most unsent bytes; twice as many for stop messages

STALLED_S: Final = 1.0
"""Time without reading by the server, seconds, after which the connection counts as lost. A lost
connection makes the server stop its devices."""

_STALLED: Final = "the server does not read any more"
_UPKEEP_S: Final = 0.05
# Bytes that are read at once; small, so that few pongs follow.
_RECEIVED: Final = 4096
_LATER: Final = (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError)


class WebSocket:
    """Open connection to a websocket server.

    ``path``: path and query.
    ``on_text``: takes each message, in the thread of this object.
    ``on_tick``: called about 20 times a second, in the thread of this object.
    ``tls``: encrypt, without a check of the certificate: local servers sign their own.

    Raises OutputLostError: the server does not answer within :data:`OPEN_S`, or not as a websocket
    server.
    """

    def __init__(
        self,
        host: str,
        port: int,
        path: str,
        on_text: Callable[[str], None],
        on_tick: Callable[[], None] = lambda: None,
        tls: bool = False,
    ) -> None:
        self.name = f"{'wss' if tls else 'ws'}://{f'[{host}]' if ':' in host else host}:{port}"
        self._on_text = on_text
        self._on_tick = on_tick
        self._lock = threading.Lock()  # of the protocol and the unsent bytes
        # A protocol without input and output: this class reads and writes the socket.
        self._protocol = ClientProtocol(parse_uri(self.name + path), max_size=MAX_MESSAGE)
        self._waiting = bytearray()  # unsent bytes
        self._moved_s = 0.0  # last time at which bytes were sent, or none were unsent
        self._message = bytearray()  # fragments of an incomplete message
        self._lost = ""  # reason
        self._is_closed = False
        self._is_left = False  # the server has closed the connection
        try:
            self._socket = socket.create_connection((host, port), timeout=OPEN_S)
        except OSError as error:
            raise OutputLostError(f"{self.name} does not answer ({error}).") from None
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if tls:
                context = ssl.create_default_context()
                context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
                self._socket = context.wrap_socket(self._socket)
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
    def waiting(self) -> int:
        """Number of unsent bytes; senders of values drop values unless 0."""
        return len(self._waiting)

    def send(self, text: str, *, is_urgent: bool = False) -> None:
        """Send a message now, or as soon as the socket has room; ``is_urgent``: a stop.

        Raises OutputLostError: the connection is lost, or more than :data:`MAX_WAITING` bytes are
        unsent.
        """
        with self._lock:
            self.check()
            if self.waiting > (2 if is_urgent else 1) * MAX_WAITING:
                raise OutputLostError(f"{self.name} does not read any more.")
            self._protocol.send_text(text.encode())
            self._write()

    def check(self) -> None:
        """Raise ``OutputLostError`` if the connection is lost."""
        # The thread may meet the closed socket before it sees that the connection is closed.
        if self._is_closed or self._lost:
            raise OutputLostError(f"{self.name}: {'is closed' if self._is_closed else self._lost}.")

    def finish(self) -> None:
        """Send a close frame and wait, at most :data:`STALLED_S`, for that of the server.

        The server's close frame follows the reading of all messages. Call :meth:`close` afterwards.

        Raises OutputLostError: the connection was lost before, or the server does not read.
        """
        with self._lock:
            self.check()
            self._protocol.send_close(1000)
            self._write()
        until = time.monotonic() + STALLED_S
        # The reading thread marks the connection as lost when the close frame arrives.
        while not self._lost and time.monotonic() < until:
            time.sleep(0.002)
        if self._waiting or not self._is_left:
            raise OutputLostError(f"{self.name}: {self._lost or _STALLED}.")

    def close(self) -> None:
        """Send a close frame (1000) if possible and close the connection, without waiting for
        unsent bytes or an answer; may be called again."""
        if not self._is_closed:
            self._is_closed = True
            with self._lock, suppress(OutputLostError, WebSocketException):
                self._protocol.send_close(1000)
                self._write()
        with suppress(OSError):
            self._socket.close()

    def _shake_hands(self) -> None:
        """Do the opening handshake on the blocking socket within 3 s.
        Raises OSError: no answer. Raises OutputLostError: the answer is no websocket handshake."""
        until = time.monotonic() + OPEN_S
        self._protocol.send_request(self._protocol.connect())
        self._socket.sendall(b"".join(self._protocol.data_to_send()))
        content = b""
        while self._protocol.state is State.CONNECTING:
            # The limit holds for the whole handshake, not for each read.
            self._socket.settimeout(max(until - time.monotonic(), 0.001))
            try:
                content = self._socket.recv(_RECEIVED)
            except TimeoutError:
                if content:  # the server has sent an incomplete answer
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
        """Queue the output of the protocol, and send as many bytes as the socket takes. The lock
        has to be held. OutputLostError if the connection is lost."""
        if not self._waiting:
            self._moved_s = time.monotonic()
        self._waiting += b"".join(self._protocol.data_to_send())
        while self._waiting:
            try:
                sent = self._socket.send(self._waiting)
            except _LATER:
                return
            except OSError as error:
                self._lost = self._lost or f"the connection is lost ({error})"
                raise OutputLostError(f"{self.name}: {self._lost}.") from None
            self._moved_s = time.monotonic()
            del self._waiting[:sent]

    def _keep_alive(self) -> None:
        """Thread: until the connection is closed or lost, wait 50 ms at most for data or room,
        process both, and call ``on_tick``. Lost: any exception, closing by the server, or a server
        that has read nothing for a second."""
        while not self._is_closed and not self._lost:
            try:
                writing = [self._socket] if self._waiting else []
                # TLS decrypts more at once than is read: the rest waits inside of the socket.
                tls = self._socket if isinstance(self._socket, ssl.SSLSocket) else None
                wait_s = 0.0 if tls and tls.pending() else _UPKEEP_S
                readable, _, _ = select.select([self._socket], writing, [], wait_s)
                with self._lock:  # a TLS socket takes one call at a time
                    is_read = readable or not wait_s
                    content = self._socket.recv(_RECEIVED) if is_read else b""
                self._take(content)
                if is_read and not content:
                    self._is_left = True
                    self._lost = self._lost or "the connection was closed by the server"
                    continue
                self._on_tick()
                # A server that reads nothing would let a stop wait for ever.
                if self._waiting and time.monotonic() - self._moved_s > STALLED_S:
                    self._lost = _STALLED
            except _LATER:
                continue
            except OutputLostError as error:
                self._lost = self._lost or str(error).rstrip(".")
            except Exception as error:  # data from a server must not raise in a thread
                self._lost = self._lost or f"the connection is lost ({error})"
        with suppress(OSError):  # a server that has closed the connection waits for this
            self._socket.close()

    def _take(self, content: bytes) -> None:
        """Process received bytes: answer pings, and pass messages on; a closing or faulty server is
        marked as lost. An empty ``content`` processes bytes that came with the handshake.
        OutputLostError for a message that is not UTF-8 text."""
        with self._lock:
            if content:
                self._protocol.receive_data(content)
            frames = [x for x in self._protocol.events_received() if isinstance(x, Frame)]
            fault = self._protocol.parser_exc
            if self._protocol.close_rcvd is not None:
                self._is_left = True
                self._lost = self._lost or "the server closed the connection"
            if isinstance(fault, PayloadTooBig):
                self._lost = "the server sent too long a message"
            elif fault is not None:
                self._lost = f"the server sent data that is not a frame ({fault})"
            if self.waiting > MAX_WAITING:  # a server that sends pings but reads nothing: no pongs
                self._protocol.data_to_send()
            self._write()
        # Outside the lock, as a receiver of messages may send. A message may come in fragments:
        # TEXT, then CONT up to the frame with the mark ``fin``.
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
