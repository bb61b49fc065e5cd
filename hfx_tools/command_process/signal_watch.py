# SPDX-License-Identifier: GPL-3.0-or-later
"""End of a process of this package by Ctrl-C, SIGTERM or SIGHUP, at any moment.

An exception from a signal handler is lost within a call from Blender or ctypes to Python, and may
leave locks held. So the handler only records the signal. The main thread polls for it between two
pieces of work (:func:`.process_end.check`) and unwinds. After a second, as during long work
of Blender, a watching thread ends the process: child processes first, then unfinished files.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import FrameType
from typing import Final, NoReturn

from hfx_blender.files import atomic
from hfx_blender.processes import start
from hfx_blender.processes.process_end import claims_farewell, state
from hfx_blender.processes.startup import SIGNALS, end_at_once, farewell

UNNOTICED_S: Final = 1.0
"""Time limit for the main thread to poll for a signal, seconds."""

UNWINDING_S: Final = 2.0
"""Time limit from a signal to the end of unwinding, seconds."""

TIDYING_S: Final = 2.6
"""Time limit for ending child processes and removing unfinished files, seconds."""

_CHILDREN_S: Final = 2.0
_WRITING_S: Final = 0.3
_LOOK_S: Final = 0.02
_CHILD_LOOK_S: Final = 0.01


@dataclass
class _Watch:
    handled: int = 0  # number of calls of the handler
    unnoticed_s: float = UNNOTICED_S
    writes_farewell: bool = True


_watching = _Watch()
_actions: list[Callable[[], object]] = []
_ending = threading.Lock()  # acquired once, by the thread that ends the process


def end_on_signals(*, at_once: bool = False) -> None:
    """Let Ctrl-C, SIGTERM and SIGHUP end this process: a handler records the first signal, which
    :func:`.process_end.check` raises. Without a check in 1 s, or 2 s of unwinding, a thread ends
    the process. Signals with custom handlers are left. Has no effect outside the main thread.
    ``at_once``: end without message and without unwinding, for a process whose parent reports the
    end."""
    if threading.current_thread() is not threading.main_thread():
        return
    replaced = (signal.SIG_DFL, signal.default_int_handler, end_at_once)
    ours = [number for number in SIGNALS if signal.getsignal(number) in replaced]
    if not ours:
        return
    # A wakeup pipe and a thread, as handlers run in the main thread only.
    _watching.unnoticed_s, _watching.writes_farewell = 0.0 if at_once else UNNOTICED_S, not at_once
    reading, writing = os.pipe()
    if os.name == "posix":  # set_wakeup_fd demands it there
        os.set_blocking(writing, False)
    # Python's C handler writes the signal's number to the pipe, even while the main thread is in
    # C code and cannot run Python's handler.
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reading,), name="signals", daemon=True).start()
    for number in ours:
        signal.signal(number, _handle)


@contextmanager
def at_signals(action: Callable[[], object]) -> Iterator[None]:
    """Context in which the watching thread calls ``action`` at each signal, at once: the main
    thread may be busy for some time before its next check. Exceptions of ``action`` are ignored."""
    _actions.append(action)
    try:
        yield
    finally:
        _actions.remove(action)


def leave(code: int) -> NoReturn:
    """Exit at once with a code, past all threads; end child processes, remove unfinished files,
    flush standard output. In place of a normal exit of Python, in which Blender's module sometimes
    hangs. A signal that has not been answered overrides the code, with 128 + number."""
    # Only one thread tidies up: a second one waits, then the process is gone.
    if _ending.acquire(timeout=TIDYING_S):
        if state.is_answered:
            _in_time(_tidy, TIDYING_S)
            _in_time(_flush, _WRITING_S)
        else:
            _tidy()
            _flush()
    if state.number and not state.is_answered:  # came after the last check()
        _end(state.number)
    os._exit(code)


def _handle(number: int, _frame: FrameType | None) -> None:
    _watching.handled += 1
    _note(number)


def _note(number: int) -> None:
    if not state.number:
        state.noted_s, state.number = time.monotonic(), number


def _watch(reading: int) -> None:
    """Run the watching thread, which never returns: read numbers of arrived signals from the
    descriptor ``reading``, and call the actions of :func:`at_signals`. If the main thread does not
    call its handler in ``_LOOK_S``, record the signal here. If the main thread then exceeds its
    time limits to notice the signal and to unwind, end child processes, remove unfinished files and
    exit with 128 + number."""
    while True:
        handled = _watching.handled
        numbers = [x for x in os.read(reading, 64) if signal.getsignal(x) is _handle]
        for action in list(_actions) if numbers else ():
            with suppress(Exception):
                action()
        if _watching.handled == handled:
            time.sleep(_LOOK_S)
        # Python's handler has not run, as the main thread is in C code: record the signal here.
        if _watching.handled == handled and not state.is_answered:
            for number in numbers:
                _note(number)
        # From here on two limits run: for the main thread to notice the signal, then to unwind.
        while state.number:
            limit_s = UNWINDING_S if state.is_unwinding else _watching.unnoticed_s
            if time.monotonic() - state.noted_s >= limit_s:
                number = state.number
                if _ending.acquire(timeout=TIDYING_S):
                    _in_time(_tidy, TIDYING_S)
                _end(number)
            time.sleep(_LOOK_S)


def _end(number: int) -> NoReturn:
    """Exit at once with 128 + ``number``, after the farewell to standard error."""
    text = f"hfx: {farewell(number)}\n".encode()
    if claims_farewell():
        if _watching.writes_farewell:
            # Not through sys.stderr, whose lock the main thread may hold.
            _in_time(lambda: os.write(2, text), _WRITING_S)
    elif not state.is_answered:  # the main thread is writing the sentence at this moment
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
    """End child processes within 2 s, then remove unfinished files; threads that make further files
    wait until the end of the process."""
    end_children(_CHILDREN_S)
    # Waits while the files of a result are moved into place. Never released: the main thread may
    # run on until the exit, and would leave a new file behind.
    atomic.placing.acquire()
    for path, remove in reversed(list(atomic.unfinished_paths.items())):
        with suppress(OSError):
            remove(path)


def end_children(limit_s: float) -> None:
    """Terminate all processes started by :func:`.start.start`; kill the rest after ``limit_s``
    seconds. Later starts fail: this process is ending. On Windows processes with an input pipe are
    left, as these exit with their input."""
    start.ended.append(True)
    # A copy, as other threads may start processes.
    known = [reference() for reference in list(start.started.values())]
    running = [process for process in known if process is not None and process.poll() is None]
    if os.name == "nt":  # terminate() kills there; processes with a pipe exit with their input
        running = [process for process in running if process.stdin is None]
    for process in running:
        with suppress(OSError):
            process.terminate()
    until = time.monotonic() + limit_s
    while time.monotonic() < until and any(process.poll() is None for process in running):
        time.sleep(_CHILD_LOOK_S)
    for process in running:
        with suppress(OSError):
            process.kill()
