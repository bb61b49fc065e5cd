# SPDX-License-Identifier: GPL-3.0-or-later
"""Guards against what comes over a wire or from a server: each alone, without either."""

from __future__ import annotations

import base64
import hashlib
import struct
import threading
import zlib
from typing import Any

import pytest

from hfx_blender.devices.host import wire
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import websocket
from hfx_blender.devices.transports.websocket import WebSocket, _decode_frame


def test_a_frame_of_another_version_is_dropped_however_intact():
    def framed(version: int) -> bytes:
        content = struct.pack("<BBH", version, wire.FrameKind.STOP, 3)
        return wire.encode_cobs(content + struct.pack("<I", zlib.crc32(content)))

    assert wire.decode_frame(framed(wire.VERSION)) == wire.Frame(wire.FrameKind.STOP, 3, b"")
    assert wire.decode_frame(framed(wire.VERSION + 1)) is None


def test_bytes_without_an_end_take_only_so_much_memory():
    receiver = wire.Receiver()
    receiver.take(b"\x01" * 10_000)
    assert len(receiver._waiting) <= wire.MAX_FRAME


@pytest.mark.parametrize(
    "content",
    [
        *(b"\xc1\x00", b"\x91\x00", b"\x81\x80", b"\x81\xfe\x00\x00"),
        *(b"\x89\x7e\x00\x7e", b"\x09\x00", b"\x88\x7f"),  # long pings, pings in pieces
    ],
)
def test_reserved_bits_masks_and_long_pings_are_no_frames_of_a_server(content: bytes) -> None:
    with pytest.raises(OutputLostError, match="not a frame"):
        _decode_frame(bytearray(content))


def test_a_frame_that_would_be_too_long_is_not_waited_for():
    with pytest.raises(OutputLostError, match="too long"):
        _decode_frame(bytearray(b"\x81\x7f" + struct.pack(">Q", websocket.MAX_MESSAGE + 1)))
    assert _decode_frame(bytearray(b"\x81\x7f" + struct.pack(">Q", websocket.MAX_MESSAGE))) is None


class Server:
    """The other end: gives what it is told to give."""

    def __init__(self, *given: bytes) -> None:
        self.given = list(given)
        self.sent = b""

    def sendall(self, content: bytes) -> None:
        self.sent += content

    def recv(self, count: int) -> bytes:
        if not self.given:
            raise AssertionError("asked once more")
        return self.given.pop(0) if len(self.given) > 1 else self.given[0]

    def close(self) -> None: ...


def connection(server: Any, on_text: Any = lambda text: None) -> WebSocket:
    """A connection without its thread."""
    found = WebSocket.__new__(WebSocket)
    found._name, found._socket, found._lock = "ws://x:1", server, threading.Lock()
    found._on_text, found._on_tick = on_text, lambda: None
    found._waiting, found._received, found._message = bytearray(), bytearray(), bytearray()
    found._is_fragmented, found._lost, found._is_closed = False, "", False
    found._moved_s = 0.0
    return found


class Greeting(Server):
    """Answers a handshake with some headers, of which one is the right key."""

    def __init__(self, head: str) -> None:
        super().__init__()
        self.head = head

    def recv(self, count: int) -> bytes:
        key = self.sent.split(b"Sec-WebSocket-Key: ")[1].split(b"\r\n")[0]
        accept = hashlib.sha1(key + b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11").digest()
        return self.head.format(base64.b64encode(accept).decode()).encode()


RIGHT = "HTTP/1.1 101 Yes\r\nUpgrade: websocket\r\nSec-WebSocket-Accept: {}\r\n\r\n"


def test_the_right_greeting_is_taken():
    connection(Greeting(RIGHT))._shake_hands("x", 1, "/")


@pytest.mark.parametrize(
    ("wrong", "by"), [("101", "200"), ("websocket", "h2c"), ("{}", "AAAA"), ("Upgrade: ", "X: ")]
)
def test_a_greeting_with_one_thing_wrong_is_refused(wrong: str, by: str) -> None:
    with pytest.raises(OutputLostError, match="not a websocket server"):
        connection(Greeting(RIGHT.replace(wrong, by)))._shake_hands("x", 1, "/")


def test_a_greeting_without_end_is_not_listened_to_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    server = Server(*[b"x" * 4096] * 6, b"")
    with pytest.raises(OutputLostError, match="not a websocket server"):
        connection(server)._shake_hands("x", 1, "/")
    assert len(server.given) > 1  # it was refused before the server ended


def test_fragments_that_grow_too_long_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket, "MAX_MESSAGE", 100)
    found = connection(Server())
    found._received += b"\x01\x50" + b"a" * 80
    found._take()
    found._received += b"\x80\x50" + b"a" * 80
    with pytest.raises(OutputLostError, match="too long"):
        found._take()


def serve(found: WebSocket, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket.select, "select", lambda r, w, x, t: (r, [], []))
    found._serve()


def test_a_server_that_ends_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    found = connection(Server(b"\x81\x01a", b""))
    heard: list[str] = []
    found._on_text = heard.append

    def ticked() -> None:
        heard.append("tick")
        if len(heard) > 5:
            raise ValueError("it goes on")

    found._on_tick = ticked
    serve(found, monkeypatch)
    assert found._lost == "the connection was closed by the server" and heard == ["a", "tick"]


def test_what_a_server_says_wrongly_ends_the_connection_and_not_the_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nonsense(text: str) -> None:
        raise KeyError(text)

    found = connection(Server(b"\x81\x01a", b""), nonsense)
    serve(found, monkeypatch)
    assert found._lost == "the connection is lost ('a')"


class Deaf(Server):
    """A server that takes nothing."""

    def send(self, content: bytes) -> int:
        raise BlockingIOError


def test_who_asks_for_answers_and_does_not_read_them_costs_no_memory() -> None:
    found = connection(Deaf())
    for _ in range(100):
        found._received += (b"\x89\x7d" + b"p" * 125) * 100
        found._take()
    assert len(found._waiting) < 2 * websocket.MAX_WAITING


def test_stops_that_nobody_reads_cost_no_memory() -> None:
    found = connection(Deaf())
    with pytest.raises(OutputLostError, match="does not read"):
        for _ in range(10_000):
            found.send("x" * 100, is_urgent=True)
    assert len(found._waiting) < 3 * websocket.MAX_WAITING


def test_a_server_that_does_not_read_is_left_so_that_it_stops_what_we_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [100.0]
    monkeypatch.setattr(websocket.time, "monotonic", lambda: now[0])
    found = connection(Deaf(b"\x8a\x00"))
    found.send("x")

    def ticked() -> None:
        assert now[0] <= 100.0 + websocket.STALLED_S, "it is waited for"
        now[0] += 0.3

    found._on_tick = ticked
    serve(found, monkeypatch)
    assert found._lost == "the server does not read any more"
