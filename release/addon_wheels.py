# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels of an extension zip, by platform and Blender's Python.

Blender has numpy; every other imported distribution comes as a wheel, also for imports in
functions, by name, or under ``except ImportError``: users of Blender cannot install packages.
``addon_wheels.sha256`` pins every file, in the format of ``sha256sum -c``; pip fetches the files
once into a folder.
"""

from __future__ import annotations

import ast
import email
import hashlib
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
LOCK = Path(__file__).with_suffix(".sha256")
LICENCES = ROOT / "licences"  # of distributions without a licence in their wheels
# Import name -> distribution. Imported distributions and their requirements are bundled.
DISTRIBUTIONS = {
    "fast_simplification": "fast-simplification",
    "pythonosc": "python-osc",
    "scipy": "scipy",
    "serial": "pyserial",
    "sounddevice": "sounddevice",
    "trimesh": "trimesh",
    "websockets": "websockets",
}
REQUIRED = {"sounddevice": {"cffi"}}
"""Imports of bundled distributions, besides NumPy."""
NOT_USED = {"pycparser"}
"""Requirements in the metadata of bundled wheels for unused code only: cffi needs pycparser for
compiling declarations, and sounddevice has compiled declarations."""
IN_BLENDER = {
    *("addon_utils", "aud", "bl_operators", "bl_ui", "blf", "bmesh", "bpy", "bpy_extras", "gpu"),
    *("gpu_extras",),
    *("idprop", "imbuf", "mathutils", "numpy", "rna_prop_ui", "zstandard"),
}
COMPUTED: dict[str, set[str]] = {
    "avatars/bodies.py": {"scipy", "trimesh"},
    "blender/early_imports.py": {"scipy", "trimesh"},
    "blender/registration.py": set(),  # the package's own operators and panels
    "commands/doctor.py": set(),  # libraries that are there, or not
    "commands/left_out.py": set(),  # the two commands of the extension
    "processes/tools_package.py": set(),  # of 'hfx_tools': an absent package gives a message
    "formats/registry.py": set(),  # the package's own readers and writers
    "engine/native/library.py": set(),  # the wheel of the compiled library, made by the build
}
"""Files with imports by computed names -> names of those modules."""
REMOVED = {
    *("aifc", "asynchat", "asyncore", "audioop", "cgi", "cgitb", "chunk", "crypt", "distutils"),
    *("imghdr", "imp", "lib2to3", "mailcap", "msilib", "nis", "nntplib", "ossaudiodev", "pipes"),
    *("smtpd", "sndhdr", "spwd", "sunau", "telnetlib", "uu", "xdrlib"),
}
"""Modules of Python 3.11 missing from a later Python of a Blender."""

# blender.org's Blender: 4.2 LTS to 5.0 have Python 3.11, 5.1 and 5.2 LTS have 3.13. Distributions
# build with their own Python: Debian's 4.3 has 3.13, its 5.2 has 3.14.
OFFICIAL = ("3.11", "3.13")
PYTHONS = (*OFFICIAL, "3.14")

# The first version with a wheel is taken. Blender 4.2 and 4.3 have NumPy 1.24, supported by scipy
# up to 1.15; scipy 1.15 has no wheel for Windows on ARM, where Blender begins with 4.5.
VERSIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "scipy": {"3.11": ("1.15.3", "1.17.1"), "3.13": ("1.18.1",), "3.14": ("1.18.1",)},
    "fast-simplification": dict.fromkeys(PYTHONS, ("0.2.0",)),
    "trimesh": dict.fromkeys(PYTHONS, ("5.2.0",)),
    "pyserial": dict.fromkeys(PYTHONS, ("3.5",)),
    "python-osc": dict.fromkeys(PYTHONS, ("1.10.2",)),
    "websockets": dict.fromkeys(PYTHONS, ("17.4",)),
    # The wheel has PortAudio for Windows and macOS; Linux has a system library.
    "sounddevice": dict.fromkeys(PYTHONS, ("0.5.6",)),
    "cffi": dict.fromkeys(PYTHONS, ("2.1.1",)),
}
PURE = {"pyserial", "python-osc", "websockets"}
"""Distributions with a wheel for all platforms and without requirements: in the small zip, too. The
compiled part of websockets' other wheels is for long messages, not needed here."""


class Platform(NamedTuple):
    """Tags of wheels for a platform: system, its release, machine."""

    system: str
    machine: str
    releases: tuple[str, ...] = ("",)  # the oldest first

    def runs(self, tag: str) -> bool:
        """Test a wheel's platform tag by Blender's rule: system and machine, not release."""
        if tag == "any":
            return True
        machines = (self.machine, "universal2") if self.system == "macosx" else (self.machine,)
        return tag.startswith(self.system) and tag.endswith(
            tuple(f"_{machine}" for machine in machines)
        )

    def tags(self) -> list[str]:
        return [f"{self.system}{release}_{self.machine}" for release in self.releases]


PLATFORMS = {
    "linux-x64": Platform("manylinux", "x86_64", ("2014", "_2_27", "_2_28")),
    "macos-arm64": Platform("macosx", "arm64", ("_11_0", "_12_0", "_13_0")),
    "macos-x64": Platform("macosx", "x86_64", ("_10_15", "_11_0")),
    "windows-arm64": Platform("win", "arm64"),
    "windows-x64": Platform("win", "amd64"),
}
_LAST_INTEL_MAC = "3.11"  # Blender 4.5 LTS is blender.org's last version for Intel Macs


class WheelError(Exception):
    """A wheel cannot be fetched or differs from the pinned file."""


def default_pythons(platform: str) -> tuple[str, ...]:
    """Python versions of blender.org's Blenders for a platform."""
    return (_LAST_INTEL_MAC,) if platform == "macos-x64" else OFFICIAL


def imported(package: Path) -> set[str]:
    """Collect the distributions imported by a package's source and missing from Blender.

    Every import counts: in functions, by name (``import_module``, ``find_spec``), and under
    ``except ImportError``.

    Raises
    ------
    WheelError
        An import outside of Python, Blender and ``DISTRIBUTIONS``, or by a computed name in a file
        missing from ``COMPUTED``.
    """
    distributions = set()
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        tops = set(COMPUTED.get(name, ()))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            modules = _modules_of(node)
            if modules is None and name not in COMPUTED:
                raise WheelError(
                    f"{path}, line {getattr(node, 'lineno', 0)}: imports a module by a computed "
                    f"name; write it as a string, or list it in COMPUTED of {Path(__file__).name}."
                )
            tops |= {module.partition(".")[0] for module in modules or ()}
        for top in sorted(tops - IN_BLENDER - {package.name}):
            if top in sys.stdlib_module_names and top not in REMOVED:
                continue
            if top not in DISTRIBUTIONS:
                raise WheelError(
                    f"{path}: imports '{top}', which Blender does not have; add it to "
                    f"DISTRIBUTIONS and VERSIONS in {Path(__file__).name}."
                )
            distributions |= {DISTRIBUTIONS[top], *REQUIRED.get(DISTRIBUTIONS[top], ())}
    return distributions


def _modules_of(node: ast.AST) -> list[str] | None:
    """Names of the absolute modules imported by a node; None for a computed name."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [] if node.level else [node.module or ""]
    if not isinstance(node, ast.Call):
        return []
    called = node.func.attr if isinstance(node.func, ast.Attribute) else None
    called = node.func.id if isinstance(node.func, ast.Name) else called
    if called not in ("import_module", "__import__", "find_spec"):
        return []
    name = node.args[0] if node.args else None
    if isinstance(name, ast.Constant) and isinstance(name.value, str):
        return [] if name.value.startswith(".") else [name.value]
    return None


def check_requirements(wheels: Iterable[Path]) -> None:
    """Check that all requirements of a zip's wheels are in the zip or in Blender.

    Raises
    ------
    WheelError
        A wheel requires a distribution outside of the zip, Blender and ``NOT_USED``.
    """
    wheels = list(wheels)
    bundled = {wheel.name.partition("-")[0].replace("_", "-") for wheel in wheels}
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
            lines = email.message_from_bytes(archive.read(name)).get_all("Requires-Dist", [])
        for line in lines:
            required = re.split(r"[^A-Za-z0-9._-]", line)[0].lower()
            if "extra ==" not in line and required not in {*bundled, *IN_BLENDER, *NOT_USED}:
                raise WheelError(
                    f"{wheel.name}: requires '{required}'; add it to REQUIRED and VERSIONS in "
                    f"{Path(__file__).name}, or to NOT_USED."
                )


def read_lock(lock: Path = LOCK) -> dict[str, str]:
    """Read the pinned wheels: file name -> SHA-256 in hexadecimal."""
    lines = lock.read_text(encoding="utf-8").split("\n")
    return {name: digest for digest, name in (line.split() for line in lines if line)}


def select(
    files: Iterable[str], distributions: set[str], platform: str, python: str
) -> dict[str, str]:
    """Choose the pinned file of each distribution for a platform and Python; absent without one."""
    chosen = {}
    for name in files:
        distribution, _version, python_tag, _abi, platform_tag = name[: -len(".whl")].split("-")
        distribution = distribution.replace("_", "-")
        fits = "py3" in python_tag.split(".") or python_tag == "cp" + python.replace(".", "")
        runs = PLATFORMS[platform].runs(platform_tag)
        if distribution in distributions and fits and runs:
            # A wheel for all platforms may lack a library of the wheel for this platform.
            if platform_tag != "any" or distribution not in chosen:
                chosen[distribution] = name
    return chosen


def fetch(name: str, digest: str, folder: Path) -> Path:
    """Return the path of a pinned wheel in the folder, fetched by pip if missing.

    Raises
    ------
    WheelError
        pip fails, the content differs from the pinned hash, or the wheel has no licence.
    """
    path = folder / name
    if not path.exists():
        distribution, version, python_tag, _, platform_tag = name[: -len(".whl")].split("-")
        requirement = f"{distribution}=={version} --hash=sha256:{digest}"
        python = f"3.{python_tag[3:]}" if python_tag.startswith("cp3") else OFFICIAL[0]
        download(requirement, platform_tag.split("."), python, folder)
    if not path.exists() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
        raise WheelError(
            f"{path}: not the file that {LOCK.name} pins; delete it to fetch it again."
        )
    if not carries_licence(path) and not own_licence(name).exists():
        raise WheelError(f"{name}: carries no licence; put it into {own_licence(name)}.")
    return path


def own_licence(wheel: str) -> Path:
    """Path of the stored licence for a wheel without one."""
    return LICENCES / f"{wheel.partition('-')[0]}.txt"


def lock(
    distributions: Iterable[str], folder: Path, say: Callable[[str], None], target: Path = LOCK
) -> None:
    """Pin the wheels of every platform and Python in ``target``, and report missing wheels."""
    pinned: dict[str, str] = {}
    for name, platform in PLATFORMS.items():
        for python in PYTHONS:
            if python not in default_pythons(name) and name != "linux-x64":
                continue  # only Linux distributions have other Pythons
            for distribution in sorted(distributions):
                wheel = _newest(distribution, platform, python, folder)
                if wheel is None:
                    say(f"{name}, Python {python}: no wheel of {distribution}")
                else:
                    pinned[wheel.name] = hashlib.sha256(wheel.read_bytes()).hexdigest()
    lines = [f"{pinned[wheel]}  {wheel}\n" for wheel in sorted(pinned)]
    target.write_text("".join(lines), encoding="utf-8", newline="\n")


def _newest(distribution: str, platform: Platform, python: str, folder: Path) -> Path | None:
    tags = ["any"] if distribution in PURE else platform.tags()
    for version in VERSIONS[distribution][python]:
        for tag in tags:  # in order: the wheel for the oldest system wins
            try:
                return download(f"{distribution}=={version}", [tag], python, folder)
            except WheelError:
                continue
    return None


def download(requirement: str, tags: Iterable[str], python: str, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        requirements = Path(temporary, "requirements.txt")
        requirements.write_text(requirement + "\n", encoding="utf-8")
        command = [sys.executable, "-P", "-m", "pip", "download", "--quiet", "--no-deps"]
        command += ["--disable-pip-version-check", "--only-binary=:all:"]
        command += ["--python-version", python, "--dest", temporary, "-r", str(requirements)]
        for tag in tags:
            command += ["--platform", tag]
        done = subprocess.run(command, capture_output=True, text=True)
        wheels = list(Path(temporary).glob("*.whl"))
        if done.returncode or not wheels:
            last = (done.stderr.strip().splitlines() or ["pip said nothing"])[-1]
            raise WheelError(f"pip cannot fetch {requirement.split()[0]}: {last}")
        return wheels[0].replace(folder / wheels[0].name)


def carries_licence(wheel: Path) -> bool:
    """Test a wheel for a licence file."""
    with zipfile.ZipFile(wheel) as archive:
        names = [name.upper() for name in archive.namelist() if ".dist-info/" in name]
    files = [name.rpartition("/")[2] for name in names]
    return any(file.startswith(("LICENSE", "LICENCE", "COPYING")) for file in files)
