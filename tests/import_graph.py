# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports between the modules of the package, read from their source."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).resolve().parents[1] / "hfx_blender"


class Import(NamedTuple):
    """A module of the package that a file imports, named as :func:`module_name` names it."""

    module: str
    name: str  # what of it; "" for the module itself
    line: int


def module_name(path: Path) -> str:
    """Dotted name within the package, "" for the package itself."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    """All modules of the package, by name."""
    return {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


class Source(NamedTuple):
    """Facts of a file's source, read in one go."""

    imports: tuple[Import, ...]  # of ours, anywhere: in functions and under TYPE_CHECKING, too
    others: tuple[str, ...]  # modules of others that it imports
    names: frozenset[str]  # that it binds anywhere
    programs: tuple[str, ...]  # texts in it that import ours


def imports(path: Path) -> tuple[Import, ...]:
    """Imports of our modules anywhere in a file."""
    return source(path).imports


@cache
def source(path: Path) -> Source:
    package = path.relative_to(PACKAGE).parts[:-1]
    ours: list[Import] = []
    others: list[str] = []
    names: set[str] = set()
    programs: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names.update(alias.asname or alias.name for alias in node.names)
            for name in _imported(node, package):
                top, _, rest = name.partition(".")
                if top == "hfx_blender":
                    is_module = rest in modules()
                    module, _, attribute = (rest, "", "") if is_module else rest.rpartition(".")
                    ours.append(Import(module, attribute, node.lineno))
                else:
                    others.append(name)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if "hfx_blender." in node.value:
                programs.append(node.value)
    return Source(tuple(ours), tuple(others), frozenset(names), tuple(programs))


def _imported(node: ast.Import | ast.ImportFrom, package: tuple[str, ...]) -> list[str]:
    """Dotted names that a statement imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    within = package[: len(package) - node.level + 1] if node.level else ()
    base = [*(["hfx_blender"] if node.level else []), *within, *filter(None, [node.module])]
    return [".".join([*base, alias.name]) for alias in node.names]
