# SPDX-License-Identifier: GPL-3.0-or-later
"""Presenter of a session: a page in full screen, served to browsers of this computer only.

The address holds a random token. A page that connects replaces the page before; a lost page pauses
the session.
"""

from __future__ import annotations

import json
import logging
import secrets
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from hfx_blender.devices.transports.page_output import page_answer
from hfx_blender.errors import UsageError

from .session import Input, Screen

_PAGE: Final = Path(__file__).with_name("study_page.html")
_HOST: Final = "127.0.0.1"
_MOST_BYTES: Final = 4096
_TYPES: Final = frozenset({"next", "answer", "up", "down", "again", "pause", "stop"})

_quiet = logging.getLogger(f"{__name__}.websockets")
_quiet.addHandler(logging.NullHandler())
_quiet.propagate = False


class PagePresenter:
    """Page of a session at ``address``, from its making to :meth:`close`.

    ``noise``: strength of the masking noise, 0..1. ``port``: 0 for any free port. Raises UsageError
    for a port in use.
    """

    def __init__(self, noise: float = 0.0, port: int = 0) -> None:
        self._token = secrets.token_hex(8)
        self._settings = json.dumps({"kind": "settings", "noise": noise})
        self._page = _PAGE.read_text(encoding="utf-8")
        self._screen: str | None = None
        self._connection: ServerConnection | None = None
        self._lock = threading.Lock()
        self._inputs: deque[Input] = deque(maxlen=1000)
        try:
            self._server = serve(
                self._converse,
                _HOST,
                port,
                compression=None,
                process_request=self._answer,
                server_header=None,
                max_size=_MOST_BYTES,
                logger=_quiet,
            )
        except OSError as error:
            raise UsageError(f"--page-port {port}: cannot be opened ({error.strerror})") from error
        self._origin = f"http://{_HOST}:{self._server.socket.getsockname()[1]}"
        self.address = f"{self._origin}/{self._token}"
        threading.Thread(target=self._server.serve_forever, name="page", daemon=True).start()

    def show(self, screen: Screen) -> None:
        """Show a screen now, and to pages that connect later."""
        with self._lock:
            self._screen = json.dumps(screen)
            connection = self._connection
        if connection is not None:
            with suppress(ConnectionClosed, OSError):
                connection.send(self._screen)

    def inputs(self) -> list[Input]:
        """Inputs since the last call, in order; "left" for a lost page."""
        taken = []
        while self._inputs:
            taken.append(self._inputs.popleft())
        return taken

    def close(self) -> None:
        """Close the port and the page's connection."""
        with self._lock:
            connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(ConnectionClosed, OSError):
                connection.close()
        self._server.shutdown()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        path = f"/{self._token}"
        return page_answer(connection, request, self._origin, self._page, path, f"{path}/answers")

    def _converse(self, connection: ServerConnection) -> None:
        """Send the present screen, then take inputs until the page is left or replaced."""
        with self._lock:
            previous, self._connection = self._connection, connection
            screen = self._screen
        if previous is not None:
            with suppress(ConnectionClosed, OSError):
                previous.close()
        with suppress(ConnectionClosed, OSError):
            connection.send(self._settings)
            if screen is not None:
                connection.send(screen)
            for message in connection:
                given = _input_of(message)
                if given is not None:
                    self._inputs.append(given)
        with self._lock:
            is_present = self._connection is connection
            if is_present:
                self._connection = None
        if is_present:
            self._inputs.append({"type": "left"})


def _input_of(message: str | bytes) -> Input | None:
    """Input of a page's message; None for other messages."""
    try:
        content: Any = json.loads(message)
    except ValueError:
        return None
    return content if isinstance(content, dict) and content.get("type") in _TYPES else None
