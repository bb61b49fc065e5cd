# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages of the extension, and their translations in ``hfx_blender/translations/``.

``python -m release.messages`` lists messages without a translation, translations without a message,
and translations with other placeholders. It needs Blender's module ``bpy``.

Labels, tooltips and menu entries come from the registered classes; texts of panels, reports and
errors from the source. A value inside of a text is a placeholder, ``{0}``, ``{1}``.
"""

from __future__ import annotations

import ast
import csv
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parents[1] / "hfx_blender"
LANGUAGES = ("de", "ja")
_UNSEEN = (
    *("commands", "engine/reference", "engine/native", "export/batch", "devices/workers"),
    *("cli.py", "__main__.py", "files/blend_paths.py"),
)
"""Parts of the package whose texts Blender never shows."""

_IN_BLENDER = (
    *("ui/", "operators/", "properties/", "authoring/", "avatars/", "playback/", "reading/"),
    *("blender/", "export/", "generation/", "engine/retargeting/quality.py"),
    *("devices/live/connection_search.py", "devices/configurations/device_facts.py"),
)
"""Modules with texts for panels and reports that are neither labels nor errors."""

_LABELS = ("ui/", "engine/body/parts.py")
"""Modules whose capitalized words are labels."""

_FORMATS, _REGIONS = "formats/formats.toml", "engine/body/regions.csv"
_MODALITIES = "engine/modalities.toml"

_WORDS = re.compile(r"[A-Za-z]{2,}")
_PLACEHOLDER = re.compile(r"\{\d+\}")
_FORMAT_FIELD = re.compile(r"(\{[a-z_]*(?::[^{}]*)?\})")  # of str.format
_TEXT_ARGUMENTS = {"text", "title", "placeholder", "confirm_text", "message"}
_NO_TEXT = {
    "NONE",
    *("not {0}", "item {0}", "degree {0}", "weave {0}", "a datablock {0}"),
    *("latin-1", "module {0} has no attribute {1}", "born_until_s not before born_from_s"),
    "User Interface",
    *("live track", "live source", "live mutes", "live forget"),
    "numpy scipy trimesh fast_simplification serial sounddevice websockets",
    "Scene Screen WindowManager WorkSpace Collection Material World Camera Light Brush Image",
}
"""Names in the program that look like texts."""

_SKIPPED_CALLS = {"compile", "getattr", "setattr", "hasattr", "driver_add", "get", "path_from_id"}


def placeholders(text: str) -> list[str]:
    """Placeholders of a message, sorted."""
    return sorted(_PLACEHOLDER.findall(text))


def template(node: ast.expr) -> str | None:
    """Text of a string expression with placeholders for values; None for other expressions."""
    parts = _parts(node)
    if not any(isinstance(part, str) for part in parts):
        return None
    numbers = iter(range(len(parts)))
    return "".join(part if isinstance(part, str) else f"{{{next(numbers)}}}" for part in parts)


def _parts(node: ast.expr) -> list[str | None]:
    """Constant parts of a string expression, with None for each value; [None] without parts."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        pieces: list[str | None] = list(_FORMAT_FIELD.split(node.value))
        return [None if k % 2 else piece for k, piece in enumerate(pieces) if piece != ""]
    if isinstance(node, ast.JoinedStr):
        return [part for value in node.values for part in _parts(value)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _parts(node.left) + _parts(node.right)
    return [None]


class _Texts(ast.NodeVisitor):
    """Collector of the texts of a module."""

    def __init__(self, *, is_in_blender: bool, has_labels: bool) -> None:
        self.found: list[str] = []
        self._is_in_blender = is_in_blender or has_labels
        self._has_labels = has_labels
        self._is_shown = False  # inside of an argument that is shown to the user

    def visit(self, node: ast.AST) -> None:
        if isinstance(node, ast.expr):
            text = template(node)
            if text is not None:
                if self.is_text(text):
                    self.found.append(text)
                # Values inside of a text may be texts themselves.
                for inner in _values(node):
                    self._visit_shown(inner)
                return
        super().visit(node)

    def is_text(self, text: str) -> bool:
        if not _WORDS.search(_PLACEHOLDER.sub(" ", text)) or "\n" in text:
            return False
        if self._is_shown:
            return text.strip() not in _NO_TEXT and not re.fullmatch(r"[a-z_]+|[A-Z0-9_]+", text)
        if self._has_labels and re.fullmatch("[A-Z][a-z]{2,}", text):
            return True
        names = "_" in text and re.fullmatch("[a-z_ ]+", text)  # of properties
        if not self._is_in_blender or text in _NO_TEXT or names:
            return False
        if re.match(r"[A-Z'{]", text):
            return " " in text and bool(re.search("[a-z]{2}", text))
        return bool(re.search(r"[a-z]{3} [a-z]{2}|\} [a-z]{3}|[a-z]{3} \{|^[ ,;]+[a-z]{3}", text))

    def _visit_shown(self, node: ast.AST) -> None:
        before, self._is_shown = self._is_shown, True
        self.visit(node)
        self._is_shown = before

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # docstrings
            self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        if isinstance(node.exc, ast.Call):
            for argument in node.exc.args:
                self._visit_shown(argument)

    def visit_Call(self, node: ast.Call) -> None:
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        self.visit(node.func)
        if name in _SKIPPED_CALLS or ast.unparse(node.func).startswith("_log."):
            return
        is_shown = name in ("fail", "report", "draw_text", "draw_wrapped", "translated")
        for argument in node.args:
            (self._visit_shown if is_shown else self.visit)(argument)
        for keyword in node.keywords:
            is_text = keyword.arg in _TEXT_ARGUMENTS
            (self._visit_shown if is_text else self.visit)(keyword.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        pass

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_arguments(self, node: ast.arguments) -> None:
        for default in (*node.defaults, *filter(None, node.kw_defaults)):
            self.visit(default)


def _values(node: ast.AST) -> Iterator[ast.expr]:
    """Expressions of the values in a string expression."""
    if isinstance(node, ast.FormattedValue):
        yield node.value
    elif isinstance(node, ast.JoinedStr):
        for value in node.values:
            yield from _values(value)
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        for side in (node.left, node.right):
            if template(side) is None:
                yield side
            else:
                yield from _values(side)


def source_messages() -> dict[str, str]:
    """Texts of panels, reports and errors, with the file of each."""
    messages: dict[str, str] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        if name.startswith(_UNSEEN):
            continue
        is_in_blender = name.startswith(_IN_BLENDER)
        texts = _Texts(is_in_blender=is_in_blender, has_labels=name.startswith(_LABELS))
        texts.visit(ast.parse(path.read_text(encoding="utf-8")))
        for text in texts.found:
            messages.setdefault(text, name)
    labels = _Texts(is_in_blender=True, has_labels=True)
    for name, text in _table_texts():
        if labels.is_text(text):
            messages.setdefault(text, name)
    return messages


def _table_texts() -> Iterator[tuple[str, str]]:
    """Labels in tables beside the source: the name of the table, and a text."""
    for members in tomllib.loads((PACKAGE / _FORMATS).read_text(encoding="utf-8")).values():
        yield _FORMATS, members["title"]
    for members in tomllib.loads((PACKAGE / _MODALITIES).read_text(encoding="utf-8")).values():
        for field in ("title", "description", "devices"):
            yield _MODALITIES, members[field]
    with (PACKAGE / _REGIONS).open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            yield _REGIONS, row["label"]


def class_messages() -> dict[str, str]:
    """Labels, tooltips and menu entries of the registered classes, with the class of each."""
    import bpy

    messages: dict[str, str] = {}

    def add(text: str, owner: str) -> None:
        if _WORDS.search(text or "") and not re.fullmatch("[a-z_]+", text):  # no name of Python
            messages.setdefault(text, owner)

    for cls in _classes():
        name, rna = cls.__name__, cls.bl_rna
        inherited = set() if rna.base is None else set(rna.base.properties.keys())
        if not hasattr(cls, "preset_subdir"):  # Blender sets the label to the chosen preset
            add(getattr(cls, "bl_label", ""), name)
        if issubclass(cls, bpy.types.Operator):
            rna = getattr(bpy.ops.hfx, cls.bl_idname.partition(".")[2]).get_rna_type()
            inherited = {"rna_type"}
        if issubclass(cls, bpy.types.Operator | bpy.types.Menu):
            add(rna.description, name)
        for prop in rna.properties:
            if prop.identifier in inherited:
                continue
            if not getattr(prop, "is_hidden", False):
                add(prop.name, name)
                add(prop.description, name)
            for item in getattr(prop, "enum_items_static", ()):
                add(item.name, name)
                add(item.description, name)
    kinds = [bpy.types.WorkSpaceTool, bpy.types.FileHandler]
    while kinds:
        for tool in kinds.pop().__subclasses__():
            kinds.append(tool)
            if tool.__module__.startswith("hfx_blender."):
                add(getattr(tool, "bl_label", ""), tool.__name__)
                add(getattr(tool, "bl_description", ""), tool.__name__)
    for owner in (bpy.types.Scene, bpy.types.Object, bpy.types.WindowManager):
        for prop in owner.bl_rna.properties:
            if prop.identifier.startswith("hfx"):
                add(prop.name, owner.__name__)
                add(prop.description, owner.__name__)
    return messages


def _classes() -> list[Any]:
    """Registered classes of the extension."""
    import bpy

    kinds = [bpy.types.Operator, bpy.types.Panel, bpy.types.Menu, bpy.types.UIList]
    kinds += [bpy.types.PropertyGroup, bpy.types.AddonPreferences, bpy.types.GizmoGroup]
    classes: list[Any] = []
    while kinds:
        subclasses = kinds.pop().__subclasses__()
        kinds += subclasses
        classes += [
            cls
            for cls in subclasses
            if cls.__module__.startswith("hfx_blender.") and getattr(cls, "is_registered", False)
        ]
    return classes


def messages() -> dict[str, str]:
    """All messages of the extension, with the place of each; registers the extension."""
    return {**source_messages(), **class_messages()}


def translations(language: str) -> dict[str, str]:
    """Translations into a language, by message."""
    path = PACKAGE / "translations" / f"{language}.json"
    content: dict[str, str] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    return content


def faults(language: str, known: dict[str, str]) -> list[str]:
    """Missing, superfluous and faulty translations of a language, one line each."""
    own = translations(language)
    lines = [f"missing: {text!r} ({known[text]})" for text in sorted(known.keys() - own.keys())]
    lines += [f"superfluous: {text!r}" for text in sorted(own.keys() - known.keys())]
    lines += [
        f"other placeholders: {text!r} -> {own[text]!r}"
        for text in sorted(own.keys() & known.keys())
        if placeholders(text) != placeholders(own[text]) or not own[text].strip()
    ]
    return lines


def main() -> int:
    import hfx_blender

    hfx_blender.register()
    known = messages()
    count = 0
    for language in LANGUAGES:
        for line in faults(language, known):
            count += 1
            sys.stdout.write(f"{language}: {line}\n")
    sys.stdout.write(f"{len(known)} messages, {count} faults\n")
    sys.stdout.flush()
    return 1 if count else 0


if __name__ == "__main__":
    raise SystemExit(main())
