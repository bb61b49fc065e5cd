# SPDX-License-Identifier: GPL-3.0-or-later
"""Docstrings and C comments begin with a noun or a verb."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hfx_blender"

# All docstrings, found by a pattern. Parsing all files would take a second.
_FIRST_WORD = re.compile(r'^[ \t]*r?"""([^\s"]+)', re.MULTILINE)

# First lines of C comments on separate lines.
_FIRST_WORD_IN_C = re.compile(
    r"^(?![ \t]*//)[^\n]*\n[ \t]*//[ ]([^\s:,]+)|^[ \t]*/\*[ ]([^\s:,]+)", re.MULTILINE
)

_CLAUSES = {"What", "Where", "Which", "How", "Who", "Whom", "Whose", "That", "Whether", "When"}
_CLAUSES |= {"Why", "If", "As", "So", "Those", "These", "Of", "From", "To", "Nobody", "Nothing"}


def _first_words(text: str) -> list[str]:
    return _FIRST_WORD.findall(text)


def test_docstrings_begin_with_a_noun_or_a_verb() -> None:
    actual = [
        (word, path.relative_to(PACKAGE))
        for path in sorted(PACKAGE.rglob("*.py"))
        for word in _first_words(path.read_text(encoding="utf-8"))
    ]
    assert len(actual) > 3000  # the pattern still matches
    clauses = [entry for entry in actual if entry[0] in _CLAUSES]
    assert not clauses


def _first_words_in_c(text: str) -> list[str]:
    return ["".join(match) for match in _FIRST_WORD_IN_C.findall(text)]


def test_comments_in_c_begin_with_a_noun_or_a_verb() -> None:
    folders = PACKAGE / "engine" / "native" / "source", ROOT / "players" / "core", ROOT / "firmware"
    actual = [
        (word, path.relative_to(ROOT))
        for folder in folders
        for path in sorted(folder.rglob("*.[ch]"))
        for word in _first_words_in_c(path.read_text(encoding="utf-8"))
    ]
    assert len(actual) > 250  # the pattern still matches
    clauses = [entry for entry in actual if entry[0] in _CLAUSES]
    assert not clauses
    text = "int a;\n// What it is, if\n// How much\n\n  /* Whether: */\n  b();\n  // Which one.\n"
    assert _first_words_in_c(text) == ["What", "Whether", "Which"]


def test_first_words_are_those_of_docstrings() -> None:
    text = '"""What it is."""\nX = """none"""\ndef f():\n    r"""Reads.\n\n    More.\n    """\n'
    assert _first_words(text) == ["What", "Reads."]
