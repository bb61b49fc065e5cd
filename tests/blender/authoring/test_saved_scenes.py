# SPDX-License-Identifier: GPL-3.0-or-later
"""Saved demo scenes, and .blend files of the project, do not say where they were made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from hfx_tools.demo.scene_file import forget_folders

ROOT = Path(__file__).resolve().parents[3]


def _browsers() -> list[Any]:
    spaces = [
        space for screen in bpy.data.screens for area in screen.areas for space in area.spaces
    ]
    return [space.params for space in spaces if space.type == "FILE_BROWSER" and space.params]


def test_no_part_of_a_folder_of_a_file_browser_is_saved(tmp_path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True)
    browsers = _browsers()
    assert browsers
    for params in browsers:
        params.directory = b"/homes/jane.doe/projects"
    forget_folders()
    path = tmp_path / "a.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=False, copy=True)
    assert b"ane.doe" not in path.read_bytes()


def test_no_blend_file_of_the_project_names_a_home_folder() -> None:
    files = [*ROOT.glob("effect_library/*.blend"), *ROOT.glob("tests/blender/old_files/*.blend")]
    assert len(files) >= 2
    for file in files:
        bpy.ops.wm.open_mainfile(filepath=str(file), load_ui=True)
        assert {params.directory for params in _browsers()} <= {b"", b"//"}, file.name
