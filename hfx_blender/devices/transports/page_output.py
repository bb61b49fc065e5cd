# SPDX-License-Identifier: GPL-3.0-or-later
"""Vibration of a phone or gamepad by a web page that this output serves, without TLS.

The page asks for a code. Only the page itself can be fetched, and only by loopback and private
addresses. Each message holds the strengths; the page answers it, and falls silent without messages
for the dead-man time.
"""

import base64
import hashlib
import hmac
import http
import json
import logging
import re
import secrets
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from ...engine.arrays import F64
from ...engine.rendering.device_config import DEAD_MAN_MS, BodyPlace, DeviceConfig
from ..configurations.configuration_reader import is_local
from ..host.output import OutputLostError

PORT: Final = 8137
"""Port of the page; any free port if in use."""

MAX_TRIES: Final = 10
"""Wrong codes after which no page is accepted until the next connection of the device."""

JOIN_S: Final = 55.0
"""Time to open the page for an output that waits for a page, seconds."""

_PAGE: Final = Path(__file__).with_name("phone_page.html")
_MAX_CONNECTIONS: Final = 8
_MAX_UNANSWERED: Final = 4  # messages; a slow network must not queue old values
_WRONG_S: Final = 1.0  # pause after a wrong code, seconds
_CLOSED: Final = {"wrong": 4001, "locked": 4003}

_quiet = logging.getLogger(f"{__name__}.websockets")
_quiet.addHandler(logging.NullHandler())
_quiet.propagate = False


def own_address() -> str:
    """Address of this computer in its local network; 127.0.0.1 without a private one."""
    # Connecting a UDP socket sends nothing; the address is of the documentation (RFC 5737).
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))
        address = str(probe.getsockname()[0])
        if is_local(address):
            return address
    return "127.0.0.1"


class PageOutput:
    """Output to pages with the right code, at most 8; all of them play the same.

    ``host``: own address, loopback or private. ``port``: None for 8137, or any free port.
    ``code``: six digits; random by default. The attribute ``chosen_device`` has address and code.
    ``waits``: wait for the first page.

    Raises OutputLostError: the device has no vibration, the address cannot be used, or no page was
    opened within 55 s.
    """

    def __init__(
        self,
        device: DeviceConfig,
        host: str,
        port: int | None = None,
        code: str = "",
        waits: bool = False,
    ) -> None:
        shaking = [
            (actuator, column)
            for actuator, column in zip(device.actuators, device.strength_columns, strict=True)
            if actuator.type.modality == "vibration"
        ]
        if not shaking:
            raise OutputLostError(f"Device '{device.name}': a page plays vibration; it has none.")
        self._columns = [column for _, column in shaking]
        self._silence = json.dumps([0.0] * len(shaking))
        self._hello = json.dumps(
            {
                "device": device.name,
                "vibrations": [
                    {
                        "modality": "vibration",
                        "side": _side(actuator.place),
                        "column": k,
                        "highest": actuator.type.strength.highest,
                        "deadManMs": DEAD_MAN_MS,
                    }
                    for k, (actuator, _) in enumerate(shaking)
                ],
            }
        )
        self._code = code or f"{secrets.randbelow(10**6):06d}"
        self._tries = self._connections = self._joined = 0
        self._news = threading.Condition()
        self._number, self._text = 0, ""  # of the newest message
        self._is_closed = False
        self._page = _PAGE.read_text(encoding="utf-8")
        self._listener = _listening(host, port)
        number = self._listener.getsockname()[1]
        self._origin = f"http://{f'[{host}]' if ':' in host else host}:{number}"
        self.chosen_device = f"{self._origin} code {self._code}"
        self._server = serve(
            self._play,
            sock=self._listener,
            compression=None,
            process_request=self._answer,
            server_header=None,
            open_timeout=3.0,
            ping_interval=None,
            close_timeout=0.5,
            max_size=64,
            logger=_quiet,
        )
        threading.Thread(target=self._accept, name=self._origin, daemon=True).start()
        until_s = time.monotonic() + JOIN_S
        while waits and not self._joined:
            if time.monotonic() > until_s:
                self.close()
                raise OutputLostError(f"{self._origin}: no page was opened with the code in time.")
            time.sleep(0.02)

    def send(self, values: F64) -> None:
        """Hand the strengths of values (columns,) to the pages, in place of unsent ones."""
        strengths = [round(max(float(values[column]), 0.0), 4) for column in self._columns]
        self._hand_over(json.dumps(strengths))

    def stop(self) -> None:
        """Send zeros to the pages, in place of unsent values."""
        self._hand_over(self._silence)

    def close(self) -> None:
        """Close port and connections; a page falls silent then. May be called again."""
        with self._news:
            self._is_closed = True
            self._news.notify_all()
        with suppress(OSError):  # wakes a thread in accept
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _hand_over(self, text: str) -> None:
        with self._news:
            self._number += 1
            self._text = text
            self._news.notify_all()

    def _accept(self) -> None:
        """Accept connections of local senders until the port is closed, each in a thread."""
        while not self._is_closed:
            try:
                connection, sender = self._listener.accept()
            except OSError:
                continue
            with self._news:
                is_welcome = is_local(sender[0]) and self._connections < _MAX_CONNECTIONS
                self._connections += is_welcome
            if is_welcome:
                threading.Thread(target=self._serve, args=(connection, sender), daemon=True).start()
            else:
                connection.close()

    def _serve(self, connection: socket.socket, sender: Any) -> None:
        try:
            self._server.handler(connection, sender)
        finally:
            with self._news:
                self._connections -= 1

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer of :func:`page_answer` for the page "/" with the websocket "/feel"."""
        return page_answer(connection, request, self._origin, self._page, "/", "/feel")

    def _play(self, connection: ServerConnection) -> None:
        """Take the code of a page, then send values until the output is closed or the page left."""
        with suppress(ConnectionClosed, TimeoutError, OSError):
            refusal = self._refusal(connection.recv(timeout=60.0))
            if refusal:
                time.sleep(_WRONG_S)
                connection.close(_CLOSED[refusal], refusal)
                return
            # Before the greeting: a value that follows it at once is new.
            sent = self._number
            connection.send(self._hello)
            self._joined += 1
            unanswered, last = 0, ""
            while not self._is_closed:
                with self._news:
                    if self._number == sent:
                        self._news.wait(0.5)
                    number, text = self._number, self._text
                # Silence goes past the limit, once.
                is_urgent = text == self._silence != last
                if number != sent and (unanswered < _MAX_UNANSWERED or is_urgent):
                    connection.send(text)
                    last, sent, unanswered = text, number, unanswered + 1
                with suppress(TimeoutError):
                    # A page that answers late holds up newer values, never collects them.
                    while True:
                        is_full = unanswered >= _MAX_UNANSWERED
                        connection.recv(timeout=0.05 if is_full else 0)
                        unanswered = max(unanswered - 1, 0)

    def _refusal(self, code: str | bytes) -> str:
        """Reason to refuse a code: "wrong", or "locked" after ten wrong ones; "" for the code."""
        with self._news:
            if self._tries >= MAX_TRIES:
                return "locked"
            is_right = isinstance(code, str) and hmac.compare_digest(
                code.encode(), self._code.encode()
            )
            self._tries += not is_right
        return "" if is_right else "wrong"


def _side(place: Any) -> str:
    side = place.side if isinstance(place, BodyPlace) else None
    return side if side in ("left", "right") else "any"


def _listening(host: str, port: int | None) -> socket.socket:
    """Open a TCP port; OutputLostError for a foreign address, or a port that is in use."""
    if not is_local(host) or host == "localhost":
        raise OutputLostError(f"'{host[:60]}' is no loopback or private address of this computer.")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for number in (PORT, 0) if port is None else (port,):
        try:
            return socket.create_server((host, number), family=family, backlog=_MAX_CONNECTIONS)
        except OSError as error:
            reason = error.strerror or str(error)
    raise OutputLostError(f"{host}:{port or PORT} cannot be opened ({reason}).")


def page_answer(
    connection: ServerConnection,
    request: Request,
    origin: str,
    page: str,
    path: str,
    socket_path: str,
) -> Response | None:
    """Answer of a server with one page: the HTML ``page`` at ``path``, None for the page's own
    websocket at ``socket_path``, else 404. Other names of this computer than that of ``origin`` are
    refused, which a foreign page may use (DNS rebinding)."""
    host = request.headers.get("Host")
    if f"http://{host}" != origin:
        return connection.respond(http.HTTPStatus.MISDIRECTED_REQUEST, "unknown host\n")
    if request.path == socket_path and request.headers.get("Origin") == origin:
        return None
    if request.path != path:
        return connection.respond(http.HTTPStatus.NOT_FOUND, "not found\n")
    content = page.encode()
    headers = Headers(
        {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(content)),
            "Content-Security-Policy": f"{_content_policy(page)} ws://{host}",
            "Cache-Control": "no-store",
            "Connection": "close",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
    )
    return Response(200, "OK", headers, content)


def _content_policy(page: str) -> str:
    """Content security policy: the page's own script and style, by their hashes, no more."""
    hashes = {
        tag: base64.b64encode(
            hashlib.sha256(re.findall(f"(?s)<{tag}[^>]*>(.*?)</{tag}>", page)[0].encode()).digest()
        ).decode()
        for tag in ("script", "style")
    }
    return (
        f"default-src 'none'; script-src 'sha256-{hashes['script']}'; "
        f"style-src 'sha256-{hashes['style']}'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'; connect-src"
    )
