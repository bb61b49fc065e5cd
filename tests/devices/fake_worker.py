# SPDX-License-Identifier: GPL-3.0-or-later
"""Scripted worker process: records messages and answers on demand."""

from __future__ import annotations

import io
from collections.abc import Callable
from types import ModuleType
from typing import Any, ClassVar

import pytest

from hfx_blender.processes.messages import EVERY_DEVICE, Message, MessageKind, messages


class FakeWorker:
    """Stand-in for :class:`hfx_blender.processes.worker.Worker`."""

    started: ClassVar[list[FakeWorker]] = []

    @classmethod
    def replace(cls, monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> list[FakeWorker]:
        """Replace the Worker class of a module and return the list of started workers (filled
        later).
        """
        started: list[FakeWorker] = []
        monkeypatch.setattr(cls, "started", started)
        monkeypatch.setattr(module, "Worker", cls)
        return started

    def __init__(
        self,
        _module: str = "",
        *_arguments: str,
        received: Callable[[Any, Message], str | None] = lambda *_: None,
        ended: Callable[[Any, str], None] = lambda *_: None,
        **_settings: Any,
    ) -> None:
        self._received, self._ended = received, ended
        self.sent: list[Message] = []
        self.urged: list[Message] = []  # by the second pipe
        self.is_killed = False

    @property
    def is_running(self) -> bool:
        return not self.is_killed

    def start(self) -> None:
        self.started.append(self)

    def send(self, content: bytes, *, is_awaited: bool = False) -> None:
        self.sent += messages(io.BytesIO(content))

    def urge(self, content: bytes) -> None:
        self.urged += messages(io.BytesIO(content))

    def close(self, limit_s: float = 0.0) -> None:
        self.kill()

    def kill(self) -> None:
        self.is_killed = True

    def says(self, kind: MessageKind, body: bytes = b"", number: int = EVERY_DEVICE) -> None:
        """Deliver a message to the parent."""
        reason = self._received(self, Message(kind, number, body))
        if reason is not None:
            self.ends(reason)

    def ends(self, reason: str = "has ended") -> None:
        self._ended(self, reason)
