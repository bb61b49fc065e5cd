# SPDX-License-Identifier: GPL-3.0-or-later
"""Crashed, hung and killed batch workers, simulated without Blender: the rest go on."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.export.batch import batch
from hfx_blender.export.batch.units import ExportOptions, Outcome, Unit
from hfx_blender.processes import start, worker
from hfx_tools.export_workers import local_workers
from hfx_tools.export_workers.local_workers import LocalWorkers

STAND_IN = """
import json, os, signal, struct, sys, tempfile, time
from pathlib import Path
HEAD, JSON = struct.Struct("<IBH"), 32
def answer(**message):
    body = json.dumps(message).encode()
    sys.stdout.buffer.write(HEAD.pack(len(body), JSON, 0) + body)
    sys.stdout.buffer.flush()
answer(ready=True)
while head := sys.stdin.buffer.read(HEAD.size):
    unit = json.loads(sys.stdin.buffer.read(HEAD.unpack(head)[0]))
    name = unit["stem"]
    (Path(unit["folder"]) / f"{name}.{unit['kind']}.{os.getpid()}.{time.monotonic_ns()}").touch()
    tried = len(list(Path(unit["folder"]).glob(f"{name}.scene.*")))
    answer(progress=0.5)
    if name.startswith("litter"):  # as Blender does
        tempfile.mkdtemp(prefix="blender_")
        os.kill(os.getpid(), getattr(signal, name.removeprefix("litter")))
        time.sleep(1000)
    if name.startswith("hang"):
        time.sleep(1000)
    if name.startswith("segfault"):
        os.kill(os.getpid(), signal.SIGSEGV)
    if name.startswith("memory") or name.startswith("once") and tried == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("leave"):
        print("no such thing", file=sys.stderr, flush=True)
        sys.exit(7)
    if name.startswith("babble"):
        sys.stdout.buffer.write(b"hello")
    if name.startswith("bad"):
        answer(outcome={"input": name, "error": "is bad", "exit_code": 3})
    elif name.startswith("long") and unit["kind"] == "scene" and unit["parts"] > 1:
        answer(outcome={"split": [[0, 128], [128, 256], [256, 300]]})
    elif unit["kind"] == "part":
        if name.startswith("longbad") and unit["part"][0] == 128:
            answer(outcome={"input": name, "error": "this part is bad", "exit_code": 3})
        else:
            answer(outcome={"part": {"first": unit["part"][0]}})
    else:
        report = {"files": [], "merged": [each["first"] for each in unit["done"]]}
        answer(outcome={"input": name, "report": report, "text": name})
"""


@pytest.fixture(autouse=True)
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "stand_in.py"
    program.write_text(STAND_IN)
    monkeypatch.setattr(start, "command", lambda module: [sys.executable, "-S", str(program)])


@pytest.fixture
def make() -> Iterator[Any]:
    created: list[LocalWorkers] = []

    def make(jobs: int = 2, limit_s: float | None = None) -> LocalWorkers:
        created.append(LocalWorkers(jobs, limit_s))
        return created[-1]

    yield make
    for item in created:
        item.close()


def _units(tmp_path: Path, *names: str) -> list[Unit]:
    (tmp_path / "out").mkdir(exist_ok=True)
    (tmp_path / "stage").mkdir(exist_ok=True)
    return [
        Unit("scene", f"/{name}.blend", str(tmp_path / "out"), name, str(tmp_path / "stage"),
             ExportOptions())
        for name in names
    ]  # fmt: skip


def _tries(tmp_path: Path, name: str, kind: str = "scene") -> list[str]:
    return sorted(
        (path.name for path in (tmp_path / "out").glob(f"{name}.{kind}.*")),
        key=lambda text: int(text.split(".")[-1]),
    )


def test_a_crash_costs_other_scenes_nothing(make: Any, tmp_path: Path) -> None:
    names = ("segfault", "a", "memory", "bad", "b", "leave", "babble", "c", "hang", "d")
    messages: list[str] = []
    outcomes = batch.run(
        _units(tmp_path, *names),
        make(limit_s=1.0),
        tell=lambda unit, outcome: messages.append(unit.stem),
    )
    actual = {name: item.get("error", "fine") for name, item in zip(names, outcomes, strict=True)}
    assert {name for name, error in actual.items() if error == "fine"} == set("abcd")
    assert "crashed (SIGSEGV)" in actual["segfault"] and "a second one" in actual["segfault"]
    assert "memory" in actual["memory"]
    assert "code 7 (no such thing)" in actual["leave"]
    assert actual["bad"] == "is bad"
    assert actual["hang"] == "took longer than the time limit of 1 s"
    assert "something else" in actual["babble"]
    assert [outcome["exit_code"] for outcome in outcomes if "error" in outcome] == [
        1,
        1,
        3,
        1,
        1,
        3,
    ]
    assert sorted(messages) == sorted(names)
    assert len(_tries(tmp_path, "segfault")) == 2  # the second in another process
    assert len(_tries(tmp_path, "hang")) == len(_tries(tmp_path, "bad")) == 1
    left = [path for path in (tmp_path / "stage").iterdir() if "error" in path.name]
    assert left == []


def test_no_worker_leaves_temporary_files(
    make: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crash, a kill, and a timeout."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setenv("TMPDIR", str(temporary))
    workers = make(limit_s=1.0)
    names = ("litterSIGSEGV", "litterSIGKILL", "litterSIGCONT")
    outcomes = batch.run(_units(tmp_path, *names), workers)
    assert ["error" in outcome for outcome in outcomes] == [True] * 3
    assert len(list(temporary.glob("*/blender_*"))) >= 3
    workers.close()
    assert list(temporary.iterdir()) == []


def test_a_scene_of_a_dead_worker_is_retried_once(make: Any, tmp_path: Path) -> None:
    [outcome] = batch.run(_units(tmp_path, "once"), make())
    assert outcome["text"] == "once"
    assert len({name.split(".")[2] for name in _tries(tmp_path, "once")}) == 2


def test_long_scenes_are_split_where_workers_would_be_idle(make: Any, tmp_path: Path) -> None:
    shares: list[float] = []
    outcomes = batch.run(
        _units(tmp_path, "long1", "longbad", "long2"), make(3), progress=shares.append
    )
    # Only the last scene had idle workers to share with.
    assert [outcome["report"]["merged"] for outcome in outcomes if "report" in outcome] == [
        [],
        [],
        [0, 128, 256],
    ]
    [outcome] = batch.run(_units(tmp_path, "longbad"), make(3))
    assert outcome["error"] == "this part is bad"
    assert _tries(tmp_path, "longbad", "merge") == []
    assert shares[-1] == 1.0 and all(0.0 <= share <= 1.0 for share in shares)


def test_a_worker_is_renewed_after_some_scenes(
    make: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_workers, "RENEW_AFTER", 3)
    names = [f"s{k}" for k in range(7)]
    outcomes = batch.run(_units(tmp_path, *names), make(1))
    assert len(outcomes) == 7
    pids = [_tries(tmp_path, name)[0].split(".")[2] for name in names]
    assert [pids.count(pid) for pid in dict.fromkeys(pids)] == [3, 3, 1]


def test_closing_ends_every_process(
    make: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workers = make(2)
    outcomes: list[Outcome] = []

    def work() -> None:
        with suppress(RuntimeError):  # nothing can begin any more
            outcomes.extend(batch.run(_units(tmp_path, "hang1", "hang2", "never"), workers))

    thread = threading.Thread(target=work)
    thread.start()
    until = time.monotonic() + 30
    while len(_tries(tmp_path, "hang*")) < 2 and time.monotonic() < until:
        time.sleep(0.02)
    pids = workers.pids
    assert len(pids) == 2
    monkeypatch.setattr(worker, "END_LIMIT_S", 0.2)  # the stand-in does not listen
    workers.close()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    thread.join(30)
    assert not thread.is_alive() and _tries(tmp_path, "never") == []


STUCK = """
import threading
from hfx_tools.command_process.signal_watch import leave
from hfx_tools.export_workers.local_workers import LocalWorkers
workers = LocalWorkers(2)
held = threading.Lock()
held.acquire()
workers._pool.submit(held.acquire)  # as where Ctrl-C struck while the pool was waited for
workers.close()
leave(3)
"""


def test_a_thread_waiting_forever_does_not_block_the_exit() -> None:
    done = subprocess.run([sys.executable, "-c", STUCK], env=start.environment(), timeout=60)
    assert done.returncode == 3


@pytest.mark.parametrize("limit_s", (None, 0.5))
def test_a_worker_hanging_at_the_start_is_replaced(
    make: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit_s: float | None
) -> None:
    program, mark = tmp_path / "stand_in.py", tmp_path / "started"
    begin = f"""
import os, time
if not os.path.exists({str(mark)!r}):
    open({str(mark)!r}, "w").close()
    time.sleep(1000)
"""
    program.write_text(begin + STAND_IN)
    monkeypatch.setattr(
        local_workers, "START_LIMIT_S" if limit_s is None else "LIMITED_START_S", 2.0
    )
    (outcome,) = batch.run(_units(tmp_path, "a"), make(1, limit_s))
    assert outcome.get("error", "fine") == "fine"
