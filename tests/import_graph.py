# SPDX-License-Identifier: GPL-3.0-or-later
"""Imports between the modules of the package, read from their source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
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


@cache
def imports(path: Path) -> tuple[Import, ...]:
    """Imports anywhere in a file: in functions and under TYPE_CHECKING, too."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[Import]:
    package = path.relative_to(PACKAGE).parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            ours = (*package[: len(package) - node.level + 1],) if node.level else ()
            base = ".".join((*(["hfx_blender"] if node.level else []), *ours))
            base = ".".join(filter(None, (base, node.module)))
            found = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in found:
            top, _, rest = name.partition(".")
            if top == "hfx_blender":
                is_module = rest in modules()
                module, _, attribute = (rest, "", "") if is_module else rest.rpartition(".")
                yield Import(module, attribute, node.lineno)


@cache
def names_in(module: str) -> frozenset[str]:
    """Names that the source of a module binds anywhere."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(modules()[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found.update(alias.asname or alias.name for alias in node.names)
    return frozenset(found)
