# SPDX-License-Identifier: GPL-3.0-or-later
"""End of a command by Ctrl-C, SIGTERM or SIGHUP, between two pieces of work.

Only pip's command records signals (``hfx_tools/command_process/signal_watch.py``): in Blender's
process :func:`check` does nothing.
"""

import threading
from dataclasses import dataclass

from .startup import farewell


class TerminatedError(KeyboardInterrupt):
    """Raised by :func:`check` after a signal; ``exit_code`` is 128 and the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(farewell(number))
        self.exit_code = 128 + number


@dataclass
class SignalState:
    """Recorded signal of this process."""

    number: int = 0  # of the first signal; 0: none
    noted_s: float = 0.0  # time of the signal
    is_unwinding: bool = False  # TerminatedError was raised
    is_answered: bool = False  # TerminatedError was caught


state = SignalState()
_farewell = threading.Lock()  # acquired once, by the thread that writes the farewell


def check() -> None:
    """Raise TerminatedError, once, if a signal has come; does nothing outside the main thread. To
    be called between two pieces of work, neither in callbacks of Blender nor under a lock."""
    # Once: code that unwinds may poll again, and must not be interrupted a second time.
    if not state.number or state.is_unwinding:
        return
    if threading.current_thread() is threading.main_thread():
        state.is_unwinding = True
        raise TerminatedError(state.number)


def claims_farewell() -> bool:
    """True once: the caller writes the sentence about the end by a signal, no other thread."""
    return _farewell.acquire(blocking=False)


def answered() -> None:
    """Mark the signal as answered after catching TerminatedError: no thread ends the process."""
    state.number, state.is_unwinding, state.is_answered = 0, False, True
