# SPDX-License-Identifier: GPL-3.0-or-later
"""Input of a worker of the output process; a worker ends with its owner."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from queue import SimpleQueue
from typing import BinaryIO

from .messages import Message, MessageError, read_message


def messages_of_owner(source: BinaryIO) -> SimpleQueue[Message]:
    """Queue of messages from the owner; at their end the process ends at once."""
    waiting: SimpleQueue[Message] = SimpleQueue()
    threading.Thread(target=_read, args=(source, waiting), daemon=True).start()
    return waiting


def _read(source: BinaryIO, waiting: SimpleQueue[Message]) -> None:
    with suppress(MessageError, OSError):
        while True:
            found = read_message(source)
            if found is None:
                break
            waiting.put(found)
    os._exit(0)
