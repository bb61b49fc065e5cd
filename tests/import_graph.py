# SPDX-License-Identifier: GPL-3.0-or-later
"""Import graph of the packages' modules, read from source."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hfx_blender"
PACKAGES = ("hfx_blender", "hfx_tools")


class Import(NamedTuple):
    """Module imported by a file, in the form of :func:`module_name`."""

    module: str
    name: str  # of the module's contents; "" for the module itself
    line: int


def module_name(path: Path) -> str:
    """Return the dotted name of a file's module: ``hfx_blender.engine.scene``."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    """Return all modules of the packages, by name."""
    return {
        module_name(path): path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))
    }


class Source(NamedTuple):
    """Facts of a file's source, from a single parse."""

    imports: tuple[Import, ...]  # of the packages, anywhere: in functions and TYPE_CHECKING, too
    others: tuple[str, ...]  # imported third-party modules
    names: frozenset[str]  # bound anywhere
    programs: tuple[str, ...]  # strings naming modules of the packages


def imports(path: Path) -> tuple[Import, ...]:
    """Return imports of modules of the packages anywhere in a file."""
    return source(path).imports


@cache
def source(path: Path) -> Source:
    """Return facts of a file's source."""
    package = path.relative_to(ROOT).parts[:-1]
    own: list[Import] = []
    others: list[str] = []
    names: set[str] = set()
    programs: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names.update(alias.asname or alias.name for alias in node.names)
            for name in _imported(node, package):
                if name.partition(".")[0] in PACKAGES:
                    module, _, attribute = (
                        (name, "", "") if name in modules() else name.rpartition(".")
                    )
                    own.append(Import(module, attribute, node.lineno))
                else:
                    others.append(name)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if any(f"{name}." in node.value for name in PACKAGES):
                programs.append(node.value)
    return Source(tuple(own), tuple(others), frozenset(names), tuple(programs))


def _imported(node: ast.Import | ast.ImportFrom, package: tuple[str, ...]) -> list[str]:
    """Return dotted names imported by a statement."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    within = package[: len(package) - node.level + 1] if node.level else ()
    base = [*within, *filter(None, [node.module])]
    return [".".join([*base, alias.name]) for alias in node.names]
