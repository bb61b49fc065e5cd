# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheel of the compiled library, for Blender extensions.

Windows cannot replace a loaded library, and Blender cannot unload a library during an upgrade of an
extension. So the wheel and its module are named after the sources' digest: unchanged sources keep
the installed module, and changed sources give a second module; Blender removes the old module at
the next start.
"""

from __future__ import annotations

import base64
import hashlib
import tempfile
import zipfile
from pathlib import Path

from hfx_blender.files.atomic import atomic_file

from . import native_build
from .native_build import ROOT, Target

NAME = "hfx_native"
_TIME = (1980, 1, 1, 0, 0, 0)  # equal bytes for equal content


def make(target: Target, folder: Path, zig: Path) -> Path:
    """Compile the library for a target and write its wheel into a folder; returns the path.

    ``engine/native/library.py`` imports the module ``hfx_native_DIGEST`` of the wheel.

    Raises
    ------
    BuildError
        The library cannot be compiled.
    """
    with tempfile.TemporaryDirectory(prefix="hfx_native_") as work:
        library = native_build.build(target, Path(work), zig).read_bytes()
    digest = native_build.digest()
    version = f"1.0.0+{digest}"
    module = f"{NAME}_{digest}"
    tag = f"py3-none-{target.wheel}"
    information = f"{NAME}-{version}.dist-info"
    content = {
        f"{module}/__init__.py": b'"""The compiled library of HFX for Blender."""\n',
        f"{module}/{target.library}": library,
        f"{information}/licenses/LICENSE": (ROOT / "LICENSE").read_bytes(),
        f"{information}/METADATA": _metadata(version).encode(),
        f"{information}/WHEEL": _wheel(tag).encode(),
    }
    content[f"{information}/RECORD"] = _record(content, f"{information}/RECORD").encode()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{NAME}-{version}-{tag}.whl"
    with atomic_file(path) as file, zipfile.ZipFile(file, "w") as archive:
        for name, data in content.items():
            entry = zipfile.ZipInfo(name, _TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, also when built on Windows
            entry.external_attr = (0o100755 if data is library else 0o100644) << 16
            archive.writestr(entry, data, compresslevel=9)
    return path


def _metadata(version: str) -> str:
    return (
        f"Metadata-Version: 2.4\nName: {NAME}\nVersion: {version}\n"
        "Summary: The compiled library of HFX for Blender\n"
        "License-Expression: GPL-3.0-or-later\nLicense-File: LICENSE\n"
    )


def _wheel(tag: str) -> str:
    return f"Wheel-Version: 1.0\nGenerator: hfx\nRoot-Is-Purelib: false\nTag: {tag}\n"


def _record(content: dict[str, bytes], own: str) -> str:
    lines = []
    for name, data in content.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        lines.append(f"{name},sha256={digest},{len(data)}\n")
    return "".join(lines) + f"{own},,\n"
