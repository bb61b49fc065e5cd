# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels packed from installed distributions, and a Python environment as bare as Blender's."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

BLENDERS_OWN = ("bpy", "numpy", "numpy.libs", "requests", "urllib3", "certifi", "idna")
"""Packages beside the standard library that blender.org's Blender has, as far as they are here."""


def pack(name: str, folder: Path, compression: int = zipfile.ZIP_STORED) -> Path:
    """Write the wheel of an installed distribution under a given file name.

    Raises
    ------
    importlib.metadata.PackageNotFoundError
        The distribution is not installed.
    """
    path = folder / name
    distribution = metadata.distribution(name.partition("-")[0])
    with zipfile.ZipFile(path, "w", compression) as archive:
        for file in distribution.files or ():
            if not {"..", "__pycache__", "tests"} & set(file.parts):
                archive.write(str(file.locate()), file.as_posix())
    return path


def bare_python(folder: Path) -> Path:
    """Make an environment with only Blender's module and the distributions shipped by Blender.

    Returns
    -------
    Path
        The environment's Python, of the running version.
    """
    base = getattr(sys, "_base_executable", sys.executable)
    subprocess.run([base, "-m", "venv", "--without-pip", folder], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    installed = Path(metadata.distribution("bpy").locate_file("bpy")).parent
    for name in BLENDERS_OWN:
        if (installed / name).exists():
            os.symlink(installed / name, packages / name)
    return folder / "bin" / "python"
