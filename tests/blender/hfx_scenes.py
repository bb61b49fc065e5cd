# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes for tests of user actions, and ``hfx`` run as a process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy

ROOT = Path(__file__).resolve().parents[2]
FPS = 25


def small_scene(frame_end: int = 9) -> Any:
    """Small scene: an avatar at rest, a painted effect 'Touch' and a volume 'Ball' around the
    avatar.
    """
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = FPS
    scene.frame_start, scene.frame_end = 0, frame_end
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    bpy.ops.hfx.fill_part(part="hand_palm")
    bpy.ops.hfx.add_volume(
        modality="vibration", shape="SPHERE", name="Ball", radius=0.3, location=(0, 0, 1)
    )
    return scene


def save(path: Path) -> Path:
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    return path


def process(*arguments: object, **settings: Any) -> subprocess.CompletedProcess[str]:
    """Run ``hfx`` with arguments to the end."""
    settings.setdefault("stdout", subprocess.PIPE)
    settings.setdefault("stderr", subprocess.PIPE)
    settings.setdefault("env", environment())
    return subprocess.run(command(*arguments), text=True, **settings)


def process_without_litter(
    folder: Path, *arguments: object, **settings: Any
) -> subprocess.CompletedProcess[str]:
    """:func:`process` with a new folder for temporary files; asserts an empty folder at the end."""
    folder.mkdir()
    done = process(*arguments, env={**environment(), "TMPDIR": str(folder)}, **settings)
    assert names_in(folder) == []
    return done


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "hfx_blender", *map(str, arguments)]


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def names_in(folder: Path) -> list[str]:
    """Everything in a folder, hidden and temporary files included."""
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def contents_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}
