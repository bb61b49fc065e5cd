# SPDX-License-Identifier: GPL-3.0-or-later
"""Unity package as a tarball, with the compiled core for each platform."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from release import archives

PLAYERS = Path(__file__).resolve().parents[1] / "players"
PACKAGE = PLAYERS / "unity"


def package_files(package: Path = PACKAGE) -> dict[str, bytes]:
    """Paths in the package and contents, without tests, and with the licence of the start-up code
    in the libraries for Windows."""
    # Unity ignores folders with a tilde at the end, which need no .meta files.
    licence = (PLAYERS.parent / "licences" / "mingw_w64.txt").read_bytes()
    return {"Documentation~/LICENSE-mingw_w64.txt": licence} | {
        path.relative_to(package).as_posix(): path.read_bytes()
        for path in sorted(package.rglob("*"))
        if path.is_file() and path.relative_to(package).parts[0] != "Tests~"
    }


def write_tarball(folder: Path, package: Path = PACKAGE) -> Path:
    """Write ``NAME-VERSION.tgz`` in the layout of npm; the same files give the same bytes."""
    files = package_files(package)
    facts = json.loads(files["package.json"])
    return archives.write_tarball(folder / f"{facts['name']}-{facts['version']}.tgz", files)


if __name__ == "__main__":
    # The plug-ins in the package are those of the core of today; commit them with a release.
    subprocess.run([sys.executable, PLAYERS / "native" / "build.py"], check=True)
    sys.stdout.write(f"{write_tarball(Path(sys.argv[1] if sys.argv[1:] else 'dist'))}\n")
