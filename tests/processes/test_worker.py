# SPDX-License-Identifier: GPL-3.0-or-later
"""Worker processes, simulated by small programs: messages, time limits, and every kind of end."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from hfx_blender.processes import start
from hfx_blender.processes.messages import Message, MessageKind, message
from hfx_blender.processes.worker import Worker
from hfx_tools import processes

PATIENCE_S = 60.0

ECHO = """
import os, signal, struct, sys, time
from hfx_blender.processes.messages import MessageKind, message
from hfx_blender.processes.worker import Owner
owner = Owner()
print("printed, but no message")
while True:
    asked = owner.receive()
    if asked.kind is MessageKind.PULSE:
        exec(asked.body)
    else:
        owner.send(message(asked.kind, asked.device, asked.body))
"""


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setattr(start, "command", lambda module: processes.program(module))
    created: list[Worker] = []

    def make(source: str = ECHO, **settings: Any) -> Worker:
        created.append(Worker(source, **settings))
        created[-1].start()
        return created[-1]

    yield make
    for worker in created:
        worker.close(0.0)


def do(worker: Worker, source: str) -> None:
    worker.send(message(MessageKind.PULSE, body=source.encode()))


def test_messages_of_any_size_come_back_in_their_order(make: Any) -> None:
    worker = make()
    sent = [bytes([k]) * size for k, size in enumerate((0, 1, 4096, 1 << 20, 3))]
    for number, body in enumerate(sent):
        worker.send(message(MessageKind.VALUES, number, body))
    actual = [worker.receive(PATIENCE_S) for _ in sent]
    assert actual == [Message(MessageKind.VALUES, k, body) for k, body in enumerate(sent)]
    worker.send(message(MessageKind.ARM, 7), is_awaited=True)
    assert worker.receive(PATIENCE_S) == Message(MessageKind.ARM, 7, b"")


def test_sending_never_waits_and_receiving_has_a_timeout(make: Any) -> None:
    worker = make("import time; time.sleep(1000)")
    begun = time.monotonic()
    for _ in range(64):  # far more than a pipe takes
        worker.send(bytes(1 << 20))
    with pytest.raises(TimeoutError):
        worker.receive(0.05)
    worker.kill()
    assert worker.receive(PATIENCE_S) is None and worker.receive(PATIENCE_S) is None
    assert time.monotonic() - begun < PATIENCE_S


@pytest.mark.parametrize(
    ("source", "how"),
    [
        ("os._exit(0)", "ended with code 0"),
        ("sys.stderr.write('first\\nno such thing\\n\\n'); os._exit(7)", "code 7 (no such thing)"),
        ("sys.stderr.write('x' * 300); os._exit(1)", f"code 1 ({'x' * 200})"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "was killed; the system does so when memory"),
        ("os.kill(os.getpid(), signal.SIGTERM)", "was ended by SIGTERM"),
    ],
)
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_an_end_is_reported_with_the_reason(make: Any, source: str, how: str) -> None:
    worker = make(keeps_errors=True)
    do(worker, source)
    assert worker.receive(PATIENCE_S) is None and not worker.fault
    assert how in worker.how_it_ended() and not worker.is_running


@pytest.mark.parametrize(
    ("written", "fault"),
    [
        (b"hello, world", "sent a message of 1819043176 bytes, allowed are 16777216"),  # "hell"
        (b"\0\0\0\0\xc8\0\0", "sent a message of the unknown kind 200"),
        (b"\0\0", ""),  # an incomplete message is the end
    ],
)
def test_something_else_than_messages_is_a_fault(make: Any, written: bytes, fault: str) -> None:
    worker = make(f"import os; os.write(1, {written!r})")
    assert worker.receive(PATIENCE_S) is None
    assert worker.fault == fault


def test_callbacks_get_every_message_then_the_end(make: Any) -> None:
    messages: list[Any] = []
    ended = threading.Event()

    def take(_worker: Worker, kind: Message) -> str | None:
        messages.append(kind.device)
        return "is wrong" if kind.device == 3 else None

    def end(_worker: Worker, reason: str) -> None:
        messages.append(reason)
        ended.set()

    worker = make(received=take, ended=end)
    for number in (1, 2, 3, 4):
        worker.send(message(MessageKind.ARM, number))
    assert ended.wait(PATIENCE_S) and messages == [1, 2, 3, "is wrong"]


def test_the_input_ends_after_all_outgoing_messages(make: Any) -> None:
    def outgoing(_worker: Worker) -> Iterator[bytes]:
        yield message(MessageKind.ARM, 1)

    worker = make(outgoing=outgoing)
    assert worker.wait(PATIENCE_S) == 0  # an owner's end is a normal end


def test_closing_gives_a_process_its_time_and_no_more(make: Any) -> None:
    polite, deaf = make(), make("import time; time.sleep(1000)")
    polite.send(message(MessageKind.ARM))
    assert polite.receive(PATIENCE_S) is not None
    polite.close()
    deaf.close(0.1)
    assert polite.wait() == 0 and deaf.wait() == -signal.SIGKILL


def test_of_200_that_are_killed_at_any_moment_none_is_lost(make: Any) -> None:
    """Each end is noticed, and earlier messages arrive whole."""
    bodies = {number: bytes([number]) * 3000 for number in range(200)}
    source = (
        "import os, struct, time\n"
        "for n in range(200):\n"
        "    os.write(1, struct.pack('<IBH', 3000, 5, n) + bytes([n]) * 3000)\n"
        "time.sleep(1000)\n"
    )
    for batch in range(20):
        workers = [make(source) for _ in range(10)]
        for delay, worker in enumerate(workers):
            time.sleep(0.003 * delay)
            worker.kill()
        for worker in workers:
            actual = []
            while (receive := worker.receive(PATIENCE_S)) is not None:
                actual.append(receive)
            whole = [Message(MessageKind.VALUES, n, bodies[n]) for n in range(len(actual))]
            assert actual == whole and not worker.fault, batch
            assert worker.wait(PATIENCE_S) == -signal.SIGKILL
