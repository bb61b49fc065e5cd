# SPDX-License-Identifier: GPL-3.0-or-later
"""Import of ``hfx_tools``, the package of pip's command, which an installed extension lacks.

Only this module imports the package.
"""

import importlib.util
import sys
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Final

PACKAGE: Final = "hfx_tools"


def tools_module(name: str) -> ModuleType | None:
    """Import a module by its name within ``hfx_tools``; None in an installed extension."""
    return importlib.import_module(f"{PACKAGE}.{name}") if has_tools() else None


def has_tools() -> bool:
    """Import the package; False where it is missing next to this package."""
    if PACKAGE in sys.modules:
        return True
    # Search only the folder of this package: a package of that name elsewhere, or next to an
    # extension (``bl_ext...hfx_blender``), is another program's.
    spec = PathFinder.find_spec(PACKAGE, [str(Path(__file__).resolve().parents[2])])
    if __package__.count(".") > 1 or spec is None or spec.loader is None:
        return False
    sys.modules[PACKAGE] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[PACKAGE])
    return True
