# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation of the library of ``hfx_blender/engine/native``; run without options for this system.

The compiler is zig, from the PyPI package ``ziglang``, a cross compiler for all systems.
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
SWITCH = "HFX_NATIVE"  # 0: do not build; the package does not load a library then

ZIG_VERSION = "0.17.1"  # another version may write other bytes
REQUIREMENT = f"ziglang=={ZIG_VERSION}"
FETCHED = ROOT / "build" / "zig"
_OLDEST_MACOS = (13, 0)  # oldest for zig's wheels; the compiled library runs on older systems

# By the library's suffix. No compiler runtime, so only this project's sources are compiled. zig has
# the symbols of each system's C library; for glibc, of the release in the target's name.
_LINKED = {
    "so": ["-lm", "-lc", "-Wl,-z,defs", "-Wl,-soname,{}"],
    "dylib": ["-Wl,-install_name,{}"],
    "dll": ["-lucrtbase"],
}


# Options of the system's compiler, which has the runtime of these checks; zig lacks it.
_SANITIZED = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


class BuildError(Exception):
    """The library cannot be compiled."""


class Target(NamedTuple):
    """Kind of computer, by zig's target and processor and the wheels' platform tag.

    Processors are the oldest supported by Blender 4.2: SSE 4.2 on x86-64.
    """

    zig: str
    processor: str
    wheel: str

    @property
    def library(self) -> str:
        """File name of the library, as in ``engine/native/library.py``."""
        ends = {"macosx": "dylib", "win": "dll"}
        return f"hfx_native.{ends.get(self.wheel.partition('_')[0], 'so')}"

    @property
    def is_windows(self) -> bool:
        return self.wheel.startswith("win_")

    @property
    def options(self) -> list[str]:
        return ["-target", self.zig, f"-mcpu={self.processor}"]


# By Blender's names of platforms. Releases of systems are the oldest supported by zig's targets and
# by Blender 4.2 or the module bpy.
TARGETS = {
    "linux-arm64": Target("aarch64-linux-gnu.2.17", "generic", "manylinux_2_17_aarch64"),
    "linux-x64": Target("x86_64-linux-gnu.2.17", "x86_64_v2", "manylinux_2_17_x86_64"),
    "macos-arm64": Target("aarch64-macos.11.0", "apple_m1", "macosx_11_0_arm64"),
    "macos-x64": Target("x86_64-macos.10.15", "x86_64_v2", "macosx_10_15_x86_64"),
    "windows-arm64": Target("aarch64-windows-gnu", "generic", "win_arm64"),
    "windows-x64": Target("x86_64-windows-gnu", "x86_64_v2", "win_amd64"),
}


def this_target() -> Target | None:
    """Target of the running Python; None without a supported one."""
    system, _, machine = sysconfig.get_platform().partition("-")
    systems = {"linux": "linux", "macosx": "macos", "win": "windows"}
    if system == "macosx":
        machine = platform.machine()  # a universal Python names both machines
    machines = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64", "arm64": "arm64"}
    return TARGETS.get(f"{systems.get(system)}-{machines.get(machine)}")


def requirements(root: Path = ROOT) -> list[str]:
    """Build requirements of an installation from ``root``: the compiler, or an empty list.

    Empty if the library is disabled, unsupported or current.
    """
    target = this_target()
    if target is None or not has_compiler():
        return []
    return [] if is_current(root / NATIVE / target.library, target, root) else [REQUIREMENT]


def has_compiler() -> bool:
    """Test that libraries are wanted, and that the compiler exists for this system."""
    return wanted() and (sys.platform != "darwin" or _macos_release() >= _OLDEST_MACOS)


def wanted() -> bool:
    """Test that the environment variable does not disable the library."""
    return os.environ.get(SWITCH) != "0"


def digest(root: Path = ROOT) -> str:
    """Digest of the C sources, computed like in the package.

    Raises
    ------
    BuildError
        The sources are missing.
    """
    value = _sources(root).digest()
    if value is None:
        raise BuildError(f"{root / NATIVE}: there are no sources")
    return str(value)


def is_current(library: Path, target: Target, root: Path = ROOT) -> bool:
    """Test that a file is the library of the current sources for a target; False without a file."""
    try:
        return mark(target, root).encode() in library.read_bytes()
    except OSError:
        return False


def compiler() -> Path:
    """Find the program ``zig`` of the package ``ziglang``, installed or fetched.

    Raises
    ------
    BuildError
        The program is missing, or is another version.
    """
    spec = importlib.util.find_spec("ziglang")
    folders = [*((spec and spec.submodule_search_locations) or ()), FETCHED / "ziglang"]
    fault = "there is no compiler"
    for path in (Path(folder, f"zig{'.exe' * (sys.platform == 'win32')}") for folder in folders):
        if path.is_file():
            version = _version(path)
            if version == ZIG_VERSION:
                return path
            fault = f"{path} is version {version}, not {ZIG_VERSION}"
    raise BuildError(f"{fault}; python -m pip install {REQUIREMENT}")


def _version(zig: Path) -> str:
    try:
        completed = subprocess.run([zig, "version"], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.SubprocessError) as error:
        return f"unknown ({error})"
    return completed.stdout.strip() or "unknown"


def fetched_compiler(say: Callable[[str], None]) -> Path:
    """Find the compiler, fetched by pip into ``build/zig`` if missing.

    Raises
    ------
    BuildError
        pip fails.
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


def build(
    target: Target, folder: Path, zig: Path, root: Path = ROOT, *, is_sanitized: bool = False
) -> Path:
    """Compile the library into a folder; an older library is replaced atomically.

    Parameters
    ----------
    folder : Path
        Folder of the finished library; all other files go to a temporary folder.
    zig : Path
        See :func:`compiler`.
    root : Path
        Root of the project.
    is_sanitized : bool
        True for a library that ends the process at an access beyond an array and at undefined
        behaviour. ``zig`` is then the system's C compiler.

    Raises
    ------
    BuildError
        A source does not compile or link, or a file cannot be written.
    """
    sources = _sources(root)
    kind = SanitizingCompiler if is_sanitized else Compiler
    try:
        with tempfile.TemporaryDirectory(prefix="hfx_native_", ignore_cleanup_errors=True) as name:
            work = Path(name)
            run = kind(zig, target, work)
            header = work / "hfx_build.h"
            declared = json.dumps(interface(sources.files()))  # a string in C, too
            defines = (
                f'#define HFX_BUILD "{mark(target, root)}"\n#define HFX_INTERFACE {declared}\n'
            )
            header.write_text(defines, encoding="utf-8")
            flags = [*_flags(sources.FOLDER), "-include", header.name, f"-I{sources.FOLDER}"]
            paths = [path for path in sources.files() if path.suffix == ".c"]
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                objects = list(pool.map(lambda path: run.compile(path, flags), paths))
            linked = run.link(objects, target.library)
            folder.mkdir(parents=True, exist_ok=True)
            new = folder / f"{target.library}.new"  # on the folder's own disk
            new.write_bytes(linked.read_bytes())
            new.chmod(0o755)
            return new.replace(folder / target.library)
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        raise BuildError(str(error)) from error


class Compiler(NamedTuple):
    """Compiler for a target, working in a temporary folder."""

    zig: Path
    target: Target
    work: Path

    def compile(self, source: Path, flags: Iterable[str]) -> str:
        object_name = f"{source.stem}.o"
        position = [] if self.target.is_windows else ["-fPIC"]
        self("-c", str(source), "-o", object_name, *flags, *position)
        return object_name

    def link(self, objects: Sequence[str], library: str) -> Path:
        options = [option.format(library) for option in _LINKED[library.rpartition(".")[2]]]
        self("-shared", "-nostdlib", "-s", "-o", library, *objects, *options)
        return self.work / library

    def __call__(self, *arguments: str) -> None:
        cache = str(self.work / "cache")  # removed with the temporary folder
        self._run(
            [str(self.zig), "cc", *self.target.options, *arguments],
            {
                **os.environ,
                "ZIG_GLOBAL_CACHE_DIR": cache,
                "ZIG_LOCAL_CACHE_DIR": cache,
                "SOURCE_DATE_EPOCH": "0",  # a DLL contains its time of linking: equal bytes
            },
        )

    def _run(self, command: Sequence[str], environment: dict[str, str] | None = None) -> None:
        """Run a compiler in the temporary folder; its messages become a BuildError."""
        done = subprocess.run(
            command,
            cwd=self.work,
            env=environment,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=900,
        )
        if done.returncode:
            raise BuildError((done.stderr or done.stdout).strip() or "the compiler said nothing")


class SanitizingCompiler(Compiler):
    """The system's C compiler, with checks of memory and of undefined behaviour."""

    def __call__(self, *arguments: str) -> None:
        # These would end the checks, or the use of the runtime library of the checks.
        unfit = {"-fno-sanitize=undefined", "-g0", "-nostdlib", "-Wl,-z,defs"}
        fitting = [argument for argument in arguments if argument not in unfit]
        self._run([str(self.zig), *fitting, *_SANITIZED])


def _flags(folder: Path) -> list[str]:
    lines = (folder / "flags.txt").read_text(encoding="utf-8").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.startswith("#")]


def mark(target: Target, root: Path) -> str:
    """Mark inside the library file, for recognition without loading."""
    return f"{_sources(root).MARK} {digest(root)} {target.zig} {target.processor}"


def _sources(root: Path) -> Any:
    """Load the package's module ``sources`` by path: package and numpy may be not installed."""
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
        "--platform", choices=TARGETS, help="platform of the library (default: this computer)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="default: folder of engine/native/library.py",
    )
    parser.add_argument(
        "--sanitize",
        action="store_true",
        help="for a test of the sources: compile by cc, with checks of memory and behaviour",
    )
    options = parser.parse_args()
    target = TARGETS.get(options.platform) or this_target()
    if target is None:
        sys.stderr.write("No library is built for this computer; name a --platform.\n")
        return 2
    try:
        zig = Path("cc") if options.sanitize else compiler()
        folder = options.output or ROOT / NATIVE
        if options.sanitize:
            target = target._replace(zig="sanitized")  # another mark: installations replace it
        library = build(target, folder, zig, is_sanitized=options.sanitize)
    except BuildError as error:
        sys.stderr.write(f"{error}\n")
        return 3
    sys.stdout.write(f"{library} ({library.stat().st_size} bytes)\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
