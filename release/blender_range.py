# SPDX-License-Identifier: GPL-3.0-or-later
"""Test the command with each supported Blender: ``python release/blender_range.py [--suite]``.

Makes an environment for each module ``bpy`` with the NumPy of that Blender, and runs the demo. The
files of devices must equal those of the first version to the byte. ``--suite`` runs the tests, too.
Writes the table of ``README.md`` if no ``--version`` is chosen.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import build_addon

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "README.md"
_TABLE = re.compile(r"(?<=<!-- blender range -->\n).*?(?=<!-- end -->)", re.DOTALL)


class Version(NamedTuple):
    """Versions of a test environment: PyPI's module ``bpy`` and the packages beside the module.

    Attributes
    ----------
    bpy : str
        Release of Blender, three numbers.
    python : str
        Python of the release, two numbers.
    numpy : str
        NumPy inside blender.org's Blender of the release.
    scipy : str
        SciPy in the extension's zip for this NumPy (``addon_wheels.VERSIONS``).
    """

    bpy: str
    python: str
    numpy: str
    scipy: str


VERSIONS = (
    Version("4.5.15", "3.11", "1.26.4", "1.17.1"),
    Version("4.2.0", "3.11", "1.24.3", "1.15.3"),
    Version("4.2.23", "3.11", "1.24.3", "1.15.3"),
    Version("4.3.0", "3.11", "1.24.3", "1.15.3"),
    Version("4.4.0", "3.11", "1.26.4", "1.15.3"),
    Version("5.0.1", "3.11", "1.26.4", "1.17.1"),
    Version("5.2.2", "3.13", "2.3.5", "1.18.1"),
)


class Result(NamedTuple):
    """Result of a version; the suite's summary is empty if the suite did not run."""

    demo: str
    suite: str


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--suite", action="store_true", help="run the tests, too (hours)")
    parser.add_argument(
        "--version",
        action="append",
        choices=[version.bpy for version in VERSIONS],
        help="test one version (repeatable; default: all)",
    )
    parser.add_argument(
        "--python",
        default="python{}",
        help="interpreters, {} for the version (default: %(default)s)",
    )
    options = parser.parse_args()
    chosen = [v for v in VERSIONS if not options.version or v.bpy in options.version]
    results: dict[Version, Result] = {}
    expected: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="hfx_range_") as folder:
        for version in chosen:
            work = Path(folder, version.bpy)
            python = environment(version, options.python.format(version.python), work)
            files = demo_files(python, work / "demo")
            expected = expected or files
            differing = sorted(name for name in expected if files.get(name) != expected[name])
            demo = f"{len(files)} files, equal" if not differing else f"differs: {differing}"
            summary = suite(python) if options.suite else ""
            results[version] = Result(demo, summary)
            build_addon.say(f"Blender {version.bpy}: demo {demo}; {summary or 'tests did not run'}")
    if not options.version:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(_TABLE.sub(lambda _: table(results), text), encoding="utf-8")
    return int(any("equal" not in result.demo for result in results.values()))


def environment(version: Version, interpreter: str, folder: Path) -> Path:
    """Make an environment with the project and the given Blender; returns its interpreter."""
    subprocess.run([interpreter, "-m", "venv", str(folder)], check=True)
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    own = [f"bpy=={version.bpy}", f"numpy=={version.numpy}", f"scipy=={version.scipy}"]
    others = [
        requirement
        for requirement in (*project["dependencies"], *project["optional-dependencies"]["dev"])
        if not requirement.startswith(("bpy", "numpy", "scipy"))
    ]
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, *own, *others], check=True)
    subprocess.run([*pip, "--no-deps", "--editable", str(ROOT)], check=True)
    return python


def demo_files(python: Path, folder: Path) -> dict[str, str]:
    """Run the demo; returns the device files' names and SHA-256 sums."""
    hfx = [str(python), "-m", "hfx_blender"]
    subprocess.run([*hfx, "demo", "--no-pictures", "-o", str(folder)], check=True, cwd=ROOT)
    paths = [*folder.glob("*.csv"), *folder.glob("*.wav")]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(paths)}


def suite(python: Path) -> str:
    """Run the tests; returns the last line of their output."""
    command = [str(python), "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    lines = done.stdout.strip().splitlines()
    for line in lines:
        if line.startswith(("FAILED", "ERROR")):
            build_addon.say(line)
    return re.sub(r" in [\d.]+s.*", "", lines[-1]).strip("= ") if lines else "no output"


def table(results: dict[Version, Result]) -> str:
    """Markdown table of the results, in order of the versions."""
    head = "| Blender | Python, NumPy, SciPy | demo | tests |\n|---|---|---|---|\n"
    return head + "".join(
        f"| {v.bpy} | {v.python}, {v.numpy}, {v.scipy} | {result.demo} | {result.suite or '-'} |\n"
        for v, result in sorted(results.items(), key=lambda item: _numbers(item[0].bpy))
    )


def _numbers(version: str) -> Sequence[int]:
    return [int(part) for part in version.split(".")]


if __name__ == "__main__":
    sys.exit(main())
