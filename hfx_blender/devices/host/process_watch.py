# SPDX-License-Identifier: GPL-3.0-or-later
"""Beginning of the end of another process, before its pipes are closed.

Linux frees a process's memory before it closes its pipes: the end of a pipe comes 50 to 800 ms
late for each GiB. So does the signal of a pidfd. What comes at once is in ``/proc/PID/stat``: a
SIGKILL that is pending (as in all threads after any fatal signal), the flag of exiting, the state
of a zombie. macOS has the same flag. Windows closes handles, and so pipes, before it frees memory,
and sets the exit code before either.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

LOOK_S: Final = 0.005
"""Interval of looking, seconds: a tenth of the time in which devices are to be silent."""

_EXITING: Final = 0x4  # PF_EXITING of Linux; PROC_FLAG_INEXIT of macOS has the same value
_KILLED: Final = 1 << 8  # SIGKILL, signal 9, in the set of pending ones


def await_end(pid: int) -> bool:
    """Wait until a process begins to end; False at once where the system does not tell it."""
    with suppress(OSError, AttributeError):
        is_ending = end_test(pid)
        while not is_ending():
            time.sleep(LOOK_S)
        return True
    return False


def end_test(pid: int) -> Callable[[], bool]:
    """Test for the beginning of the end of a process.

    Raises
    ------
    OSError
        The process cannot be looked at.
    AttributeError
        The system has no such functions.
    """
    if sys.platform == "win32":
        return _windows_test(pid)
    return _macos_test(pid) if sys.platform == "darwin" else _linux_test(pid)


def _linux_test(pid: int) -> Callable[[], bool]:
    # The open file stays that of this process, whoever gets its number afterwards.
    descriptor = os.open(f"/proc/{pid}/stat", os.O_RDONLY | os.O_CLOEXEC)

    def is_ending() -> bool:
        try:
            content = os.pread(descriptor, 4096, 0)
        except ProcessLookupError:
            return True
        return says_ending(content)

    return is_ending


def says_ending(stat: bytes) -> bool:
    """Test the content of ``/proc/PID/stat`` for a process that is ending (see man proc)."""
    # The second field, the name in parentheses, may hold spaces and parentheses itself.
    fields = stat[stat.rindex(b")") + 2 :].split()
    state, flags, pending = fields[0], int(fields[6]), int(fields[28])
    return state in (b"Z", b"X", b"x") or bool(flags & _EXITING) or bool(pending & _KILLED)


def _macos_test(pid: int) -> Callable[[], bool]:
    library: Any = ctypes.CDLL("/usr/lib/libproc.dylib")
    info = (ctypes.c_uint32 * 34)()  # struct proc_bsdinfo: flags, status, ...; 136 bytes

    def is_ending() -> bool:
        size = library.proc_pidinfo(pid, 3, ctypes.c_uint64(0), info, ctypes.sizeof(info))
        is_zombie = info[1] == 5  # SZOMB
        return size <= 0 or bool(info[0] & _EXITING) or is_zombie

    if is_ending():  # it may not be looked at
        raise OSError(f"process {pid} cannot be looked at")
    return is_ending


def _windows_test(pid: int) -> Callable[[], bool]:
    kernel: Any = ctypes.WinDLL("kernel32", use_last_error=True)  # type: ignore[attr-defined]
    kernel.OpenProcess.restype = ctypes.c_void_p
    kernel.GetExitCodeProcess.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_uint32)]
    handle = kernel.OpenProcess(0x1000, False, pid)  # PROCESS_QUERY_LIMITED_INFORMATION
    if not handle:
        raise OSError(f"process {pid} cannot be opened")

    def is_ending() -> bool:
        code = ctypes.c_uint32()
        if not kernel.GetExitCodeProcess(handle, ctypes.byref(code)):
            raise OSError(f"process {pid} cannot be looked at")
        return code.value != 259  # STILL_ACTIVE

    return is_ending
