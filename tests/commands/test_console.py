# SPDX-License-Identifier: GPL-3.0-or-later
"""Output streams of the command line."""

from __future__ import annotations

import errno
import io
import json
import os
from pathlib import Path

import pytest

from hfx_blender import cli
from hfx_blender.commands import console as console_module
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError


class Terminal(io.StringIO):
    """Terminal stream; :meth:`screen` returns the visible lines."""

    def isatty(self) -> bool:
        return True

    def screen(self, width: int) -> list[str]:
        lines = [""]
        column = 0
        for character in self.getvalue():
            if character == "\n":
                lines.append("")
                column = 0
            elif character == "\r":
                column = 0
            else:
                assert column < width, "a line wraps"
                lines[-1] = lines[-1][:column].ljust(column) + character + lines[-1][column + 1 :]
                column += 1
        return [line.rstrip() for line in lines]


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(console_module, "time", clock)
    return clock


@pytest.fixture(autouse=True)
def _width(monkeypatch: pytest.MonkeyPatch) -> None:
    size = os.terminal_size((50, 24))
    monkeypatch.setattr(console_module.shutil, "get_terminal_size", lambda *_, **__: size)


def test_results_go_out_and_messages_go_to_errors() -> None:
    out, err = io.StringIO(), io.StringIO()
    console = Console(out=out, err=err)
    console.say("felt")
    console.warn("hot")
    console.result({"machine": 1})
    assert (out.getvalue(), err.getvalue()) == ("felt\n", "hot\n")


def test_json_is_all_there_is() -> None:
    out, err = io.StringIO(), Terminal()
    console = Console(as_json=True, out=out, err=err)
    console.say("felt")
    console.progress("Exporting")(1.0)
    console.result({"b": [1, None], "a": "ä"})
    assert json.loads(out.getvalue()) == {"a": "ä", "b": [1, None]}
    assert err.getvalue() == ""


def test_progress_is_quiet_without_a_terminal(clock: Clock) -> None:
    out, err = io.StringIO(), io.StringIO()
    progress = Console(out=out, err=err).progress("Exporting")
    for k in range(11):
        clock.now += 1.0
        progress(k / 10)
    assert out.getvalue() == err.getvalue() == ""


def test_progress_shows_the_time_left(clock: Clock) -> None:
    err = Terminal()
    progress = Console(out=io.StringIO(), err=err).progress("Track")
    clock.now += 30.0
    progress(0.25)  # 30 s for a quarter: 90 s for the rest
    assert err.screen(50) == ["Track [######..................]  25%  1 min 30 s"[:49].rstrip()]
    clock.now += 30.0
    progress(0.5)
    assert "50%" in err.screen(50)[0] and "1 min 00 s" in err.screen(50)[0]


def test_a_wide_terminal_shows_the_whole_line(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = os.terminal_size((100, 24))
    monkeypatch.setattr(console_module.shutil, "get_terminal_size", lambda *_, **__: size)
    err = Terminal()
    progress = Console(out=io.StringIO(), err=err).progress("Track")
    clock.now += 10.0
    progress(0.5)
    assert err.screen(100) == ["Track [############............]  50%  10 s left"]


def test_progress_is_not_shown_too_often(clock: Clock) -> None:
    err = Terminal()
    progress = Console(out=io.StringIO(), err=err).progress("Track")
    for k in range(1000):
        clock.now += 0.001
        progress(k / 1000)
    progress(1.0)
    assert err.getvalue().count("\r") <= 11
    assert "100%" in err.screen(50)[0]


def test_the_progress_line_makes_room_for_messages(clock: Clock) -> None:
    err = Terminal()
    console = Console(out=io.StringIO(), err=err)
    progress = console.progress("A scene with a name that is much longer than the terminal is wide")
    clock.now += 1.0
    progress(0.5)
    console.warn("hot")
    assert err.screen(50) == ["hot", ""]


STEERING = "a\x1b[31m\x07\x9b\u202egpj\u2028\x00\udcff"
ESCAPED = "a\\x1b[31m\\x07\\x9b\\u202egpj\\u2028\\x00\\udcff"


def test_names_cannot_steer_a_terminal() -> None:
    out, err = io.StringIO(), Terminal()
    console = Console(out=out, err=err)
    console.say(f"{STEERING}\nb")
    console.warn(f"{STEERING}\r\nb")
    console.say(f"{STEERING}\nb", several_lines=True)
    assert out.getvalue() == f"{ESCAPED}\\nb\n{ESCAPED}\nb\n"
    assert err.getvalue() == f"{ESCAPED}\\r\\nb\n"
    console.show(STEERING)
    assert "\x1b" not in err.getvalue()


def test_faults_are_one_safe_line_wherever_they_are_shown() -> None:
    error = InputError(f"Scene '{STEERING}\n' is bad.")
    assert str(error) == f"Scene '{ESCAPED}\\n' is bad."
    assert str(InputError(str(error))) == str(error)
    assert str(InputError("Größe 5 µm, 日本, \u200d")) == "Größe 5 µm, 日本, \u200d"


class Lost(io.StringIO):
    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def write(self, text: str) -> int:
        raise OSError(self.number, os.strerror(self.number))


def test_a_closed_output_does_not_stop_the_work() -> None:
    console = Console(out=Lost(errno.EPIPE), err=Lost(errno.EPIPE))
    console.say("felt")
    console.warn("hot")
    Console(as_json=True, out=Lost(errno.EPIPE)).result({})
    assert console.fault is None


def test_results_that_are_lost_are_known() -> None:
    console = Console(out=Lost(errno.ENOSPC), err=Lost(errno.ENOSPC))
    console.warn("hot")
    assert console.fault is None
    console.say("felt")
    assert console.fault is not None and console.fault.errno == errno.ENOSPC


@pytest.mark.skipif(os.name == "nt", reason="a folder in use cannot be removed")
def test_a_missing_current_folder_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert cli.run(["export", "x.blend", "-o", "out"]) == 3
    assert capsys.readouterr().err.startswith("hfx: the current folder cannot be used (")


def test_all_colliding_names_are_reported(capsys):
    names = ["x/a.blend", "y/a.blend", "x/B.blend", "y/b.blend", "z/c.blend"]
    assert cli.run(["export", *names]) == 2
    message = capsys.readouterr().err
    assert "several scenes are named 'a'" in message and "scenes 'B' and 'b' have" in message
    assert "'c'" not in message


def test_scenes_with_equal_failures_end_with_the_common_code(tmp_path, capsys):
    names = [str(tmp_path / name) for name in ("a.blend", "b.blend")]
    assert cli.run(["export", *names, "-o", str(tmp_path / "out")]) == 3
