# SPDX-License-Identifier: GPL-3.0-or-later
"""Installing the package compiles the native library, or continues without a library."""

from __future__ import annotations

import importlib.util
import re
import shutil
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from release import core_build, native_build

ROOT = Path(__file__).resolve().parents[2]

TARGET = native_build.this_target()
CORE = "" if TARGET is None else core_build.library_name(TARGET)
pytestmark = pytest.mark.skipif(TARGET is None, reason="no library is built for this computer")


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Copy the part of the project read by the build hook, without a library."""
    monkeypatch.delenv(native_build.SWITCH, raising=False)
    ignored = shutil.ignore_patterns("__pycache__", "*.so*", "*.dll", "*.dylib")
    root = tmp_path / "project"
    for folder in (native_build.NATIVE, Path("players", "core"), Path("players", "native")):
        shutil.copytree(ROOT / folder, root / folder, ignore=ignored)
    (root / core_build.FOLDER).mkdir(parents=True)
    return root


@pytest.fixture
def hook(project: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the hook with a stand-in for hatchling's base class; hatchling exists only while
    installing.
    """

    class Interface:
        __class_getitem__ = classmethod(lambda cls, _: cls)

        def __init__(self, root: Path) -> None:
            self.root = str(root)
            self.warned: list[str] = []
            self.app = SimpleNamespace(display_warning=self.warned.append)

    names = "hatchling.builders.hooks.plugin.interface".split(".")
    for count in range(1, len(names) + 1):
        module = ModuleType(".".join(names[:count]))
        module.BuildHookInterface = Interface  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
    spec = importlib.util.spec_from_file_location(
        "hatch_build", ROOT / "release" / "hatch_build.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    library_hook = module.NativeLibraryHook(project)
    library_hook.module = module
    return library_hook


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return the folders filled by a stand-in for the compiler."""
    folders: list[Path] = []

    def build(target: Any, folder: Path, zig: Path, root: Path) -> Path:
        folders.append(folder)
        path = folder / target.library
        path.write_text(native_build.mark(target, root))
        return path

    def build_core(target: Any, folder: Path, zig: Path, root: Path) -> Path:
        folders.append(folder)
        path = folder / core_build.library_name(target)
        path.write_text(core_build.mark(target, root))
        return path

    monkeypatch.setattr(native_build, "compiler", lambda: Path("zig"))
    monkeypatch.setattr(native_build, "build", build)
    monkeypatch.setattr(core_build, "build", build_core)
    return folders


def _data() -> dict[str, Any]:
    return {
        "force_include": {},
        "force_include_editable": {},
        "pure_python": True,
        "tag": "",
    }


def test_an_editable_installation_compiles_once(
    hook: Any, project: Path, compiled: list[Path]
) -> None:
    assert TARGET is not None
    data = _data()
    assert hook.dependencies() == [native_build.REQUIREMENT]
    for _ in range(2):
        hook.initialize("editable", data)
        hook.finalize("editable", data, "")
    assert compiled == [project / native_build.NATIVE, project / core_build.FOLDER]
    assert hook.dependencies() == [], "no compiler is fetched the second time"
    assert data == _data() and not hook.warned


def test_a_wheel_holds_the_library_and_says_for_whom(
    hook: Any, project: Path, compiled: list[Path]
) -> None:
    assert TARGET is not None
    data = _data()
    hook.initialize("standard", data)
    assert data["force_include"] == {
        str(compiled[0] / TARGET.library): f"hfx_blender/engine/native/{TARGET.library}",
        str(compiled[1] / CORE): f"hfx_tools/live_body/{CORE}",
    }
    assert data["tag"] == f"py3-none-{TARGET.wheel}" and data["pure_python"] is False
    hook.finalize("standard", data, "")
    assert not compiled[0].exists() and project not in compiled[0].parents


def test_a_wheel_that_this_python_would_refuse_is_made_without(
    hook: Any, compiled: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hook.module, "sys_tags", lambda: iter(()))  # musl, for example
    data = _data()
    hook.initialize("standard", data)
    assert data == _data()


def test_a_wheel_for_another_platform_holds_its_library(
    hook: Any, compiled: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HFX_PLATFORM", "windows-x64")
    data = _data()
    hook.initialize("standard", data)
    assert list(data["force_include"].values()) == [
        "hfx_blender/engine/native/hfx_native.dll",
        "hfx_tools/live_body/hfx_core.dll",
    ]
    assert data["tag"] == "py3-none-win_amd64" and data["pure_python"] is False


def test_a_release_stops_where_a_platform_does_not_compile(
    hook: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> Path:
        raise native_build.BuildError("no compiler")

    monkeypatch.setattr(native_build, "compiler", fail)
    monkeypatch.setenv("HFX_PLATFORM", "macos-arm64")
    with pytest.raises(native_build.BuildError, match="no compiler"):
        hook.initialize("standard", _data())


@pytest.mark.parametrize("version", ["editable", "standard"])
@pytest.mark.parametrize("fault", ["missing", "crashing", "source", "read-only"])
def test_the_installation_goes_on_without_a_library(
    hook: Any, project: Path, monkeypatch: pytest.MonkeyPatch, version: str, fault: str
) -> None:
    if fault == "missing":
        monkeypatch.setattr(native_build, "FETCHED", project)
        monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    elif fault == "read-only":

        def refuse(*_: Any) -> Path:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(native_build, "compiler", lambda: Path("zig"))
        monkeypatch.setattr(native_build, "build", refuse)
        monkeypatch.setattr(core_build, "build", refuse)
    else:
        words = "crash" if fault == "crashing" else "interface.c:1:1: error: what is this?"
        program = project / "zig"
        program.write_text(f"#!/bin/sh\necho '{words}' >&2\nexit 1\n")
        program.chmod(0o755)
        monkeypatch.setattr(native_build, "compiler", lambda: program)
    data = _data()
    hook.initialize(version, data)
    hook.finalize(version, data, "")
    warning, core_warning = hook.warned
    assert core_warning.startswith("HFX is installed without the players' core and without 'hfx")
    assert warning.startswith("HFX is installed without its compiled library and works in numpy")
    assert data == _data()
    assert not list(project.rglob("*.so*")), "nothing half written"


def test_the_switch_asks_for_no_compiler(
    hook: Any, compiled: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(native_build.SWITCH, "0")
    data = _data()
    hook.initialize("standard", data)
    assert data == _data()
    assert hook.dependencies() == [] and not compiled and not hook.warned


def test_pip_gets_no_compiler_where_there_is_none(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert native_build.requirements(project) == [native_build.REQUIREMENT]
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(native_build.platform, "mac_ver", lambda: ("12.7.6", ("", "", ""), ""))
    assert native_build.requirements(project) == []
    monkeypatch.setattr(native_build.platform, "mac_ver", lambda: ("13.1", ("", "", ""), ""))
    assert native_build.requirements(project) == [native_build.REQUIREMENT]
    monkeypatch.setattr(native_build.sysconfig, "get_platform", lambda: "linux-riscv64")
    assert native_build.requirements(project) == []


@pytest.mark.parametrize(
    ("system", "machine", "expected"),
    [
        ("linux-x86_64", "x86_64", "linux-x64"),
        ("linux-aarch64", "aarch64", "linux-arm64"),
        ("win-amd64", "AMD64", "windows-x64"),
        ("win-arm64", "ARM64", "windows-arm64"),
        ("macosx-10.9-universal2", "arm64", "macos-arm64"),
        ("macosx-10.9-universal2", "x86_64", "macos-x64"),
        ("macosx-11.0-arm64", "arm64", "macos-arm64"),
        ("win32", "AMD64", None),
        ("linux-i686", "x86_64", None),
        ("freebsd-14.1-release-amd64", "amd64", None),
    ],
)
def test_each_python_gets_the_library_of_its_own_kind(
    monkeypatch: pytest.MonkeyPatch, system: str, machine: str, expected: str | None
) -> None:
    monkeypatch.setattr(native_build.sysconfig, "get_platform", lambda: system)
    monkeypatch.setattr(native_build.platform, "machine", lambda: machine)
    actual = native_build.this_target()
    assert actual == (native_build.TARGETS[expected] if expected else None)


@pytest.mark.parametrize("name", ["windows-x64", "windows-arm64"])
def test_a_release_compiles_the_core_of_windows_without_libraries_of_a_compiler(
    name: str, tmp_path: Path
) -> None:
    target = native_build.TARGETS[name]
    library = core_build.build(target, tmp_path, native_build.compiler())
    content = library.read_bytes()
    assert library.name == "hfx_core.dll"
    header = int.from_bytes(content[0x3C:0x40], "little")
    assert content[header : header + 4] == b"PE\0\0"
    machine = int.from_bytes(content[header + 4 : header + 6], "little")
    assert machine == {"windows-x64": 0x8664, "windows-arm64": 0xAA64}[name]  # of Microsoft's page
    imported = {item.lower() for item in re.findall(rb"[\w-]+\.dll(?=\0)", content, re.IGNORECASE)}
    system = {item for item in imported if item.startswith((b"kernel32", b"ucrtbase", b"api-ms-"))}
    assert imported - system <= {b"hfx_core.dll"}
