# SPDX-License-Identifier: GPL-3.0-or-later
"""First steps of the command ``hfx``, before other imports: import path and signals.

A downloaded folder may contain a ``numpy.py`` next to a .blend, which Python would import with
``PYTHONPATH=.`` or ``PYTHONPATH=:``. Modules imported earlier, by Python and by the script
``hfx``, are out of reach. This file imports only modules that Python has loaded before.
"""

import _signal
import os
import sys

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
SIGNALS = {getattr(_signal, name): name for name in NAMES if hasattr(_signal, name)}
"""Names of the signals that end a command, by number."""


def absolute(python_path: str) -> list[str]:
    """Absolute entries of a PYTHONPATH."""
    return [path for path in python_path.split(os.pathsep) if os.path.isabs(path)]


def clean_import_path() -> None:
    """Remove relative entries of PYTHONPATH from ``sys.path`` and from the environment.

    Does nothing without PYTHONPATH, or if Python ignores the environment (``-E``).
    Folders with an absolute entry as well stay, and Python's own folders stay, even if one of
    them is the current folder.
    """
    python_path = os.environ.get("PYTHONPATH", "")
    if not python_path or sys.flags.ignore_environment:
        return
    entries = absolute(python_path)
    os.environ["PYTHONPATH"] = os.pathsep.join(entries)  # for child processes
    # sys.path contains the absolute paths of relative entries.
    relative = {os.path.abspath(path) for path in python_path.split(os.pathsep)}
    relative -= {*entries, os.path.dirname(os.__file__)}
    site = sys.modules.get("site")
    if site is not None:
        relative -= {*site.getsitepackages(), site.getusersitepackages()}
    sys.path[:] = [path for path in sys.path if path not in relative]


def farewell(number: int) -> str:
    """Sentence: "interrupted" for SIGINT, else "ended by <signal>", and no file is half written."""
    how = "interrupted" if number == _signal.SIGINT else f"ended by {SIGNALS[number]}"
    return f"{how}; nothing half written was left behind"


def end_at_once(number: int, _frame: object) -> None:
    """Signal handler: write the farewell to standard error, exit at once with 128 + ``number``."""
    try:
        os.write(2, f"hfx: {farewell(number)}\n".encode())
    finally:
        os._exit(128 + number)


def begin() -> None:
    """Clean the import path (:func:`clean_import_path`); let SIGINT, SIGTERM and SIGHUP without
    custom handler exit the process at once, by :func:`end_at_once`."""
    clean_import_path()
    for number in SIGNALS:
        if _signal.getsignal(number) in (_signal.SIG_DFL, _signal.default_int_handler):
            _signal.signal(number, end_at_once)
