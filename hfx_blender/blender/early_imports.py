# SPDX-License-Identifier: GPL-3.0-or-later
"""Import of the packages that a fit to an avatar needs, before *Add Haptic Body* is chosen."""

import threading
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Final

FIT_PACKAGES: Final = (
    *("scipy.sparse.linalg", "scipy.spatial", "scipy.ndimage"),
    *("trimesh.grouping", "trimesh.geometry", "trimesh.graph", "trimesh.triangles"),
)


@cache
def begin() -> threading.Thread:
    """Import the packages in a thread, once; a third of an ordinary fit's time. Returns the thread.
    It holds Python's lock for the 20 ms of the largest package at most: the window stays live."""
    # Not a daemon: Python waits for the imports, a second at most, before Blender quits.
    imports = threading.Thread(target=_import_all, name="imports")
    imports.start()
    return imports


def _import_all() -> None:
    """Import what is there; the operator reports a missing package."""
    for name in FIT_PACKAGES:
        if find_spec(name.partition(".")[0]) is not None:
            import_module(name)
