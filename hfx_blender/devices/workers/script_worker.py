# SPDX-License-Identifier: GPL-3.0-or-later
"""Script worker: runs a device script in a separate process; haptic data in, values out.

Started by the output process and by exports. The script is read once, and exactly the approved
bytes are run; the check is here, as all scripts run here. The process isolates faults but is no
sandbox.
"""

import builtins
import os
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from ...engine.rendering.device_config import DeviceConfig
from ...processes.messages import Message, MessageKind, decode_json, message
from ...processes.worker import Owner
from ..configuration import load_device
from ..live.approval import fingerprint_of, how_to_approve, may_run
from .haptics import as_values, decode_haptics
from .message_bodies import encode_values

MAX_MEMORY: Final = 4 << 30
_JUMP_S: Final = 0.25  # longest step of time that is no jump, seconds
_LONGEST_TEXT: Final = 500


class _Outlet:
    """Messages and prints of a script to the owner; at most ``prints_per_s`` prints in a second."""

    def __init__(self, owner: Owner) -> None:
        self._owner = owner
        self._since, self._count = 0.0, 0
        self.prints_per_s = 10
        self.script = ""  # file of the script, for the places of faults

    def send_text(self, kind: MessageKind, text: str) -> None:
        """Send a message with the first 500 characters of ``text``; never dropped."""
        self._owner.send(message(kind, 0, text[:_LONGEST_TEXT].encode(errors="replace")))

    def log_print(self, *parts: Any, sep: str | None = " ", **_: Any) -> None:
        """Replace ``print``: send the joined ``parts`` as a LOG message; after ``prints_per_s``
        calls, further calls are dropped until a second has passed. ``end``, ``file`` and ``flush``
        are ignored."""
        now = time.monotonic()
        if now - self._since > 1.0:
            self._since, self._count = now, 0
        self._count += 1
        if self._count <= self.prints_per_s:
            self.send_text(MessageKind.LOG, (" " if sep is None else sep).join(map(str, parts)))


def main() -> None:
    """Run the worker: limit resources, load the script of the first message, send READY, then
    answer each message of haptic data with values until the owner ends.

    Memory is limited to 4 GiB; standard input, output and errors of the script are discarded. Any
    exception, also while loading, is sent as a FAULT, "Type: text (file, line N)" with the line of
    the script, if there is one, and ends the process with exit code 1.
    """
    # No standard streams for the script, which must not read or write messages.
    null = os.open(os.devnull, os.O_RDWR)
    owner = Owner(printed=null)
    for number in (0, 2):
        os.dup2(null, number)
    _limit_resources()
    outlet = _Outlet(owner)
    try:
        device, render = _load(owner.receive(), outlet)
        owner.send(message(MessageKind.READY, 0))
        last_s: float | None = None
        while True:
            question = owner.receive()
            haptics = decode_haptics(question.body, device)
            is_first = last_s is None  # a stop ends the process
            jumped = last_s is None or not 0.0 <= haptics.time_s - last_s <= _JUMP_S
            haptics = replace(haptics, jumped=jumped, stopped=is_first)
            last_s = haptics.time_s
            values = as_values(render(haptics), haptics)
            # The answer has the number of the question.
            owner.send(message(MessageKind.ANSWER, question.device, encode_values(values)))
    except BaseException as error:
        # The innermost place in the script, not in modules that the script calls.
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == outlet.script]
        where = f" ({Path(outlet.script).name}, line {lines[-1]})" if lines else ""
        text = ": ".join(filter(None, (type(error).__name__, str(error))))
        outlet.send_text(MessageKind.FAULT, text + where)
        # Threads of the script must not keep the process alive.
        os._exit(1)


def _load(first: Message, outlet: _Outlet) -> tuple[DeviceConfig, Any]:
    """Execute the approved script of a request; return the device and the function ``render``.
    Raises PermissionError: the bytes differ from the request's fingerprint, or are not approved.
    Raises TypeError: the script has no function ``render``."""
    request = decode_json(first.body)
    path, configuration = Path(request["path"]), Path(request["configuration"])
    source = path.read_bytes()
    name, folder = request["device"], request.get("folder")
    # Of the bytes that are run below, so that no change in between can pass.
    mark = fingerprint_of(source, configuration.read_bytes())
    if mark != request["fingerprint"]:
        raise PermissionError(f"{path.name} has changed since it was approved")
    if not may_run(path, mark):
        raise PermissionError(f"{path.name} is not approved; {how_to_approve(name)}")
    device = load_device(name, None if folder is None else Path(folder))
    # Standard output is discarded; prints become lines in the panel.
    outlet.prints_per_s = request.get("prints_per_s", outlet.prints_per_s)
    outlet.script = str(path)
    builtins.print = outlet.log_print
    # A module of its own, which dataclasses look up by name; the name hides no other module.
    module = ModuleType(f"device_script_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    exec(compile(source, str(path), "exec", dont_inherit=True), module.__dict__)
    render = getattr(module, "render", None)
    if not callable(render):
        raise TypeError(f"{path.name} has no function render(haptics)")
    return device, render


def _limit_resources() -> None:
    """Limit address space to 4 GiB, disable core dumps and raise niceness by 5, where supported."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if hasattr(os, "nice"):
        os.nice(5)


if __name__ == "__main__":
    main()
