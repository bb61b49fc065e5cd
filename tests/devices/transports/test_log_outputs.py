# SPDX-License-Identifier: GPL-3.0-or-later
"""Log outputs: foreign files are never overwritten, and logging never blocks."""

from __future__ import annotations

import errno
import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.opening import open_output
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import log_outputs

BAND = load_device("forearm_band_left")
VALUES = np.tile([1.0, 100.0], 8)


def opened(kind: str, path: Path):
    """Return an open output; opening must not block."""
    actual: list[object] = []

    def work() -> None:
        try:
            actual.append(open_output(BAND, {"kind": kind, "path": str(path)}))
        except OutputLostError as error:
            actual.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(10.0)
    assert actual, "it hangs"
    if isinstance(actual[0], OutputLostError):
        raise actual[0]
    return actual[0]


def test_a_renamed_log_is_unchanged(tmp_path):
    log = b'{"time_s": 1.0, "stop": true}\n'
    (tmp_path / "thesis.txt").write_bytes(log)
    os.link(tmp_path / "thesis.txt", tmp_path / "log.jsonl")
    with pytest.raises(OutputLostError, match="another name"):
        opened("simulator", tmp_path / "log.jsonl")
    assert (tmp_path / "thesis.txt").read_bytes() == log


@pytest.mark.parametrize("kind", ["simulator", "csv"])
@pytest.mark.parametrize(
    "content",
    [
        b"mine",
        b"{}\n",
        b"[1]\n",
        b'{"time_s": 1, "values": [1], "mine": 2}\n',
        b'{"time_s": 1.0, "values": [1.0]}',  # a line without an end may be a foreign file
        b'{"time_s": 1.0, "stop": true}\nand notes of my own\n',
        b'{"time_s": 1.0, "stop": true}\n{"mine": 1}\n',
        b'{"time_s": 1.0, "stop": true}\nnotes without an end',
        b"\x00" * 10,
        b"[" * 100_000,
        b"a,b\n1,2\n",
    ],
)
def test_a_foreign_file_is_unchanged(tmp_path, kind, content):
    path = tmp_path / "thesis.txt"
    path.write_bytes(content)
    with pytest.raises(OutputLostError, match=r"thesis\.txt"):
        opened(kind, path)
    assert path.read_bytes() == content


@pytest.mark.parametrize("first", ["send", "stop"])
def test_a_simulator_overwrites_its_own_log(tmp_path, first):
    path = tmp_path / "log.jsonl"
    output = opened("simulator", path)
    if first == "send":
        output.send(VALUES)
    output.stop()
    output.close()
    again = opened("simulator", path)
    assert path.read_bytes() == b""
    again.stop()
    assert path.read_text().count("\n") == 1
    again.close()


def test_an_empty_file_may_be_used(tmp_path):
    path = tmp_path / "log.jsonl"
    path.touch()
    opened("simulator", path).close()


@pytest.mark.skipif(os.name != "posix", reason="POSIX kinds of files")
@pytest.mark.parametrize("kind", ["simulator", "csv"])
@pytest.mark.parametrize(
    "what", ["fifo", "fifo that is read", "link", "lost link", "node", "folder", "socket"]
)
def test_only_regular_files_are_opened(tmp_path, kind, what):
    path, target = tmp_path / "log", tmp_path / "target"
    reader = -1
    if what.startswith("fifo"):
        os.mkfifo(path)
        if what != "fifo":
            reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    elif what == "link":
        target.touch()
        path.symlink_to(target)
    elif what == "lost link":
        path.symlink_to(target)
    elif what == "node":
        path = Path("/dev/null")
    elif what == "folder":
        path.mkdir()
    else:
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(os.path.relpath(path))
        listener.close()
    before = set(tmp_path.iterdir())
    with pytest.raises(OutputLostError, match=path.name):
        opened(kind, path)
    assert set(tmp_path.iterdir()) == before
    if reader >= 0:
        os.close(reader)


def test_a_full_log_restarts_as_a_valid_log(tmp_path, monkeypatch):
    monkeypatch.setattr(log_outputs, "SIMULATOR_BYTES", 1000)
    path = tmp_path / "log.jsonl"
    output = opened("simulator", path)
    for _ in range(50):
        output.send(VALUES)
    output.close()
    assert 0 < path.stat().st_size <= 1000
    opened("simulator", path).close()


@pytest.mark.skipif(os.name != "posix", reason="POSIX limits of files' sizes")
@pytest.mark.parametrize("kind", ["simulator", "csv"])
@pytest.mark.parametrize("most", [0, 600])
@pytest.mark.parametrize("is_there", [False, True])
def test_nothing_is_left_of_a_new_log_that_cannot_be_written(tmp_path, kind, most, is_there):
    if is_there and kind == "csv":
        pytest.skip("a CSV log begins a new file")
    path = tmp_path / "log"
    if is_there:
        path.touch()
    with largest_file(most):
        with pytest.raises(OutputLostError) as raised:
            output = opened(kind, path)
            try:
                output.stop()
                for _ in range(20):
                    output.send(VALUES)
            finally:
                output.close()
    assert str(raised.value) == f"{path} cannot be written ({os.strerror(errno.EFBIG)})."
    assert path.exists() == is_there


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Limit the file size of this process, in bytes, within the context."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
