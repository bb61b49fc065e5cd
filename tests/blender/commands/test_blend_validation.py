# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx validate`` on .blend files of Blender, whole and damaged."""

from __future__ import annotations

import gzip
import sys
from pathlib import Path

import bpy
import pytest

from hfx_blender import cli
from hfx_tools.formats.validation import validate

CUTS = 20


@pytest.fixture(params=[False, True], ids=["plain", "packed"])
def blend(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "x.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=request.param, copy=True)
    return path


def is_valid(path: Path) -> bool:
    info, findings = validate(path)
    assert info.id == "scene"
    return not findings


def test_a_whole_file_passes_with_the_limits_of_the_check(blend, capsys):
    assert is_valid(blend)
    assert cli.run(["validate", str(blend)]) == 0
    assert "valid; only the order of its blocks was checked" in capsys.readouterr().out
    upper = blend.rename(blend.with_name("X.BLEND"))
    assert is_valid(upper)
    # Blender before 3.0 packed with gzip.
    if upper.read_bytes()[:7] == b"BLENDER":
        upper.write_bytes(gzip.compress(upper.read_bytes()))
        assert is_valid(upper)


def test_a_cut_doubled_or_extended_file_is_damaged(blend):
    content = blend.read_bytes()
    cuts = [content[: len(content) * k // CUTS] for k in range(CUTS)]
    ends = [content[:-count] for count in (1, 2, 3, 8, 30)]
    added = [content + bytes(64), content + bytes(range(1, 65)), content + content]
    for k, damage in enumerate((*cuts, *ends, *added)):
        blend.write_bytes(damage)
        assert not is_valid(blend), k


def test_zeros_in_the_head_of_a_block_are_found(blend):
    content = blend.read_bytes()
    is_packed = not content.startswith(b"BLENDER")
    # Of a plain file the first head, and the names in DNA1; of a packed file the head of the table
    # of frames behind them, a skippable frame of zstd: zeros among literals stay literals.
    table = content.rfind(bytes([0x5E, 0x2A, 0x4D, 0x18]))
    dna = content.find(b"SDNANAME") + 2000
    for at in (table,) if is_packed else (12, dna):
        blend.write_bytes(content[:at] + bytes(64) + content[at + 64 :])
        assert not is_valid(blend), at


def test_a_packed_file_without_zstandard_is_not_called_whole(blend, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "zstandard", None)
    assert cli.run(["validate", str(blend)]) == 0
    is_packed = not blend.read_bytes().startswith(b"BLENDER")
    assert ("'zstandard' is missing" in capsys.readouterr().out) == is_packed
