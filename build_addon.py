# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: ``python build_addon.py`` makes ``dist/hfx_blender-VERSION.zip``.

The zip holds the package, the body models and the device configurations. It brings no wheels:
painting, placing and exporting need nothing but the numpy that Blender has.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent
PACKAGE = ROOT / "hfx_blender"
DATA = ("body_models", "device_configs")
LICENCE = ROOT / "LICENSE"
_LEFT_OUT = {"__pycache__"}
_TIME = (1980, 1, 1, 0, 0, 0)  # the same bytes for the same content


def files() -> dict[str, Path]:
    """What goes into the zip: name inside it -> file."""
    found = {"LICENSE": LICENCE}
    for root, prefix in ((PACKAGE, ""), *((ROOT / name, f"{name}/") for name in DATA)):
        for path in sorted(root.rglob("*")):
            if path.is_file() and not _LEFT_OUT & set(path.parts) and path.suffix != ".tmp":
                found[prefix + path.relative_to(root).as_posix()] = path
    return found


def build(folder: Path) -> Path:
    """Write the extension into a folder and return its path."""
    manifest = tomllib.loads((PACKAGE / "blender_manifest.toml").read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{manifest['id']}-{manifest['version']}.zip"
    temporary = target.with_suffix(".zip.tmp")
    with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, path in files().items():
            entry = zipfile.ZipInfo(name, _TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, path.read_bytes())
    temporary.replace(target)
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description="Build the Blender extension.")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", metavar="DIR")
    target = build(parser.parse_args().output)
    sys.stdout.write(f"{target} ({target.stat().st_size / 1e6:.1f} MB)\n")


if __name__ == "__main__":
    main()
