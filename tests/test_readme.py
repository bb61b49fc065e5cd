# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims of the README: the Python example, command lines, and links."""

from __future__ import annotations

import contextlib
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def code(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run ``hfx demo`` and return the folder."""
    where = tmp_path_factory.mktemp("readme")
    command = [sys.executable, "-m", "hfx_blender", "demo", "--no-pictures"]
    subprocess.run(command, cwd=where, check=True, capture_output=True)
    return where


def test_the_python_example_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    example, _ = code("python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(example, "README.md", "exec"), {})
    lines = printed.getvalue().splitlines()
    assert lines[0].startswith("pressure "), "the arrow is what is felt at 2.75 s"
    assert lines[-1].startswith("(1550, "), "15.5 s at 100 Hz"


_EDITS_ANOTHER = """
bpy.ops.hfx.add_volume()
bpy.ops.wm.open_mainfile(filepath="hfx_demo/garage.blend", use_scripts=False)
"""


@pytest.mark.parametrize("end", ["", "hfx_blender.unregister()\n", _EDITS_ANOTHER])
def test_a_pipeline_script_runs_and_ends(folder: Path, end: str) -> None:
    """Runs in a separate process, as Blender's module used to crash or hang at exit."""
    _, example = code("python")
    (folder / "script.py").write_text(example + end, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=folder,
        env={**os.environ, "PWD": str(folder)},  # set by shells and read by Blender
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    written = "garage.hfxtrack garage.back_pad.csv garage.report.json"
    assert written in done.stdout.splitlines()
    assert {path.name for path in (folder / "out").iterdir()} == set(written.split())


def test_the_command_lines_are_understood() -> None:
    from hfx_blender.cli import build_parser

    lines = [line.partition("#")[0] for block in code("sh") for line in block.splitlines()]
    calls = [line.split("hfx ", 1)[1].split() for line in lines if re.search(r"\bhfx \w", line)]
    assert len(calls) >= 5
    for arguments in calls:
        if arguments != ["export", "-o", "out/"]:  # inside Blender, of the open file
            build_parser().parse_args(arguments)


def test_the_lines_for_farms_are_understood() -> None:
    from hfx_blender.cli import build_parser

    text = (ROOT / "docs" / "farms.md").read_text(encoding="utf-8")
    text = re.sub(r"(\$\(\([^)]*\)\)|\$\w+|<STARTFRAME>)(?=/\d)", "1", text)  # of a task
    calls = re.findall(r"(?:hfx |\")(export (?:scene|/shared)[^\"';#|`\n]*)[^`]", text)
    assert len(calls) >= 9
    options = [build_parser().parse_args(call.split()) for call in calls]
    assert sum(option.piece is not None for option in options) >= 4
    assert sum(option.merge for option in options) >= 3


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
