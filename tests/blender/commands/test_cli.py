# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, for a shell script and a person on a terminal; often as a process."""

from __future__ import annotations

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest
from hfx_scenes import (
    command,
    contents_of,
    environment,
    names_in,
    process,
    process_without_litter,
)

from hfx_blender import __version__, cli
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import UsageError
from hfx_blender.formats.registry import EXPORTED

PRINTABLE = re.compile(r"[^\x00-\x09\x0b-\x1f\x7f\x1b]*")
CSV_DEVICE = "forearm_band_left"
BRIEF = ("--frames", "0:2", "--device", "none")


@pytest.fixture(scope="module")
def blend(registered: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    hfx_scenes.small_scene()
    return hfx_scenes.save(tmp_path_factory.mktemp("scene") / "small.blend")


@pytest.fixture(scope="module")
def done(
    blend: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Folder with the results of a plain export."""
    folder = tmp_path_factory.mktemp("plain")
    litter = tmp_path_factory.mktemp("litter") / "temporary"
    actual = process_without_litter(litter, "export", blend, "-o", folder)
    assert actual.returncode == 0, actual.stderr
    return actual, folder


@pytest.fixture
def exported(done: tuple[subprocess.CompletedProcess[str], Path]) -> Path:
    """The folder of a plain export."""
    return done[1]


Here = Callable[..., tuple[int, str, str]]


@pytest.fixture
def here(
    registered: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Here:
    """Run ``hfx`` in this process (quicker) in ``tmp_path``; return exit code, output, errors."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = cli.run(list(map(str, arguments)))
        return code, *capsys.readouterr()

    return run


def test_what_a_named_format_cannot_hold_of_a_named_device_is_no_success(
    blend: Path, tmp_path: Path, here: Here
) -> None:
    """A sleeve of temperature actuators has no AHAP; the second device is written."""
    requests = ("--frames", "1:2", "-f", "track,ahap", "--device", "phone_lra")
    code, _, err = here("export", blend, "-o", "alone", *requests)
    assert code == 0, err
    code, out, err = here(
        "export", blend, "-o", "both", *requests, "--device", "peltier_sleeve_left"
    )
    assert code == 5
    assert "device 'peltier_sleeve_left' has no vibration actuators: no Apple AHAP for it" in (
        out + err
    )
    report = json.loads((tmp_path / "both" / "small.report.json").read_text("utf-8"))
    assert len(report["left_out"]) == 1 and set(report["left_out"]) <= set(report["warnings"])
    assert set(names_in(tmp_path / "alone")) <= set(names_in(tmp_path / "both"))


# Usage


def test_help_and_version_need_no_scene() -> None:
    assert process("--version").stdout == f"hfx {__version__}\n"
    done = process("--help")
    assert done.returncode == 0 and done.stderr == ""
    for word in ("demo", "export", "info", "body", "device", "exit codes"):
        assert word in done.stdout


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["dance"], "dance"),
        ([], "COMMAND"),
        (["export"], "SCENE.blend"),
        (["export", "x.blend", "--loud"], "--loud"),
        (["export", "x.blend", "--full"], "--full"),  # no abbreviations
        (["export", "x.blend", "--frames", "3"], "'3'"),
        (["export", "x.blend", "--rate", "nan"], "'nan'"),
        (["export", "x.blend", "--rate", "0"], "'0'"),
        (["export", "x.blend", "--tolerance", "3mm"], "'3mm'"),
        (["export", "x.blend", "--jobs", "0"], "--jobs 0"),
        (["export", "x.blend", "--record", "smell"], "smell"),
        (["export", "x.blend", "-f", "track,mp3"], "mp3"),
        (["export", "a/x.blend", "b/x.blend"], "'x'"),
        (["convert", "a.npz", "b.csv", "--device", "insoles", "--device", "back_pad"], "one"),
        (["play", "x.hfxtrack", "--device", "insoles", "--to", "log"], "--path"),
    ],
)
def test_wrong_usage_is_exit_2_and_says_what(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(arguments) == UsageError.exit_code == 2
    out, err = capsys.readouterr()
    assert out == "" and word in err.splitlines()[-1] and "Traceback" not in err


def test_output_that_nobody_reads_is_no_defect(blend: Path, tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    try:
        for arguments in (["--help"], ["device", "list"], ["export", blend, "-o", tmp_path]):
            done = process(*arguments, stdout=write)
            assert (done.returncode, done.stderr) == (0, "")
    finally:
        os.close(write)
    assert "small.hfxtrack" in names_in(tmp_path)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_help_that_cannot_be_written_is_no_success() -> None:
    with open("/dev/full", "w") as full:
        done = process("--help", stdout=full)
    why = os.strerror(errno.ENOSPC)
    assert done.returncode == 3
    assert done.stderr == f"hfx: standard output: cannot be written ({why}).\n"


@pytest.mark.skipif(os.name != "posix", reason="POSIX limits of files' sizes")
@pytest.mark.parametrize(
    ("more", "name"),
    [
        (("--piece", "1/1"), "small.pieces/1-of-1.hfxtrack"),
        (("--piece", "1/1", "--record", "positions"), "small.pieces/1-of-1.hfxtrack"),
        ((), "small.hfxtrack"),
    ],
)
def test_an_export_to_a_full_disk_leaves_no_folder(
    blend: Path,
    tmp_path: Path,
    more: tuple[str, ...],
    name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import resource

    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # the limit would cut cached modules short
    folder = tmp_path / "new" / "deep"
    done = process(
        *("export", blend, "-o", folder, *more),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100)),
    )
    why = os.strerror(errno.EFBIG)
    assert done.stderr == f"hfx: small.blend: {folder / name}: cannot be written ({why}).\n"
    assert done.returncode == 3 and names_in(tmp_path) == []


@pytest.mark.parametrize(
    "report",
    ["out/small.report.json", "out/SMALL.hfxTrack", "out/x/../small.insoles.csv",
     "out/small/A/insoles/small.A.insoles.csv", "out/small.pieces/1-of-1.json"],
)  # fmt: skip
def test_a_report_with_the_name_of_a_result_is_refused_at_once(
    blend: Path, tmp_path: Path, here: Here, report: str
) -> None:
    code, _, err = here("export", blend, "-o", "out", "--report", report, *BRIEF)
    assert code == 2 and "is a result of this export" in err
    assert names_in(tmp_path) == []


def test_a_report_beside_the_results_may_have_the_name_of_the_scene(
    blend: Path, tmp_path: Path, here: Here
) -> None:
    assert here("export", blend, "-o", ".", "--report", "small.summary.json", *BRIEF)[0] == 0
    assert "small.summary.json" in names_in(tmp_path)


# Output


def test_export_says_what_was_felt_and_written(
    done: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    (actual, folder) = done
    assert actual.stderr == ""
    assert "Touch (pressure) felt by Avatar from 0.00 to 0.39 s, for 0.40 s, on" in actual.stdout
    assert "Ball (vibration) felt by Avatar" in actual.stdout
    assert str(folder / "small.hfxtrack") in actual.stdout
    assert names_in(folder) == ["small.hfxtrack", "small.report.json"]
    assert all(PRINTABLE.fullmatch(line) for line in actual.stdout.splitlines())


def test_json_is_one_value_and_nothing_else(blend: Path, tmp_path: Path, here: Here) -> None:
    code, out, err = here("export", blend, "-o", tmp_path, "--json")
    assert code == 0 and err == ""
    document = json.loads(out)
    assert document["input"] == "small.blend" and document["scene"] == "Scene"
    assert {item["effect"]: item["seconds"] for item in document["felt"]} == {
        "Ball": 0.4,
        "Touch": 0.4,
    }
    report = json.loads((tmp_path / "small.report.json").read_text())
    assert report["felt"] == document["felt"]


def test_json_of_a_failure_is_one_value_too(here: Here) -> None:
    code, out, err = here("export", "none.blend", "--json")
    assert code == 3
    assert "none.blend" in json.loads(out)["error"]
    assert len(err.splitlines()) == 1


def test_progress_with_the_time_left_on_a_terminal_only(blend: Path, tmp_path: Path) -> None:
    import pty
    import termios

    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, (24, 60))
    with subprocess.Popen(
        command("export", blend, "-o", tmp_path, "--frames", "0:399"),
        env={**environment(), "COLUMNS": "60"},
        stdout=subprocess.PIPE,
        stderr=slave,
    ) as running:
        os.close(slave)
        shown = _everything(master)
        out = running.communicate()[0].decode()
    assert running.returncode == 0
    lines = shown.split("\r")
    assert re.search(r"small\.blend \[#+\.*\] +\d+%  \d+ s left", shown), shown
    assert any("100%" in line for line in lines)
    assert max(map(len, lines)) < 60  # a wrapped line is never overwritten
    assert lines[-1] == "" and lines[-2].strip() == ""  # taken away at the end
    assert "\r" not in out and "left" not in out


def _everything(descriptor: int) -> str:
    parts = []
    while True:
        try:
            part = os.read(descriptor, 4096)
        except OSError:  # Linux: the reading end was closed
            part = b""
        if not part:
            return b"".join(parts).decode()
        parts.append(part)


# Results


def test_frames_and_rate_choose_the_samples(blend: Path, tmp_path: Path, here: Here) -> None:
    # 25 fps: frames -2 to 7 are 10 frames or 0.4 s, beginning 0.08 s before the scene.
    code, _, err = here("export", blend, "-o", tmp_path, "--frames", "-2:7", "--rate", "250/3")
    assert code == 0, err
    with TrackReader(tmp_path / "small.hfxtrack") as track:
        time_base = track.header.time
        assert (time_base.frame_first, time_base.frame_last) == (-2, 7)
        assert time_base.sample_count == 34  # 0.4 * 250 / 3 = 33.3, the last frame is covered
        assert [item.sample_count for item in track.summary()] == [34, 34]
        assert track.summary()[0].first_s == pytest.approx(-0.08)


def test_full_precision_and_recorded_channels(blend: Path, tmp_path: Path, here: Here) -> None:
    code, _, err = here(
        *("export", blend, "-o", tmp_path, "--full-precision", "--record", "positions,depth"),
        *("--tolerance", "paper"),
    )
    assert code == 0, err
    with TrackReader(tmp_path / "small.hfxtrack") as track:
        assert track.full_precision
        # The avatar stands in rest pose at the origin; the ball is at (0, 0, 1), radius 0.3 m.
        [ball] = [s for s in track.samples_at(0.0) if s.stream.modality == "vibration"]
        rest = load_model("hfx-vibration-1").vertices[ball.vertices]
        assert ball.positions == pytest.approx(rest, abs=1e-5)
        distance = ((rest - (0.0, 0.0, 1.0)) ** 2).sum(axis=1) ** 0.5
        assert ball.depth_m == pytest.approx(0.3 - distance, abs=1e-5)
        assert ball.velocities is None


def test_devices_are_rendered_and_what_none_plays_is_told(
    blend: Path, tmp_path: Path, here: Here
) -> None:
    code, out, err = here("export", blend, "-o", tmp_path, "--device", CSV_DEVICE, "-f", "csv,wav")
    assert code == 0, err
    assert names_in(tmp_path) == [
        f"small.{CSV_DEVICE}.csv",
        f"small.{CSV_DEVICE}.wav",
        f"small.{CSV_DEVICE}.wav.channels.json",
        "small.report.json",
    ]
    # A band on the forearm plays no contact of the palms.
    assert "Touch: 0.40 s of it (100%) felt by Avatar but played by no device" in out


def test_a_device_may_be_a_file_or_none_at_all(
    blend: Path, exported: Path, tmp_path: Path, here: Here
) -> None:
    source = hfx_scenes.ROOT / "device_configs" / "back_pad.json"
    mine = tmp_path / "mine.json"
    mine.write_text(source.read_text().replace('"back_pad"', '"my_pad"'))
    assert here("export", blend, "-o", tmp_path / "a", "--device", mine)[0] == 0
    assert "small.my_pad.csv" in names_in(tmp_path / "a")
    assert here("export", blend, "-o", tmp_path / "b", "--device", "none")[0] == 0
    track = (tmp_path / "b" / "small.hfxtrack").read_bytes()
    assert track == (exported / "small.hfxtrack").read_bytes()  # the report states the options
    assert len(names_in(tmp_path / "b")) == 2


def test_a_scene_is_chosen_by_name(blend: Path, tmp_path: Path, here: Here) -> None:
    code, _, err = here("export", blend, "-o", tmp_path / "out", "--scene", "Attic")
    assert code == 3 and "'Attic'" in err and "'Scene'" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("jobs", [1, 2])
def test_one_bad_scene_costs_the_others_nothing(
    blend: Path, exported: Path, tmp_path: Path, jobs: int, here: Here
) -> None:
    bad = tmp_path / "bad.blend"
    bad.write_bytes(b"no scene")
    again = tmp_path / "-again.blend"  # a name like an option
    again.write_bytes(blend.read_bytes())
    arguments = ("export", "-o", "out", "--jobs", jobs, "--frames", "-2:9", "--json", "--")
    arguments += (bad.name, blend, again.name)
    if jobs == 1:
        code, out, err = here(*arguments)
    else:
        done = process_without_litter(tmp_path / "litter", *arguments, cwd=tmp_path)
        code, out, err = done.returncode, done.stdout, done.stderr
    assert code == 5, err
    failed, *good = json.loads(out)
    assert failed["exit_code"] == 3 and "bad.blend" in failed["error"]
    assert [item["input"] for item in good] == ["small.blend", "-again.blend"]
    assert len(err.splitlines()) == 1 and "bad.blend" in err
    assert names_in(tmp_path / "out") == [
        "-again.hfxtrack",
        "-again.report.json",
        "small.hfxtrack",
        "small.report.json",
    ]
    assert here("export", blend, "-o", "one", "--frames=-2:9")[0] == 0
    for name, content in contents_of(tmp_path / "one").items():
        assert (tmp_path / "out" / name).read_bytes() == content
    assert (exported / "small.hfxtrack").read_bytes() != content


@pytest.mark.parametrize("names", [("A", "a"), ("caf\u00e9", "cafe\u0301"), ("STRASSE", "straße")])
def test_scenes_whose_results_may_be_the_same_files_are_refused(
    blend: Path, tmp_path: Path, here: Here, names: tuple[str, str]
) -> None:
    """Windows and macOS treat these two names as equal, so every system refuses."""
    for k, name in enumerate(names):
        (tmp_path / str(k)).mkdir()
        (tmp_path / str(k) / f"{name}.blend").write_bytes(blend.read_bytes())
    files = [f"{k}/{name}.blend" for k, name in enumerate(names)]
    code, _, err = here("export", *files, "-o", "out", *BRIEF)
    assert code == 2 and all(f"'{name}'" in err for name in names) and "collide" in err
    assert not (tmp_path / "out").exists()


# Ending an export


def _ends_at_hang_up() -> None:
    """Restore default signal handlers, in case the tests run under ``nohup``."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture
def long_export(blend: Path, tmp_path: Path) -> Any:
    """A running export of several minutes with written output; ended with the test."""
    scenes = [blend]
    arguments = ["export", "-o", "out", "--frames", "0:100000"]
    running: list[subprocess.Popen[str]] = []

    def start(jobs: int = 1) -> subprocess.Popen[str]:
        for k in range(1, jobs + 2 if jobs > 1 else 1):
            scenes.append(tmp_path / f"copy{k}.blend")
            scenes[-1].write_bytes(blend.read_bytes())
        started = subprocess.Popen(
            command(*arguments, "--jobs", jobs, *scenes),
            cwd=tmp_path,
            env=environment(),
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=_ends_at_hang_up if hasattr(signal, "SIGHUP") else None,
        )
        running.append(started)
        until = time.monotonic() + 60
        while len(list((tmp_path / "out").glob(".*/**/*.hfxtrack.tmp"))) < jobs:
            assert started.poll() is None and time.monotonic() < until
            time.sleep(0.05)
        return started

    yield start
    for item in running:
        item.kill()
        item.communicate()


def test_ctrl_c_leaves_nothing_and_says_so(long_export: Any, tmp_path: Path) -> None:
    started = long_export()
    started.send_signal(signal.SIGINT)
    out, err = started.communicate(timeout=60)
    assert started.returncode == 130
    assert out == "" and err.splitlines() == [
        "hfx: interrupted; nothing half written was left behind"
    ]
    assert not (tmp_path / "out").exists()


INTERRUPTED_START = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "addon_utils":  # imported by Blender while it starts
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from hfx_blender.__main__ import main
main()
"""


def test_ctrl_c_while_blender_starts_is_not_lost(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_START, "demo", "--no-pictures", "-o", tmp_path / "out"],
        env=environment(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 130 and done.stdout == ""
    assert done.stderr.splitlines() == ["hfx: interrupted; nothing half written was left behind"]
    assert not (tmp_path / "out").exists()


def test_ctrl_c_while_numpy_is_loaded_is_no_defect(tmp_path: Path) -> None:
    start = INTERRUPTED_START.replace("addon_utils", "numpy")
    done = subprocess.run(
        [sys.executable, "-c", start, "demo", "-o", tmp_path / "out"],
        env=environment(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 130
    assert done.stderr.splitlines() == ["hfx: interrupted; nothing half written was left behind"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
@pytest.mark.parametrize(("end", "jobs"), [("SIGTERM", 2), ("SIGHUP", 1)])
def test_who_is_asked_to_end_leaves_nothing(
    long_export: Any, tmp_path: Path, end: str, jobs: int
) -> None:
    started = long_export(jobs)
    children = Path(f"/proc/{started.pid}/task/{started.pid}/children")
    pids = children.read_text().split() if children.exists() else []
    started.send_signal(getattr(signal, end))
    out, err = started.communicate(timeout=60)
    assert started.returncode == 128 + getattr(signal, end)
    assert out == "" and err.splitlines() == [
        f"hfx: ended by {end}; nothing half written was left behind"
    ]
    assert not (tmp_path / "out").exists()
    assert not any(Path("/proc", pid).exists() for pid in pids)


def test_what_a_killed_export_left_is_removed_by_the_next(
    long_export: Any, blend: Path, tmp_path: Path, here: Here
) -> None:
    started = long_export()
    started.kill()
    started.communicate(timeout=60)
    left = names_in(tmp_path / "out")
    assert left and all(name.startswith(".") for name in left)
    assert here("export", blend, "-o", "out", *BRIEF)[0] == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "small.hfxtrack",
        "small.report.json",
    ]


# Environment


@pytest.mark.skipif(os.name == "nt", reason="a POSIX shell")
@pytest.mark.parametrize(
    ("redirection", "code"),
    [(">&- 2>&- <&-", 0), (">/dev/full", 3)],
)
def test_the_work_is_done_whoever_reads(
    blend: Path, tmp_path: Path, redirection: str, code: int
) -> None:
    if "/dev/full" in redirection and not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    line = shlex.join(map(str, command("export", blend, "-o", "out", *BRIEF)))
    script = f"( {line}; echo $? > code ) {redirection}"
    subprocess.run(["sh", "-c", script], cwd=tmp_path, env=environment(), timeout=120)
    assert (tmp_path / "code").read_text() == f"{code}\n"
    assert names_in(tmp_path / "out") == ["small.hfxtrack", "small.report.json"]


def test_names_are_shown_escaped(registered: Any, tmp_path: Path, here: Here) -> None:
    hfx_scenes.small_scene()
    name = "a\x1b[31m\x07\u202e\nb"
    scene = registered.context.scene
    scene.name = name
    for obj in registered.data.objects:
        obj.name = name
    strange = hfx_scenes.save(tmp_path / "strange.blend")
    track = tmp_path / "out" / "strange.hfxtrack"
    arguments = [
        ("export", strange, "-o", tmp_path / "out", *BRIEF),
        ("export", strange, "--scene", "no" + name),
        ("info", strange),
        ("info", track),
        ("info", track.with_name("strange.report.json")),
        ("validate", track),
        ("convert", track, tmp_path / "a.hjif"),
        ("info", tmp_path / f"{name}.hfxtrack"),
    ]
    actual = ""
    for argument in arguments:
        code, out, err = here(*argument)
        assert code in (0, 3), err
        text = out + err
        assert PRINTABLE.fullmatch(text) and "\u202e" not in text, text
        actual += text
    assert actual.count("a\\x1b[31m\\x07\\u202e\\nb") >= 6


@pytest.mark.parametrize(
    "arguments",
    [
        ("export", "LONG.blend"),
        ("export", "SCENE", "-o", "LONG", *BRIEF),
        ("export", "SCENE", "-o", "out", "--report", "LONG.json", *BRIEF),
        ("export", "ALMOST", "-o", "out", *BRIEF),
        ("export", "SCENE", "--device", "LONG.json"),
        ("info", "LONG.hfxtrack"),
        ("validate", "LONG.hjif"),
        ("convert", "LONG.hfxtrack", "a.hjif"),
        ("convert", "TRACK", "LONG.hjif"),
        ("device", "check", "LONG.json"),
        ("demo", "--no-pictures", "-o", "LONG"),
    ],
)
def test_a_name_that_is_too_long_is_bad_input(
    blend: Path, exported: Path, tmp_path: Path, arguments: tuple[str, ...], here: Here
) -> None:
    almost = tmp_path / ("y" * 240 + ".blend")
    almost.write_bytes(blend.read_bytes())
    known = {"SCENE": str(blend), "TRACK": str(exported / "small.hfxtrack"), "ALMOST": almost.name}
    given = [known.get(argument, argument.replace("LONG", "x" * 300)) for argument in arguments]
    code, _, err = here(*given)
    assert code == 3, err
    (line,) = err.splitlines()
    assert line.startswith("hfx: ") and ("x" * 300 in line or "y" * 240 in line)
    assert ".tmp/" not in line and str(tmp_path) not in line
    assert all(path.name in (almost.name, "out") for path in tmp_path.iterdir())


def test_paths_are_shown_as_they_were_given(blend: Path, tmp_path: Path, here: Here) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "small.blend").write_bytes(blend.read_bytes())
    (tmp_path / "in" / "bad.blend").write_bytes(b"no")
    good, bad, missing = "in/small.blend", "in/bad.blend", "in/missing.blend"
    _, out, _ = here("export", good, "-o", "made", *BRIEF)
    assert "wrote made/small.hfxtrack" in out.replace(os.sep, "/")
    (tmp_path / "file").touch()
    for arguments in (
        ("export", bad),
        ("export", missing),
        ("export", good, "-o", "file", *BRIEF),
        ("export", bad, missing, "--jobs", "2"),
        ("info", bad),
        ("convert", "made/small.hfxtrack", "file/a.hjif"),
    ):
        code, out, err = here(*arguments)
        assert code in (3, 5)
        assert str(tmp_path) not in out + err, err
        assert re.search(r"hfx: (in/|file)", err.replace(os.sep, "/")), err


# Further commands


def test_info_tells_about_each_kind_of_file(blend: Path, exported: Path, here: Here) -> None:
    scene = json.loads(here("info", blend, "--json")[1])["scenes"][0]
    assert scene["bodies"] == ["Avatar"]
    assert [effect["effect"] for effect in scene["effects"]] == ["Ball", "Touch"]
    text = here("info", exported / "small.hfxtrack")[1]
    assert "rate_hz: 100.0" in text and "hfx-pressure-1" in text and "seconds: 0.4" in text
    model = here("info", hfx_scenes.ROOT / "body_models" / "vibration.npz")[1]
    assert "hfx-vibration-1" in model and "CC0" in model
    device = here("info", hfx_scenes.ROOT / "device_configs" / "insoles.json")[1]
    assert "vibration" in device


@pytest.mark.parametrize("name", ["x.txt", "x.npz", "x.json", "x.hfxtrack", "x.blend"])
@pytest.mark.parametrize(
    "content",
    [None, b"", bytes(100), b"{}", "folder"],
    ids=["missing", "empty", "zeros", "braces", "folder"],
)
def test_info_on_foreign_files_is_one_line(
    registered: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    content: bytes | str | None,
) -> None:
    path = tmp_path / name
    if content == "folder":
        path.mkdir()
    elif isinstance(content, bytes):
        path.write_bytes(content)
    assert cli.run(["info", str(path)]) == 3
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1 and name in err


def test_device_list_names_what_export_takes(blend: Path, tmp_path: Path, here: Here) -> None:
    names = list(json.loads(here("device", "list", "--json")[1]))
    assert CSV_DEVICE in names and "fan_heater" in names
    arguments = [word for name in names for word in ("--device", name)]
    code, _, err = here("export", blend, "-o", tmp_path, *arguments)
    assert code == 0, err
    assert {f"small.{name}.csv" for name in names} <= set(names_in(tmp_path))


def test_device_check_tells_faults(tmp_path: Path, here: Here) -> None:
    good = hfx_scenes.ROOT / "device_configs" / "back_pad.json"
    assert here("device", "check", good)[0] == 0
    broken = tmp_path / "broken.json"
    broken.write_text(good.read_text().replace('"version": 1', '"version": 99'))
    code, out, err = here("device", "check", broken, "--json")
    assert code == 3 and "version" in err
    assert json.loads(out)["faults"] == err.splitlines()
    assert here("device", "check", tmp_path / "none.json")[0] == 3


def test_body_stats_is_a_table_of_all_parts(here: Here) -> None:
    code, out, err = here("body", "stats", "--json")
    assert code == 0 and err == ""
    text = here("body", "stats")[1]
    for part in ("head", "torso", "fingers", "foot_sole"):
        assert part in text and part in out
    json.loads(out)


def test_each_format_is_named_where_it_is_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.run(["export", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    named = re.split(r"[ ,;]+", text[text.index("-f F,...") :])
    assert set(EXPORTED) <= set(named)
