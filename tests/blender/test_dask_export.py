# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports by a Dask cluster of separate processes, of which one is killed on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest
from hfx_scenes import contents_of, environment, names_in
from strange_modules import fill

from hfx_blender import cli
from hfx_blender.batch import batch
from hfx_blender.batch.local_workers import ThisProcess
from hfx_blender.batch.options import ExportOptions
from hfx_blender.batch.units import Unit

distributed = pytest.importorskip("distributed")
dask_workers = pytest.importorskip("hfx_blender.batch.dask_workers")


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    program = Path(__file__).with_name("dask_cluster.py")
    cluster = subprocess.Popen(
        [sys.executable, str(program)],
        env={**environment(), "PYTHONPATH": str(hfx_scenes.ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert cluster.stdin is not None and cluster.stdout is not None
    yield cluster.stdout.readline().strip()
    cluster.stdin.close()
    try:
        cluster.wait(20)
    except subprocess.TimeoutExpired:
        cluster.kill()


def test_a_cluster_whose_workers_are_killed_gives_the_same_bytes(
    registered: Any, address: str, tmp_path: Path
) -> None:
    hfx_scenes.small_scene(49)
    registered.data.objects["Ball"].hfx.radius = 0.1
    blend = hfx_scenes.save(tmp_path / "small.blend")
    (tmp_path / "one").mkdir()
    (tmp_path / "many").mkdir()
    (tmp_path / "stage").mkdir()
    stage = str(tmp_path / "stage")
    one = Unit("scene", str(blend), str(tmp_path / "one"), "small", stage, ExportOptions())
    many = Unit(
        *("scene", str(blend), str(tmp_path / "many"), "small", stage, ExportOptions()),
        part_frames=20,
    )
    [outcome] = batch.run([one], ThisProcess())
    assert "error" not in outcome, outcome
    workers = dask_workers.DaskWorkers(address)
    client = distributed.Client(address, set_as_default=False)
    fill(tmp_path / "strange")
    client.run(os.chdir, str(tmp_path / "strange"))  # before any of them has a Blender
    killed: list[int] = []

    def kill() -> None:
        """The worker that has begun, while its Blender starts or works."""
        while not killed:
            busy = [who for who, tasks in client.processing().items() if tasks]
            if busy:
                killed.append(client.run(os.getpid)[busy[0]])
                os.kill(killed[0], signal.SIGKILL)

    thread = threading.Thread(target=kill)
    try:
        assert workers.slots == 2
        thread.start()
        [outcome] = batch.run([many], workers)
        thread.join(30)
        assert killed and killed[0] not in client.run(os.getpid).values()
    finally:
        workers.close()
        client.close()
    assert "error" not in outcome, outcome
    assert contents_of(tmp_path / "many") == contents_of(tmp_path / "one")


def test_the_command_line_names_the_scheduler(
    registered: Any, address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hfx_scenes.small_scene(0)
    blend = hfx_scenes.save(tmp_path / "small.blend")
    bad = tmp_path / "bad.blend"
    bad.write_bytes(b"no scene")
    out = tmp_path / "out"
    arguments = ["export", str(blend), str(bad), "-o", str(out), "--scheduler", address]
    assert cli.run(arguments) == 5
    assert names_in(out) == ["small.hfxtrack", "small.report.json"]
    assert "bad.blend: Blender cannot open it" in capsys.readouterr().err


def test_a_scheduler_that_is_not_there_is_one_line(
    registered: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dask_workers, "_CONNECT_LIMIT_S", 0.5)
    arguments = ["export", "x.blend", "-o", str(tmp_path / "out")]
    assert cli.run([*arguments, "--scheduler", "tcp://127.0.0.1:9"]) == 3
    err = capsys.readouterr().err
    assert "tcp://127.0.0.1:9" in err and "Traceback" not in err
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert cli.run([*arguments, "--scheduler", "tcp://127.0.0.1:9"]) == 3
    assert "hfx-blender[dask]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_orphaned_blenders_of_a_killed_worker_end(address: str) -> None:
    until = time.monotonic() + 20
    while time.monotonic() < until:
        listed = subprocess.run(["ps", "-eo", "ppid,args"], capture_output=True, text=True).stdout
        orphans = [
            line
            for line in listed.splitlines()
            if line.split()[:1] == ["1"] and "hfx_blender.batch.worker" in line
        ]
        if not orphans:
            return
        time.sleep(0.2)
    raise AssertionError(orphans)
