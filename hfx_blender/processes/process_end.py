# SPDX-License-Identifier: GPL-3.0-or-later
"""End of a process of this package by Ctrl-C, SIGTERM or SIGHUP, at any moment.

An exception from a signal handler is lost within a call from Blender or ctypes to Python, and may
leave locks held. So the handler only records the signal. The main thread polls for it between two
pieces of work (:func:`check`) and unwinds. After a second, as during long work
of Blender, a watching thread ends the process: child processes first, then unfinished files.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import FrameType
from typing import Final, NoReturn

from ..files import atomic
from . import start
from .startup import SIGNALS, end_at_once, farewell

UNNOTICED_S: Final = 1.0
"""Time limit for the main thread to poll for a signal, seconds."""

UNWINDING_S: Final = 2.0
"""Time limit from a signal to the end of unwinding, seconds."""

TIDYING_S: Final = 2.6
"""Time limit for ending child processes and removing unfinished files, seconds."""

_CHILDREN_S: Final = 2.0
_WRITING_S: Final = 0.3
_LOOK_S: Final = 0.02


class TerminatedError(KeyboardInterrupt):
    """Raised by :func:`check` after a signal; ``exit_code`` is 128 and the signal's number."""

    def __init__(self, number: int) -> None:
        super().__init__(farewell(number))
        self.exit_code = 128 + number


@dataclass
class _SignalState:
    number: int = 0  # of the first signal; 0: none
    noted_s: float = 0.0  # time of the signal
    handled: int = 0  # number of calls of the handler
    is_unwinding: bool = False  # TerminatedError was raised
    is_answered: bool = False  # TerminatedError was caught
    unnoticed_s: float = UNNOTICED_S
    writes_farewell: bool = True


_state = _SignalState()
_ending = threading.Lock()  # acquired once, by the thread that ends the process
_farewell = threading.Lock()  # acquired once, by the thread that writes the farewell


def end_on_signals(*, at_once: bool = False) -> None:
    """Let Ctrl-C, SIGTERM and SIGHUP end this process: a handler records the first signal, which
    :func:`check` raises. Without a check in 1 s, or 2 s of unwinding, a thread ends the process.
    Signals with custom handlers are left. Has no effect outside the main thread. ``at_once``: end
    without message and without unwinding, for a process whose parent reports the end."""
    if threading.current_thread() is not threading.main_thread():
        return
    replaced = (signal.SIG_DFL, signal.default_int_handler, end_at_once)
    ours = [number for number in SIGNALS if signal.getsignal(number) in replaced]
    if not ours:
        return
    # A wakeup pipe and a thread, as handlers run in the main thread only.
    _state.unnoticed_s, _state.writes_farewell = 0.0 if at_once else UNNOTICED_S, not at_once
    reading, writing = os.pipe()
    if os.name == "posix":  # set_wakeup_fd demands it there
        os.set_blocking(writing, False)
    # Python's C handler writes the signal's number to the pipe, even while the main thread is in
    # C code and cannot run Python's handler.
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reading,), name="signals", daemon=True).start()
    for number in ours:
        signal.signal(number, _handle)


def check() -> None:
    """Raise TerminatedError, once, if a signal has come; does nothing outside the main thread. To
    be called between two pieces of work, neither in callbacks of Blender nor under a lock."""
    if not _state.number or _state.is_unwinding:
        return
    if threading.current_thread() is threading.main_thread():
        _state.is_unwinding = True
        raise TerminatedError(_state.number)


def claims_farewell() -> bool:
    """True once: the caller writes the sentence about the end by a signal, no other thread."""
    return _farewell.acquire(blocking=False)


def answered() -> None:
    """Mark the signal as answered after catching TerminatedError: no thread ends the process."""
    _state.number, _state.is_unwinding, _state.is_answered = 0, False, True


def leave(code: int) -> NoReturn:
    """Exit at once with a code, past all threads; end child processes, remove unfinished files,
    flush standard output. In place of a normal exit of Python, in which Blender's module sometimes
    hangs. A signal that has not been answered overrides the code, with 128 + number."""
    # Only one thread tidies up: a second one waits, then the process is gone.
    if _ending.acquire(timeout=TIDYING_S):
        if _state.is_answered:
            _in_time(_tidy, TIDYING_S)
            _in_time(_flush, _WRITING_S)
        else:
            _tidy()
            _flush()
    if _state.number and not _state.is_answered:  # came after the last check()
        _end(_state.number)
    os._exit(code)


def _handle(number: int, _frame: FrameType | None) -> None:
    _state.handled += 1
    _note(number)


def _note(number: int) -> None:
    if not _state.number:
        _state.noted_s, _state.number = time.monotonic(), number


def _watch(reading: int) -> None:
    """Run the watching thread, which never returns: read numbers of arrived signals from the
    descriptor ``reading``. If the main thread does not call its handler in ``_LOOK_S``, record the
    signal here. If the main thread then exceeds its time limits to notice the signal and to unwind,
    end child processes, remove unfinished files and exit with 128 + number."""
    while True:
        handled = _state.handled
        numbers = os.read(reading, 64)
        if _state.handled == handled:
            time.sleep(_LOOK_S)
        # Python's handler has not run, as the main thread is in C code: record the signal here.
        if _state.handled == handled and not _state.is_answered:
            for number in numbers:
                if signal.getsignal(number) is _handle:
                    _note(number)
        # From here on two limits run: for the main thread to notice the signal, then to unwind.
        while _state.number:
            limit_s = UNWINDING_S if _state.is_unwinding else _state.unnoticed_s
            if time.monotonic() - _state.noted_s >= limit_s:
                number = _state.number
                if _ending.acquire(timeout=TIDYING_S):
                    _in_time(_tidy, TIDYING_S)
                _end(number)
            time.sleep(_LOOK_S)


def _end(number: int) -> NoReturn:
    """Exit at once with 128 + ``number``, after the farewell to standard error."""
    text = f"hfx: {farewell(number)}\n".encode()
    if claims_farewell():
        if _state.writes_farewell:
            # Not through sys.stderr, whose lock the main thread may hold.
            _in_time(lambda: os.write(2, text), _WRITING_S)
    elif not _state.is_answered:  # the main thread is writing the sentence at this moment
        time.sleep(_WRITING_S)
    os._exit(128 + number)


def _in_time(work: Callable[[], object], limit_s: float) -> None:
    """Run ``work`` in a thread, without its OSError; return at its end or after ``limit_s``."""

    def safely() -> None:
        with suppress(OSError):
            work()

    thread = threading.Thread(target=safely, daemon=True)
    thread.start()
    thread.join(limit_s)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()


def _tidy() -> None:
    """End child processes within 2 s, then remove unfinished files."""
    start.end_all(_CHILDREN_S)
    with atomic.placing:  # waits while the files of a result are moved into place
        atomic.remove_unfinished()
