# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender without a screen, for the command line: starting it, opening a file, leaving it."""

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
"""Folder that this process has made for Blender's temporary files; only that is removed."""


def start() -> Any:
    """The ``bpy`` module, with this package registered.

    Raises
    ------
    HfxError
        Blender cannot be loaded on this machine; says what is missing.
    """
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
    if not hasattr(bpy.types.Object, "hfx"):
        sys.modules[__package__.rpartition(".")[0]].register()  # of the package itself
    check()  # of signals that arrived while Blender started
    return bpy


@contextmanager
def _temporary_folder() -> Iterator[None]:
    """Context in which Blender, when it starts, takes a new folder of ours for temporary files.

    Where it cannot make a folder of its own, Blender uses the user's temporary folder itself. So
    ``bpy.app.tempdir`` does not tell what may be removed.
    """
    global _temporary
    if "bpy" not in sys.modules:
        with suppress(OSError):  # no folder, or a full one: Blender finds what it can use
            _temporary = Path(tempfile.mkdtemp(prefix="hfx_"))
            remove_at_end(_temporary, remove_tree)
            atexit.register(remove_temporary_files)
    if _temporary is None:
        yield
        return
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
    """A new folder within Blender's temporary folder; it goes with Blender, or before.

    Raises
    ------
    OutputError
        It cannot be made.
    """
    folder = sys.modules["bpy"].app.tempdir
    try:
        return Path(tempfile.mkdtemp(prefix=prefix, dir=folder))
    except OSError as error:
        raise OutputError(
            f"{folder}: Blender's temporary folder cannot be written to ({error.strerror})."
        ) from error


def inside_blender() -> bool:
    """Test that this runs in a whole Blender, not in its Python module: a file is open already."""
    bpy = sys.modules.get("bpy")
    return bpy is not None and bool(bpy.app.binary_path)  # app.module is not there before 4.5


def refuse_name(path: Path) -> None:
    """Refuse a path that Blender, a report and a track cannot name.

    Raises
    ------
    InputError
        It is not UTF-8.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{path}: its name is not UTF-8, as allowed; rename it.") from None


def open_blend(path: Path) -> None:
    """Open a .blend. No script, driver or handler of the file is run.

    Raises
    ------
    InputError
        It is missing, is not a .blend, or Blender cannot read it.
    """
    refuse_name(path)
    if not path.is_file():
        found = "it is a folder" if path.is_dir() else "there is no such file"
        found = "it is no plain file" if is_endless(path) else found
        raise InputError(f"{path}: {found}; expected a .blend file.")
    if path.suffix.lower() == ".json":
        raise InputError(f"{path}: is {title_of(path)}; expected a .blend file.")
    bpy = start()
    from ..blender import blend_paths, linked_files

    blend_paths.refuse_endless(path)  # some are read while the file is opened
    try:
        # Blender does not look for bare names in the working folder.
        full = os.path.abspath(path)
        bpy.ops.wm.open_mainfile(filepath=full, load_ui=False, use_scripts=False)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[0].rpartition(": ")[2]
        reason = reason.replace(f' in file "{full}"', "")
        raise InputError(f"{path}: Blender cannot open it ({reason}).") from error
    linked_files.refuse_endless()


def remove_temporary_files() -> None:
    """Remove the folder that this process has made for Blender's temporary files, if any."""
    if _temporary is not None:
        shutil.rmtree(_temporary, ignore_errors=True)


def open_standard_streams() -> None:
    """Give the process the standard streams that it was started without (``hfx ... >&-``).

    Else the first files that are opened would get their numbers.
    """
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
    """Run ``work`` with Blender's own output discarded, so that only ours reaches stdout.

    Blender writes to the file descriptor, past ``sys.stdout``; Python's stream is moved to a
    copy of it meanwhile.
    """
    sys.stdout.flush()
    ours = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    kept = sys.stdout
    try:
        os.dup2(nowhere, 1)
        with os.fdopen(ours, "w", encoding=kept.encoding, errors="replace", closefd=False) as out:
            sys.stdout = out
            return work()
    finally:
        sys.stdout = kept
        os.dup2(ours, 1)
        os.close(ours)
        os.close(nowhere)
