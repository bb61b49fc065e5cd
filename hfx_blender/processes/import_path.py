# SPDX-License-Identifier: GPL-3.0-or-later
"""Import path of Python: without the current folder and folders relative to it.

A stranger's folder may hold a ``numpy.py`` beside a .blend. ``PYTHONPATH=:`` or ``PYTHONPATH=.``
would have Python run it. This file uses only what every Python has loaded before it looks at
``sys.path``; the build hook also installs it as ``_hfx_import_path.pth``, which Python runs before
the script ``hfx`` imports anything. Importing it changes ``sys.path`` in the process of ``hfx``
only; a program that uses this package keeps its own. For the time of the imports, signals end that
process at once.
"""

import _signal
import os
import sys


def trusted(paths: list[str]) -> list[str]:
    """Select the folders of an import path that are not named relative to the current folder.

    Parameters
    ----------
    paths : list of str
        Such as ``sys.path``, in which Python has made all entries absolute.

    Returns
    -------
    list of str
        In the same order. What an absolute entry of PYTHONPATH names, and Python's own folders,
        stay even if a relative entry names them, too.
    """
    kept = set(_own_folders()).union(map(os.path.normcase, absolute(_PYTHONPATH)))
    found = [path for path in paths if os.path.isabs(path)]
    return [
        path
        for path in found
        if os.path.normcase(path) not in _RELATIVE or os.path.normcase(path) in kept
    ]


def absolute(python_path: str) -> list[str]:
    """Select the absolute entries of a PYTHONPATH."""
    return [path for path in python_path.split(os.pathsep) if os.path.isabs(path)]


def protect() -> None:
    """Remove the current folder, and relative ones, from ``sys.path``.

    PYTHONPATH loses the same entries, for processes that are started from here.
    """
    paths = list(sys.path)
    if _is_module_run() and paths and os.path.normcase(paths[0]) == os.path.normcase(_CURRENT):
        del paths[0]
    sys.path[:] = trusted(paths)
    if _PYTHONPATH:
        os.environ["PYTHONPATH"] = os.pathsep.join(absolute(_PYTHONPATH))


def end_early(number: int, _frame: object) -> None:
    """End the process of ``hfx`` by a signal, as long as it has made nothing yet."""
    how = {_signal.SIGINT: "interrupted", _signal.SIGTERM: "ended by SIGTERM"}
    text = f"hfx: {how.get(number, 'ended by SIGHUP')}; nothing half written was left behind\n"
    try:
        os.write(2, text.encode())
    finally:
        os._exit(128 + number)


def handle_early_signals() -> None:
    """Have :func:`end_early` called instead of Python's own ends, until the command begins."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(_signal, name, None)
        own_ends = (_signal.SIG_DFL, _signal.default_int_handler)
        if number is not None and _signal.getsignal(number) in own_ends:
            _signal.signal(number, end_early)


def is_own_command(arguments: list[str]) -> bool:
    """Test a Python command line for ``hfx``: its script, or its module."""
    if arguments[1:3] == ["-m", "hfx_blender.cli"]:
        return True
    scripts = [each for each in arguments[1:] if not each.startswith("-")]
    name = scripts[0].replace("\\", "/").rpartition("/")[2].lower() if scripts else ""
    return name in ("hfx", "hfx.exe", "hfx-script.py")


def _current_folder() -> str:
    try:
        return os.getcwd()
    except OSError:  # it has been removed
        return ""


def _own_folders() -> list[str]:
    """Python's library and its packages, which may be the current folder."""
    site = sys.modules.get("site")
    folders = [os.path.dirname(os.__file__)] if getattr(os, "__file__", None) else []
    for name in ("getsitepackages", "getusersitepackages"):
        found = getattr(site, name, list)()
        folders += [found] if isinstance(found, str) else found
    return [os.path.normcase(folder) for folder in folders]


def _is_module_run() -> bool:
    return "-m" in sys.orig_argv[1:] and not sys.flags.safe_path


_PYTHONPATH = "" if sys.flags.ignore_environment else os.environ.get("PYTHONPATH", "")
_CURRENT = _current_folder()  # when Python started, approximately
_RELATIVE = {
    os.path.normcase(os.path.abspath(path))
    for path in (_PYTHONPATH.split(os.pathsep) if _PYTHONPATH else ())
    if not os.path.isabs(path) and _CURRENT
}

if is_own_command(sys.orig_argv):
    protect()
    handle_early_signals()
