# SPDX-License-Identifier: GPL-3.0-or-later
"""Unity package as a tarball, with the compiled core for each platform."""

from __future__ import annotations

import gzip
import io
import json
import subprocess
import sys
import tarfile
from pathlib import Path

PLAYERS = Path(__file__).resolve().parents[1] / "players"
PACKAGE = PLAYERS / "unity"


def package_files(package: Path = PACKAGE) -> dict[str, bytes]:
    """Paths in the package and contents, sorted, without tests."""
    return {
        path.relative_to(package).as_posix(): path.read_bytes()
        for path in sorted(package.rglob("*"))
        if path.is_file() and path.relative_to(package).parts[0] != "Tests~"
    }


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
    # The plug-ins in the package are those of the core of today; commit them with a release.
    subprocess.run([sys.executable, PLAYERS / "native" / "build.py"], check=True)
    sys.stdout.write(f"{write_tarball(Path(sys.argv[1] if sys.argv[1:] else 'dist'))}\n")
