# SPDX-License-Identifier: GPL-3.0-or-later
"""Docstrings say what a thing is or does: they begin with a noun or a verb."""

from __future__ import annotations

import re
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "hfx_blender"

# Modules, classes, functions and constants alike. Parsing all files would take a second.
_FIRST_WORD = re.compile(r'^[ \t]*r?"""([^\s"]+)', re.MULTILINE)

_CLAUSES = {"What", "Where", "Which", "How", "Who", "Whom", "Whose", "That", "Whether", "When"}
_CLAUSES |= {"Why", "If", "As", "So", "Those", "These", "Of", "From", "To", "Nobody", "Nothing"}


def _first_words(text: str) -> list[str]:
    return _FIRST_WORD.findall(text)


def test_docstrings_begin_with_a_noun_or_a_verb() -> None:
    found = [
        (word, path.relative_to(PACKAGE))
        for path in sorted(PACKAGE.rglob("*.py"))
        for word in _first_words(path.read_text(encoding="utf-8"))
    ]
    assert len(found) > 3000  # the pattern still finds them
    clauses = [each for each in found if each[0] in _CLAUSES]
    assert not clauses


def test_first_words_are_those_of_docstrings() -> None:
    text = '"""What it is."""\nX = """none"""\ndef f():\n    r"""Reads.\n\n    More.\n    """\n'
    assert _first_words(text) == ["What", "Reads."]
