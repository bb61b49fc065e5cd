# SPDX-License-Identifier: GPL-3.0-or-later
"""Worker process of a batch: executes units in sequence.

The messages are JSON: ``{"ready": true}`` or ``{"cannot_start": "..."}`` once, then for each unit
several ``{"progress": 0.5}`` and a final ``{"outcome": {...}}``.
"""

from __future__ import annotations

import faulthandler
import os
import time
from functools import partial

from hfx_blender.errors import HfxError
from hfx_blender.export.batch.work import run_safely
from hfx_blender.processes import blender_session
from hfx_blender.processes.messages import json_message
from hfx_blender.processes.worker import Owner

from ..command_process.signal_watch import leave
from .unit_messages import decode_unit

_INTERVAL_S = 0.2
"""Shortest time between two progress messages, seconds."""


def main() -> None:
    """Execute units until the owner process ends. Without Blender, send the reason and exit."""
    faulthandler.enable()  # report the place of a crash in Blender to the owner process
    # Blender and reports of operators print to standard output.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    # Messages have a descriptor of their own, so foreign prints cannot damage them.
    owner = Owner(nowhere, at_end=partial(leave, 0))
    try:
        blender_session.start()
    except HfxError as error:
        owner.send(json_message({"cannot_start": str(error)}))
        leave(error.exit_code)
    owner.send(json_message({"ready": True}))
    while True:
        unit = decode_unit(owner.receive().body)
        owner.send(json_message({"outcome": run_safely(unit, _Progress(owner))}))


class _Progress:
    def __init__(self, owner: Owner) -> None:
        self._owner = owner
        self._next = 0.0

    def __call__(self, share: float) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _INTERVAL_S
            self._owner.send(json_message({"progress": share}))


if __name__ == "__main__":
    main()
