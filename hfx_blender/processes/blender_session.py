# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender for the command line: start, opening of files, temporary files."""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from ..errors import InputError, OutputError, is_endless
from ..files.kinds import title_of
from .process_end import check
from .tools_package import tools_module


def start() -> Any:
    """Import ``bpy`` and register this package in it; return the module. Raises HfxError: pip's
    command cannot load Blender; TerminatedError: a signal arrived during the import."""
    # A process of pip starts without Blender: hfx_tools loads the module, and takes care of the
    # module's temporary folder and of signals during the import.
    if "bpy" not in sys.modules:
        loader = tools_module("command_process.blender_module")
        assert loader is not None, "an extension runs in Blender"
        loader.load()
    bpy = sys.modules["bpy"]
    # In the Blender program the extension is registered already.
    if not hasattr(bpy.types.Object, "hfx"):
        sys.modules[__package__.rpartition(".")[0]].register()  # of hfx_blender
    check()  # for signals during the start of Blender
    return bpy


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
        if (encoding := sys.getfilesystemencoding()) != "utf-8":
            raise InputError(
                f"{path}: names are {encoding} here, allowed is UTF-8: set LC_ALL=C.UTF-8."
            ) from None
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
    from ..blender import linked_files
    from ..files import blend_paths

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
