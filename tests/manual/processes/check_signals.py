# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals at random moments of many commands: each ends soon, with the right code, without traces.

``python tests/manual/processes/check_signals.py --signals 1000`` prints the number of failures;
a part of the trials is in the test run. Linux: left processes are detected by the environment of
the trial.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

from hfx_blender.devices.host.process_watch import says_ending  # noqa: E402

LIMIT_S = 5.0
NAMES = ("SIGTERM", "SIGHUP", "SIGINT")

MAKE = """
import sys
from pathlib import Path
import bpy, hfx_blender
hfx_blender.register()
folder = Path(sys.argv[1])
for name in ("curves", "stepped"):
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 0, 240
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_volume(modality="vibration", shape="SPHERE", name="Ball", radius=0.3,
                           location=(0, 0, 1))
    if name == "stepped":
        driver = bpy.data.objects["Ball"].driver_add("location", 0).driver
        driver.expression = "sin(frame / 20)"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"), compress=True)
(folder / "second.blend").write_bytes((folder / "curves.blend").read_bytes())
import os
os._exit(0)
"""


def _hfx(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "hfx_blender", *map(str, arguments)]


def _environment(temporary: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(temporary)}


def prepare(folder: Path, *, is_short: bool = False) -> dict[str, list[str]]:
    """Make scenes, tracks and (unless short) pieces in a folder; returns the commands by name.

    OUT in a command stands for the output folder of a trial, PIECES for a copy of the pieces.
    """
    temporary = folder / "temporary"
    temporary.mkdir(parents=True)
    environment = _environment(temporary)
    subprocess.run([sys.executable, "-c", MAKE, folder], env=environment, check=True,
                   capture_output=True)  # fmt: skip
    curves, stepped, second = (folder / f"{n}.blend" for n in ("curves", "stepped", "second"))
    created, pieces = folder / "made", folder / "pieces"
    brief = ("--frames", "0:24")
    for item in (
        _hfx("export", curves, "-o", created, "--device", "waist_belt", "-f", "track,csv", *brief),
        *(
            _hfx("export", curves, "-o", pieces, *brief, "--piece", f"{k}/2")
            for k in (1, 2)
            if not is_short
        ),
    ):
        subprocess.run(item, env=environment, check=True, capture_output=True)
    track = created / "curves.hfxtrack"
    belt = ("--device", "waist_belt")
    return {
        "export": _hfx("export", curves, "-o", "OUT", *belt, "--rate", 200),
        "stepped": _hfx("export", stepped, "-o", "OUT", "--device", "none"),
        "jobs": _hfx("export", curves, second, "-o", "OUT", "--jobs", 2, "--device", "none"),
        "parts": _hfx("export", curves, "-o", "OUT", "--jobs", 2, "--device", "none"),
        "merge": _hfx("export", curves, "-o", "PIECES", "--merge", *brief),
        "play": _hfx("play", track, *belt, "--to", "simulator", "--path", "OUT/log"),
        "convert": _hfx("convert", track, "OUT/out.hjif"),
        "rendered": _hfx("convert", track, "OUT/out.csv", *belt),
        "validate": _hfx("validate", track),
        "info": _hfx("info", curves),
        "demo": _hfx("demo", "--no-pictures", "-o", "OUT/demo"),
        "sound": _hfx("device", "list"),
        "bench": _hfx("bench", "volumes", "--short"),
        "pictures": _hfx("demo", "-o", "OUT/demo"),
        "throughput": _hfx("bench", "throughput", "--short"),
    }


@dataclass
class Trials:
    """Results of all trials."""

    count: Counter[str] = field(default_factory=Counter)
    codes: Counter[str] = field(default_factory=Counter)
    longest_s: float = 0.0
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """Write the result for people."""
        faults = "".join(f"\n  {fault}" for fault in self.faults)
        return (
            f"{sum(self.count.values())} signals {dict(self.count)}, ends {dict(self.codes)}, "
            f"longest {self.longest_s:.2f} s, {len(self.faults)} wrong{faults}"
        )


def lengths_s(commands: dict[str, list[str]], folder: Path) -> dict[str, float]:
    """Durations of undisturbed commands."""
    actual = {}
    for name, command in commands.items():
        begun = time.monotonic()
        _run(command, folder / f"undisturbed-{name}", None, 0.0)
        actual[name] = time.monotonic() - begun
    return actual


def trial(
    name: str,
    command: list[str],
    folder: Path,
    number: str,
    delay_s: float,
    all_: Trials,
    *,
    is_for_all: bool,
) -> None:
    """Send a signal, perhaps to the child processes as well, and record failures."""
    folder.mkdir(parents=True)
    code, took_s, err, moment = _run(
        command, folder, getattr(signal, number), delay_s, is_for_all=is_for_all
    )
    expected = 128 + getattr(signal, number)
    all_.count[name] += 1
    if moment == "end":
        all_.codes["complete"] += 1
        return
    faults = []
    is_early = code in (-getattr(signal, number), 1) and moment == "start"
    all_.codes["at Python's start" if is_early else str(code)] += 1
    all_.longest_s = max(all_.longest_s, took_s)
    if not is_early:
        words = "interrupted" if number == "SIGINT" else f"ended by {number}"
        if code != expected:
            faults.append(f"code {code}")
        if f"hfx: {words}; nothing half written" not in err:
            faults.append("no message")
        if "Traceback" in err or "defect" in err:
            faults.append("a traceback")
        # A busy machine also stops a device of 'hfx play', with a separate message.
        lines = [line for line in err.splitlines() if "did not run for" not in line]
        if len(lines) > 1 and "--resume" not in err:
            faults.append("several lines")
    if took_s > LIMIT_S:
        faults.append(f"{took_s:.1f} s")
    left = [str(path.relative_to(folder)) for path in _left(folder)]
    if left:
        faults.append(f"left {left[:5]}")
    if _running(folder):
        faults.append("children")
    if faults:
        shown = " | ".join(err.splitlines()[-4:])
        to = " to all" if is_for_all else ""
        all_.faults.append(f"{name} {number}{to} at {delay_s:.3f} s: {', '.join(faults)}: {shown}")


def _run(
    command: list[str],
    folder: Path,
    number: int | None,
    delay_s: float,
    *,
    is_for_all: bool = False,
) -> tuple[int, float, str, str]:
    """Exit code, seconds from the signal to the end, errors, and the :func:`moment_of` of the
    signal."""
    out, temporary = folder / "out", folder / "temporary"
    out.mkdir(parents=True)
    temporary.mkdir()
    if "PIECES" in command:  # removed by a merge
        shutil.copytree(folder.parent / "pieces", out / "pieces")
    words = {"PIECES": str(out / "pieces"), "OUT": str(out)}
    started = subprocess.Popen(
        [words.get(item, item.replace("OUT/", f"{out}/")) for item in command],
        env=_environment(temporary),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_undo_nohup,
    )
    time.sleep(delay_s)
    begun, moment = time.monotonic(), ""
    if number is not None:
        # Stopped, as the command could begin or end between the look and the signal.
        # By os.kill: send_signal() would collect an ended process first.
        os.kill(started.pid, signal.SIGSTOP)
        moment = moment_of(started.pid)
        os.kill(started.pid, number)
        os.kill(started.pid, signal.SIGCONT)
        for child in _processes(folder) if is_for_all else ():
            with suppress(OSError):
                os.kill(child, number)
    try:
        _, err = started.communicate(timeout=None if number is None else 10 * LIMIT_S)
    except subprocess.TimeoutExpired:
        started.kill()
        _, err = started.communicate()
    return started.returncode, time.monotonic() - begun, err, moment


def moment_of(pid: int) -> str:
    """Wait until a process stands still after SIGSTOP. Returns "end" if it exits or has ended: the
    system frees the memory of Blender for up to 0.1 s. Returns "start" if Python starts, before any
    line of the command: signals then have the system's handlers. Otherwise "command"."""
    folder = Path(f"/proc/{pid}")
    while not (stat := (folder / "stat").read_bytes()).rpartition(b")")[2].startswith(b" T"):
        if says_ending(stat):
            return "end"
        time.sleep(0.001)
    # Python itself catches SIGINT only.
    caught = int((folder / "status").read_text().partition("SigCgt:")[2].split()[0], 16)
    return "command" if caught & (1 << (signal.SIGTERM - 1)) else "start"


def _undo_nohup() -> None:
    for name in NAMES:
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _left(folder: Path) -> list[Path]:
    """Temporary files, and hidden or unfinished results."""
    temporary = list((folder / "temporary").iterdir())
    hidden = [p for p in (folder / "out").rglob("*") if p.name[0] == "." or p.suffix == ".tmp"]
    return temporary + hidden


def _running(folder: Path) -> list[int]:
    """Processes of a trial still running a second later."""
    until = time.monotonic() + 1.0
    while (processes := _processes(folder)) and time.monotonic() < until:
        time.sleep(0.05)
    return processes


def _processes(folder: Path) -> list[int]:
    """Processes with a trial's folder for temporary files."""
    mark = str(folder / "temporary").encode()
    actual = []
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark in (path / "environ").read_bytes():
                actual.append(int(path.name))
    return actual


def check(commands: dict[str, list[str]], folder: Path, count: int, seed: int) -> Trials:
    """Send signals at random moments, in turn to each command."""
    actual, rng = Trials(), random.Random(seed)
    lengths = lengths_s(commands, folder)
    names = list(commands)
    for k in range(count):
        name = names[k % len(names)]
        # A third of the signals during the import of modules and Blender's start.
        longest = min(lengths[name], 1.0) if rng.random() < 1 / 3 else lengths[name]
        delay_s = rng.uniform(0.0, 0.9 * longest)
        trial(
            *(name, commands[name], folder / f"{k}", rng.choice(NAMES), delay_s, actual),
            is_for_all=rng.random() < 1 / 3,  # as a farm does
        )
        shutil.rmtree(folder / f"{k}")
        if k % 20 == 19:
            sys.stderr.write(actual.text() + "\n")
    return actual


def main() -> None:
    """Check from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--signals", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", help="some of them, with commas between")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hfx-signals-") as folder:
        commands = prepare(Path(folder))
        if options.commands:
            commands = {name: commands[name] for name in options.commands.split(",")}
        actual = check(commands, Path(folder), options.signals, options.seed)
    sys.stdout.write(actual.text() + "\n")
    sys.exit(bool(actual.faults))


if __name__ == "__main__":
    main()
