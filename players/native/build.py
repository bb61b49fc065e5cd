# SPDX-License-Identifier: MIT
"""Compile the core as a library for Linux, Windows, macOS and Android, for Godot and for Unity.

``python players/native/build.py [PLATFORM ...]`` needs the compiler of ``pip install ziglang``,
and writes into ``godot/addons/hfx/bin`` and ``unity/Runtime/Plugins``. A platform that fails loses
its library, the others are built; the exit code is 1 then, and 2 for an unknown platform.
"""

import hashlib
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
GODOT = HERE.parent / "godot" / "addons" / "hfx" / "bin"
UNITY = HERE.parent / "unity" / "Runtime" / "Plugins"
SOURCES = ("live_body.c", "live_player.c", "godot.c")

# Platform, as Godot names it: zig's targets, file, Unity's editor, player and processor.
PLATFORMS = {
    "linux.x86_64": (["x86_64-linux-gnu.2.17"], "libhfx_haptics.so", "Linux", "Linux64", "x86_64"),
    "linux.arm64": (["aarch64-linux-gnu.2.17"], "libhfx_haptics.so", None, None, None),
    "windows.x86_64": (["x86_64-windows-gnu"], "hfx_haptics.dll", "Windows", "Win64", "x86_64"),
    "macos": (
        ["x86_64-macos", "aarch64-macos"],
        "libhfx_haptics.dylib",
        *("OSX", "OSXUniversal", "AnyCPU"),
    ),
    "android.arm64": (["aarch64-linux-android"], "libhfx_haptics.so", None, "Android", "ARM64"),
}
# Without errno and traps of numbers, square roots and choices become vector instructions.
OPTIMIZED = "-std=c99 -O2 -fno-math-errno -fno-trapping-math"
FLAGS = f"{OPTIMIZED} -Wall -Wextra -Werror -Wno-unused-function -fvisibility=hidden".split()

# Functions of Android's libc.so and libm.so. zig has no libc of Android: the sources are compiled
# with the headers of musl, which declare them alike, and linked to libraries with only these names.
ANDROID = {
    "libc.so": "malloc calloc free memcpy memset memmove",
    "libm.so": "sqrt floor ceil fabs exp log pow sin sqrtf fabsf",
}

GDEXTENSION = """\
[configuration]

entry_symbol = "hfx_haptics_begin"
compatibility_minimum = "4.2"

[libraries]

"""
UID = "uid://bhfxhapticsb\n"  # of the file above, as Godot would draw one

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
"""
EDITOR = """\
  - first:
      Editor: Editor
    second:
      enabled: 1
      settings:
        CPU: {processor}
        OS: {editor}
"""
PLAYER = """\
  - first:
      {group}
    second:
      enabled: 1
      settings:
        CPU: {processor}
"""


FOLDER = """\
fileFormatVersion: 2
guid: {guid}
folderAsset: yes
DefaultImporter:
  externalObjects: {{}}
  userData:
  assetBundleName:
  assetBundleVariant:
"""


def main() -> int:
    platforms = sys.argv[1:] or list(PLATFORMS)
    unknown = [name for name in platforms if name not in PLATFORMS]
    if unknown:
        known = ", ".join(PLATFORMS)
        sys.stderr.write(f"Unknown platform {unknown[0]!r}; allowed are {known}.\n")
        return 2
    for folder in (*GODOT.glob("*/"), *UNITY.glob("*/")):  # of an older version of this file
        if folder.name not in PLATFORMS:
            shutil.rmtree(folder)
            folder.with_name(f"{folder.name}.meta").unlink(missing_ok=True)
    failed = [platform for platform in platforms if not build(platform)]
    GODOT.mkdir(parents=True, exist_ok=True)
    built = [name for name in PLATFORMS if (GODOT / name / PLATFORMS[name][1]).is_file()]
    lines = [f'{name} = "{name}/{PLATFORMS[name][1]}"\n' for name in built]
    (GODOT / "hfx.gdextension").write_text(GDEXTENSION + "".join(lines), encoding="utf-8")
    (GODOT / "hfx.gdextension.uid").write_text(UID, encoding="utf-8")
    if failed:
        sys.stderr.write(f"Not built: {', '.join(failed)}.\n")
    return 1 if failed else 0


def build(platform: str) -> bool:
    """Compile the library for one platform into the folders of Godot and, if supported, Unity.
    False if the compiler failed; the folders have no library of the platform then."""
    targets, name, editor, player, processor = PLATFORMS[platform]
    folder_meta = UNITY / f"{platform}.meta"
    folder_meta.unlink(missing_ok=True)
    for folder in (GODOT / platform, UNITY / platform):
        shutil.rmtree(folder, ignore_errors=True)
    with tempfile.TemporaryDirectory() as temporary:
        library = Path(temporary, name)
        parts = [Path(temporary, target, name) for target in targets]
        try:
            for target, part in zip(targets, parts, strict=True):
                compile_for(target, part)
        except (subprocess.SubprocessError, OSError) as error:
            sys.stderr.write(f"{platform}: {error}\n")
            return False
        library.write_bytes(universal([part.read_bytes() for part in parts]))
        copy(library, GODOT / platform / name)
        sys.stdout.write(f"{GODOT / platform / name}\n")
        if player is None:  # Unity has no such player
            return True
        copy(library, UNITY / platform / name)
    # Unity leaves out folders without a meta file in packages that come from git or a tarball.
    UNITY.with_name("Plugins.meta").write_text(FOLDER.format(guid=guid_of("Plugins")), "utf-8")
    folder_meta.write_text(FOLDER.format(guid=guid_of(platform)), "utf-8")
    text = META.format(guid=guid_of(f"{platform}/{name}"))
    if editor:
        text += EDITOR.format(processor=processor, editor=editor)
    group = f"Standalone: {player}" if editor else f"{player}: {player}"
    text += PLAYER.format(group=group, processor=processor)
    (UNITY / platform / f"{name}.meta").write_text(text, encoding="utf-8")
    return True


def guid_of(path: str) -> str:
    """Unity's identity of a file or folder of the plug-ins, the same in each build."""
    return hashlib.md5(path.encode(), usedforsecurity=False).hexdigest()


def copy(library: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(library, target)


def compile_for(target: str, library: Path) -> None:
    """Compile the sources for a target of zig. Raises CalledProcessError if that fails."""
    library.parent.mkdir()
    sources = [str(HERE / name) for name in SOURCES]
    options = [*FLAGS, "-fno-sanitize=undefined"]
    shared = ["-shared", "-s", "-o", str(library)]
    if "android" in target:
        link_for_android(sources, options, library)
    elif "windows" in target:
        zig("cc", "-target", target, *options, *shared, *sources)
    else:
        if "macos" in target:
            shared.append(f"-Wl,-install_name,@rpath/{library.name}")
        zig("cc", "-target", target, *options, *shared, "-fPIC", "-lm", *sources)


def link_for_android(sources: list[str], options: list[str], library: Path) -> None:
    musl = ["-target", "aarch64-linux-musl", "-fPIC"]
    folder = library.parent
    objects = []
    for source in sources:
        objects.append(str(folder / f"{Path(source).stem}.o"))
        zig("cc", *musl, *options, "-fno-stack-protector", "-c", source, "-o", objects[-1])
    for name, functions in ANDROID.items():
        stub = folder / f"{name}.c"
        lines = [f"void {function}(void) {{}}\n" for function in functions.split()]
        stub.write_text("".join(lines), encoding="utf-8")
        quiet = ["-fno-builtin", "-w", "-nostdlib", "-shared", f"-Wl,-soname,{name}"]
        zig("cc", *musl, *quiet, str(stub), "-o", str(folder / name))
    pages = ["-z", "max-page-size=16384", "--no-undefined", "--hash-style=both"]
    names = ["-soname", library.name, "-L", str(folder), "-lc", "-lm"]
    zig("ld.lld", "-shared", "-s", *pages, *objects, *names, "-o", str(library))


def zig(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "ziglang", *arguments], check=True, timeout=1800)


def universal(parts: list[bytes]) -> bytes:
    """Join Mach-O files of several processors into a universal one; one file stays as it is."""
    if len(parts) == 1:
        return parts[0]
    alignment = 14  # a power of two: pages of 16 KiB
    table, content = struct.pack(">II", 0xCAFEBABE, len(parts)), b""
    at = 1 << alignment
    for part in parts:
        processor, kind = struct.unpack_from("<II", part, 4)
        table += struct.pack(">IIIII", processor, kind, at, len(part), alignment)
        padded = part + bytes(-len(part) % (1 << alignment))
        content += padded
        at += len(padded)
    return table + bytes((1 << alignment) - len(table)) + content


if __name__ == "__main__":
    sys.exit(main())
