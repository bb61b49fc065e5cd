# SPDX-License-Identifier: GPL-3.0-or-later
"""Engine players meet ``players/conformance``, where engines are installed."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest
from core_library import compiled
from small_clip import write_small_clip

from release import unity_package

PLAYERS = Path(__file__).resolve().parents[2] / "players"


def test_the_unity_package_plays_the_conformance_clips(tmp_path: Path) -> None:
    if shutil.which("mcs") is None or shutil.which("mono") is None:
        pytest.skip("Mono is not installed (mono-mcs, mono-runtime)")
    program = tmp_path / "conformance.exe"
    folders = ("Runtime", "Editor", "Samples~/Garage", "Samples~/Board", "Tests~")
    sources = [path for folder in folders for path in (PLAYERS / "unity" / folder).glob("*.cs")]
    defined = "-d:HFX_INPUT_SYSTEM;UNITY_ANDROID"
    subprocess.run(["mcs", defined, f"-out:{program}", *sources], check=True)
    core = '#include "../native/live_body.c"\n#include "../native/live_player.c"\n'
    compiled(core, tmp_path / "libhfx_haptics.so", "-std=c99", "-shared", "-fPIC")
    folders = [PLAYERS / "conformance", PLAYERS / "conformance" / "spatial"]
    found_there = {**os.environ, "LD_LIBRARY_PATH": str(tmp_path)}
    start = ["mono", program, *folders, write_small_clip(tmp_path)]
    subprocess.run(start, check=True, env=found_there, cwd=PLAYERS / "unity")


def test_the_godot_addon_plays_the_conformance_clips(tmp_path: Path) -> None:
    godot = shutil.which("godot4") or shutil.which("godot")
    if godot is None:
        pytest.skip("Godot 4 is not installed")
    project = tmp_path / "project"
    shutil.copytree(PLAYERS / "godot", project)
    add_extension(project)
    start = [godot, "--headless", "--path", project]
    subprocess.run([*start, "--import"], check=True)
    scripts = (
        *(("conformance", "."), ("behaviour", "behaviour"), ("body", "spatial")),
        *(("avatar", "spatial"), ("bones", "."), ("surfaces", "surfaces")),
        ("outputs", "demo_garage.hfxclip"),
    )
    for script, path in scripts:
        expected = ["--script", f"tests/{script}.gd", "--", PLAYERS / "conformance" / path]
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


def test_every_file_of_the_unity_package_has_an_identity_of_its_own(tmp_path: Path) -> None:
    package = PLAYERS / "unity"
    tarball = unity_package.write_tarball(tmp_path)
    assert tarball.name == "org.hfx.haptics-0.1.0.tgz"
    again = unity_package.write_tarball(tmp_path / "again")
    assert again.read_bytes() == tarball.read_bytes()
    with tarfile.open(tarball) as tar:
        files = {
            entry.name.removeprefix("package/"): tar.extractfile(entry).read().decode("latin-1")  # type: ignore[union-attr]
            for entry in tar
        }
    # Folders whose names end in ~ are hidden from Unity; samples are copied out with their metas.
    shown = {
        name for name in files if not re.match(r"Documentation~|Samples~/[^/]+$|Tests~", name)
    } - {"Samples~/Garage.meta", "Samples~/Board.meta"}
    folders = {
        str(parent) for name in shown for parent in Path(name).parents if str(parent) != "."
    } - {"Samples~", "Samples~/Garage", "Samples~/Board"}
    assets = folders | {name for name in shown if not name.endswith(".meta")}
    metas = {name.removesuffix(".meta") for name in shown if name.endswith(".meta")}
    assert assets == metas
    assert {Path(name).suffix for name in assets if "Plugins/" in name} > {".so", ".dll", ".dylib"}
    assert {"README.md", "CHANGELOG.md", "LICENSE.md", "Runtime/Plugins"} < assets
    assert "Documentation~/index.md" in files and not any("Tests~" in name for name in files)
    guids = [
        re.search(r"^guid: ([0-9a-f]{32})$", text, re.MULTILINE)
        for name, text in files.items()
        if name.endswith(".meta")
    ]
    assert all(guids) and len({guid[1] for guid in guids if guid}) == len(guids)

    facts = json.loads(files["package.json"])
    in_godot = ("addons/hfx/samples/garage.hfxclip", "board/board.hfxclip")
    for sample, clip in zip(facts["samples"], in_godot, strict=True):
        clips = [PLAYERS / "godot" / clip, package / sample["path"] / Path(clip).name]
        assert len({path.read_bytes() for path in clips}) == 1
    assert f"## {facts['version']}" in files["CHANGELOG.md"]


def test_git_keeps_the_plugins_of_the_unity_package() -> None:
    """A repository that holds the package installs from git only if its libraries are in it."""
    folder = "players/unity/Runtime/Plugins"
    names = [
        "linux.x86_64/libhfx_haptics.so",
        "windows.x86_64/hfx_haptics.dll",
        "linux.x86_64.meta",
    ]
    paths = [f"{folder}/{name}" for name in names] + [f"{folder}.meta"]
    done = subprocess.run(
        ["git", "check-ignore", "--no-index", *paths],
        cwd=PLAYERS.parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode > 1:
        pytest.skip("this is no git repository")
    assert done.stdout == ""


def test_all_packages_have_one_version() -> None:
    core = (PLAYERS / "core" / "hfx_player.h").read_text()
    names = ("MAJOR", "MINOR", "PATCH")
    numbers = [re.search(rf"#define HFX_PLAYER_VERSION_{name} (\d+)", core) for name in names]
    version = ".".join(number[1] for number in numbers if number)
    assert json.loads((PLAYERS / "unity" / "package.json").read_text())["version"] == version
    assert f'version="{version}"' in (PLAYERS / "godot/addons/hfx/plugin.cfg").read_text()
    assert f'version = "{version}"' in (PLAYERS / "examples/rust/Cargo.toml").read_text()
