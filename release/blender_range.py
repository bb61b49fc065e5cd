# SPDX-License-Identifier: GPL-3.0-or-later
"""Test each supported Blender: ``python release/blender_range.py [--suite]``.

Makes an environment for each module ``bpy`` with the NumPy of that Blender, and runs the demo. The
files of devices must equal those of the first version to the byte. ``--suite`` also runs the tests
inside Blender, ``tests/blender``. The rows of the tested versions are replaced in two tables: of
results in ``README.md``, and of skipped tests in ``docs/install.md``.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import build_addon

ROOT = Path(__file__).resolve().parents[1]
_TABLE = re.compile(r"(?<=<!-- blender range -->\n).*?(?=<!-- end -->)", re.DOTALL)


class Version(NamedTuple):
    """A Blender with its Python and the packages of its test environment.

    Attributes
    ----------
    bpy : str
        Release of PyPI's module ``bpy``: the Blender's version, three numbers.
    python : str
        Python of this Blender, two numbers.
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


class Suite(NamedTuple):
    """Results of the tests inside a Blender.

    ``counts`` are numbers of tests by outcome, in pytest's words ("passed", "failed", "errors").
    ``skipped`` are numbers of skipped tests by reason.
    """

    counts: dict[str, int]
    skipped: dict[str, int]

    @property
    def is_good(self) -> bool:
        """Test for passed and skipped tests only, with one passed test at least. pytest counts
        Python's warnings beside the outcomes of tests."""
        known = {"passed", "skipped", "warning", "warnings"}
        return self.counts.get("passed", 0) > 0 and self.counts.keys() <= known

    def __str__(self) -> str:
        return ", ".join(f"{n:,} {outcome}" for outcome, n in self.counts.items()) or "no test"


class Result(NamedTuple):
    """Results of a Blender; ``suite`` is None if the tests did not run."""

    demo: str
    is_equal: bool
    suite: Suite | None

    @property
    def is_good(self) -> bool:
        """Test for equal files of the demo and no failed test."""
        return self.is_equal and (self.suite is None or self.suite.is_good)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--suite", action="store_true", help="also run tests/blender (hours)")
    parser.add_argument("--processes", default="2", metavar="N", help="of tests (default: 2)")
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
    parser.add_argument(
        "--environments",
        type=Path,
        metavar="FOLDER",
        help="keep the environments here, and use those of an earlier run (default: temporary)",
    )
    options = parser.parse_args()
    chosen = [v for v in VERSIONS if not options.version or v.bpy in options.version]
    results: dict[Version, Result] = {}
    expected: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="hfx_range_") as folder:
        for version in chosen:
            home = (options.environments or Path(folder, "environments")).absolute() / version.bpy
            python = environment(version, options.python.format(version.python), home)
            files = demo_files(python, Path(folder, version.bpy))
            expected = expected or files
            differing = sorted(name for name in expected if files.get(name) != expected[name])
            demo = f"{len(files)} files, equal" if not differing else f"differs: {differing}"
            tests = run_suite(python, options.processes) if options.suite else None
            results[version] = Result(demo, not differing, tests)
            build_addon.say(f"Blender {version.bpy}: demo {demo}; tests {tests or 'did not run'}")
            # After each version: a run takes hours, and may be ended early.
            write_tables(results, ROOT)
    return int(not all(result.is_good for result in results.values()))


def environment(version: Version, interpreter: str, folder: Path) -> Path:
    """Make an environment with the project and a Blender, unless it exists; returns its Python."""
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    if python.exists():
        return python
    subprocess.run([interpreter, "-m", "venv", str(folder)], check=True)
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


def run_suite(python: Path, processes: str) -> Suite:
    """Run ``tests/blender``, and print the failures."""
    command = [
        str(python),
        "-m",
        "pytest",
        "-q",
        "-rfEs",
        "-n",
        processes,
        "-p",
        "no:cacheprovider",
    ]
    done = subprocess.run([*command, "tests/blender"], cwd=ROOT, capture_output=True, text=True)
    for line in done.stdout.splitlines():
        if line.startswith(("FAILED", "ERROR")):
            build_addon.say(line)
    return suite_of(done.stdout)


def suite_of(output: str) -> Suite:
    """Read the output of ``pytest -q -rs``; no counts without the summary of a complete run."""
    last = output.strip().rpartition("\n")[2]
    counts = re.findall(r"(\d+) (\w+)", last.partition(" in ")[0]) if " in " in last else []
    skipped: Counter[str] = Counter()
    for number, reason in re.findall(r"^SKIPPED \[(\d+)\] \S+: (.*)$", output, re.MULTILINE):
        skipped[reason] += int(number)
    return Suite({outcome: int(number) for number, outcome in counts}, dict(skipped))


def write_tables(results: Mapping[Version, Result], folder: Path) -> None:
    """Replace the rows of the tested versions in two pages of the project's ``folder``; other rows
    stay, sorted by version. Without a suite the page of skipped tests is unchanged."""
    rows = {
        v.bpy: f"| {v.bpy} | {v.python}, {v.numpy}, {v.scipy} | {r.demo} | {r.suite or '-'} |\n"
        for v, r in results.items()
    }
    head = "| Blender | Python, NumPy, SciPy | demo | tests inside Blender |\n|---|---|---|---|\n"
    _write_rows(folder / "README.md", head, rows)
    skipped_rows = {}
    for version, result in results.items():
        if result.suite is not None:
            reasons = "; ".join(f"{n}: {reason}" for reason, n in result.suite.skipped.items())
            skipped_rows[version.bpy] = f"| {version.bpy} | {reasons or '-'} |\n"
    head = "| Blender | skipped tests: reason |\n|---|---|\n"
    _write_rows(folder / "docs" / "install.md", head, skipped_rows)


def _write_rows(page: Path, head: str, rows: Mapping[str, str]) -> None:
    """Write a page's table with ``rows`` by version; the page's rows of further versions stay."""
    text = page.read_text(encoding="utf-8")
    lines = "".join(_TABLE.findall(text)).splitlines(keepends=True)
    present = {line.split()[1]: line for line in lines if re.match(r"\| \d", line)}
    merged = sorted({**present, **rows}.items(), key=lambda item: _numbers(item[0]))
    table = head + "".join(row for _, row in merged)
    page.write_text(_TABLE.sub(lambda _: table, text), encoding="utf-8")


def _numbers(version: str) -> list[int]:
    return [int(part) for part in version.split(".")]


if __name__ == "__main__":
    sys.exit(main())
