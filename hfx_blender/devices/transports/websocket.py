# SPDX-License-Identifier: GPL-3.0-or-later
"""A small websocket client on the standard library: text messages, without TLS (RFC 6455).

Opening waits, for a few seconds at most. After that nothing does: a thread of its own answers
pings and takes what comes in, and text that finds no room waits, or is left out.
"""

from __future__ import annotations

import base64
import hashlib
import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from ..host.output import OutputLostError

OPEN_S: Final = 3.0
MAX_MESSAGE: Final = 1 << 20
MAX_WAITING: Final = 1 << 16
"""Bytes that may wait to be written; stop messages are let in up to twice as many."""

STALLED_S: Final = 1.0
"""A server that reads nothing for so long is left: it then stops what we used."""

_GUID: Final = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
_CONTINUATION, _TEXT, _CLOSE, _PING, _PONG = 0x0, 0x1, 0x8, 0x9, 0xA
_UPKEEP_S: Final = 0.05


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
        self._name = f"ws://{host}:{port}"
        self._on_text = on_text
        self._on_tick = on_tick
        self._lock = threading.Lock()
        self._waiting = bytearray()  # to be written
        self._moved_s = 0.0  # when the server took something of it last, or it was empty
        self._received = bytearray()
        self._message = bytearray()  # of fragments so far
        self._is_fragmented = False
        self._lost = ""
        self._is_closed = False
        try:
            self._socket = socket.create_connection((host, port), timeout=OPEN_S)
        except OSError as error:
            raise OutputLostError(f"{self._name} does not answer ({error}).") from None
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._shake_hands(host, port, path)
            self._socket.setblocking(False)
        except OSError as error:
            self._socket.close()
            raise OutputLostError(f"{self._name} does not answer ({error}).") from None
        except OutputLostError:
            self._socket.close()
            raise
        self._thread = threading.Thread(target=self._keep_alive, name=self._name, daemon=True)
        self._thread.start()

    @property
    def has_room(self) -> bool:
        """Test for an empty write queue; a sender of newest values waits for it."""
        return not self._waiting

    def send(self, text: str, *, is_urgent: bool = False) -> None:
        """Write a message now, or as soon as there is room.

        Raises
        ------
        OutputLostError
            The connection is lost, or the server has not read for long.
        """
        self._check()
        if len(self._waiting) > (2 if is_urgent else 1) * MAX_WAITING:
            raise OutputLostError(f"{self._name} does not read any more.")
        self._write(_encode_frame(_TEXT, text.encode()))

    def check(self) -> None:
        """Raise OutputLostError if the connection is lost."""
        self._check()

    def close(self) -> None:
        """Close the connection, after pending data if that takes no time; may be called again."""
        if not self._is_closed:
            self._is_closed = True
            with suppress(OutputLostError):
                self._write(_encode_frame(_CLOSE, struct.pack(">H", 1000)))
        with suppress(OSError):
            self._socket.close()

    def _check(self) -> None:
        if self._lost or self._is_closed:
            raise OutputLostError(f"{self._name}: {self._lost or 'is closed'}.")

    def _shake_hands(self, host: str, port: int, path: str) -> None:
        key = base64.b64encode(os.urandom(16)).decode()
        named = f"[{host}]" if ":" in host else host
        self._socket.sendall(
            (
                f"GET {path} HTTP/1.1\r\nHost: {named}:{port}\r\nUpgrade: websocket\r\n"
                f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
                "Sec-WebSocket-Version: 13\r\n\r\n"
            ).encode("ascii")
        )
        answer = b""
        until = time.monotonic() + OPEN_S
        while b"\r\n\r\n" not in answer:
            content = self._socket.recv(4096)
            answer += content
            if not content or len(answer) > 16384 or time.monotonic() > until:
                raise OutputLostError(f"{self._name} is not a websocket server.")
        head, _, self._received[:] = answer.partition(b"\r\n\r\n")
        lines = head.decode("latin-1").split("\r\n")
        headers = {}
        for line in lines[1:]:
            name, _, value = line.partition(":")
            headers[name.strip().lower()] = value.strip()
        expected = base64.b64encode(hashlib.sha1((key + _GUID).encode()).digest()).decode()
        if (
            lines[0].split(" ")[1:2] != ["101"]
            or headers.get("upgrade", "").lower() != "websocket"
            or headers.get("sec-websocket-accept") != expected
        ):
            raise OutputLostError(f"{self._name} is not a websocket server.")

    def _write(self, content: bytes) -> None:
        with self._lock:
            if not self._waiting:
                self._moved_s = time.monotonic()
            self._waiting += content
            self._flush()

    def _flush(self) -> None:
        while self._waiting:
            try:
                sent = self._socket.send(self._waiting)
            except BlockingIOError:
                return
            except OSError as error:
                self._lost = self._lost or f"the connection is lost ({error})"
                self._check()
            self._moved_s = time.monotonic()
            del self._waiting[:sent]

    def _keep_alive(self) -> None:
        self._serve()
        with suppress(OSError):  # a server that said goodbye waits for this
            self._socket.close()

    def _serve(self) -> None:
        while not self._is_closed and not self._lost:
            try:
                writing = [self._socket] if self._waiting else []
                readable, writable, _ = select.select([self._socket], writing, [], _UPKEEP_S)
                if writable:
                    with self._lock:
                        self._flush()
                if readable:
                    content = self._socket.recv(65536)
                    if not content:
                        self._lost = "the connection was closed by the server"
                        return
                    self._received += content
                self._take()
                self._on_tick()
                if self._waiting and time.monotonic() - self._moved_s > STALLED_S:
                    self._lost = "the server does not read any more"
            except BlockingIOError:
                continue
            except OutputLostError as error:
                self._lost = self._lost or str(error).rstrip(".")
            except Exception as error:  # data from a server must not raise in a thread
                self._lost = self._lost or f"the connection is lost ({error})"

    def _take(self) -> None:
        while (found := _decode_frame(self._received)) is not None:
            is_last, code, payload, size = found
            del self._received[:size]
            if code == _PING:
                if len(self._waiting) <= MAX_WAITING:  # else it does not read what it asks for
                    self._write(_encode_frame(_PONG, payload))
            elif code == _CLOSE:
                self._lost = "the server closed the connection"
                with suppress(OutputLostError):
                    self._write(_encode_frame(_CLOSE, payload[:2]))
                return
            elif code in (_TEXT, _CONTINUATION) and (code == _CONTINUATION) == self._is_fragmented:
                self._message += payload
                if len(self._message) > MAX_MESSAGE:
                    raise OutputLostError("the server sent too long a message.")
                self._is_fragmented = not is_last
                if is_last:
                    text = self._message.decode("utf-8")
                    self._message.clear()
                    self._on_text(text)
            elif code != _PONG:
                raise OutputLostError("the server sent data that is not text.")


def _encode_frame(code: int, payload: bytes) -> bytes:
    """Masked frame, as a client has to send it."""
    size = len(payload)
    if size < 126:
        head = struct.pack(">BB", 0x80 | code, 0x80 | size)
    elif size < 1 << 16:
        head = struct.pack(">BBH", 0x80 | code, 0xFE, size)
    else:
        head = struct.pack(">BBQ", 0x80 | code, 0xFF, size)
    mask = os.urandom(4)
    keys = (mask * (size // 4 + 1))[:size]
    masked = (int.from_bytes(payload, "big") ^ int.from_bytes(keys, "big")).to_bytes(size, "big")
    return head + mask + masked


def _decode_frame(content: bytearray) -> tuple[bool, int, bytes, int] | None:
    """Last of its message, code, payload and length of the first frame; None: not all there."""
    if len(content) < 2:
        return None
    first, size = content[0], content[1]
    is_control = first & 0x08
    if first & 0x70 or size & 0x80 or (is_control and (size > 125 or first < 0x80)):
        raise OutputLostError("the server sent data that is not a frame.")
    at = 2
    if size >= 126:
        width = 2 if size == 126 else 8
        if len(content) < at + width:
            return None
        size = int.from_bytes(content[at : at + width], "big")
        at += width
    if size > MAX_MESSAGE:
        raise OutputLostError("the server sent too long a message.")
    if len(content) < at + size:
        return None
    return bool(first & 0x80), first & 0x0F, bytes(content[at : at + size]), at + size
