# SPDX-License-Identifier: GPL-3.0-or-later
"""Pipelining over two threads gives the same results as a single thread."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from hfx_blender.engine.overlapping import overlapped, sequentially


def _squares(numbers: Iterator[int]) -> Iterator[int]:
    for number in numbers:
        yield number * number


def test_everything_comes_out_once_in_its_order() -> None:
    lists = list(overlapped(iter(range(100)), _squares))
    assert [item for examples in lists for item in examples] == [k * k for k in range(100)]
    assert len(lists) > 100  # one after each value, so a progress display goes on


def test_nothing_in_gives_nothing() -> None:
    assert not any(overlapped(iter(()), _squares))


def test_both_go_on_at_the_same_time() -> None:
    """Both sides wait for each other; sequential execution would block forever."""
    reached, done = threading.Event(), threading.Event()

    def source() -> Iterator[int]:
        yield 1
        assert done.wait(10.0)
        reached.set()
        yield 2

    def work(numbers: Iterator[int]) -> Iterator[int]:
        assert next(numbers) == 1
        done.set()
        assert reached.wait(10.0)
        yield next(numbers)

    assert [item for examples in overlapped(source(), work) for item in examples] == [2]


def test_the_source_is_not_far_ahead() -> None:
    created: list[int] = []
    gate = threading.Event()

    def source() -> Iterator[int]:
        for number in range(50):
            created.append(number)
            yield number

    def work(numbers: Iterator[int]) -> Iterator[int]:
        for number in numbers:
            gate.wait(10.0)
            yield number

    def open_later() -> None:
        time.sleep(0.2)
        assert len(created) < 8
        gate.set()

    opener = threading.Thread(target=open_later)
    opener.start()
    assert sum(len(examples) for examples in overlapped(source(), work)) == 50
    opener.join()


def test_an_error_of_the_worker_is_raised_here() -> None:
    def work(numbers: Iterator[int]) -> Iterator[int]:
        for number in numbers:
            yield 1 // (5 - number)

    with pytest.raises(ZeroDivisionError):
        list(overlapped(iter(range(100)), work))


def test_an_error_at_the_end_of_the_worker_is_raised_here() -> None:
    def work(numbers: Iterator[int]) -> Iterator[int]:
        yield from numbers
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        list(overlapped(iter(range(3)), work))


@pytest.mark.parametrize("way", ["close", "source"])
def test_no_thread_is_left_and_the_worker_is_closed(way: str) -> None:
    closed, before = [], threading.active_count()
    interval = sys.getswitchinterval()

    def source() -> Iterator[int]:
        yield from range(5)
        if way == "source":
            raise ZeroDivisionError
        yield from range(1000)

    def work(numbers: Iterator[int]) -> Iterator[int]:
        try:
            yield from numbers
        finally:
            closed.append(True)

    actual = overlapped(source(), work)
    for _ in range(5):
        next(actual)
    assert sys.getswitchinterval() < interval
    if way == "source":
        with pytest.raises(ZeroDivisionError):
            next(actual)
    else:
        actual.close()
    assert closed == [True]
    assert threading.active_count() == before
    assert sys.getswitchinterval() == interval


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timer to interrupt with")
@pytest.mark.parametrize("after_s", [0.03, 0.07, 0.11, 0.15])
def test_an_interrupt_while_waiting_leaves_no_thread(after_s: float) -> None:
    def work(numbers: Iterator[int]) -> Iterator[int]:
        for number in numbers:
            time.sleep(0.3)
            yield number

    before = threading.active_count()
    old = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, after_s)
        with pytest.raises(KeyboardInterrupt):
            list(overlapped(iter([1]), work))
    finally:
        signal.signal(signal.SIGALRM, old)
    assert threading.active_count() == before


def test_in_turn_values_come_when_done_and_sources_are_closed() -> None:
    started, closed = [], []

    def source() -> Iterator[int]:
        for number in range(9):
            started.append(number)
            yield number

    def work(numbers: Iterator[int]) -> Iterator[int]:
        try:
            yield from _squares(numbers)
        finally:
            closed.append(True)

    actual = sequentially(source(), work)
    assert [next(actual), next(actual)] == [[0], [1]]
    assert started == [0, 1]
    actual.close()
    assert closed == [True]
