# SPDX-License-Identifier: GPL-3.0-or-later
"""Build all files of a release: ``python release/make.py`` writes them into ``dist/``.

=====================  ==========================================================
folder                 files
=====================  ==========================================================
``python``             wheels with the compiled library, source distribution
``blender``            extension for each platform, small extension
``games``              packages for Godot, Unity, the web, and C and C++
``site``               documentation (``--site``)
``.``                  first steps, SHA-256 sums, bill of materials, licences of others
=====================  ==========================================================

Needs ``pip install -r release/requirements.txt``, and the internet for the wheels in the
extension. Two runs from equal sources give equal bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

if not __package__:  # run as a program
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import build_addon
from hfx_blender.files.atomic import atomic_file
from hfx_blender.version import __version__
from release import addon_wheels, bill_of_materials, godot_zip, native_build, unity_package
from release.archives import write_tarball, write_zip
from release.links import without_links
from release.single_header import single_header

ROOT = Path(__file__).resolve().parents[1]
PLAYERS = ROOT / "players"
_EPOCH = "315532800"  # 1980-01-01, the oldest time of a zip
# Platforms of the module bpy, which the command needs.
WHEEL_PLATFORMS = ("linux-arm64", "linux-x64", "macos-arm64", "macos-x64", "windows-x64")
PARTS = ("python", "blender", "games")
SUMS = "SHA256SUMS"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", metavar="DIR")
    parser.add_argument(
        "--part", action="append", choices=PARTS, help="build one part (repeatable; default: all)"
    )
    parser.add_argument(
        "--repository",
        metavar="ADDRESS",
        help="of the source code on the web, for links and pictures of the page on PyPI",
    )
    parser.add_argument("--site", action="store_true", help="build the documentation, too")
    options = parser.parse_args()
    output: Path = options.output
    if options.repository:
        os.environ["HFX_REPOSITORY"] = options.repository  # read by release/hatch_metadata.py
    builders = {"python": python_packages, "blender": extensions, "games": game_packages}
    try:
        for part in options.part or PARTS:
            shutil.rmtree(output / part, ignore_errors=True)
            for path in builders[part](output / part):
                build_addon.say(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
        if options.site:
            build_addon.say(str(site(output / "site")))
        summaries(output)
    except (addon_wheels.WheelError, native_build.BuildError) as error:
        sys.stderr.write(f"{error}\n")
        return 3
    except subprocess.CalledProcessError as error:
        command = " ".join(str(part) for part in error.cmd)
        sys.stderr.write(f"{command} failed with exit code {error.returncode}.\n")
        return 3
    return 0


def python_packages(folder: Path) -> list[Path]:
    """Build a wheel for each platform and the source distribution; returns their paths."""
    for platform in WHEEL_PLATFORMS:
        _hatchling("wheel", folder, HFX_PLATFORM=platform)
    _hatchling("sdist", folder)
    return sorted([*folder.glob("*.whl"), *folder.glob("*.tar.gz")])


def _hatchling(target: str, folder: Path, **environment: str) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "SOURCE_DATE_EPOCH": _EPOCH, **environment},
        check=True,
        stdout=subprocess.DEVNULL,
    )


def extensions(folder: Path) -> list[Path]:
    """Build the extension for each platform and the small extension; returns their paths."""
    zig = native_build.fetched_compiler(build_addon.say)
    cache = build_addon.WHEELS
    zips = [
        build_addon.build_for(platform, addon_wheels.default_pythons(platform), folder, cache, zig)
        for platform in addon_wheels.PLATFORMS
    ]
    return [*zips, build_addon.build_small(folder, cache, zig)]


def game_packages(folder: Path) -> list[Path]:
    """Compile the players and pack them for Godot, Unity, the web, and C; returns the paths."""
    _run(sys.executable, PLAYERS / "native" / "build.py")
    absent = godot_zip.missing()
    if absent:
        raise native_build.BuildError(f"Godot's add-on lacks {', '.join(absent)}.")
    return [
        godot_zip.write(folder),
        unity_package.write_tarball(folder),
        web_package(folder),
        core_package(folder),
    ]


def web_package(folder: Path) -> Path:
    """Write the npm package with its compiled script and pages of one file; returns its path."""
    web = PLAYERS / "web"
    facts = json.loads((web / "package.json").read_text(encoding="utf-8"))
    names = ["package.json", "README.md", "LICENSE", "index.d.ts"]
    files = {name: (web / name).read_bytes() for name in names}
    with tempfile.TemporaryDirectory() as temporary:
        _run(sys.executable, web / "build.py", temporary)
        for path in sorted(Path(temporary).iterdir()):
            files[f"dist/{path.name}"] = path.read_bytes()
    return write_tarball(folder / f"{facts['name']}-{facts['version']}.tgz", files)


def core_package(folder: Path) -> Path:
    """Write the C core, its single header, the C++ classes, the sources of the library, and the
    examples; returns the path."""
    files = {"hfx_player.h": single_header().encode()}
    for path in sorted((PLAYERS / "native").glob("live_*")):
        files[f"native/{path.name}"] = path.read_bytes()
    for part in ("core", "cpp", "examples"):
        for path in sorted((PLAYERS / part).rglob("*")):
            if path.is_file() and "target" not in path.parts and "__pycache__" not in path.parts:
                files[path.relative_to(PLAYERS).as_posix()] = path.read_bytes()
    files["LICENSE"] = (PLAYERS / "core" / "LICENSE").read_bytes()
    sample = PLAYERS / "godot" / "addons" / "hfx" / "samples" / "garage.hfxclip"
    files["garage.hfxclip"] = sample.read_bytes()
    files["README.md"] = (ROOT / "release" / "core_readme.md").read_bytes()
    format_page = (ROOT / "docs" / "formats" / "clip.md").read_text(encoding="utf-8")
    files["format.md"] = without_links(format_page).replace("players/core/", "core/").encode()
    return write_zip(folder / f"hfx-core-{__version__}.zip", files)


def site(folder: Path) -> Path:
    """Build the documentation as web pages; a broken link stops the build. Returns the folder."""
    # With --quiet, mkdocs drops the warnings before --strict counts them.
    _run(sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder)
    theme = importlib.metadata.distribution("mkdocs-material")
    text = theme.read_text("licenses/LICENSE")
    if text is None:
        raise addon_wheels.WheelError(f"mkdocs-material {theme.version} has no licenses/LICENSE.")
    _write(
        folder / "THIRD-PARTY-LICENCES.txt",
        f"The pages hold scripts and styles of Material for MkDocs {theme.version}. Scripts of "
        f"other projects inside name their licences in comments.\n\n{text.strip()}\n",
    )
    return folder


def start_here() -> str:
    """Text of the first steps in Blender, Godot and a browser, with this release's file names."""
    text = (ROOT / "release" / "start_here.md").read_text(encoding="utf-8")
    return text.replace("{version}", __version__)


def summaries(output: Path) -> None:
    """Write first steps, sums, bill of materials and licences of other projects into a folder."""
    _write(output / "START-HERE.md", start_here())
    artefacts = sorted(path for part in PARTS for path in (output / part).glob("*"))
    bill = bill_of_materials.bill(__version__, artefacts, addon_wheels.read_lock())
    _write(output / f"hfx-{__version__}.cdx.json", bill)
    licences = bill_of_materials.third_party_licences(artefacts)
    _write(output / "THIRD-PARTY-LICENCES.txt", licences)
    _write(output / SUMS, sums(output))


def sums(folder: Path) -> str:
    """SHA-256 sums of all files below a folder but the sums themselves, as ``sha256sum`` reads."""
    names = {
        path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()
    }
    names.pop(SUMS, None)
    return "".join(
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {name}\n"
        for name, path in sorted(names.items())
    )


def _write(path: Path, text: str) -> None:
    with atomic_file(path) as file:
        file.write(text.encode())


def _run(*command: str | Path) -> None:
    subprocess.run([str(part) for part in command], cwd=ROOT, check=True)


if __name__ == "__main__":
    sys.exit(main())
