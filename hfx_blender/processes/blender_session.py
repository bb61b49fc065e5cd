# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender without a window, for the command line: start, opening of files, temporary files."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import HfxError, InputError, OutputError, is_endless
from ..files.atomic import remove_at_end
from ..files.kinds import title_of
from ..files.staging import remove_tree
from .process_end import check
from .process_end import end_on_signals as end_on_signals
from .process_end import leave as leave
from .start import is_child

_SYSTEM_PACKAGES = (
    "libx11-6 libxrender1 libxxf86vm1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1"
)


_temporary: Path | None = None
"""Folder of Blender's temporary files, created by this process and removed at the end."""


def start() -> Any:
    """Import ``bpy`` and register this package in it; return the module. A signal during the import
    raises TerminatedError at its end; in child processes signals end the process at once. Raises
    HfxError: Blender cannot be loaded; the message names the missing packages."""
    if is_child():
        end_on_signals(at_once=True)
    try:
        with _temporary_folder():
            import bpy
    except ModuleNotFoundError as error:
        if error.name != "bpy":
            raise
        version = ".".join(map(str, sys.version_info[:2]))
        raise HfxError(
            f"Blender's Python module 'bpy' is not installed for Python {version}. It is published "
            "for Python 3.11 (Blender 4.5) and 3.13 (Blender 5.2), not for 3.12."
        ) from error
    except ImportError as error:
        raise HfxError(
            f"Blender's Python module cannot be loaded ({error}). On Debian and Ubuntu it needs: "
            f"{_SYSTEM_PACKAGES}."
        ) from error
    # In the Blender program the extension is registered already.
    if not hasattr(bpy.types.Object, "hfx"):
        sys.modules[__package__.rpartition(".")[0]].register()  # of hfx_blender
    check()  # for signals during the start of Blender
    return bpy


@contextmanager
def _temporary_folder() -> Iterator[None]:
    """Context manager in which a starting Blender uses a new folder for temporary files, removed at
    the end of the process; no effect if Blender runs or the folder cannot be made.
    ``bpy.app.tempdir`` cannot be removed instead: without permission to create a folder, Blender
    uses the user's temporary folder itself."""
    global _temporary
    if "bpy" not in sys.modules:
        with suppress(OSError):  # missing or full: Blender looks for a folder
            _temporary = Path(tempfile.mkdtemp(prefix="hfx_"))
            remove_at_end(_temporary, remove_tree)
            atexit.register(remove_temporary_files)
    if _temporary is None:
        yield
        return
    # Blender reads the folder once, at its start. The variables are restored for this process's own
    # children.
    earlier = {name: os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP")}
    os.environ.update(dict.fromkeys(earlier, str(_temporary)))
    try:
        yield
    finally:
        for name, value in earlier.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def new_temporary_folder(prefix: str) -> Path:
    """Create a folder in Blender's temporary folder, to be removed by the caller or with Blender.
    Raises OutputError: the folder cannot be created."""
    folder = sys.modules["bpy"].app.tempdir
    try:
        return Path(tempfile.mkdtemp(prefix=prefix, dir=folder))
    except OSError as error:
        raise OutputError(
            f"{folder}: Blender's temporary folder cannot be written to ({error.strerror})."
        ) from error


def inside_blender() -> bool:
    """Test that this process is the Blender program; False for the Python module or without bpy."""
    bpy = sys.modules.get("bpy")
    return bpy is not None and bool(bpy.app.binary_path)  # bpy.app.module is missing before 4.5


def refuse_name(path: Path) -> None:
    """Raise ``InputError`` for a path that is not UTF-8: Blender and reports cannot hold it."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: its name is not UTF-8, as allowed; rename it.") from None


def open_blend(path: Path) -> None:
    """Open a .blend file; no script, driver or handler of the file is run. Raises InputError: the
    file is missing, is no .blend, links to a pipe or device, or Blender cannot read it."""
    refuse_name(path)
    if not path.is_file():
        fault = "it is a folder" if path.is_dir() else "there is no such file"
        fault = "it is no plain file" if is_endless(path) else fault
        raise InputError(f"{path}: {fault}; expected a .blend file.")
    # The message names the kind of JSON, often a device configuration.
    if path.suffix.lower() == ".json":
        raise InputError(f"{path}: is {title_of(path)}; expected a .blend file.")
    bpy = start()
    from ..blender import blend_paths, linked_files

    # A link to a pipe or device would hang Blender.
    blend_paths.refuse_endless(path)  # Blender reads linked files while opening the file
    try:
        # Blender does not look for a name without folder in the working folder.
        full = os.path.abspath(path)
        bpy.ops.wm.open_mainfile(filepath=full, load_ui=False, use_scripts=False)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0].rpartition(": ")[2]
        reason = reason.replace(f' in file "{full}"', "")
        raise InputError(f"{path}: Blender cannot open it ({reason}).") from error
    linked_files.refuse_endless()


def remove_temporary_files() -> None:
    """Remove the folder of Blender's temporary files created by this process, if any."""
    if _temporary is not None:
        shutil.rmtree(_temporary, ignore_errors=True)


def open_standard_streams() -> None:
    """Open missing standard streams (``hfx ... >&-``) on the null device. Otherwise the first
    opened files would get their descriptors, and prints would go there."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
        mode = "r" if number == 0 else "w"
        setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))


def without_chatter(work: Callable[[], int]) -> int:
    """Run ``work`` without Blender's output on stdout; prints of Python still reach stdout. Blender
    writes to descriptor 1, past ``sys.stdout``. During the call descriptor 1 is the null device,
    and ``sys.stdout`` writes to a copy of the original descriptor."""
    sys.stdout.flush()
    # Blender writes to descriptor 1 directly, so it is descriptor 1 that is replaced.
    original = os.dup(1)
    null = os.open(os.devnull, os.O_WRONLY)
    stream = sys.stdout
    try:
        os.dup2(null, 1)
        with os.fdopen(
            original, "w", encoding=stream.encoding, errors="replace", closefd=False
        ) as copy:
            sys.stdout = copy
            return work()
    finally:
        sys.stdout = stream
        os.dup2(original, 1)
        os.close(original)
        os.close(null)
