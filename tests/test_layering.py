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
from import_graph import ROOT, imports, module_name, modules, source

PURE = ("engine", "formats", "devices", "generation", "tracking")
PURE_TOOLS = ("body_building", "diffusion", "formats")
LOOSE = {"errors", "text", "version"}
"""Modules beside the packages that every package may import."""

BLENDER = ("bpy", "mathutils", "bmesh", "bpy_extras", "gpu", "idprop")
HEAVY = ("scipy", "trimesh", "fast_simplification", "serial", "websockets", "pythonosc")
EVERYDAY = (
    "engine.evaluate",
    "engine.track",
    "engine.scene",
    "engine.colouring",
    "engine.body.model",
    "engine.volume.mesh",
    "engine.rendering.render",
    "devices.configuration",
    "devices.host.host",
)

NEWER = ("ActionSlot", "ActionLayer", "ActionStrip", "ActionKeyframeStrip", "ActionChannelbag")
NEWER_STRIPS = ("Strip", "SoundStrip", "MovieStrip", "ImageStrip", "MetaStrip", "SceneStrip")
"""Types of ``bpy.types`` that came with Blender 4.4, for actions and for the sequencer."""

BLOCKER = """
import importlib, sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ImportError(name + " is blocked")

sys.meta_path.insert(0, Blocker())
for name in {names!r}:
    importlib.import_module(name)
"""


def _pure_files() -> list[Path]:
    folders = [f"hfx_blender/{name}" for name in PURE] + [
        f"hfx_tools/{name}" for name in PURE_TOOLS
    ]
    return sorted(path for name in folders for path in (ROOT / name).rglob("*.py"))


def _import_without(blocked: tuple[str, ...], names: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BLOCKER.format(blocked=set(blocked), names=names)],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr


def _stated_order(package: str) -> list[str]:
    """Return the packages listed in a package's docstring, lowest first."""
    text = ast.get_docstring(ast.parse(modules()[package].read_text(encoding="utf-8")))
    return re.findall(r"^(\w+)  +\S", text or "", re.MULTILINE)


def _units(package: str) -> dict[str, set[str]]:
    """Return each module's or folder's imports from the rest of the package."""
    start = f"{package}."
    units: dict[str, set[str]] = {}
    for name, path in modules().items():
        if name.startswith(start):
            unit = name.removeprefix(start).partition(".")[0]
            others = (
                import_.module for import_ in imports(path) if import_.module.startswith(start)
            )
            actual = {item.removeprefix(start).partition(".")[0] for item in others}
            units.setdefault(unit, set()).update(actual - {unit})
    return units


def test_layers() -> None:
    faults = []
    for path in _pure_files():
        name = module_name(path)
        faults += [
            f"{name} imports {second}" for second in source(path).others if _top(second) in BLENDER
        ]
        allowed = {*PURE, *LOOSE, "files", "processes"}
        for actual in imports(path):
            package, _, rest = actual.module.partition(".")
            is_tool = package == "hfx_tools" and path.is_relative_to(ROOT / "hfx_tools")
            if not is_tool and _top(rest) not in allowed:
                faults.append(f"{name}:{actual.line} imports {actual.module}")
    for package in ("hfx_blender", "hfx_blender.engine"):
        order, units = _stated_order(package), _units(package)
        folder = ROOT.joinpath(*package.split("."))
        is_listed = (
            units if package != "hfx_blender" else {n for n in units if (folder / n).is_dir()}
        )
        assert sorted(order) == sorted(is_listed)
        number = {name: k for k, name in enumerate(order)}
        faults += [
            f"{package}: {unit} imports {second}, which stands above it"
            for unit in number
            for second in units[unit] & number.keys()
            if number[second] > number[unit]
        ]
        TopologicalSorter(units).prepare()
    assert not [name for name, path in modules().items() if _is_tools(name, path)]
    assert not faults, "\n".join(faults)


def _top(name: str) -> str:
    return name.partition(".")[0]


def _is_tools(name: str, path: Path) -> bool:
    """A module of the product imports a module of the tools."""
    return _top(name) == "hfx_blender" and any(
        _top(actual.module) == "hfx_tools" for actual in imports(path)
    )


def test_pure_packages_import_where_blender_is_not() -> None:
    _import_without(BLENDER, [module_name(path) for path in _pure_files()])
    with pytest.raises(AssertionError, match="bpy is blocked"):
        _import_without(("bpy",), ["hfx_blender.properties.objects"])


def test_the_everyday_path_needs_numpy_only() -> None:
    formats = [module_name(path) for path in (ROOT / "hfx_blender/formats").rglob("*.py")]
    everyday = [f"hfx_blender.{name}" for name in EVERYDAY]
    _import_without((*BLENDER, *HEAVY), [*everyday, *formats])


def test_imported_names_are_there() -> None:
    for name, path in modules().items():
        for actual in imports(path):
            there = actual.module in modules()
            assert there and (
                not actual.name or actual.name in source(modules()[actual.module]).names
            ), (name, actual)


def test_evaluated_annotations_name_types_of_the_oldest_blender() -> None:
    """Annotations of types that Blender 4.2 lacks are quoted or postponed, so that all modules can
    be imported there."""
    newer = re.compile(rf"(?<!\")bpy\.types\.({'|'.join((*NEWER, *NEWER_STRIPS))})\b")
    postponed = "from __future__ import annotations"
    texts = {name: path.read_text(encoding="utf-8") for name, path in modules().items()}
    assert any(newer.search(text) for text in texts.values()), "nothing is looked at"
    assert [n for n, text in texts.items() if postponed not in text and newer.search(text)] == []


def test_no_modules_import_each_other_in_a_circle() -> None:
    TopologicalSorter(
        {name: {actual.module for actual in imports(path)} for name, path in modules().items()}
    ).prepare()


def test_the_spine_of_the_engine_is_short() -> None:
    assert len(list((ROOT / "hfx_blender/engine").glob("*.py"))) <= 16  # with __init__


def test_programs_within_strings_import_modules_that_exist() -> None:
    # Children run short programs; a move of the module is seen nowhere else.
    pattern = re.compile(r"^\s*(?:from|import) (hfx_(?:blender|tools)(?:\.\w+)+)", re.M)
    missing = []
    for path in modules().values():
        for program in source(path).programs:
            for dotted in pattern.findall(program):
                module_path = ROOT.joinpath(*dotted.split("."))
                if not (module_path.is_dir() or module_path.with_suffix(".py").is_file()):
                    missing.append(f"{path.name}: {dotted}")
    assert not missing
