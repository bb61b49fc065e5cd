# SPDX-License-Identifier: MIT
"""Make ``dist/hfx.js``, the package with the core in it, and ``dist/garage.html``, a page of one file.

``python players/web/build.py [FOLDER]`` needs the compiler of ``pip install ziglang``, and writes into FOLDER
instead of ``dist`` if it is given.
"""

import base64
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
MODULES = ("core", "clip", "player", "bones", "body", "outputs", "loop")  # in the order of imports
LICENSE = "// SPDX-License-Identifier: MIT\n// Made by players/web/build.py of HFX for Blender.\n"
FLAGS = "-target wasm32-wasi -mexec-model=reactor -std=c99 -Os -fno-math-errno -fvisibility=hidden -s"
WARNINGS = "-Wall -Wextra -Werror -Wno-unused-function -fno-sanitize=undefined"
LINKING = "-Wl,--export-dynamic -Wl,--export=__heap_base"


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "dist"
    folder.mkdir(parents=True, exist_ok=True)
    script = package()
    (folder / "hfx.js").write_text(script, encoding="utf-8", newline="\n")
    (folder / "garage.html").write_text(page(script), encoding="utf-8", newline="\n")
    sys.stdout.write(f"{folder / 'hfx.js'}\n{folder / 'garage.html'}\n")


def package() -> str:
    """Text of one module: the compiled core, and all modules of ``src`` without their imports."""
    core = base64.b64encode(compiled()).decode()
    parts = [LICENSE, f'const WASM = "{core}";\n']
    for name in MODULES:
        source = (HERE / "src" / f"{name}.js").read_text(encoding="utf-8")
        parts.append(re.sub(r'^import .* from "\./.*";\n', "", source, flags=re.MULTILINE))
    return "\n".join(parts)


def compiled() -> bytes:
    """The core as a WebAssembly module without imports."""
    with tempfile.TemporaryDirectory() as name:
        target = Path(name, "hfx.wasm")
        options = f"{FLAGS} {WARNINGS} {LINKING}".split()
        command = [sys.executable, "-m", "ziglang", "cc", *options, "-o", str(target)]
        subprocess.run([*command, str(HERE / "core.c")], check=True, timeout=600)
        return target.read_bytes()


def page(script: str) -> str:
    """Text of the garage's page, with the package and the clip in it."""
    clip = (HERE.parent / "godot" / "garage" / "garage.hfxclip").read_bytes()
    text = (HERE / "garage.html").read_text(encoding="utf-8")
    without_exports = re.sub(r"^export ", "", script, flags=re.MULTILINE)
    text = text.replace("/* package */", without_exports)
    return text.replace("CLIP_IN_BASE64", base64.b64encode(clip).decode())


if __name__ == "__main__":
    main()
