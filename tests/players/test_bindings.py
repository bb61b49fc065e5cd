# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine players meet ``players/conformance``, where engines are installed."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from core_library import compiled
from small_clip import write_small_clip

PLAYERS = Path(__file__).resolve().parents[2] / "players"


def test_the_unity_package_plays_the_conformance_clips(tmp_path: Path) -> None:
    if shutil.which("mcs") is None or shutil.which("mono") is None:
        pytest.skip("Mono is not installed (mono-mcs, mono-runtime)")
    program = tmp_path / "conformance.exe"
    folders = ("Runtime", "Editor", "Samples~/Garage", "Tests~")
    sources = [path for folder in folders for path in (PLAYERS / "unity" / folder).glob("*.cs")]
    subprocess.run(["mcs", f"-out:{program}", *sources], check=True)
    core = '#include "../native/live_body.c"\n#include "../native/live_player.c"\n'
    compiled(core, tmp_path / "libhfx_haptics.so", "-std=c99", "-shared", "-fPIC")
    folders = [PLAYERS / "conformance", PLAYERS / "conformance" / "spatial"]
    found_there = {**os.environ, "LD_LIBRARY_PATH": str(tmp_path)}
    start = ["mono", program, *folders, write_small_clip(tmp_path)]
    subprocess.run(start, check=True, env=found_there)


def test_the_godot_addon_plays_the_conformance_clips(tmp_path: Path) -> None:
    godot = shutil.which("godot4") or shutil.which("godot")
    if godot is None:
        pytest.skip("Godot 4 is not installed")
    project = tmp_path / "project"
    shutil.copytree(PLAYERS / "godot", project)
    add_extension(project)
    start = [godot, "--headless", "--path", project]
    subprocess.run([*start, "--import"], check=True)
    for script, folder in (("conformance", "."), ("body", "spatial"), ("surfaces", "surfaces")):
        expected = ["--script", f"tests/{script}.gd", "--", PLAYERS / "conformance" / folder]
        subprocess.run([*start, *expected], check=True)


def add_extension(project: Path) -> None:
    """Compile the Godot binding of the core into a project not yet opened."""
    path = project / "addons" / "hfx" / "bin"
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    sources = '#include "../native/live_body.c"\n#include "../native/godot.c"\n'
    compiled(sources, path / "libhfx_haptics.so", "-std=c99", "-shared", "-fPIC")
    (path / "hfx.gdextension").write_text(
        '[configuration]\nentry_symbol = "hfx_haptics_begin"\ncompatibility_minimum = "4.2"\n'
        '[libraries]\nlinux = "libhfx_haptics.so"\n'
    )
    # Godot 4.5 to 4.7 abort at the end of a headless run after finding a new extension (#111048).
    (project / ".godot").mkdir(exist_ok=True)
    known = project / ".godot" / "extension_list.cfg"
    known.write_text("res://addons/hfx/bin/hfx.gdextension\n")


def test_every_file_of_the_unity_package_has_an_identity_of_its_own() -> None:
    package = PLAYERS / "unity"
    folders = ("Tests~", "Plugins")  # not shown in Unity; compiled here
    shown = [
        path
        for path in package.rglob("*")
        if not any(item in str(path.relative_to(package)) for item in folders)
    ]
    assets = {path for path in shown if path.suffix != ".meta"}
    metas = {path.with_suffix("") for path in shown if path.suffix == ".meta"}
    assert assets - {package / "Samples~"} == metas and len(metas) > 5
    guids = [
        re.search(r"^guid: ([0-9a-f]{32})$", path.read_text(), re.MULTILINE)
        for path in shown
        if path.suffix == ".meta"
    ]
    assert all(guids) and len({guid[1] for guid in guids if guid}) == len(metas)

    (sample,) = json.loads((package / "package.json").read_text())["samples"]
    clips = [PLAYERS / "godot" / "garage", package / sample["path"]]
    assert len({(folder / "garage.hfxclip").read_bytes() for folder in clips}) == 1
