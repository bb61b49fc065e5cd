# SPDX-License-Identifier: GPL-3.0-or-later
"""Open files of earlier commits with this state of the code.

``python tests/manual/upgrades/open_old_files.py -o FOLDER`` takes commits at equal distances of the
history, installs each into a folder, and runs its demo with new settings. This state then exports
the demo's .blend file, validates and converts tracks and clips, and loads device configurations,
sensations, paths and the user's settings of that commit. A line per commit names the files, and the
files with an error. Needs Git, and ``pip install hatchling ziglang`` in the running environment.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
_CALL = "import sys; from hfx_blender.{} import main; sys.exit(main())"
_LOAD = """
import sys
from hfx_blender.devices.configuration import load_device
for name in sys.argv[1:]:
    try:
        load_device(name)
    except Exception as error:
        print(f"{name}: {type(error).__name__}: {error}")
"""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--commits", type=int, default=12, metavar="N", help="(default: 12)")
    parser.add_argument("--commit", action="append", metavar="HASH", help="a commit (repeatable)")
    options = parser.parse_args()
    output: Path = options.output.absolute()
    output.mkdir(parents=True, exist_ok=True)
    failures = 0
    for commit in options.commit or commits(options.commits):
        folder = output / commit
        if not (folder / "made").exists():
            message = make_files(commit, folder)
            if message:
                print_line(f"{commit} {date(commit)}: makes no files: {message}")
                continue
        errors, count = open_files(folder)
        failures += len(errors)
        print_line(f"{commit} {date(commit)}: {count} files, {len(errors)} errors")
        for error in errors:
            print_line(f"    {error}")
    return int(failures > 0)


def print_line(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def date(commit: str) -> str:
    return git("log", "-1", "--format=%cs", commit)


def commits(number: int) -> list[str]:
    """Commits at equal distances, the oldest with a command line first."""
    first = git("log", "--reverse", "--format=%h", "--", "hfx_blender/cli.py").split()[0]
    hashes = git("log", "--reverse", "--format=%h", f"{first}..HEAD").split()
    step = (len(hashes) - 1) / max(number - 1, 1)
    return [hashes[round(index * step)] for index in range(number)]


def make_files(commit: str, folder: Path) -> str:
    """Run the demo of a commit with new settings in a folder; returns the last line of an error."""
    shutil.rmtree(folder, ignore_errors=True)
    source, package = folder / "source", folder / "package"
    source.mkdir(parents=True)
    archive = subprocess.run(
        ["git", "-C", str(ROOT), "archive", commit], check=True, capture_output=True
    ).stdout
    subprocess.run(["tar", "-x", "-C", str(source)], input=archive, check=True)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    done = subprocess.run([*pip, "--target", package, source], capture_output=True, text=True)
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["pip failed"])[-1]
    environment = {**clean_environment(folder), "PYTHONPATH": str(package)}
    module = "__main__" if (package / "hfx_blender" / "__main__.py").exists() else "cli"
    call = [sys.executable, "-c", _CALL.format(module)]
    for extra in (["--no-pictures"], []):  # the option is not in the first versions
        done = subprocess.run(
            [*call, "demo", *extra, "-o", str(folder / "demo")],
            env=environment,
            cwd=folder,
            capture_output=True,
            text=True,
        )
        if done.returncode == 0:
            break
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["the demo failed"])[-1]
    # Clips, and settings of playback: not in the first versions, so an error is no matter.
    blend = next((folder / "demo").glob("*.blend"))
    frames = ["--frames", "50:90"]
    clip = ["export", str(blend), "-o", str(folder / "clip"), "-f", "clip", *frames]
    track = next((folder / "demo").glob("*.hfxtrack"), None)
    commands = [[*clip, "--device", "oculus_touch"], ["doctor"]]
    commands += [["play", str(track), "--device", "back_pad", "--to", "simulator"]] if track else []
    for command in commands:
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(
                [*call, *command],
                env=environment,
                cwd=folder,
                capture_output=True,
                stdin=subprocess.DEVNULL,
                timeout=180,
            )
    for kind in ("device_configs", "effect_library"):
        if (source / kind).exists():
            shutil.copytree(source / kind, folder / kind)
    shutil.rmtree(source)
    shutil.rmtree(package, ignore_errors=True)
    (folder / "made").touch()
    return ""


def clean_environment(folder: Path) -> dict[str, str]:
    """Variables of a process whose home folder and settings lie in a folder."""
    home = folder / "home"
    home.mkdir(exist_ok=True)
    kept = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
    return {**kept, "HOME": str(home), "APPDATA": str(home / "appdata")}


def open_files(folder: Path) -> tuple[list[str], int]:
    """Open a commit's files; returns the errors and the number of opened files."""
    results = list(_opened(folder))
    return [line for line in results if line], len(results)


def _opened(folder: Path) -> Iterator[str]:
    """Yield an empty text for each good file, and an error otherwise."""
    now = folder / "now"
    shutil.rmtree(now, ignore_errors=True)
    now.mkdir()
    environment = {**clean_environment(folder), "PYTHONPATH": str(ROOT)}

    def hfx(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "hfx_blender", *arguments],
            env=environment,
            cwd=now,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
        )
        said = [line for line in done.stderr.splitlines() if line.strip()]
        if done.returncode == 0 and "Traceback" not in done.stderr:
            return ""
        return f"hfx {' '.join(arguments)}: {done.returncode}: {(said or ['no word'])[-1]}"

    for blend in sorted((folder / "demo").glob("*.blend")):
        formats = ("-f", "track,csv", "--device", "back_pad")
        yield hfx("export", str(blend), "-o", "export", *formats)
        yield from _compared(folder / "demo", now / "export")
    for track in sorted(folder.glob("demo/*.hfxtrack")):
        yield hfx("info", str(track)) or hfx("validate", str(track))
        yield hfx("convert", str(track), f"{track.stem}.hjif")
    for clip in sorted(folder.glob("clip/*.hfxclip")):
        yield hfx("validate", str(clip))
    effects = [str(path) for path in sorted(folder.glob("effect_library/**/*.hfx*"))]
    if effects:
        yield hfx("validate", *effects).replace(" ".join(effects), f"{len(effects)} sensations")
    devices = [str(path) for path in sorted(folder.glob("device_configs/**/*.json"))]
    devices = [path for path in devices if not path.endswith("schema.json")]
    command = [sys.executable, "-c", _LOAD, *devices]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    errors = done.stdout.splitlines() if done.returncode == 0 else [done.stderr.strip()[-300:]]
    yield from errors
    yield from ("" for _ in range(len(devices) - len(errors)))
    yield hfx("doctor")


def _compared(before: Path, now: Path) -> Iterator[str]:
    """Yield a line if the device's file differs by more than a hundredth of the full strength."""
    name = "garage.back_pad.csv"
    if not ((before / name).exists() and (now / name).exists()):
        return
    tables = [list(csv.reader((folder / name).open(encoding="utf-8"))) for folder in (before, now)]
    if [row[:1] for row in tables[0]] != [row[:1] for row in tables[1]]:
        yield f"{name}: {len(tables[0])} rows before, {len(tables[1])} now"
        return
    differing = 0
    for old, new in zip(*tables, strict=True):
        with contextlib.suppress(ValueError):
            pairs = zip(map(float, old), map(float, new), strict=True)
            differing += any(abs(a - b) > 0.01 for a, b in pairs)
    yield (
        f"{name}: {differing} of {len(tables[0])} rows differ by more than 0.01"
        if differing
        else ""
    )


if __name__ == "__main__":
    sys.exit(main())
