# SPDX-License-Identifier: GPL-3.0-or-later
"""End of a process of this package by Ctrl-C, SIGTERM or SIGHUP, whatever it is doing.

An exception from a signal handler is lost where Blender or ctypes is calling Python, and leaves
locks taken. So handlers only note the signal. The main thread looks at the note between two pieces
of work (:func:`check`) and unwinds. Where it does not within a second, as in Blender's long work, a
thread that the signal wakes ends the process: child processes first, then unfinished files.
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
"""Time for the main thread to notice a signal, seconds."""

UNWINDING_S: Final = 2.0
"""Time from a signal to the end of the work that noticed it, seconds."""

TIDYING_S: Final = 2.6
"""Longest time for ending child processes and removing unfinished files after that, seconds."""

_CHILDREN_S: Final = 2.0
_WRITING_S: Final = 0.3
_LOOK_S: Final = 0.02


class TerminatedError(KeyboardInterrupt):
    """Raised by :func:`check` after a signal to end the process."""

    def __init__(self, number: int) -> None:
        super().__init__(farewell(number))
        self.exit_code = 128 + number


@dataclass
class _State:
    number: int = 0  # of the signal; 0: none
    noted_s: float = 0.0
    handled: int = 0  # count of signals that reached the main thread
    is_unwinding: bool = False
    is_answered: bool = False
    unnoticed_s: float = UNNOTICED_S
    writes_farewell: bool = True


_state = _State()
_ending = threading.Lock()  # taken by the thread that ends the process, for good


def end_on_signals(*, at_once: bool = False) -> None:
    """Let Ctrl-C, SIGTERM and SIGHUP end this process, unless they have other handlers.

    Parameters
    ----------
    at_once : bool
        End without a word and without unwinding: a process whose parent reports the end.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    replaced = (signal.SIG_DFL, signal.default_int_handler, end_at_once)
    ours = [number for number in SIGNALS if signal.getsignal(number) in replaced]
    if not ours:
        return
    _state.unnoticed_s, _state.writes_farewell = 0.0 if at_once else UNNOTICED_S, not at_once
    reading, writing = os.pipe()
    if os.name == "posix":  # set_wakeup_fd demands it there
        os.set_blocking(writing, False)
    # The system's own handler writes to it, whatever the main thread is doing.
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reading,), name="signals", daemon=True).start()
    for number in ours:
        signal.signal(number, _handle)


def check() -> None:
    """Raise TerminatedError in the main thread if a signal to end the process has come.

    To be called between two pieces of work, not within callbacks of Blender's and not under a
    lock. Raises once.
    """
    if not _state.number or _state.is_unwinding:
        return
    if threading.current_thread() is threading.main_thread():
        _state.is_unwinding = True
        raise TerminatedError(_state.number)


def answered() -> None:
    """Forget a signal whose TerminatedError was caught: the caller ends the process, or goes on."""
    _state.number, _state.is_unwinding, _state.is_answered = 0, False, True


def leave(code: int) -> NoReturn:
    """End the process at once, whatever its threads are waiting for; remove unfinished files.

    Blender's module sometimes hangs while Python takes it down, after all work is done.
    """
    if _ending.acquire(timeout=TIDYING_S):
        if _state.is_answered:
            _in_time(_tidy, TIDYING_S)
            _in_time(_flush, _WRITING_S)
        else:
            _tidy()
            _flush()
    if _state.number and not _state.is_answered:  # it came too late for the work
        _end(_state.number)
    os._exit(code)


def _handle(number: int, _frame: FrameType | None) -> None:
    _state.handled += 1
    _note(number)


def _note(number: int) -> None:
    if not _state.number:
        _state.noted_s, _state.number = time.monotonic(), number


def _watch(reading: int) -> None:
    """Thread that ends the process where the main thread does not."""
    while True:
        handled = _state.handled
        numbers = os.read(reading, 64)
        if _state.handled == handled:
            time.sleep(_LOOK_S)
        # The main thread is in C, where it runs no handlers.
        if _state.handled == handled and not _state.is_answered:
            for number in numbers:
                if signal.getsignal(number) is _handle:
                    _note(number)
        while _state.number:
            limit_s = UNWINDING_S if _state.is_unwinding else _state.unnoticed_s
            if time.monotonic() - _state.noted_s >= limit_s:
                _end_by_force(_state.number)
            time.sleep(_LOOK_S)


def _end_by_force(number: int) -> NoReturn:
    if _ending.acquire(timeout=TIDYING_S):
        _in_time(_tidy, TIDYING_S)
    _end(number)


def _end(number: int) -> NoReturn:
    text = f"hfx: {farewell(number)}\n".encode()
    if _state.writes_farewell and not _state.is_answered:  # else the main thread has written it
        # Past sys.stderr, whose lock the main thread may hold.
        _in_time(lambda: os.write(2, text), _WRITING_S)
    os._exit(128 + number)


def _in_time(work: Callable[[], object], limit_s: float) -> None:
    """Do work, but go on after a time: a file system or a reader of ours may hang."""

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
    start.end_all(_CHILDREN_S)
    with atomic.placing:  # not between two files of one result
        atomic.remove_unfinished()
