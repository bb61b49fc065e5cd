# SPDX-License-Identifier: GPL-3.0-or-later
"""The pure packages work without Blender, and the everyday path needs numpy only."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "hfx_blender"
PURE = ("engine", "formats", "devices")
SHARED = {
    "errors",
    "resources",
    "atomic_files",
    "file_limits",
    "file_suffixes",
    "import_path",
    "own_processes",
    "printable",
    "sentences",
    "stage_folders",
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


def _module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _import_without(blocked: tuple[str, ...], names: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BLOCKER.format(blocked=set(blocked), names=names)],
        capture_output=True,
        text=True,
        cwd=PACKAGE.parent,
    )
    assert done.returncode == 0, done.stderr


def test_pure_packages_import_where_blender_is_not() -> None:
    _import_without(BLENDER, [_module_name(path) for path in _pure_files()])


def test_the_everyday_path_needs_numpy_only() -> None:
    formats = [_module_name(path) for path in (PACKAGE / "formats").glob("*.py")]
    _import_without((*BLENDER, *HEAVY), [*EVERYDAY, *formats])


def test_the_blocker_blocks() -> None:
    with pytest.raises(AssertionError, match="bpy is blocked"):
        _import_without(("bpy",), ["properties"])


def _imports(path: Path) -> Iterator[str]:
    """Modules that a file imports anywhere, functions included; ours relative to the package."""
    package = path.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module or ""
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1]
            tail = node.module.split(".") if node.module else []
            ours = [*base, *tail]
            names = [[*ours, alias.name] for alias in node.names] if not ours else [ours]
            yield from (".".join(("hfx_blender", *each)) for each in names)


@pytest.mark.parametrize("path", _pure_files(), ids=_module_name)
def test_pure_files_look_neither_at_blender_nor_at_its_side(path: Path) -> None:
    for name in _imports(path):
        top, _, rest = name.partition(".")
        assert top not in BLENDER, f"imports {name}"
        if top == "hfx_blender":
            assert rest.partition(".")[0] in SHARED, f"imports {name}"


def test_engine_knows_neither_formats_nor_devices() -> None:
    for path in (PACKAGE / "engine").rglob("*.py"):
        for name in _imports(path):
            assert not name.startswith(("hfx_blender.formats", "hfx_blender.devices")), path
