# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled library: building, lookup, refusal of unsuitable files, running without."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.engine.native import library as loading
from hfx_blender.engine.native import sources
from hfx_blender.export.batch import journal
from hfx_tools.bench import machine
from release import (
    native_build,
    native_wheel,
)

ROOT = Path(__file__).resolve().parents[3]

TARGET = native_build.this_target()
_GLIBC = re.compile(rb"GLIBC_([\d.]+)")


@pytest.fixture(scope="module")
def zig() -> Path:
    """Return the compiler, installed or downloaded."""
    try:
        return native_build.compiler()
    except native_build.BuildError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def built(zig: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the library for this computer."""
    if TARGET is None:
        pytest.skip("no library is built for this computer")
    return native_build.build(TARGET, tmp_path_factory.mktemp("native"), zig)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Return a function for a fresh load with ``library.py`` in ``tmp_path``: (state, library)."""
    monkeypatch.setattr(loading, "__file__", str(tmp_path / "library.py"))
    monkeypatch.delenv(loading.SWITCH, raising=False)
    return lambda: (loading.state(), loading.find_library()[0])


def test_the_build_gives_a_library_that_the_package_loads(
    built: Path, found: Any, tmp_path: Path
) -> None:
    assert found() == ("numpy (no library was built)", None)
    shutil.copy(built, tmp_path / loading.NAME)
    state, library = found()
    assert state == "compiled"
    assert library.hfx_build().decode().split()[:2] == ["hfx_native", sources.digest()]


def test_every_function_that_python_calls_is_exported(built: Path) -> None:
    engine = Path(loading.__file__).parents[1]
    wrappers = "\n".join(map(_text, engine.rglob("*.py")))
    bench = _text(Path(machine.__file__).with_name("volumes.py"))
    code = "\n".join(map(_text, sources.files()))
    structures = set(re.findall(r"\}\s*(hfx_\w+);", code))
    called = set(re.findall(r"[.\"](hfx_\w+)", wrappers)) - structures - {sources.MARK}
    called |= set(re.findall(r"loaded\(\)\.(hfx_\w+)", bench))
    matches = set(re.findall(r"HFX_EXPORT[^(]*?\b(hfx_\w+)", code))
    exported = ctypes.CDLL(str(built))
    assert "hfx_build" in called
    assert [name for name in called if not hasattr(exported, name)] == []
    assert matches == called, "exported, but nobody calls it"


# Unsuitable files are not loaded


@pytest.mark.parametrize("keep", [0, 3, 40, 0.3, 0.6, 0.99])
def test_a_damaged_file_is_not_loaded(built: Path, found: Any, tmp_path: Path, keep: float) -> None:
    content = built.read_bytes()
    cut = content[: int(keep * len(content)) if isinstance(keep, float) else keep]
    (tmp_path / loading.NAME).write_bytes(cut)
    state, library = found()
    assert library is None and state.startswith(f"numpy ({tmp_path / loading.NAME}: ")


def test_text_folders_and_unreadable_files_are_not_loaded(found: Any, tmp_path: Path) -> None:
    path = tmp_path / loading.NAME
    path.write_text("no library")
    assert found()[1] is None
    path.unlink()
    path.mkdir()
    assert found() == ("numpy (no library was built)", None)


def test_another_computers_library_is_not_loaded(zig: Path, found: Any, tmp_path: Path) -> None:
    foreign_target = next(
        target
        for target in native_build.TARGETS.values()
        if target.library == loading.NAME and target != TARGET
    )
    native_build.build(foreign_target, tmp_path, zig, _small(tmp_path / "project"))
    state, library = found()
    assert library is None and "numpy" in state


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (("// Description", "// description"), "other sources"),
        (("hfx_build(", "hfx_unknown("), "hfx_build"),
    ],
)
def test_a_library_of_another_state_is_not_loaded(
    zig: Path, found: Any, tmp_path: Path, text: tuple[str, str], reason: str
) -> None:
    root = _small(tmp_path / "project")
    changed = root / native_build.NATIVE / "source" / "interface.c"
    changed.write_text(_text(changed).replace(*text), encoding="utf-8")
    assert TARGET is not None
    native_build.build(TARGET, tmp_path, zig, root)
    state, library = found()
    assert library is None and reason in state


def test_the_switch_leaves_the_library_out(
    built: Path, found: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(built, tmp_path / loading.NAME)
    monkeypatch.setenv("HFX_NATIVE", "0")
    assert found() == ("numpy (HFX_NATIVE=0)", None)
    assert native_build.requirements(tmp_path) == []


def test_the_module_of_a_blender_extension_is_found(
    zig: Path, built: Path, found: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert TARGET is not None
    monkeypatch.setattr(
        native_build, "build", lambda target, folder, zig: Path(shutil.copy(built, folder))
    )
    wheel = native_wheel.make(TARGET, tmp_path / "wheels", zig)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    state, library = found()
    assert state == "compiled" and library._name.startswith(str(tmp_path / "site"))
    assert not any(name.startswith("hfx_native_") for name in sys.modules), "nothing is imported"
    monkeypatch.setattr(sources, "digest", lambda: "0123456789abcdef")
    assert found() == ("numpy (no library was built)", None)


def test_starting_the_package_loads_nothing() -> None:
    program = (
        "import sys, hfx_blender.engine.evaluate, hfx_blender.cli\n"
        "from hfx_blender.engine.native.library import library\n"
        "assert library.cache_info().currsize == 0, 'loaded at import'"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT)


# Reports of the state


def test_measurements_and_reports_name_the_engine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert journal.tools()["native"] is (loading.library() is not None)
    monkeypatch.setattr(loading, "find_library", lambda: (None, "numpy (of a test)"))
    assert machine.describe()["engine"] == "numpy (of a test)"
    assert "engine: numpy (of a test)" in machine.as_line(machine.describe())


# The build


@pytest.mark.parametrize("name", sorted(native_build.TARGETS))
def test_the_same_sources_give_the_same_bytes(name: str, zig: Path, tmp_path: Path) -> None:
    target = native_build.TARGETS[name]
    first, second = tmp_path / "one", tmp_path / "two"
    library = [native_build.build(target, item, zig, _small(item)) for item in (first, second)]
    assert library[0].read_bytes() == library[1].read_bytes()
    assert [path.name for path in first.iterdir() if path.is_file()] == [target.library]


def test_a_library_is_current_until_a_source_or_the_target_changes(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(loading.SWITCH, raising=False)
    assert TARGET is not None
    root = _copied(tmp_path)
    library = root / native_build.NATIVE / TARGET.library
    assert native_build.requirements(root) == [native_build.REQUIREMENT]
    shutil.copy(built, library)
    assert native_build.is_current(library, TARGET, root)
    assert native_build.requirements(root) == []
    assert not native_build.is_current(library, TARGET._replace(processor="x86_64_v3"), root)
    flags = root / native_build.NATIVE / "source" / "flags.txt"
    text = flags.read_bytes()
    flags.write_bytes(text.replace(b"\n", b"\r\n"))
    assert native_build.is_current(library, TARGET, root), "git's line ends are no change"
    flags.write_bytes(text + b"-O1\n")
    assert not native_build.is_current(library, TARGET, root)


def test_nothing_of_the_builder_gets_into_a_library(built: Path, tmp_path: Path) -> None:
    content = built.read_bytes()
    for word in (str(ROOT), str(Path.home()), "/tmp", "hfx_native_sources", ".zig"):
        assert word.encode() not in content, word


@pytest.mark.parametrize("name", sorted(native_build.TARGETS))
def test_each_platform_gets_its_library(zig: Path, built: Path, tmp_path: Path, name: str) -> None:
    """Linked against the system's C library only, of the release in the target's name."""
    target = native_build.TARGETS[name]
    library = built if target == TARGET else native_build.build(target, tmp_path, zig)
    content = library.read_bytes()
    heads = {"so": b"\x7fELF\x02", "dll": b"MZ", "dylib": b"\xcf\xfa\xed\xfe"}
    assert content.startswith(heads[target.library.rpartition(".")[2]])
    assert f"hfx_native {sources.digest()} {target.zig}".encode() in content
    assert {*re.findall(rb"[\w-]+\.dll", content)} - {b"hfx_native.dll"} <= {b"ucrtbase.dll"}
    if target.library.endswith(".so"):
        assert {*re.findall(rb"lib\w+\.so\.\d+", content)} == {b"libc.so.6", b"libm.so.6"}
        releases = [tuple(map(int, match.split(b"."))) for match in _GLIBC.findall(content)]
        assert releases and max(releases) <= (2, 17), "the wheel's tag says manylinux_2_17"
    assert (b"\xfa\xde\x0c\xc0" in content) is (name == "macos-arm64"), "it runs nothing unsigned"


def test_a_source_with_unknown_functions_is_refused(zig: Path, tmp_path: Path) -> None:
    root = _small(tmp_path / "project")
    source = root / native_build.NATIVE / "source" / "interface.c"
    more = "int hfx_absent(void);\nHFX_EXPORT int hfx_more(void) { return hfx_absent(); }\n"
    source.write_text(_text(source) + more, encoding="utf-8")
    for name in ("linux-x64", "windows-x64"):
        with pytest.raises(native_build.BuildError, match="hfx_absent"):
            native_build.build(native_build.TARGETS[name], tmp_path, zig, root)


def test_a_function_with_large_arrays_is_linked_on_windows(zig: Path, tmp_path: Path) -> None:
    """For large arrays on Windows, compilers insert a call to a stack probe."""
    root = _small(tmp_path / "project")
    source = root / native_build.NATIVE / "source" / "interface.c"
    more = """
HFX_EXPORT int64_t hfx_deep(int64_t n) {
  volatile int64_t many[99999];
  for (int64_t k = 0; k < n; ++k) many[k] = k;
  return many[n / 2];
}
"""
    source.write_text(_text(source) + more, encoding="utf-8")
    for name in ("windows-arm64", "windows-x64"):
        library = native_build.build(native_build.TARGETS[name], tmp_path, zig, root)
        assert b"hfx_deep" in library.read_bytes()


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _copied(root: Path) -> Path:
    """Copy the sources into a project without a library."""
    ignored = shutil.ignore_patterns("__pycache__", "*.so*", "*.dll", "*.dylib")
    shutil.copytree(ROOT / native_build.NATIVE, root / native_build.NATIVE, ignore=ignored)
    return root


def _small(root: Path) -> Path:
    """Return library sources reduced to two quickly compiled files."""
    for path in sources.files(_copied(root) / native_build.NATIVE / "source"):
        if path.suffix == ".c" and path.name not in ("interface.c", "windows.c"):
            path.unlink()
    return root
