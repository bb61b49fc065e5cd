# SPDX-License-Identifier: GPL-3.0-or-later
"""Build of the players' native libraries: failed platforms, stale folders, universal files."""

from __future__ import annotations

import importlib.util
import shutil
import struct
import subprocess
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
from core_library import ROOT

from release import godot_zip


@pytest.fixture
def build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The build script for folders of the test, with a compiler that fails for Windows."""
    spec = importlib.util.spec_from_file_location("build", ROOT / "players/native/build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def compile_for(target: str, library: Path) -> None:
        if "windows" in target:
            raise subprocess.CalledProcessError(1, ["zig"])
        library.parent.mkdir()
        kind = 0x0100000C if "aarch64" in target else 0x01000007
        library.write_bytes(struct.pack("<III", 0xFEEDFACF, kind, 3) + target.encode())
        library.with_suffix(".lib").write_bytes(b"an import library")

    monkeypatch.setattr(module, "GODOT", tmp_path / "godot" / "bin")
    monkeypatch.setattr(module, "UNITY", tmp_path / "unity" / "Plugins")
    monkeypatch.setattr(module, "compile_for", compile_for)
    return module


def run(module: ModuleType, monkeypatch: pytest.MonkeyPatch, *platforms: str) -> int:
    monkeypatch.setattr("sys.argv", ["build.py", *platforms])
    return int(module.main())


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_failed_platform_has_no_library_and_the_others_have(
    build: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    godot, unity = tmp_path / "godot" / "bin", tmp_path / "unity" / "Plugins"
    for stale in ("windows.x86_64/hfx_haptics.dll", "macos.arm64/libhfx_haptics.dylib"):
        for folder in (godot, unity):
            (folder / stale).parent.mkdir(parents=True)
            (folder / stale).write_bytes(b"of an older core")
    assert run(build, monkeypatch) == 1
    assert "Not built: windows.x86_64." in capsys.readouterr().err
    libraries = {
        "linux.x86_64/libhfx_haptics.so",
        "linux.arm64/libhfx_haptics.so",
        "macos/libhfx_haptics.dylib",
        "android.arm64/libhfx_haptics.so",
    }
    assert files(godot) == {*libraries, "hfx.gdextension", "hfx.gdextension.uid"}
    plugins = libraries - {"linux.arm64/libhfx_haptics.so"}
    folders = {f"{Path(name).parent}.meta" for name in plugins}
    assert files(unity) == plugins | folders | {f"{name}.meta" for name in plugins}
    listed = (godot / "hfx.gdextension").read_text().partition("[libraries]")[2].split("\n")
    assert {line.partition(" = ")[2].strip('"') for line in listed if line} == libraries


def test_a_universal_file_holds_both_processors(build: ModuleType) -> None:
    parts = [
        struct.pack("<III", 0xFEEDFACF, kind, sub) + bytes(20_000)
        for kind, sub in ((0x01000007, 3), (0x0100000C, 0))
    ]
    joined = build.universal(parts)
    assert struct.unpack_from(">II", joined) == (0xCAFEBABE, 2)
    for k, part in enumerate(parts):
        processor, kind, at, size, alignment = struct.unpack_from(">IIIII", joined, 8 + 20 * k)
        assert (processor, kind) == struct.unpack_from("<II", part, 4)
        assert at % (1 << alignment) == 0 and joined[at : at + size] == part
    assert build.universal(parts[:1]) == parts[0]


def test_an_unknown_platform_is_named(
    build: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(build, monkeypatch, "macos", "amiga") == 2
    message = capsys.readouterr().err
    assert "'amiga'" in message and "android.arm64" in message and "Traceback" not in message


def test_the_zip_for_godot_is_complete_or_names_what_is_missing(
    build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    addon = tmp_path / "hfx"
    shutil.copytree(godot_zip.ADDON, addon, ignore=shutil.ignore_patterns("bin"))
    assert godot_zip.missing(addon) == list(godot_zip.PLATFORMS)
    monkeypatch.setattr(build, "GODOT", addon / "bin")
    assert run(build, monkeypatch) == 1
    assert godot_zip.missing(addon) == ["windows.x86_64"]
    (addon / "plugin.gd.uid").unlink()
    (addon / "notes.tmp").write_text("a stray file")
    assert godot_zip.missing(addon) == ["windows.x86_64", "plugin.gd.uid"]
    path = godot_zip.write(tmp_path / "dist", addon)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    assert {Path(name).parts[:2] for name in names} == {("addons", "hfx")}
    contents = (
        *(
            "LICENSE",
            "LICENSE-mingw_w64.txt",
            "README.md",
            "icon.svg",
            "plugin.cfg",
            "bin/macos/libhfx_haptics.dylib",
        ),
        *("samples/garage.tscn", "samples/garage.gd", "samples/garage.hfxclip"),
    )
    assert {f"addons/hfx/{name}" for name in contents} <= set(names)
    assert not [name for name in names if name.endswith(".tmp")]


def test_each_script_of_the_add_on_has_a_uid() -> None:
    scripts = sorted(godot_zip.ADDON.rglob("*.gd"))
    uids = [Path(f"{path}.uid").read_text() for path in scripts]
    assert len(scripts) > 10 and len(set(uids)) == len(uids)
    assert all(uid.startswith("uid://") for uid in uids)
