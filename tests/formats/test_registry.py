# SPDX-License-Identifier: GPL-3.0-or-later
"""Table of formats: existing functions, agreement with the page, no imports."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from hfx_blender.errors import UsageError
from hfx_blender.formats.registry import EXPORTED, FORMATS, FormatInfo
from hfx_tools.commands.conversion import target_of

PAGE = Path(__file__).resolve().parents[2] / "docs" / "formats" / "index.md"
FUNCTIONS = (
    *("write_track", "write_played", "write_raster", "write_signals", "held", "why_nothing"),
    *("check", "read", "decode", "read_raster", "facts"),
)


@pytest.mark.parametrize("info", FORMATS.values(), ids=list(FORMATS))
def test_every_function_of_the_table_is_there(info: FormatInfo) -> None:
    named = [kind for kind in FUNCTIONS if getattr(info, kind)]
    assert named or info.id == "glb"
    for kind in named:
        assert callable(info.function(kind)), kind
    assert bool(info.check) != bool(info.read) or info.id == "he1"


def test_the_table_imports_no_format() -> None:
    program = (
        "import sys; from hfx_blender.formats import registry; "
        "print([m for m in sys.modules if m.startswith(('numpy', 'hfx_blender.formats.', "
        "'hfx_blender.engine')) and not m.endswith('.registry')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_the_page_of_formats_has_a_row_for_each() -> None:
    table = PAGE.read_text(encoding="utf-8").partition("\n## ")[0]
    rows = dict(re.findall(r"^\| `([a-z0-9]+)` \| (.+?) \|", table, re.MULTILINE))
    assert list(rows) == list(EXPORTED)
    for id, files in rows.items():
        assert f"{FORMATS[id].suffix}`" in files
        assert all(f"{companion}`" in files for companion in FORMATS[id].companions)


def test_the_longest_suffix_names_the_target() -> None:
    expected = {"a.he": "he", "a.v1.he": "he1", "a.samples.jsonl": "jsonl", "a.b.hjif": "hjif"}
    assert {name: target_of(Path(name)).id for name in expected} == expected
    for name in ("a.jsonl", "a.glb", "a.hfxtrack", "a.channels.json", "a", ".csv"):
        with pytest.raises(UsageError, match=r"names no format; there are \.hjif, "):
            target_of(Path(name))
