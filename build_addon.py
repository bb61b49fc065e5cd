# SPDX-License-Identifier: GPL-3.0-or-later
"""Build the Blender extension: ``python build_addon.py`` makes the zip for this computer.

A zip has the package ``hfx_blender``, body models, device configurations, effect library, the
library of engine/native compiled for the platform, and wheels of all imports missing from Blender,
for every Python of blender.org's Blender 4.2 LTS to 5.2 LTS. Blender unpacks the fitting wheels.
A full zip for all platforms would be five times as large; the small zip has only the compiled
library for all platforms and pure wheels.
"""

from __future__ import annotations

import argparse
import platform
import sys
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path

from release import addon_wheels, bundled_libraries, native_build, native_wheel
from release.addon_wheels import PLATFORMS, PYTHONS, WheelError
from release.archives import write_zip
from release.native_build import BuildError

ROOT = Path(__file__).resolve().parent
PACKAGE = ROOT / "hfx_blender"
MANIFEST = "blender_manifest.toml"
DATA = ("body_models", "device_configs", "effect_library")
LICENCE = ROOT / "LICENSE"
WHEELS = ROOT / "build" / "wheels"
_LEFT_OUT = {"__pycache__", MANIFEST}
_STRAY = {".tmp", ".bak", ".orig", ".pyc", ".blend1", ".new", ".so", ".dll", ".dylib"}


def files() -> dict[str, Path]:
    """Files of every zip except the manifest: name in the zip -> file."""
    paths = {"LICENSE": LICENCE}
    for root, prefix in ((PACKAGE, ""), *((ROOT / name, f"{name}/") for name in DATA)):
        for path in sorted(root.rglob("*")):
            name = path.relative_to(root)
            hidden = any(part.startswith(".") for part in name.parts)
            if path.is_file() and not hidden and not _LEFT_OUT & set(name.parts):
                if path.suffix not in _STRAY:
                    paths[prefix + name.as_posix()] = path
    return paths


def manifest(wheels: Iterable[str] = (), platforms: Iterable[str] = ()) -> str:
    """Build the text of the manifest for a zip with the given wheels and platforms."""
    text = (PACKAGE / MANIFEST).read_text(encoding="utf-8")
    keys = {"platforms": list(platforms), "wheels": [f"./wheels/{name}" for name in wheels]}
    lines = "".join(
        f"{key} = [\n" + "".join(f'  "{value}",\n' for value in values) + "]\n"
        for key, values in keys.items()
        if values
    )
    head, table, tail = text.partition("\n[permissions]")  # the first table ends the plain keys
    return f"{head}{lines}{table}{tail}"


def build(folder: Path, tag: str = "", text: str = "", wheels: Sequence[Path] = ()) -> Path:
    """Write a zip into a folder and return its path.

    Parameters
    ----------
    tag : str
        Last part of the zip's name, after the version: platform and Python.
    text : str
        Text of the manifest; empty: a manifest without wheels.
    wheels : sequence of Path
        Compressed files, stored without compression.
    """
    text = text or manifest()
    identity = tomllib.loads(text)
    content = {MANIFEST: text.encode()}
    content |= {name: path.read_bytes() for name, path in files().items()}
    content |= {f"wheels/{path.name}": path.read_bytes() for path in wheels}
    licences = {addon_wheels.own_licence(wheel.name) for wheel in wheels}
    for wheel in wheels:
        licences |= bundled_libraries.licence_files(wheel.name, wheel.read_bytes())
    content |= {f"licences/{path.name}": path.read_bytes() for path in licences if path.exists()}
    name = "-".join(filter(None, (identity["id"], identity["version"], tag)))
    return write_zip(folder / f"{name}.zip", content)


def build_for(
    name: str, pythons: Sequence[str], folder: Path, cache: Path, zig: Path | None = None
) -> Path:
    """Build the zip for a platform with wheels for the given Pythons.

    Parameters
    ----------
    name : str
        Blender's name of the platform.
    folder, cache : Path
        Folders of the zip and of fetched wheels.
    zig : Path, optional
        Compiler; None: no compiled library in the zip.

    Raises
    ------
    WheelError
        A wheel cannot be fetched or differs from the pinned file.
    BuildError
        The library cannot be compiled.
    """
    lock = addon_wheels.read_lock()
    distributions = addon_wheels.imported(PACKAGE)
    chosen: dict[str, Path] = {}
    for python in pythons:
        wheel_names = addon_wheels.select(lock, distributions, name, python)
        for distribution in sorted(distributions - set(wheel_names)):
            say(f"{name}, Python {python}: there is no wheel of {distribution}, built without")
        for wheel in wheel_names.values():
            fetched = addon_wheels.fetch(wheel, lock[wheel], cache)
            path = bundled_libraries.for_platform(fetched, name)
            chosen[path.name] = path
    addon_wheels.check_requirements(chosen.values())
    if zig is not None:
        own = native_wheel.make(native_build.TARGETS[name], cache, zig)
        chosen[own.name] = own
    tag = name.replace("-", "_")
    if tuple(pythons) != addon_wheels.default_pythons(name):
        tag += "-py" + "_".join(python.replace(".", "") for python in pythons)
    return build(folder, tag, manifest(sorted(chosen), [name]), [chosen[key] for key in chosen])


def build_small(folder: Path, cache: Path, zig: Path | None = None) -> Path:
    """Build the small zip for all platforms, with wheels of the library and pure wheels.

    Parameters
    ----------
    folder, cache : Path
        Folders of the zip and of the wheels.
    zig : Path, optional
        Compiler; None: no compiled library in the zip.

    Raises
    ------
    WheelError
        A wheel cannot be fetched or differs from the pinned file.
    BuildError
        The library cannot be compiled.
    """
    lock = addon_wheels.read_lock()
    pure = addon_wheels.select(lock, addon_wheels.PURE, next(iter(PLATFORMS)), PYTHONS[0]).values()
    targets = native_build.TARGETS.values() if zig is not None else ()
    wheels = sorted(
        [addon_wheels.fetch(name, lock[name], cache) for name in pure]
        + [native_wheel.make(target, cache, zig) for target in targets]
    )
    return build(folder, "no_wheels", manifest(path.name for path in wheels), wheels)


def this_platform() -> str:
    """Blender's name of the current platform."""
    systems = {"darwin": "macos"}
    machines = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64"}
    system, machine = platform.system().lower(), platform.machine().lower()
    return f"{systems.get(system, system)}-{machines.get(machine, machine)}"


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Build the Blender extension.")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "dist", metavar="DIR")
    parser.add_argument(
        "--platform",
        action="append",
        choices=(*PLATFORMS, "all"),
        help="platform of the zip (default: this computer; repeatable)",
    )
    parser.add_argument(
        "--python",
        action="append",
        choices=PYTHONS,
        help="for Blenders with this Python (default: those of blender.org's Blender 4.2 to 5.2; "
        "Debian's 4.3 has 3.13, its 5.2 has 3.14; repeatable)",
    )
    parser.add_argument(
        "--no-wheels",
        action="store_true",
        help="a small zip for every platform, without fitting avatars of your own",
    )
    parser.add_argument(
        "--without-native",
        action="store_true",
        help="leave out the compiled library: samples are computed in numpy, slower",
    )
    parser.add_argument(
        "--wheels", type=Path, default=WHEELS, metavar="DIR", help="folder of fetched wheels"
    )
    parser.add_argument(
        "--lock", action="store_true", help="pin the wheels again instead of building"
    )
    return parser


def main() -> int:
    arguments = _parser().parse_args()
    names = sorted(set(arguments.platform or [this_platform()]))
    names = list(PLATFORMS) if "all" in names else names
    if not arguments.no_wheels and not arguments.lock and set(names) - set(PLATFORMS):
        say(f"There are no wheels for {names[0]}: name a --platform, or build with --no-wheels.")
        return 2
    try:
        if arguments.lock:
            addon_wheels.lock(addon_wheels.VERSIONS, arguments.wheels, say)
            return 0
        zig = None if arguments.without_native else native_build.fetched_compiler(say)
        if arguments.no_wheels:
            built = [build_small(arguments.output, arguments.wheels, zig)]
        else:
            built = [
                build_for(
                    name,
                    tuple(sorted(set(arguments.python or addon_wheels.default_pythons(name)))),
                    arguments.output,
                    arguments.wheels,
                    zig,
                )
                for name in names
            ]
    except WheelError as error:
        sys.stderr.write(f"{error}\nTo build without wheels: {Path(__file__).name} --no-wheels\n")
        return 3
    except BuildError as error:
        sys.stderr.write(
            f"The library of engine/native cannot be compiled: {error}\n"
            f"To build without it: {Path(__file__).name} --without-native\n"
        )
        return 3
    for target in built:
        say(f"{target} ({target.stat().st_size / 1e6:.1f} MB)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
