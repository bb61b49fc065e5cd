# SPDX-License-Identifier: GPL-3.0-or-later
"""Independence of the core: C99 and C++17, no library but math, nothing from the product."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from core_library import CORE, ROOT, compiled

_MATH = {"ceil", "exp", "floor", "log", "pow", "sin", "sqrt", "sqrtf"}
_SOURCES = sorted(CORE.glob("*.h"))
_OURS = [
    path
    for folder in ("hfx_blender", "firmware")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".c", ".h", ".ino", ".py")
]
_SUBSTANTIVE = 24
"""Letters and digits of a line that says something of its own."""


@pytest.mark.parametrize(
    ("suffix", "standard"), [(".c", "c99"), (".cc", "c++17")], ids=["C99", "C++17"]
)
def test_the_core_compiles_without_warnings(suffix: str, standard: str, tmp_path: Path) -> None:
    source = '#include "hfx_player.h"\nint main(void) { return 0; }\n'
    assert compiled(source, tmp_path / "x", f"-std={standard}", suffix=suffix).is_file()


def test_the_core_calls_only_listed_mathematics(tmp_path: Path) -> None:
    source = '#define HFX_API extern\n#include "hfx_player.h"\n'
    library = compiled(source, tmp_path / "x.o", "-std=c99", "-c", "-O0")
    nm = shutil.which("nm")
    assert nm, "the program nm, of binutils, is needed"
    completed = subprocess.run([nm, "-u", str(library)], capture_output=True, text=True, check=True)
    called = {line.split()[-1] for line in completed.stdout.splitlines()} - {
        "_GLOBAL_OFFSET_TABLE_"
    }
    assert called <= _MATH


def test_the_core_includes_nothing_else_and_has_its_own_licence() -> None:
    for path in _SOURCES:
        text = path.read_text()
        assert text.startswith("/* SPDX-License-Identifier: MIT\n")
        included = set(re.findall(r"#include [<\"](.*?)[>\"]", text))
        assert included <= {"math.h", "stddef.h", "stdint.h", *(item.name for item in _SOURCES)}
    assert (CORE / "LICENSE").read_text().startswith("MIT License")


def _lines(path: Path) -> set[str]:
    """Return the lines of a file without spaces."""
    return {"".join(line.split()) for line in path.read_text(errors="replace").splitlines()}


def test_the_core_shares_no_lines_with_the_product() -> None:
    core = set().union(*(_lines(path) for path in _SOURCES))
    own = {item for item in core if len(re.sub(r"\W", "", item)) >= _SUBSTANTIVE}
    ours = set().union(*(_lines(path) for path in _OURS))
    shared = own & ours
    assert len(own) > 100 and len(ours) > 10_000
    assert len(shared) < 5, shared
