# SPDX-License-Identifier: GPL-3.0-or-later
"""Detection of the exit of a process before the closing of its pipes.

Linux frees the memory of a process before closing pipes: the end of a pipe comes 50 to 800 ms
late for each GiB, and so does the signal of a pidfd. Three facts change at once in
``/proc/PID/stat``: SIGKILL is pending (in all threads after any fatal signal), the exiting flag is
set, the state is zombie. macOS has the same flag. Windows sets the exit code and closes handles,
pipes included, before freeing memory.
"""

import ctypes
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

LOOK_S: Final = 0.005
"""Polling interval, seconds: a tenth of the time in which devices have to be silent."""

_EXITING: Final = 0x4  # PF_EXITING of Linux; PROC_FLAG_INEXIT of macOS has the same value
_KILLED: Final = 1 << 8  # SIGKILL, signal 9, in the set of pending signals


def await_end(pid: int) -> bool:
    """Wait until a process begins to exit, and return True.

    False at once if the system does not allow it to be observed, or has no process ``pid``.
    """
    with suppress(OSError, AttributeError):
        is_ending = end_test(pid)
        while not is_ending():
            time.sleep(LOOK_S)
        return True
    return False


def end_test(pid: int) -> Callable[[], bool]:
    """Return a function that tests whether a process has started to exit, or has ended.

    Raises OSError: the process does not exist, or may not be watched.
    Raises AttributeError: the system lacks the functions.
    """
    if sys.platform == "win32":
        return _windows_test(pid)
    return _macos_test(pid) if sys.platform == "darwin" else _linux_test(pid)


def _linux_test(pid: int) -> Callable[[], bool]:
    # An open file refers to this very process, even after a new process with this number.
    descriptor = os.open(f"/proc/{pid}/stat", os.O_RDONLY | os.O_CLOEXEC)

    def is_ending() -> bool:
        with suppress(ProcessLookupError):
            return says_ending(os.pread(descriptor, 4096, 0))
        return True

    return is_ending


def says_ending(stat: bytes) -> bool:
    """Test ``/proc/PID/stat`` (man proc) for a zombie, the exiting flag or a pending SIGKILL."""
    # The second field, the name in parentheses, may contain spaces and parentheses.
    fields = stat[stat.rindex(b")") + 2 :].split()
    state, flags, pending = fields[0], int(fields[6]), int(fields[28])
    return state in (b"Z", b"X", b"x") or bool(flags & _EXITING) or bool(pending & _KILLED)


def _macos_test(pid: int) -> Callable[[], bool]:
    # proc_pidinfo with flavour 3, PROC_PIDTBSDINFO, of libproc.h.
    library: Any = ctypes.CDLL("/usr/lib/libproc.dylib")
    info = (ctypes.c_uint32 * 34)()  # struct proc_bsdinfo: flags, status, ...; 136 bytes

    def is_ending() -> bool:
        size = library.proc_pidinfo(pid, 3, ctypes.c_uint64(0), info, ctypes.sizeof(info))
        is_zombie = info[1] == 5  # SZOMB
        return size <= 0 or bool(info[0] & _EXITING) or is_zombie

    if is_ending():  # not permitted: the call fails as for an ended process
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
