# SPDX-License-Identifier: GPL-3.0-or-later
"""Entry point of child processes: loads the package by path, then runs a module of the package.

Run by path (``start.py``): ``child.py PACKAGES MODULE ARGUMENT...`` or ``child.py PACKAGES -c
PROGRAM ARGUMENT...``. The parent folder of the package is not added to ``sys.path``: in Blender
all extensions are there, with names such as ``queue``. The folders in PACKAGES are appended.
"""

import _signal
import os
import sys
from importlib.util import module_from_spec, spec_from_file_location
from runpy import run_module

_FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_NAME = "hfx_blender"  # also in an extension, whose package has another name in Blender
_TOOLS = "hfx_tools"  # next to the package; missing in an extension


def _load_package(name: str, folder: str) -> None:
    spec = spec_from_file_location(
        name, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
    )
    assert spec is not None and spec.loader is not None
    package = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(package)


def main() -> None:
    """Append the folders in argument 1, separated by ``os.pathsep``, to ``sys.path``, load the
    package (and ``hfx_tools`` next to it, for a module of another package), and run argument 2 as a
    module; after ``-c``, argument 3 as Python source. Both run as ``__main__`` with the further
    arguments in ``sys.argv``."""
    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        # Ctrl-C ends the parent, which reports: no traceback of each child.
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    packages, what, *arguments = sys.argv[1:]
    sys.path += [path for path in packages.split(os.pathsep) if path and path not in sys.path]
    _load_package(_NAME, _FOLDER)
    tools = os.path.join(os.path.dirname(_FOLDER), _TOOLS)
    # Next to an extension, a folder of that name would be another extension.
    if not what.startswith(f"{_NAME}.") and os.path.isdir(tools):
        _load_package(_TOOLS, tools)
    if what == "-c":
        source, *arguments = arguments
        sys.argv[:] = [what, *arguments]
        exec(compile(source, "<program>", "exec"), {"__name__": "__main__"})
    else:
        sys.argv[:] = [what, *arguments]
        run_module(what, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
