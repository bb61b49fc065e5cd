# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays passed by pointer to the compiled library are bound to a name until the call is over.

Python frees an array that only ``pointer`` was given before the library reads it. The memory is
reused by then only by chance, and hardly ever in one thread.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import hfx_blender.engine.native

ENGINE = Path(hfx_blender.engine.native.__file__).parents[1]
FILES = sorted((*ENGINE.glob("native/*.py"), *ENGINE.glob("contact/compiled_*.py")))


def _nameless(source: str) -> list[str]:
    """Pointers in some source without an owner."""
    tree = ast.parse(source)
    found: list[str] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ListComp | ast.GeneratorExp) and _points(node.elt):
            found += _made(*(each.iter for each in node.generators))
        elif isinstance(node, ast.Call) and _points(node.func):
            found += _made(*node.args)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "map":
            found += _made(*node.args[1:]) if _points(node.args[0]) else ()
        elif isinstance(node, ast.Attribute) and ast.unparse(node).endswith(".ctypes.data"):
            found += _made(node.value)
    return found


def _points(expression: ast.expr) -> bool:
    """Test an expression for ``pointer``, or a call of it."""
    if isinstance(expression, ast.Call):
        expression = expression.func
    return isinstance(expression, ast.Name) and expression.id == "pointer"


def _made(*values: ast.expr) -> Iterator[str]:
    """Parts of expressions that are neither names nor attributes, nor tuples of such."""
    for value in values:
        if isinstance(value, ast.Tuple | ast.List):
            yield from _made(*value.elts)
        elif isinstance(value, ast.Starred | ast.Attribute):
            yield from _made(value.value)
        elif not isinstance(value, ast.Name):
            yield ast.unparse(value)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_all_that_is_pointed_at_is_held(path: Path) -> None:
    assert _nameless(path.read_text()) == []


@pytest.mark.parametrize(
    "source",
    [
        "call(pointer(f64(points)))",
        "call(*[pointer(each) for each in (weights, f64(reported), columns)])",
        "call(*(pointer(each) for each in made()))",
        "call(*map(pointer, (rows, found[1:])))",
        "call(pointer(a + b))",
        "call(made().ctypes.data)",
    ],
)
def test_what_is_made_on_the_way_is_found(source: str) -> None:
    assert len(_nameless(source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        "call(pointer(points), pointer(self.table.points))",
        "call(*map(pointer, (*arrays, boxes)), *map(pointer, arrays))",
        "at = [pointer(each) for each in self._arrays]",
        "call([f64(each) for each in (a, b)])",
    ],
)
def test_what_has_a_name_is_not(source: str) -> None:
    assert _nameless(source) == []
