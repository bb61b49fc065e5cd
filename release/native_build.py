# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiles the library of ``hfx_blender/engine/native``: ``python native_build.py`` for this one.

The compiler is zig's, from the PyPI package ``ziglang``, on every system for every other one.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from release.native_interface import interface

ROOT = Path(__file__).resolve().parents[1]
NATIVE = Path("hfx_blender", "engine", "native")
SWITCH = "HFX_NATIVE"  # 0: build none, as the package then loads none

ZIG_VERSION = "0.17.1"  # another one may write other bytes
REQUIREMENT = f"ziglang=={ZIG_VERSION}"
FETCHED = ROOT / "build" / "zig"
_OLDEST_MACOS = (13, 0)  # that zig's wheels run on; what it builds runs on older ones

# By the library's ending. Nothing of the compiler's runtime, so only our sources are compiled. zig
# has the symbols of each system's C library, of glibc those of the release that a target names.
_LINKED = {
    "so": ["-lm", "-lc", "-Wl,-z,defs", "-Wl,-soname,{}"],
    "dylib": ["-Wl,-install_name,{}"],
    "dll": ["-lucrtbase"],
}


class BuildError(Exception):
    """The library cannot be compiled."""


class Target(NamedTuple):
    """A kind of computer: how zig, wheels and Python's ``ctypes`` call it.

    Processors are the oldest that Blender 4.2 runs on: SSE 4.2 on x86-64.
    """

    zig: str
    processor: str
    wheel: str

    @property
    def library(self) -> str:
        """The file's name, as ``engine/native/library.py`` looks for it."""
        ends = {"macosx": "dylib", "win": "dll"}
        return f"hfx_native.{ends.get(self.wheel.partition('_')[0], 'so')}"

    @property
    def is_windows(self) -> bool:
        return self.wheel.startswith("win_")

    @property
    def options(self) -> list[str]:
        return ["-target", self.zig, f"-mcpu={self.processor}"]


# By Blender's names of platforms. Releases of systems are the oldest that zig can name and that
# Blender 4.2, or the module bpy, runs on.
TARGETS = {
    "linux-arm64": Target("aarch64-linux-gnu.2.17", "generic", "manylinux_2_17_aarch64"),
    "linux-x64": Target("x86_64-linux-gnu.2.17", "x86_64_v2", "manylinux_2_17_x86_64"),
    "macos-arm64": Target("aarch64-macos.11.0", "apple_m1", "macosx_11_0_arm64"),
    "macos-x64": Target("x86_64-macos.10.15", "x86_64_v2", "macosx_10_15_x86_64"),
    "windows-arm64": Target("aarch64-windows-gnu", "generic", "win_arm64"),
    "windows-x64": Target("x86_64-windows-gnu", "x86_64_v2", "win_amd64"),
}


def this_target() -> Target | None:
    """Target of the running Python, if it is one that we build for."""
    system, _, machine = sysconfig.get_platform().partition("-")
    systems = {"linux": "linux", "macosx": "macos", "win": "windows"}
    if system == "macosx":
        machine = platform.machine()  # a universal Python tells of both
    machines = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64", "arm64": "arm64"}
    return TARGETS.get(f"{systems.get(system)}-{machines.get(machine)}")


def requirements(root: Path = ROOT) -> list[str]:
    """Requirements of an installation from ``root`` beside its build backend: the compiler, or
    nothing.

    Nothing where no library is wanted or can be made, or the one that is there is current.
    """
    target = this_target()
    if target is None or not wanted():
        return []
    if sys.platform == "darwin" and _macos_release() < _OLDEST_MACOS:
        return []
    return [] if is_current(root / NATIVE / target.library, target, root) else [REQUIREMENT]


def wanted() -> bool:
    """Test that the environment does not disable the library."""
    return os.environ.get(SWITCH) != "0"


def digest(root: Path = ROOT) -> str:
    """Digest of the C sources, as the package computes it.

    Raises
    ------
    BuildError
        There are no sources.
    """
    found = _sources(root).digest()
    if found is None:
        raise BuildError(f"{root / NATIVE}: there are no sources")
    return str(found)


def is_current(library: Path, target: Target, root: Path = ROOT) -> bool:
    """Test that a file is the library of the present sources, for this target."""
    try:
        return mark(target, root).encode() in library.read_bytes()
    except OSError:
        return False


def compiler() -> Path:
    """The program ``zig`` of the package ``ziglang``, installed or fetched by ``build_addon.py``.

    Raises
    ------
    BuildError
        It is not there, or is another version.
    """
    spec = importlib.util.find_spec("ziglang")
    folders = [*((spec and spec.submodule_search_locations) or ()), FETCHED / "ziglang"]
    fault = "there is no compiler"
    for path in (Path(each, f"zig{'.exe' * (sys.platform == 'win32')}") for each in folders):
        if path.is_file():
            version = _version(path)
            if version == ZIG_VERSION:
                return path
            fault = f"{path} is version {version}, not {ZIG_VERSION}"
    raise BuildError(f"{fault}; python -m pip install {REQUIREMENT}")


def _version(zig: Path) -> str:
    try:
        told = subprocess.run([zig, "version"], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.SubprocessError) as error:
        return f"unknown ({error})"
    return told.stdout.strip() or "unknown"


def fetched_compiler(say: Callable[[str], None]) -> Path:
    """Compiler, fetched by pip into ``build/zig`` if it is not there.

    Raises
    ------
    BuildError
        pip cannot get it.
    """
    try:
        return compiler()
    except BuildError:
        say(f"Fetching the compiler, {REQUIREMENT} (100 MB, once)")
    command = [sys.executable, "-P", "-m", "pip", "install", "--quiet", "--no-deps", "--no-compile"]
    command += ["--disable-pip-version-check", "--only-binary=:all:", "--upgrade"]
    done = subprocess.run(
        [*command, "--target", str(FETCHED), REQUIREMENT], capture_output=True, text=True
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["pip said nothing"])[-1]
        raise BuildError(f"pip cannot fetch {REQUIREMENT}: {last}")
    return compiler()


def build(target: Target, folder: Path, zig: Path, root: Path = ROOT) -> Path:
    """Compile the library into a folder, where it replaces an older one as a whole.

    Parameters
    ----------
    target : Target
    folder : Path
        Of the finished library; everything else is written to a temporary folder.
    zig : Path
        See :func:`compiler`.
    root : Path
        The project.

    Raises
    ------
    BuildError
        A source is faulty or calls what no C library has, or a file cannot be written.
    """
    sources = _sources(root)
    try:
        with tempfile.TemporaryDirectory(prefix="hfx_native_", ignore_cleanup_errors=True) as name:
            work = Path(name)
            run = _Compiler(zig, target, work)
            header = work / "hfx_build.h"
            declared = json.dumps(interface(sources.files()))  # a string in C, too
            told = f'#define HFX_BUILD "{mark(target, root)}"\n#define HFX_INTERFACE {declared}\n'
            header.write_text(told, encoding="utf-8")
            flags = [*_flags(sources.FOLDER), "-include", header.name, f"-I{sources.FOLDER}"]
            paths = [path for path in sources.files() if path.suffix == ".c"]
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                objects = list(pool.map(lambda path: run.compile(path, flags), paths))
            made = run.link(objects)
            folder.mkdir(parents=True, exist_ok=True)
            new = folder / f"{target.library}.new"  # on the folder's own disk
            new.write_bytes(made.read_bytes())
            new.chmod(0o755)
            return new.replace(folder / target.library)
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        raise BuildError(str(error)) from error


class _Compiler(NamedTuple):
    """Compiler of one target, working in a temporary folder."""

    zig: Path
    target: Target
    work: Path

    def compile(self, source: Path, flags: Iterable[str]) -> str:
        made = f"{source.stem}.o"
        position = [] if self.target.is_windows else ["-fPIC"]
        self("-c", str(source), "-o", made, *flags, *position)
        return made

    def link(self, objects: Sequence[str]) -> Path:
        made = self.target.library
        options = [each.format(made) for each in _LINKED[made.rpartition(".")[2]]]
        self("-shared", "-nostdlib", "-s", "-o", made, *objects, *options)
        return self.work / made

    def __call__(self, *arguments: str) -> None:
        cache = str(self.work / "cache")  # never in the tree, and none is left behind
        done = subprocess.run(
            [str(self.zig), "cc", *self.target.options, *arguments],
            cwd=self.work,
            env={
                **os.environ,
                "ZIG_GLOBAL_CACHE_DIR": cache,
                "ZIG_LOCAL_CACHE_DIR": cache,
                "SOURCE_DATE_EPOCH": "0",  # a DLL holds when it was linked: the same bytes always
            },
            capture_output=True,
            text=True,
            errors="replace",
            timeout=900,
        )
        if done.returncode:
            raise BuildError((done.stderr or done.stdout).strip() or "the compiler said nothing")


def _flags(folder: Path) -> list[str]:
    lines = (folder / "flags.txt").read_text(encoding="utf-8").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.startswith("#")]


def mark(target: Target, root: Path) -> str:
    """Mark of the library, by which it is recognised without being loaded."""
    return f"{_sources(root).MARK} {digest(root)} {target.zig} {target.processor}"


def _sources(root: Path) -> Any:
    """The module ``sources`` of the package, which may be installed nowhere and lack numpy."""
    path = root / NATIVE / "sources.py"
    spec = importlib.util.spec_from_file_location("hfx_native_sources", path)
    if spec is None or spec.loader is None:
        raise BuildError(f"{path} is missing")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _macos_release() -> tuple[int, ...]:
    return tuple(int(part) for part in platform.mac_ver()[0].split(".")[:2] if part.isdigit())


def main() -> int:
    parser = argparse.ArgumentParser(description="Compile the library of engine/native.")
    parser.add_argument(
        "--platform", choices=TARGETS, help="for which computers (default: this one)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="default: beside engine/native/library.py"
    )
    options = parser.parse_args()
    target = TARGETS.get(options.platform) or this_target()
    if target is None:
        sys.stderr.write("No library is built for this computer; name a --platform.\n")
        return 2
    try:
        made = build(target, options.output or ROOT / NATIVE, compiler())
    except BuildError as error:
        sys.stderr.write(f"{error}\n")
        return 3
    sys.stdout.write(f"{made} ({made.stat().st_size} bytes)\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
