# SPDX-License-Identifier: GPL-3.0-or-later
"""Journeys through a real Blender window, apart from pytest.

``python tests/manual/gui/run.py --blender BLENDER --zip EXTENSION.zip`` installs the extension with
new settings, opens Blender's window once per journey (a file of ``journeys/``), and uses Blender
with mouse and keyboard. Pictures and the log go to ``out/gui/JOURNEY``. A journey fails when a
check fails, when Blender ends by itself, and on any traceback in the log.

On Linux with ``Xvfb`` and ``xdotool`` the screen is a virtual screen with real mouse and keyboard;
elsewhere the window opens on your screen and Blender simulates the input (leave the mouse alone).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from blender_process import BlenderError, BlenderProcess
from inputs import SimulatedInput

HERE = Path(__file__).resolve().parent
JOURNEYS = HERE / "journeys"


def main() -> int:
    arguments = _parser().parse_args()
    names = arguments.journey or sorted(path.stem for path in JOURNEYS.glob("*.py"))
    files = [_journey(name) for name in names]
    failed = []
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
    with _display(arguments) as display:
        for file in files:
            out = arguments.out / file.stem
            shutil.rmtree(out, ignore_errors=True)
            out.mkdir(parents=True)
            begin = time.monotonic()
            message = _run(arguments, file, out.resolve(), display)
            verdict = f"FAILED: {message}" if message else "ok"
            sys.stdout.write(f"{file.stem}: {verdict} ({time.monotonic() - begin:.0f} s)\n")
            sys.stdout.flush()
            failed += [file.stem] if message else []
    sys.stdout.write(f"{len(files) - len(failed)} passed, {len(failed)} failed\n")
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("journey", nargs="*", help="names or files (default: all)")
    parser.add_argument("--blender", type=Path, required=True, help="the executable")
    parser.add_argument(
        "--zip", type=Path, action="append", default=[], help="the extension (several: in turn)"
    )
    parser.add_argument("--out", type=Path, default=Path("out/gui"))
    parser.add_argument("--size", default="1600x1000", help="of the window (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=240, help="limit for a journey")
    parser.add_argument("--screen", choices=("virtual", "real"), help="where the window opens")
    parser.add_argument("--input", choices=("real", "simulated"), help="whose mouse and keyboard")
    parser.add_argument(
        "--pictures", type=Path, help="write the documentation's pictures into this folder"
    )
    parser.add_argument("--arg", action="append", default=[], help="passed on to the journeys")
    return parser


def _journey(name: str) -> Path:
    for path in (JOURNEYS / f"{name}.py", Path(name)):
        if path.is_file():
            return path.resolve()
    raise SystemExit(f"There is no journey '{name}'; there are: " + ", ".join(_known()))


def _known() -> list[str]:
    return sorted(path.stem for path in JOURNEYS.glob("*.py"))


@contextlib.contextmanager
def _display(arguments: argparse.Namespace) -> Iterator[dict[str, str]]:
    """Context with additions to the environment, and the open choices of screen and input.

    ``arguments.memory`` becomes the file with the virtual screen's pixels.
    """
    has_virtual = shutil.which("Xvfb") is not None
    arguments.screen = arguments.screen or ("virtual" if has_virtual else "real")
    if arguments.input is None:
        real = arguments.screen == "virtual" and shutil.which("xdotool") is not None
        arguments.input = "real" if real else "simulated"
    arguments.memory = ""
    if arguments.screen == "real":
        yield {}
        return
    read, write = os.pipe()
    folder = tempfile.mkdtemp(prefix="hfx_screen_")
    arguments.memory = str(Path(folder, "Xvfb_screen0"))
    screen = ["-screen", "0", f"{arguments.size}x24", "-fbdir", folder, "-nolisten", "tcp"]
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), *screen],
        pass_fds=[write],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            number = answer.readline().strip()
        if not number:
            raise SystemExit("Xvfb did not start")
        yield {"DISPLAY": f":{number}", "WAYLAND_DISPLAY": ""}
    finally:
        _end(server)
        shutil.rmtree(folder, ignore_errors=True)


def _run(arguments: argparse.Namespace, file: Path, out: Path, display: dict[str, str]) -> str:
    """Run a journey; return the error, or an empty result."""
    with tempfile.TemporaryDirectory(prefix="hfx_gui_", ignore_cleanup_errors=True) as folder:
        blender = BlenderProcess(arguments.blender, Path(folder))
        zips = [path.resolve() for path in arguments.zip]
        try:
            if "INSTALLS_BY_ITSELF = True" not in file.read_text(encoding="utf-8"):
                for path in zips:
                    blender.install(path)
        except BlenderError as error:
            (out / "blender.log").write_text(str(error), encoding="utf-8")
            return "cannot install the extension, see blender.log"
        request = {
            "journey": str(file),
            "out": str(out),
            "input": arguments.input,
            "screen": arguments.memory,
            "zips": [str(path) for path in zips],
            "args": arguments.arg,
            "pictures": str(arguments.pictures.resolve()) if arguments.pictures else "",
        }
        code, text = _window(blender, arguments, request, out, display)
        for crash in Path(folder).rglob("*.crash.txt"):
            shutil.copy(crash, out)
    log = (out / "blender.log").read_text(encoding="utf-8", errors="replace")
    if code == 0 and "Traceback (most recent call last)" in log:
        return f"a traceback in {out / 'blender.log'}"
    if code:
        (out / "failure.txt").write_text(text, encoding="utf-8")
        sys.stdout.write(text)
    return "" if code == 0 else (text.strip().splitlines() or [f"code {code}"])[-1]


def _window(
    blender: BlenderProcess,
    arguments: argparse.Namespace,
    request: dict[str, object],
    out: Path,
    display: dict[str, str],
) -> tuple[int, str]:
    flags: Sequence[str] = SimulatedInput.flags if arguments.input == "simulated" else ()
    if arguments.screen == "virtual":
        flags = (*flags, "--gpu-backend", "opengl")  # no graphics card behind the virtual screen
    size = arguments.size.split("x")
    command = [str(blender.executable), "-noaudio", "--offline-mode", *flags]
    command += ["--window-geometry", "0", "0", *size, "--python", str(HERE / "session.py")]
    command += ["--", json.dumps(request)]
    status = out / "status"
    with (out / "blender.log").open("wb") as log:
        process = subprocess.Popen(
            command,
            env={**blender.environment, **display},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        end = time.monotonic() + arguments.seconds
        while process.poll() is None and not status.exists() and time.monotonic() < end:
            time.sleep(0.1)
        ended = process.poll()
        _end(process)
    if status.exists():
        first, _, text = status.read_text(encoding="utf-8").partition("\n")
        status.unlink()
        return int(first), text
    if ended is not None:
        return 5, f"Blender ended by itself with code {ended}"
    return 124, f"not done after {arguments.seconds:.0f} s"


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


if __name__ == "__main__":
    sys.exit(main())
