# SPDX-License-Identifier: GPL-3.0-or-later
"""Guards against wrong data from wires and servers, each tested without hardware or network."""

from __future__ import annotations

import socket
import struct
import time
import zlib
from collections.abc import Iterator
from typing import Any

import pytest
from raw_server import RIGHT, RawServer, fault_of

from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import websocket
from hfx_blender.devices.transports import wire_board as wire
from hfx_blender.devices.transports.websocket import MAX_WAITING, WebSocket


def test_a_frame_of_another_version_is_dropped_however_intact():
    def framed(version: int) -> bytes:
        content = struct.pack("<BBH", version, wire.FrameKind.STOP, 3)
        return wire.encode_cobs(content + struct.pack("<I", zlib.crc32(content)))

    assert wire.decode_frame(framed(wire.VERSION)) == wire.Frame(wire.FrameKind.STOP, 3, b"")
    assert wire.decode_frame(framed(wire.VERSION + 1)) is None


def test_bytes_without_an_end_take_only_so_much_memory():
    receiver = wire.Receiver()
    receiver.take(b"\x01" * 10_000)
    assert len(receiver.unfinished) <= wire.MAX_FRAME


@pytest.fixture
def serve() -> Iterator[Any]:
    servers: list[RawServer] = []

    def started(*arguments: Any, **facts: Any) -> RawServer:
        servers.append(RawServer(*arguments, **facts))
        return servers[-1]

    yield started
    for server in servers:
        server.close()


@pytest.mark.parametrize(
    "content",
    [
        *(b"\xc1\x00", b"\x91\x00", b"\x81\x80aaaa", b"\x81\xfe\x00\x00aaaa"),
        *(b"\x89\x7e\x00\x7e" + b"p" * 126, b"\x09\x00"),  # long pings, pings in pieces
        *(b"\x83\x00", b"\x80\x00", b"\x01\x00\x81\x00"),  # no such code; no such order
    ],
)
def test_reserved_bits_masks_and_long_pings_are_no_frames_of_a_server(
    serve: Any, content: bytes
) -> None:
    connection = serve(content).connect()
    assert "not a frame" in fault_of(connection)
    connection.close()


def test_a_frame_that_would_be_too_long_is_not_waited_for(serve: Any) -> None:
    head = b"\x81\x7f" + struct.pack(">Q", websocket.MAX_MESSAGE + 1)
    connection = serve(head).connect()
    assert "too long" in fault_of(connection)
    connection.close()


def test_fragments_that_grow_too_long_are_refused(
    serve: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(websocket, "MAX_MESSAGE", 100)
    fragments = b"\x01\x50" + b"a" * 80 + b"\x80\x50" + b"a" * 80
    heard: list[str] = []
    connection = serve(fragments).connect(heard.append)
    assert "too long" in fault_of(connection) and not heard
    connection.close()


def test_bytes_that_are_no_text_are_refused(serve: Any) -> None:
    for content, fault in (
        (b"\x82\x01a", "0x61; expected is text"),
        (b"\x81\x01\xff", "not UTF-8"),
    ):
        connection = serve(content).connect()
        assert fault in fault_of(connection)
        connection.close()


def test_a_message_that_comes_with_the_greeting_is_heard(serve: Any) -> None:
    heard: list[str] = []
    connection = serve(b"\x81\x01a\x01\x01b\x80\x01c").connect(heard.append)
    until = time.monotonic() + 30.0
    while heard != ["a", "bc"]:
        assert time.monotonic() < until
        time.sleep(0.002)
    connection.close()


@pytest.mark.parametrize(
    ("wrong", "by"),
    [(b"101", b"200"), (b"websocket", b"h2c"), (b"{}", b"AAAA"), (b"Upgrade: ", b"X: ")],
)
def test_a_greeting_with_one_thing_wrong_is_refused(
    serve: Any, wrong: bytes, by: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(websocket, "OPEN_S", 1.0)  # a 200 may have a page without end
    serve().connect().close()
    with pytest.raises(OutputLostError, match="not a websocket server"):
        serve(answer=RIGHT.replace(wrong, by)).connect()


@pytest.mark.parametrize("content", [b"x" * 1_000_000, b"HTTP/1.1 101 X\r\n" + b"a: b\r\n" * 1000])
def test_a_greeting_without_end_is_not_listened_to_for_ever(serve: Any, content: bytes) -> None:
    began = time.monotonic()
    with pytest.raises(OutputLostError, match="not a websocket server"):
        serve(answer=content).connect()
    assert time.monotonic() - began < websocket.OPEN_S


def test_a_greeting_that_trickles_is_not_waited_for(
    serve: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(websocket, "OPEN_S", 0.3)
    for answer, fault in ((b"HTTP/1.1 101 X\r\n", "not a websocket server"), (b"", "not answer")):
        server = serve(answer=answer)
        with pytest.raises(OutputLostError, match=fault):
            server.connect()


def test_no_proxy_of_the_environment_is_asked(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "ws_proxy", "all_proxy", "socks_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:1")
        monkeypatch.setenv(name.upper(), "http://127.0.0.1:1")
    serve().connect().close()


def test_a_server_that_ends_is_gone(serve: Any) -> None:
    heard: list[str] = []
    connection = serve(b"\x81\x01a", ends=True).connect(heard.append)
    assert fault_of(connection).endswith("the connection was closed by the server.")
    assert heard == ["a"]
    connection.close()


def test_a_wrong_server_message_ends_the_connection_only(serve: Any) -> None:
    def nonsense(text: str) -> None:
        raise KeyError(text)

    connection = serve(b"\x81\x01a").connect(nonsense)
    assert fault_of(connection).endswith("the connection is lost ('a').")
    connection.close()


def test_closing_says_goodbye_and_ends_the_thread(serve: Any) -> None:
    server = serve()
    connection = server.connect()
    connection.close()
    connection.close()
    with pytest.raises(OutputLostError, match="is closed"):
        connection.send("x")
    server.close()
    code, length = server.received[:2]
    mask, content = server.received[2:6], server.received[6:]
    assert (code, length) == (0x88, 0x82)
    assert bytes(a ^ b for a, b in zip(mask, content, strict=False)) == struct.pack(">H", 1000)


class StalledSocket:
    """Socket with a far end blocked after the handshake."""

    def __init__(self, inner: socket.socket) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def send(self, content: bytes) -> int:
        raise BlockingIOError


@pytest.fixture
def deaf(monkeypatch: pytest.MonkeyPatch) -> None:
    connect = socket.create_connection
    monkeypatch.setattr(
        websocket.socket, "create_connection", lambda *a, **k: StalledSocket(connect(*a, **k))
    )


def test_unread_answers_cost_no_memory(
    serve: Any, deaf: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(websocket, "STALLED_S", 60.0)
    waiting: list[int] = []
    server = serve((b"\x89\x7d" + b"p" * 125) * 10_000 + b"\x81\x01z")
    connection = server.connect(lambda _: waiting.append(connection.waiting))
    until = time.monotonic() + 60.0
    while not waiting:
        assert time.monotonic() < until
        time.sleep(0.01)
    assert MAX_WAITING < waiting[0] < 2 * MAX_WAITING
    connection.close()


def test_unread_stops_cost_no_memory(serve: Any, deaf: None) -> None:
    connection: WebSocket = serve().connect()
    with pytest.raises(OutputLostError, match="does not read"):
        for _ in range(10_000):
            connection.send("x" * 100, is_urgent=True)
    assert connection.waiting < 3 * MAX_WAITING
    connection.close()


def test_leaving_a_stalled_server_makes_the_server_stop_devices(
    serve: Any, deaf: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(websocket, "STALLED_S", 0.2)
    server = serve()
    connection = server.connect()
    connection.send("x")
    assert "the server does not read any more" in fault_of(connection)
    server.close()  # returns after the client has left
    connection.close()
