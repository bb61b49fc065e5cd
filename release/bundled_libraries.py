# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled libraries inside the files of a release: their projects, licences and texts.

Wheels of other projects contain libraries of third projects. A release stops at a library without a
row in ``LIBRARIES``.
"""

from __future__ import annotations

import io
import re
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from .addon_wheels import LICENCES, PLATFORMS, WheelError
from .archives import write_zip

_OWN = "GPL-3.0-or-later"
_GCC = "GPL-3.0-or-later WITH GCC-exception-3.1"
_MAGIC = (
    b"\x7fELF",
    b"MZ",
    *(b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf"),  # Mach-O
)
# Modules of Python: parts of the distribution of their wheel.
_MODULE = re.compile(r"\.(cpython-\w+-[\w-]+|abi3)\.so$|\.pyd$")
_LIBRARY = re.compile(r"\.(so|dll|dylib)(\.\d+)*$")


class Library(NamedTuple):
    """A project with libraries inside a release.

    Attributes
    ----------
    name : str
        Project.
    files : str
        Regular expression for the beginning of the libraries' file names.
    expression : str
        SPDX expression of the licence; a licence without an SPDX identifier is a ``LicenseRef``.
    text : str
        File of the licence in ``licences/``; empty: the licence of the wheel or package holds the
        text.
    source : str
        Address of the project's sources; empty for libraries of this project.
    """

    name: str
    files: str
    expression: str
    text: str = ""
    source: str = ""


_GCC_SOURCE = "https://gcc.gnu.org/git/gcc.git"
LIBRARIES = (
    Library(
        "OpenBLAS",
        r"(lib)?scipy_openblas.*\.dll$",  # the runtime of Fortran is linked statically
        f"BSD-3-Clause AND BSD-3-Clause-Open-MPI AND ({_GCC})",
        source="https://github.com/OpenMathLib/OpenBLAS",
    ),
    Library(
        "OpenBLAS",
        r"libscipy_openblas",
        "BSD-3-Clause AND BSD-3-Clause-Open-MPI",
        source="https://github.com/OpenMathLib/OpenBLAS",
    ),
    Library("libgfortran", r"libgfortran[-.]", _GCC, "gcc_runtime.txt", _GCC_SOURCE),
    Library("libgcc_s", r"libgcc_s\.", _GCC, "gcc_runtime.txt", _GCC_SOURCE),
    Library("libgomp", r"libgomp[-.]", _GCC, "gcc_runtime.txt", _GCC_SOURCE),
    Library("libquadmath", r"libquadmath[-.]", "LGPL-2.1-or-later", "libquadmath.txt", _GCC_SOURCE),
    Library(
        "PortAudio",
        r"libportaudio(64bit|arm64)?\.",
        "MIT",
        "portaudio.txt",
        "https://github.com/PortAudio/portaudio",
    ),
    Library(
        "Microsoft Visual C++ runtime",
        r"msvcp140-",
        "LicenseRef-Microsoft-Distributable-Code",
        "msvcp140.txt",
        "https://visualstudio.microsoft.com/license-terms/",
    ),
    Library(
        "scipy", r"libsf_error_state\.", "BSD-3-Clause", source="https://github.com/scipy/scipy"
    ),
    Library(
        "libffi",  # statically linked; Macs have their own
        r"_cffi_backend\.(.*linux.*\.so|.*\.pyd)$",
        "MIT",
        "libffi.txt",
        "https://github.com/libffi/libffi",
    ),
    # The Windows libraries of this project have the start-up code of Mingw-w64.
    Library("hfx_native", r"hfx_native\.dll$", f"{_OWN} AND ZPL-2.1", "mingw_w64.txt"),
    Library("hfx_core", r"hfx_core\.dll$", f"{_OWN} AND ZPL-2.1", "mingw_w64.txt"),
    Library(
        "hfx_haptics", r"(lib)?hfx_(haptics|godot)\b.*\.dll$", "MIT AND ZPL-2.1", "mingw_w64.txt"
    ),
    Library("hfx_native", r"hfx_native\.", _OWN),
    Library("hfx_core", r"(lib)?hfx_core\.", _OWN),
    Library("hfx_haptics", r"(lib)?hfx_(haptics|godot)\b", "MIT"),
)

# File of PortAudio by platform, loaded by sounddevice without the environment variable
# SD_ENABLE_ASIO. Its wheels hold all files, and for Windows also builds with Steinberg's ASIO.
_PORTAUDIO = {
    "macos-arm64": "libportaudio.dylib",
    "macos-x64": "libportaudio.dylib",
    "windows-arm64": "libportaudioarm64.dll",
    "windows-x64": "libportaudio64bit.dll",
}


def library_of(name: str) -> Library | None:
    """Project of a library by its file name; None without a row in ``LIBRARIES``."""
    file = name.rpartition("/")[2]
    return next((row for row in LIBRARIES if re.match(row.files, file)), None)


def libraries(archive: str, content: bytes) -> dict[str, Library]:
    """Libraries in a wheel, zip or tarball and in the wheels inside: name -> project.

    Names are paths in the archive; an archive in an archive is joined by ``!``. Modules of Python
    without a row are left out: the licence of their wheel covers them.

    Parameters
    ----------
    archive : str
        File name; its end tells the kind of archive.

    Raises
    ------
    WheelError
        A library has no row in ``LIBRARIES``.
    """
    result = {}
    for name, head in _members(archive, content):
        is_compiled = head.startswith(_MAGIC) or _LIBRARY.search(name) is not None
        library = library_of(name)
        if not is_compiled or (library is None and _MODULE.search(name)):
            continue
        if library is None:
            raise WheelError(
                f"{archive}: {name} is a library of an unknown project; add the project and its "
                f"licence to LIBRARIES in {Path(__file__).name}."
            )
        result[name] = library
    return result


def member(archive: str, content: bytes, name: str) -> bytes:
    """Content of a file in a wheel, zip or tarball, by its name of :func:`libraries`."""
    if archive.endswith((".tgz", ".tar.gz")):
        with tarfile.open(fileobj=io.BytesIO(content)) as tar:
            file = tar.extractfile(name)
            return b"" if file is None else file.read()
    with zipfile.ZipFile(io.BytesIO(content)) as source:
        return source.read(name)


def licence_files(archive: str, content: bytes) -> set[Path]:
    """Stored licences of the libraries in a wheel, zip or tarball."""
    rows = libraries(archive, content).values()
    return {LICENCES / library.text for library in rows if library.text}


def _members(archive: str, content: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield name and first bytes of the files in an archive and in the archives inside."""
    if archive.endswith((".tgz", ".tar.gz")):
        with tarfile.open(fileobj=io.BytesIO(content)) as tar:
            for entry in tar:
                file = tar.extractfile(entry)
                if file is not None:
                    yield entry.name, file.read(4)
        return
    with zipfile.ZipFile(io.BytesIO(content)) as source:
        for name in source.namelist():
            with source.open(name) as member:
                head = member.read(4)
            yield name, head
            # scipy's wheels for Windows hold an empty file with the name of the wheel.
            if name.endswith(".whl") and head.startswith(b"PK"):
                members = _members(name, source.read(name))
                yield from ((f"{name}!{inner}", first) for inner, first in members)


def for_platform(wheel: Path, platform: str) -> Path:
    """Copy a wheel for the extension of a platform; most wheels are returned as given.

    A wheel for all Macs takes the tag of one platform: Blender before 4.4 rejects names ending in
    ``universal2``. A wheel of sounddevice keeps the PortAudio of the platform only, and loses the
    libraries with ASIO, because ASIO's licence may not agree with the GPL. The copy has a folder of
    its own, beside the pinned file.
    """
    unneeded = set()
    if wheel.name.startswith("sounddevice-"):
        with zipfile.ZipFile(wheel) as archive:
            names = [name for name in archive.namelist() if _LIBRARY.search(name)]
        unneeded = {n for n in names if n.rpartition("/")[2] != _PORTAUDIO.get(platform)}
    name = wheel.name
    if wheel.stem.endswith("universal2"):
        name = f"{wheel.stem.rpartition('-')[0]}-{PLATFORMS[platform].tags()[0]}.whl"
    if name == wheel.name and not unneeded:
        return wheel
    with zipfile.ZipFile(wheel) as archive:
        files = {n: archive.read(n) for n in archive.namelist() if n not in unneeded}
    for record in [n for n in files if n.endswith(".dist-info/RECORD")]:
        lines = files[record].decode().splitlines(keepends=True)
        files[record] = "".join(
            line for line in lines if line.partition(",")[0] not in unneeded
        ).encode()
    return write_zip(wheel.parent / platform / name, files)
