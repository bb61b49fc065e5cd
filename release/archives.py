# SPDX-License-Identifier: GPL-3.0-or-later
"""Zips and tarballs with equal bytes for equal files: sorted, without times, owners and names."""

from __future__ import annotations

import gzip
import io
import tarfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

from hfx_blender.files.atomic import atomic_file

_TIME = (1980, 1, 1, 0, 0, 0)  # the oldest time of a zip


def write_zip(path: Path, files: Mapping[str, bytes]) -> Path:
    """Write a zip and return its path.

    Parameters
    ----------
    path : Path
        The zip; its folder is made.
    files : mapping of str to bytes
        Name in the zip -> content. Wheels and zips are stored without compression.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file, zipfile.ZipFile(file, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _TIME)
            is_compressed = name.endswith((".whl", ".zip"))
            entry.compress_type = zipfile.ZIP_STORED if is_compressed else zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, also when built on Windows
            entry.external_attr = 0o100644 << 16
            archive.writestr(entry, files[name], compresslevel=9)
    return path


def write_tarball(path: Path, files: Mapping[str, bytes]) -> Path:
    """Write a gzip-compressed tarball in the layout of npm, below ``package/``; returns its path.

    Parameters
    ----------
    path : Path
        The tarball; its folder is made.
    files : mapping of str to bytes
        Name below ``package/`` -> content.
    """
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name in sorted(files):
            entry = tarfile.TarInfo(f"package/{name}")
            entry.size, entry.mode = len(files[name]), 0o644
            tar.addfile(entry, io.BytesIO(files[name]))
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(gzip.compress(content.getvalue(), mtime=0))
    return path
