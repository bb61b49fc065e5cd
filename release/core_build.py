# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation of the players' core as a library of ``hfx_tools``; run without options for this
system. The compiler is that of ``native_build``."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from release.native_build import NATIVE, ROOT, BuildError, Compiler, Target, compiler, this_target

FOLDER = Path("hfx_tools", "live_body")  # of the finished library
_SOURCE = Path("players", "native", "core_library.c")
_WINDOWS = Path(NATIVE, "source", "windows.c")  # entry point of a DLL, and growth of the stack
# The options of players/native/build.py, with sections for a small file; no trap, no stack guard.
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-g0", "-Wall", "-Wextra")
_FLAGS += ("-fno-sanitize=undefined", "-fno-stack-protector")


def library_name(target: Target) -> str:
    """File name of the library, as in ``hfx_tools/live_body/player_core.py``."""
    return target.library.replace("hfx_native", "hfx_core")


def mark(target: Target, root: Path = ROOT) -> str:
    """Text inside the library by which a file is recognised; BuildError without sources."""
    hasher = hashlib.sha256(" ".join(_FLAGS).encode())
    paths = [*_sources(target, root), *sorted(root.glob("players/core/*.h"))]
    for path in paths:
        try:
            text = path.read_bytes().replace(b"\r\n", b"\n")
        except OSError as error:
            raise BuildError(f"{path}: {error.strerror}") from error
        hasher.update(b"%s\0%d\0%s" % (path.name.encode(), len(text), text))
    return f"hfx_player_core {hasher.hexdigest()[:16]} {target.zig} {target.processor}"


def _sources(target: Target, root: Path) -> list[Path]:
    return [root / name for name in (_SOURCE, *[_WINDOWS] * target.is_windows)]


def is_current(library: Path, target: Target, root: Path = ROOT) -> bool:
    """Test that a file is the library of the current sources; False without a file."""
    try:
        return mark(target, root).encode() in library.read_bytes()
    except (OSError, BuildError):
        return False


def build(target: Target, folder: Path, zig: Path, root: Path = ROOT) -> Path:
    """Compile the library into a folder; an older library is replaced atomically.

    Raises
    ------
    BuildError
        The source does not compile or link, or a file cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="hfx_core_", ignore_cleanup_errors=True) as name:
            run = Compiler(zig, target, Path(name))
            header = Path(name, "hfx_core_build.h")
            header.write_text(f'#define HFX_CORE_BUILD "{mark(target, root)}"\n', encoding="utf-8")
            flags = [*_FLAGS, "-include", header.name]
            compiled = [run.compile(source, flags) for source in _sources(target, root)]
            linked = run.link(compiled, library_name(target))
            folder.mkdir(parents=True, exist_ok=True)
            new = folder / f"{library_name(target)}.new"  # on the folder's own disk
            new.write_bytes(linked.read_bytes())
            new.chmod(0o755)
            return new.replace(folder / library_name(target))
    except (OSError, subprocess.SubprocessError) as error:
        raise BuildError(str(error)) from error


if __name__ == "__main__":
    this = this_target()
    if this is None:
        raise SystemExit("No library is built for this computer.")
    sys.stdout.write(f"{build(this, ROOT / FOLDER, compiler())}\n")
