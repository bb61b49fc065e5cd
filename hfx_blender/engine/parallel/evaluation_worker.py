# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates blocks for another process of this program.

Started as ``python -m hfx_blender.engine.parallel.evaluation_worker``. It is told the scene, and
then one block after the other, each with the meshes that it does not know yet; the answer to a
block is what is felt, touches whose response remembers what was before, and what was counted, or
None where the block could not be evaluated. It ends with whoever started it.
"""

from __future__ import annotations

import logging
import os
import threading
from queue import SimpleQueue
from typing import IO

from ..evaluate import Engine
from ..volume.mesh import MeshVolume
from .serialization import decode_object, encode_object, receive, send

_log = logging.getLogger(__name__)


def main() -> None:
    """Answer until standard input ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not garble the answers
    waiting: SimpleQueue[bytes] = SimpleQueue()
    source = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_read, args=(source, waiting), daemon=True).start()
    description, record, tolerance = decode_object(waiting.get())
    engine = Engine(description, record=record, tolerance=tolerance)
    engine.responses.defers = True
    known: dict[int, MeshVolume] = {}
    while True:
        kept, fresh = decode_object(waiting.get())
        known = {number: known[number] for number in kept if number in known} | fresh
        try:
            block = decode_object(waiting.get(), known)
            before = engine.counters.copy()
            runs = engine.evaluate(block)
            counted = engine.counters.since(before)
            answer = encode_object((runs, engine.responses.take_deferred(), counted))
        except Exception:  # the caller tries it itself, and reports
            _log.info("a block could not be evaluated", exc_info=True)
            engine.responses.take_deferred()
            answer = encode_object(None)
        send(out, answer)


def _read(source: IO[bytes], waiting: SimpleQueue[bytes]) -> None:
    while (body := receive(source)) is not None:
        waiting.put(body)
    os._exit(0)


if __name__ == "__main__":
    main()
