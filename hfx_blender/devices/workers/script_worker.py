# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs one device script in a process of its own: haptic data in, values out.

Started by the output process, and by exports. The script is read once, and these very bytes are
run if the user has approved them: this is the one door, which trusts nobody who asks. The process
isolates from faults; it is no sandbox.
"""

from __future__ import annotations

import builtins
import os
import sys
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from ...engine.rendering.device_config import DeviceConfig
from ...processes.messages import Message, MessageKind, decode_json, message
from ...processes.worker import Owner
from ..configuration import load_device
from ..live.approval import fingerprint_of, how_to_approve, may_run
from .haptics import as_values, decode_haptics
from .message_bodies import encode_values

MAX_MEMORY: Final = 4 << 30
_LOGS_PER_S: Final = 10
_LONGEST_TEXT: Final = 500


class _Outlet:
    """Messages of a script to the owner; its prints are sent, too, a few lines a second."""

    def __init__(self, owner: Owner) -> None:
        self._owner = owner
        self._since, self._count = 0.0, 0

    def send_text(self, kind: MessageKind, text: str) -> None:
        self._owner.send(message(kind, 0, text[:_LONGEST_TEXT].encode(errors="replace")))

    def log_print(self, *parts: Any, sep: str | None = " ", **_: Any) -> None:
        """Takes the place of ``print``."""
        now = time.monotonic()
        if now - self._since > 1.0:
            self._since, self._count = now, 0
        self._count += 1
        if self._count <= _LOGS_PER_S:
            self.send_text(MessageKind.LOG, (" " if sep is None else sep).join(map(str, parts)))


def main() -> None:
    """Answer until the owner ends."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    owner = Owner(printed=nowhere)
    for number in (0, 2):  # its output there is discarded
        os.dup2(nowhere, number)
    _limit_resources()
    outlet = _Outlet(owner)
    try:
        device, render = _load(owner.receive(), outlet)
        owner.send(message(MessageKind.READY, 0))
        while True:
            asked = owner.receive()
            haptics = decode_haptics(asked.body, device)
            values = as_values(render(haptics), haptics)
            # The number is the question's.
            owner.send(message(MessageKind.ANSWER, asked.device, encode_values(values)))
    except BaseException as error:
        outlet.send_text(MessageKind.FAULT, _described(error))
        os._exit(1)


def _load(first: Message, outlet: _Outlet) -> tuple[DeviceConfig, Any]:
    request = decode_json(first.body)
    path, configuration = Path(request["path"]), Path(request["configuration"])
    source = path.read_bytes()
    name, folder = request["device"], request.get("folder")
    mark = fingerprint_of(source, configuration.read_bytes())
    if mark != request["fingerprint"]:
        raise PermissionError(f"{path.name} has changed since it was approved")
    if not may_run(path, mark):
        raise PermissionError(f"{path.name} is not approved; {how_to_approve(name)}")
    device = load_device(name, None if folder is None else Path(folder))
    builtins.print = outlet.log_print
    names: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    exec(compile(source, str(path), "exec"), names)
    render = names.get("render")
    if not callable(render):
        raise TypeError(f"{path.name} has no function render(haptics)")
    return device, render


def _limit_resources() -> None:
    """Limit the process's memory and priority, where the system can."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if hasattr(os, "nice"):
        os.nice(5)


def _described(error: BaseException) -> str:
    """Describe an error in one line: type, text, and its place in the script."""
    frames = traceback.extract_tb(sys.exc_info()[2])
    where = ""
    if frames and frames[-1].filename != __file__:
        where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"
    return f"{type(error).__name__}: {error}{where}"


if __name__ == "__main__":
    main()
