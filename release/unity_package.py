# SPDX-License-Identifier: GPL-3.0-or-later
"""Unity package as a tarball, with the compiled core for each platform."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import sys
import tarfile
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "players" / "unity"
_META = """\
fileFormatVersion: 2
guid: {guid}
folderAsset: yes
DefaultImporter:
  externalObjects: {{}}
  userData:
  assetBundleName:
  assetBundleVariant:
"""
_LEFT_OUT = ("Tests~",)


def folder_meta(path: str) -> str:
    """Meta file of a folder, with an identity that follows from its path in the package."""
    guid = hashlib.md5(f"org.hfx.haptics/{path}".encode(), usedforsecurity=False).hexdigest()
    return _META.format(guid=guid)


def package_files(package: Path = PACKAGE) -> dict[str, bytes]:
    """Paths in the package and contents, sorted, without tests.

    Folders of plug-ins get meta files: Unity leaves out all assets without one in a package that
    was installed from git or a tarball.
    """
    files = {
        path.relative_to(package).as_posix(): path.read_bytes()
        for path in package.rglob("*")
        if path.is_file() and path.relative_to(package).parts[0] not in _LEFT_OUT
    }
    plugins = [name for name in files if name.startswith("Runtime/Plugins/")]
    for folder in {str(parent) for name in plugins for parent in Path(name).parents}:
        if folder.startswith("Runtime/Plugins"):
            files.setdefault(f"{folder}.meta", folder_meta(folder).encode())
    return dict(sorted(files.items()))


def write_tarball(folder: Path, package: Path = PACKAGE) -> Path:
    """Write ``NAME-VERSION.tgz`` in the layout of npm; the same files give the same bytes."""
    files = package_files(package)
    facts = json.loads(files["package.json"])
    path = folder / f"{facts['name']}-{facts['version']}.tgz"
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name, data in files.items():
            entry = tarfile.TarInfo(f"package/{name}")
            entry.size, entry.mode = len(data), 0o644
            tar.addfile(entry, io.BytesIO(data))
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(gzip.compress(content.getvalue(), mtime=0))
    return path


if __name__ == "__main__":
    # After "python players/native/build.py", which writes Runtime/Plugins.
    if not (PACKAGE / "Runtime" / "Plugins").is_dir():
        sys.exit("Runtime/Plugins is missing: run python players/native/build.py first.")
    sys.stdout.write(f"{write_tarball(Path(sys.argv[1] if sys.argv[1:] else 'dist'))}\n")
