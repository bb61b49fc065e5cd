# SPDX-License-Identifier: GPL-3.0-or-later
"""The pure packages work without Blender, and the everyday path needs numpy only."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from import_graph import PACKAGE, imports, module_name, modules, source

PURE = ("engine", "formats", "devices", "generation")
PURE += ("maintenance/body_building", "maintenance/diffusion")
SHARED = {
    "errors",
    "resources",
    "atomic_files",
    "file_hash",
    "file_limits",
    "file_suffixes",
    "import_path",
    "json_kinds",
    "own_processes",
    "printable",
    "sentences",
    "stage_folders",
    "staging",
    "stepwise",
    *PURE,
}
BLENDER = ("bpy", "mathutils", "bmesh", "bpy_extras", "gpu", "idprop")
HEAVY = ("scipy", "trimesh", "fast_simplification", "serial")
EVERYDAY = (
    "engine.evaluate",
    "engine.track",
    "engine.scene",
    "engine.colouring",
    "engine.body.model",
    "engine.volume.mesh",
    "engine.rendering.render",
    "devices.configuration",
)

BLOCKER = """
import importlib, sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ImportError(name + " is blocked")

sys.meta_path.insert(0, Blocker())
for name in {names!r}:
    importlib.import_module("hfx_blender." + name)
"""


def _pure_files() -> list[Path]:
    return sorted(path for name in PURE for path in (PACKAGE / name).rglob("*.py"))


def _import_without(blocked: tuple[str, ...], names: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BLOCKER.format(blocked=set(blocked), names=names)],
        capture_output=True,
        text=True,
        cwd=PACKAGE.parent,
    )
    assert done.returncode == 0, done.stderr


def test_pure_packages_import_where_blender_is_not() -> None:
    _import_without(BLENDER, [module_name(path) for path in _pure_files()])


def test_the_everyday_path_needs_numpy_only() -> None:
    formats = [module_name(path) for path in (PACKAGE / "formats").glob("*.py")]
    _import_without((*BLENDER, *HEAVY), [*EVERYDAY, *formats])


def test_the_blocker_blocks() -> None:
    with pytest.raises(AssertionError, match="bpy is blocked"):
        _import_without(("bpy",), ["properties"])


@pytest.mark.parametrize("path", _pure_files(), ids=module_name)
def test_pure_files_look_neither_at_blender_nor_at_its_side(path: Path) -> None:
    assert not [name for name in source(path).others if name.partition(".")[0] in BLENDER]
    for found in imports(path):
        package = "/".join(found.module.split(".")[:2])
        ours = package in PURE and "maintenance" in path.parts
        assert ours or found.module.partition(".")[0] in SHARED, f"imports {found.module}"


def test_what_is_imported_is_there() -> None:
    for name, path in modules().items():
        for found in imports(path):
            there = found.module in modules()
            assert there and (
                not found.name or found.name in source(modules()[found.module]).names
            ), (name, found)


# Order


def _stated_order(package: str) -> list[str]:
    """The list in the docstring of a package, lowest first."""
    text = ast.get_docstring(ast.parse(modules()[package].read_text(encoding="utf-8")))
    return re.findall(r"^(\w+)  +\S", text or "", re.MULTILINE)


def _units(package: str) -> dict[str, set[str]]:
    """Imports of each module or folder of a package from the others, anywhere in it."""
    start = f"{package}." if package else ""
    found: dict[str, set[str]] = {}
    for name, path in modules().items():
        if name != package and name.startswith(start):
            unit = name.removeprefix(start).partition(".")[0]
            others = (each.module for each in imports(path) if each.module.startswith(start))
            units = {each.removeprefix(start).partition(".")[0] for each in others}
            found.setdefault(unit, set()).update(units - {unit, ""})
    return found


@pytest.mark.parametrize("package", ["", "engine"])
def test_a_package_imports_only_from_those_before_it(package: str) -> None:
    order, units = _stated_order(package), _units(package)
    folders = {name for name in units if (PACKAGE / package / name).is_dir()}
    assert sorted(order) == sorted(units if package else folders)
    place = {name: number for number, name in enumerate(order)}
    upward = {
        (unit, other)
        for unit in place
        for other in units[unit] & place.keys()
        if place[other] > place[unit]
    }
    assert not upward


@pytest.mark.parametrize("package", ["", "engine"])
def test_nothing_imports_itself_in_a_circle(package: str) -> None:
    TopologicalSorter(_units(package)).prepare()
    whole = {name: {each.module for each in imports(path)} for name, path in modules().items()}
    del whole[""]  # the package itself imports all to register it, and all may know its version
    for found in whole.values():
        found.discard("")
    TopologicalSorter(whole).prepare()


def test_the_spine_of_the_engine_is_short() -> None:
    assert len([path for path in (PACKAGE / "engine").glob("*.py")]) <= 16  # with __init__


def test_programs_within_strings_import_modules_that_exist() -> None:
    # Children run short programs; a move of the module is seen nowhere else.
    wanted = re.compile(r"^\s*(?:from|import) hfx_blender((?:\.\w+)+)", re.M)
    missing = []
    for path in modules().values():
        for program in source(path).programs:
            for dotted in wanted.findall(program):
                place = PACKAGE.joinpath(*dotted[1:].split("."))
                if not (place.is_dir() or place.with_suffix(".py").is_file()):
                    missing.append(f"{path.name}: hfx_blender{dotted}")
    assert not missing
