# SPDX-License-Identifier: GPL-3.0-or-later
"""Time slices of the output process: a request that changes neither policy nor niceness."""

from __future__ import annotations

import os
import struct
import sys
import threading
from typing import Any

import pytest

from hfx_blender.devices.host import clock


def in_a_thread(function: Any) -> Any:
    """Result of a function in a new thread, whose slices end with it."""
    results: list[Any] = []
    thread = threading.Thread(target=lambda: results.append(function()))
    thread.start()
    thread.join()
    return results[0]


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="sched_setattr is of Linux")


@on_linux
def test_a_thread_keeps_its_policy_and_niceness() -> None:
    def changed() -> tuple[int, int]:
        os.nice(3)
        clock.shorten_slices()
        return os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    nice = os.getpriority(os.PRIO_PROCESS, 0)
    assert in_a_thread(changed) == (os.SCHED_OTHER, min(nice + 3, 19))


@on_linux
def test_the_request_has_the_layout_of_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """``struct sched_attr`` of ``include/uapi/linux/sched/types.h``: 56 bytes, runtime at 24."""
    requests: list[tuple[int, bytes]] = []

    class Library:
        def __init__(self, _name: None) -> None: ...

        def syscall(self, number: int, _thread: int, attributes: bytes, _flags: int) -> int:
            requests.append((number, attributes))
            return -1

    monkeypatch.setattr(clock.ctypes, "CDLL", Library)
    monkeypatch.setattr(clock.sys, "platform", "linux")
    monkeypatch.setattr(clock.platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(clock.os, "sched_getscheduler", lambda _: os.SCHED_OTHER, raising=False)
    assert not clock.shorten_slices()
    [(number, attributes)] = requests
    assert number == 274 and len(attributes) == 56
    assert struct.unpack_from("=II", attributes) == (56, 0)
    assert struct.unpack_from("=Q", attributes, 24) == (100_000,)


def test_further_systems_and_policies_get_no_request(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock.ctypes, "CDLL", None)
    for platform, machine in (("win32", "x86_64"), ("darwin", "aarch64"), ("linux", "riscv64")):
        monkeypatch.setattr(clock.sys, "platform", platform)
        monkeypatch.setattr(clock.platform, "machine", lambda machine=machine: machine)
        assert not clock.shorten_slices()
