# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages for game developers: the program in C runs, and named properties and methods exist."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

from core_library import ROOT, compiled

PAGES = ROOT / "docs" / "players"
GODOT = ROOT / "players" / "godot" / "addons" / "hfx"
UNITY = ROOT / "players" / "unity" / "Runtime"


def test_the_program_in_c_plays_the_sample(tmp_path: Path) -> None:
    page = (PAGES / "c.md").read_text(encoding="utf-8")
    source = re.search(r"```c\n(.*?)```", page, re.DOTALL)
    assert source
    shutil.copy(GODOT / "samples" / "garage.hfxclip", tmp_path)
    program = compiled(source[1], tmp_path / "game", "-std=c99", "-Wall", "-Wextra", "-Werror")
    done = subprocess.run([program], cwd=tmp_path, capture_output=True, text=True, check=True)
    lines = [line.split() for line in done.stdout.splitlines()]
    assert abs(len(lines) - 15.5 * 60) <= 1  # 15.5 s at 60 frames a second
    assert {words[0] for words in lines} == {"left"} and {words[2] for words in lines} == {"right"}
    strengths = [(float(words[1]), float(words[3])) for words in lines]
    assert any(left > 0.5 and right > 0.5 for left, right in strengths)
    assert all(0.0 <= share <= 1.0 for pair in strengths for share in pair)


def first_cells(page: Path, heading: str) -> str:
    """First column of the table below a heading."""
    section = page.read_text(encoding="utf-8").partition(f"### {heading}\n")[2]
    rows = section.partition("\n#")[0].splitlines()
    return "\n".join(row.split("|")[1] for row in rows if row.startswith("|"))


def test_properties_and_methods_of_godot_exist() -> None:
    source = (GODOT / "haptic_source.gd").read_text(encoding="utf-8")
    for heading, file in [("HapticPlayer", "player"), ("HapticControllers", "controllers")]:
        script = (GODOT / f"haptic_{file}.gd").read_text(encoding="utf-8") + source
        cells = first_cells(PAGES / "godot.md", heading)
        names = re.findall(r"\*([A-Z][A-Za-z ]*)\*", cells)
        exported = set(
            re.findall(r"^@export\S*(?: .*\)| )\s*var (\w+)|^@export var (\w+)", script, re.M)
        )
        variables = {name for pair in exported for name in pair}
        assert len(names) >= 4
        assert {name.lower().replace(" ", "_") for name in names} <= variables
        for method in re.findall(r"`(\w+)\(", cells):
            assert re.search(rf"^(func|signal) {method}\(", script, re.M), method


def test_properties_and_methods_of_unity_exist() -> None:
    for heading in ("Haptic Player", "Controller Haptics"):
        script = (UNITY / f"{heading.replace(' ', '')}.cs").read_text(encoding="utf-8")
        cells = first_cells(PAGES / "unity.md", heading)
        fields = set(re.findall(r"\[SerializeField[^\]]*\] [\w\[\]]+ (\w+)", script))
        names = [name.replace(" ", "") for name in re.findall(r"\*([A-Z][A-Za-z ]*)\*", cells)]
        assert len(names) >= 4
        assert {name[0].lower() + name[1:] for name in names} <= fields
        for member in re.findall(r"`(\w+)", cells):
            assert re.search(rf"public [\w<>\[\] ]*\b{member}\b", script), member
