# SPDX-License-Identifier: MIT
"""Make the package ``dist/hfx.js``, with the core in it, and pages of one file.

``dist/hfx.js`` is kept in the repository, so that a page needs no compiler; its third line is the
fingerprint of the core's sources, which a test compares.

``dist/garage.html`` plays the garage of HFX's demo, and ``dist/board.html`` is the board of the map
paper, on the phone that shows it.

``python players/web/build.py [FOLDER]`` needs the compiler of ``pip install ziglang``, and writes
into FOLDER instead of ``dist`` if it is given.
"""

import base64
import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PHONE_PAGE = HERE.parents[1] / "hfx_blender" / "devices" / "transports" / "phone_page.html"
MODULES = ("core", "clip", "player", "bones", "body", "surface", "outputs", "loop")  # as imported
SAMPLES = {"garage": "addons/hfx/samples/garage.hfxclip", "board": "board/board.hfxclip"}
EXPORTS = """
export {
  GamepadHaptics, HapticBody, HapticClip, HapticError, HapticLoop, HapticPlayer, HapticSurface,
  HapticVolume, PhoneHaptics, XRHaptics, isDevice,
};
"""
LICENSE = "// SPDX-License-Identifier: MIT\n// Made by players/web/build.py of HFX for Blender.\n"
TARGET = "-target wasm32-wasi -mexec-model=reactor -std=c99 -Os -msimd128 -fno-math-errno"
WARNINGS = "-Wall -Wextra -Werror -Wno-unused-function -fno-sanitize=undefined"
LINKING = "-fvisibility=hidden -s -Wl,--export-dynamic -Wl,--export=__heap_base"


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "dist"
    write(folder, package(compiled()))
    if len(sys.argv) == 1:
        PHONE_PAGE.write_text(phone_page(), encoding="utf-8", newline="\n")
    sys.stdout.write(f"{folder}: hfx.js, {', '.join(f'{name}.html' for name in SAMPLES)}\n")


def write(folder: Path, script: str) -> None:
    """Write the package and the pages of a script of :func:`package`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "hfx.js").write_text(script + EXPORTS, encoding="utf-8", newline="\n")
    for name in SAMPLES:
        text = page(name, script)
        (folder / f"{name}.html").write_text(text, encoding="utf-8", newline="\n")


def phone_page() -> str:
    """Text of the page that ``hfx play --page`` serves: ``phone.html`` with the outputs in it."""
    outputs = (HERE / "src" / "outputs.js").read_text(encoding="utf-8")
    outputs = re.sub(r"^export ", "", outputs, flags=re.MULTILINE)
    return (HERE / "phone.html").read_text(encoding="utf-8").replace("/* outputs */", outputs)


def fingerprint() -> str:
    """Hash of all sources of the compiled core, without comments, blanks and the compiler."""
    digest = hashlib.sha256(f"{TARGET} {LINKING}".encode())
    for path in [HERE / "core.c", *sorted((HERE.parent / "core").glob("*.h"))]:
        text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        digest.update(f"{path.name}\0{''.join(text.split())}\0".encode())
    return digest.hexdigest()


def package(core: bytes) -> str:
    """Text of one script: the compiled core, and all modules without imports and exports."""
    text = base64.b64encode(core).decode()
    parts = [f"{LICENSE}// Core: {fingerprint()}\n", f'const WASM = "{text}";\n']
    for name in MODULES:
        source = (HERE / "src" / f"{name}.js").read_text(encoding="utf-8")
        source = re.sub(r'^import .* from "\./.*";\n', "", source, flags=re.MULTILINE)
        parts.append(re.sub(r"^export ", "", source, flags=re.MULTILINE))
    return "\n".join(parts)


def compiled() -> bytes:
    """The core as a WebAssembly module; its imports are four functions of JavaScript's Math."""
    with tempfile.TemporaryDirectory() as name:
        target = Path(name, "hfx.wasm")
        options = f"{TARGET} {WARNINGS} {LINKING}".split()
        command = [sys.executable, "-m", "ziglang", "cc", *options, "-o", str(target)]
        subprocess.run([*command, str(HERE / "core.c")], check=True, timeout=1800)
        return target.read_bytes()


def page(name: str, script: str) -> str:
    """Text of a page, with the package and a clip of the Godot samples in it."""
    clip = (HERE.parent / "godot" / SAMPLES[name]).read_bytes()
    text = (HERE / f"{name}.html").read_text(encoding="utf-8")
    text = text.replace("/* package */", script)
    return text.replace("CLIP_IN_BASE64", base64.b64encode(clip).decode())


if __name__ == "__main__":
    main()
