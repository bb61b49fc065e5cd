# SPDX-License-Identifier: GPL-3.0-or-later
"""Exported functions and structures of the library's C sources, as JSON for ``library.py``."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

_COMMENT = re.compile(r"//.*|/\*[^*]*\*/")
_FUNCTION = re.compile(r"HFX_EXPORT ([\w ]+\*?)\b(hfx_\w+)\(([^()]*)\) \{")
_STRUCTURE = re.compile(r"typedef struct \{([^{}]*)\} (hfx_\w+);")
_CONSTANT = re.compile(r"#define (\w+) (\d+)\b")
_DECLARATION = re.compile(r"((?:const )?\w+) (.*)", re.DOTALL)
_NAME = re.compile(r"(\**)(\w+)(?:\[(\w+)\])?")

Variable = tuple[str, str, int]
"""Name, type such as ``const double *``, and number of elements; 0 if not an array in C."""


def interface(sources: Iterable[Path]) -> str:
    """Read C sources to JSON: ``functions`` (result, arguments), ``structures`` (fields) by name.

    Raises
    ------
    ValueError
        A declaration cannot be read.
    """
    text = _COMMENT.sub("", "\n".join(path.read_text("utf-8") for path in sources))
    constants = dict(_CONSTANT.findall(text))
    functions = {
        name: (result.strip(), _variables(arguments.split(",") if arguments != "void" else (), {}))
        for result, name, arguments in _FUNCTION.findall(text)
    }
    structures = {
        name: _variables(fields.strip().rstrip(";").split(";"), constants)
        for fields, name in _STRUCTURE.findall(text)
    }
    return json.dumps({"functions": functions, "structures": structures}, separators=(",", ":"))


def _variables(declarations: Iterable[str], constants: dict[str, str]) -> list[Variable]:
    return [variable for text in declarations for variable in _declared(text.strip(), constants)]


def _declared(declaration: str, constants: dict[str, str]) -> Iterator[Variable]:
    """Variables of one declaration, as ``const double *boxes, *far``."""
    parts = _DECLARATION.fullmatch(declaration)
    for declarator in parts[2].split(",") if parts else ():
        named = _NAME.fullmatch(declarator.strip())
        if named is None:
            parts = None
            break
        stars, name, count = named.groups()
        yield name, f"{parts[1]} {stars}".strip(), int(constants.get(count, 0))
    if parts is None:
        raise ValueError(f"'{declaration}' cannot be declared for Python")
