# SPDX-License-Identifier: GPL-3.0-or-later
"""Zip of Godot's add-on for its Asset Library: ``python release/godot_zip.py [FOLDER]``.

Writes ``hfx-godot-VERSION.zip`` into FOLDER (default ``dist``), with the add-on at ``addons/hfx``.
Needs the libraries of all platforms, by ``python players/native/build.py``; the exit code is 1 if
one is missing.
"""

from __future__ import annotations

import configparser
import re
import sys
from pathlib import Path

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from release.archives import write_zip

ROOT = Path(__file__).resolve().parents[1]
ADDON = ROOT / "players" / "godot" / "addons" / "hfx"
PLATFORMS = ("linux.x86_64", "linux.arm64", "windows.x86_64", "macos", "android.arm64")
_SUFFIXES = {
    *(".gd", ".uid", ".svg", ".cfg", ".md", ".tscn", ".hfxclip"),
    *(".gdextension", ".so", ".dll", ".dylib"),
}


def files(addon: Path = ADDON) -> dict[str, Path]:
    """Files of the zip: name in the zip -> file."""
    # The library for Windows has the start-up code of Mingw-w64, whose licence travels along.
    licence = {"addons/hfx/LICENSE-mingw_w64.txt": ROOT / "licences" / "mingw_w64.txt"}
    return licence | {
        f"addons/hfx/{path.relative_to(addon).as_posix()}": path
        for path in sorted(addon.rglob("*"))
        if path.is_file() and (path.suffix in _SUFFIXES or path.name == "LICENSE")
    }


def missing(addon: Path = ADDON) -> list[str]:
    """Platforms without a library in ``bin``, and scripts without a ``.uid`` file."""
    listed = (addon / "bin" / "hfx.gdextension").read_text() if (addon / "bin").is_dir() else ""
    libraries = dict(re.findall(r'^(\S+) = "(\S+)"$', listed, re.MULTILINE))
    absent = [
        name
        for name in PLATFORMS
        if name not in libraries or not (addon / "bin" / libraries[name]).is_file()
    ]
    scripts = sorted(addon.rglob("*.gd"))
    return absent + [f"{path.name}.uid" for path in scripts if not Path(f"{path}.uid").is_file()]


def version(addon: Path = ADDON) -> str:
    plugin = configparser.ConfigParser()
    plugin.read(addon / "plugin.cfg", encoding="utf-8")
    return plugin["plugin"]["version"].strip('"')


def write(folder: Path, addon: Path = ADDON) -> Path:
    """Write the zip; equal files give equal bytes."""
    target = folder / f"hfx-godot-{version(addon)}.zip"
    return write_zip(target, {name: path.read_bytes() for name, path in files(addon).items()})


def main() -> int:
    absent = missing()
    if absent:
        sys.stderr.write(
            f"Missing: {', '.join(absent)}. Run python players/native/build.py for libraries, and "
            "open players/godot once in Godot for .uid files.\n"
        )
        return 1
    target = write(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "dist")
    sys.stdout.write(f"{target}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
