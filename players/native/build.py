# SPDX-License-Identifier: MIT
"""Compile the core as a library for Linux, Windows and macOS, for Godot and for Unity.

``python players/native/build.py [PLATFORM ...]`` needs the compiler of ``pip install ziglang``,
and writes into ``godot/addons/hfx/bin`` and ``unity/Runtime/Plugins``.
"""

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
GODOT = HERE.parent / "godot" / "addons" / "hfx" / "bin"
UNITY = HERE.parent / "unity" / "Runtime" / "Plugins"
SOURCES = ("live_body.c", "live_player.c", "godot.c")

# Platform: zig's target, file, Unity's editor, player and processor.
PLATFORMS = {
    "linux.x86_64": ("x86_64-linux-gnu.2.17", "libhfx_haptics.so", "Linux", "Linux64", "x86_64"),
    "linux.arm64": ("aarch64-linux-gnu.2.17", "libhfx_haptics.so", None, None, None),
    "windows.x86_64": ("x86_64-windows-gnu", "hfx_haptics.dll", "Windows", "Win64", "x86_64"),
    "macos.x86_64": ("x86_64-macos", "libhfx_haptics.dylib", "OSX", "OSXUniversal", "x86_64"),
    "macos.arm64": ("aarch64-macos", "libhfx_haptics.dylib", "OSX", "OSXUniversal", "ARM64"),
}
OPTIMIZED = "-std=c99 -O2 -fno-math-errno"  # without errno, square roots become vector instructions
FLAGS = f"{OPTIMIZED} -Wall -Wextra -Werror -Wno-unused-function -fvisibility=hidden".split()

GDEXTENSION = """\
[configuration]

entry_symbol = "hfx_haptics_begin"
compatibility_minimum = "4.2"

[libraries]

"""

META = """\
fileFormatVersion: 2
guid: {guid}
PluginImporter:
  serializedVersion: 2
  isPreloaded: 0
  platformData:
  - first:
      Any:
    second:
      enabled: 0
      settings: {{}}
  - first:
      Editor: Editor
    second:
      enabled: 1
      settings:
        CPU: {processor}
        OS: {editor}
  - first:
      Standalone: {player}
    second:
      enabled: 1
      settings:
        CPU: {processor}
"""


def main() -> None:
    for platform in sys.argv[1:] or PLATFORMS:
        build(platform)
    built = [(name, facts[1]) for name, facts in PLATFORMS.items() if (GODOT / name).is_dir()]
    lines = [f'{platform} = "{platform}/{name}"\n' for platform, name in built]
    (GODOT / "hfx.gdextension").write_text(GDEXTENSION + "".join(lines), encoding="utf-8")


def build(platform: str) -> None:
    """Compile the library for one platform into the folders of Godot and, if supported, Unity."""
    target, name, editor, player, processor = PLATFORMS[platform]
    library = GODOT / platform / name
    library.parent.mkdir(parents=True, exist_ok=True)
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", target, *FLAGS]
    compiler += ["-fno-sanitize=undefined", "-shared", "-s", "-o", str(library)]
    if "windows" not in target:
        compiler += ["-fPIC", "-lm"]
    sources = [str(HERE / name_) for name_ in SOURCES]
    subprocess.run([*compiler, *sources], check=True, timeout=600)
    library.with_suffix(".lib").unlink(missing_ok=True)  # import library of Windows, unused
    sys.stdout.write(f"{library}\n")
    if editor is None:  # Unity has no such editor
        return
    plugin = UNITY / platform / name
    plugin.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(library, plugin)
    guid = hashlib.md5(f"{platform}/{name}".encode(), usedforsecurity=False).hexdigest()
    facts = {"guid": guid, "editor": editor, "player": player, "processor": processor}
    plugin.with_name(name + ".meta").write_text(META.format(**facts), encoding="utf-8")


if __name__ == "__main__":
    main()
