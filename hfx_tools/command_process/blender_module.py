# SPDX-License-Identifier: GPL-3.0-or-later
"""Loading of Blender's Python module, with a removable folder for its temporary files."""

from __future__ import annotations

import atexit
import gc
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hfx_blender.errors import HfxError
from hfx_blender.files.atomic import placing, remove_at_end
from hfx_blender.files.staging import remove_tree
from hfx_blender.processes.start import CHILD

from .signal_watch import end_on_signals

_SYSTEM_PACKAGES = (
    "libx11-6 libxrender1 libxxf86vm1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1"
)

_temporary: Path | None = None
"""Folder of Blender's temporary files, created by this process and removed at the end."""


def load() -> None:
    """Import ``bpy``. A signal during the import is recorded; in child processes signals end the
    process at once. Raises HfxError: Blender cannot be loaded; the message names the missing
    packages."""
    if str(CHILD) in sys.orig_argv:  # started by start()
        end_on_signals(at_once=True)
    try:
        with _temporary_folder():
            import bpy  # noqa: F401
        # Descriptions of thousands of effects are no garbage: looking through all objects again
        # and again takes a tenth of an export.
        gc.set_threshold(50_000, 20, 100)
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


@contextmanager
def _temporary_folder() -> Iterator[None]:
    """Context manager in which a starting Blender uses a new folder for temporary files, removed at
    the end of the process; no effect if the folder cannot be made.
    ``bpy.app.tempdir`` cannot be removed instead: without permission to create a folder, Blender
    uses the user's temporary folder itself."""
    global _temporary
    with suppress(OSError):  # missing or full: Blender looks for a folder
        with placing:
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


def remove_temporary_files() -> None:
    """Remove the folder of Blender's temporary files created by this process, if any."""
    if _temporary is not None:
        shutil.rmtree(_temporary, ignore_errors=True)
