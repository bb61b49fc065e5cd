# SPDX-License-Identifier: GPL-3.0-or-later
"""Foreign modules with the names of imported modules; each prints a line when run."""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from pathlib import Path

RAN = "IT RAN"
OTHERS = """numpy scipy trimesh serial sounddevice bpy mathutils addon_utils bl_ui hfx_blender
_distutils_hack sitecustomize usercustomize startup_file""".split()
# Imported by Python before reading options; impossible to prevent.
NOT_OURS = {"encodings"}

CHILDREN = (
    "hfx_tools.export_workers.unit_process",
    "hfx_tools.demo.picture_process",
    "devices.host.host",
    "devices.workers.render_worker",
    "devices.workers.script_worker",
    "engine.texture.relief.relief_estimate",
    "generation.generation_process",
    "hfx_tools.relief.data_set",
    "hfx_tools.relief.training",
)
"""Modules that are run as processes."""


def fill(folder: Path, *, only_known: bool = False) -> None:
    """Write a module for every name of Python's library and of the package's imports into a folder.

    ``only_known`` leaves out modules missing in this Python, such as Windows' modules.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names = {*(sys.stdlib_module_names - set(sys.builtin_module_names) - NOT_OURS), *OTHERS}
    for name in names:
        path = folder / f"{name}.py"
        if path.with_suffix("").exists() or (only_known and PathFinder.find_spec(name) is None):
            continue
        path.write_text(f"import sys\nsys.stderr.write('{RAN}: {name}\\n')\nraise SystemExit(77)\n")
