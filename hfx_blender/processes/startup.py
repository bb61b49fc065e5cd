# SPDX-License-Identifier: GPL-3.0-or-later
"""First steps of the command ``hfx``, before it imports anything: import path and signals.

A stranger's folder may hold a ``numpy.py`` beside a .blend, which ``PYTHONPATH=.`` or
``PYTHONPATH=:`` would have Python import. What Python itself and the script ``hfx`` import before
this file cannot be kept from there. This file imports only what Python has loaded before it.
"""

import _signal
import os
import sys

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
SIGNALS = {getattr(_signal, name): name for name in NAMES if hasattr(_signal, name)}
"""Signals that end a command, with their names."""


def absolute(python_path: str) -> list[str]:
    """Select the absolute entries of a PYTHONPATH."""
    return [path for path in python_path.split(os.pathsep) if os.path.isabs(path)]


def clean_import_path() -> None:
    """Remove folders that PYTHONPATH names relative to the current folder from ``sys.path``.

    PYTHONPATH loses the same entries, for processes that are started from here. Folders that it
    also names absolutely stay, and so do Python's own, even if one is the current folder.
    """
    python_path = os.environ.get("PYTHONPATH", "")
    if not python_path or sys.flags.ignore_environment:
        return
    kept = absolute(python_path)
    os.environ["PYTHONPATH"] = os.pathsep.join(kept)
    # Python has made all entries of sys.path absolute.
    relative = {os.path.abspath(path) for path in python_path.split(os.pathsep)}
    relative -= {*kept, *_own_folders()}
    sys.path[:] = [path for path in sys.path if path not in relative]


def _own_folders() -> list[str]:
    """Folders of Python's library and of its packages."""
    site = sys.modules.get("site")
    if site is None:
        return [os.path.dirname(os.__file__)]
    return [os.path.dirname(os.__file__), *site.getsitepackages(), site.getusersitepackages()]


def farewell(number: int) -> str:
    """Sentence about a process that a signal ended."""
    how = "interrupted" if number == _signal.SIGINT else f"ended by {SIGNALS[number]}"
    return f"{how}; nothing half written was left behind"


def end_at_once(number: int, _frame: object) -> None:
    """End the process by a signal, before it has made anything."""
    try:
        os.write(2, f"hfx: {farewell(number)}\n".encode())
    finally:
        os._exit(128 + number)


def begin() -> None:
    """Clean the import path, and have signals end the process, while modules are imported."""
    clean_import_path()
    for number in SIGNALS:
        if _signal.getsignal(number) in (_signal.SIG_DFL, _signal.default_int_handler):
            _signal.signal(number, end_at_once)
