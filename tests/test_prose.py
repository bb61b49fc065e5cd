# SPDX-License-Identifier: GPL-3.0-or-later
"""Style of docstrings, comments and local names, measured for each package.

Bounds are those of well-known code bases (httpx, black, trimesh, glTF-Blender-IO). A count does not
prove that a sentence is clear; a count above its bound shows that a package has left plain English.
"""

from __future__ import annotations

import ast
import collections
import io
import re
import tokenize
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "hfx_blender"
FOLDERS = [
    *(path for path in sorted(PACKAGE.iterdir()) if (path / "__init__.py").is_file()),
    ROOT / "hfx_tools",
    ROOT / "tests",
]

RELATIVES = frozenset("that which what who whose".split())
PRONOUNS = frozenset("it its they them these those others other one ones".split())
ODD_WORDS = frozenset(
    "nobody whoever anew told tells stranger strangers meanwhile whatever beside nor alike "
    "ours".split()
)
# Names of locals that do not say what they hold.
ANONYMOUS = frozenset("found each place kept felt asked made told some wanted other".split())


@dataclass
class Prose:
    """Counts of one folder of Python files."""

    words: collections.Counter[str] = field(default_factory=collections.Counter)
    functions: int = 0
    anonymous_locals: int = 0
    code_lines: int = 0  # lines with code or with nothing but a comment
    comment_lines: int = 0

    def per_words(self, words: frozenset[str], scale: int) -> float:
        """Occurrences of the words in each ``scale`` words of docstrings and comments."""
        return scale * sum(self.words[word] for word in words) / max(self.words.total(), 1)

    def add(self, source: str) -> None:
        """Count one file."""
        tree = ast.parse(source)
        docstring_lines: set[int] = set()
        texts = []
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                texts.append(ast.get_docstring(node) or "")
            if isinstance(node, ast.FunctionDef):
                self.functions += 1
                names = {
                    name.id
                    for name in ast.walk(node)
                    if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
                }
                self.anonymous_locals += len(names & ANONYMOUS)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                if isinstance(node.value.value, str):
                    docstring_lines |= set(range(node.lineno, (node.end_lineno or 0) + 1))
        comments, code = set(), set()
        layout = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
        layout |= {tokenize.ENDMARKER}
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type == tokenize.COMMENT:
                texts.append(token.string)
                comments.add(token.start[0])
            elif token.type not in layout:
                code |= set(range(token.start[0], token.end[0] + 1))
        code -= docstring_lines
        self.code_lines += len(code | comments)
        self.comment_lines += len(comments - code)
        self.words.update(re.findall(r"[a-z']+", " ".join(texts).lower()))


def prose(folder: Path) -> Prose:
    """Counts of all Python files below a folder."""
    counts = Prose()
    for path in sorted(folder.rglob("*.py")):
        counts.add(path.read_text(encoding="utf-8"))
    return counts


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_words_and_names_are_those_of_plain_english(folder: Path) -> None:
    counts = prose(folder)
    assert counts.words.total() > 300  # docstrings are found
    assert counts.per_words(RELATIVES, 100) <= 1.3
    assert counts.per_words(PRONOUNS, 100) <= 1.7
    assert counts.per_words(ODD_WORDS, 10_000) <= 5
    assert 100 * counts.anonymous_locals / counts.functions <= 2


def test_comments_stand_in_the_product() -> None:
    """Hard places have more comments than this mean, lists of properties have fewer."""
    counts = prose(PACKAGE)
    assert counts.comment_lines / counts.code_lines >= 0.049


def test_class_and_file_names_stand_once() -> None:
    classes: dict[str, list[str]] = collections.defaultdict(list)
    files: dict[str, list[str]] = collections.defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        name = str(path.relative_to(PACKAGE))
        if path.name != "__init__.py":
            files[path.name].append(name)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                classes[node.name].append(name)
    assert len(classes) > 500
    assert {key: paths for key, paths in {**classes, **files}.items() if len(paths) > 1} == {}


def test_the_counts_are_right() -> None:
    """Counted by hand in a small file."""
    counts = Prose()
    counts.add(
        '"""Words that count."""\n# one\nX = 1  # it\n\ndef f():\n'
        '    """Told."""\n    found = [each for each in X]\n    return found\n'
    )
    assert counts.words == {"words": 1, "that": 1, "count": 1, "one": 1, "it": 1, "told": 1}
    assert (counts.functions, counts.anonymous_locals) == (1, 2)
    assert (counts.code_lines, counts.comment_lines) == (5, 1)
    assert counts.per_words(RELATIVES, 100) == pytest.approx(100 / 6)


# First words of comments in C. Comments in Python and docstrings are counted above.
_FIRST_WORD_IN_C = re.compile(
    r"^(?![ \t]*//)[^\n]*\n[ \t]*//[ ]([^\s:,]+)|^[ \t]*/\*[ ]([^\s:,]+)", re.MULTILINE
)
_CLAUSES = frozenset(
    "What Where Which How Who Whom Whose That Whether When Why If As So Those These Of From To "
    "Nobody Nothing".split()
)


def _first_words_in_c(text: str) -> list[str]:
    return ["".join(groups) for groups in _FIRST_WORD_IN_C.findall(text)]


def test_comments_in_c_begin_with_a_noun_or_a_verb() -> None:
    folders = PACKAGE / "engine" / "native" / "source", ROOT / "players" / "core", ROOT / "firmware"
    words = [
        (word, path.relative_to(ROOT))
        for folder in folders
        for path in sorted(folder.rglob("*.[ch]"))
        for word in _first_words_in_c(path.read_text(encoding="utf-8"))
    ]
    assert len(words) > 250  # the pattern still finds them
    assert [word for word in words if word[0] in _CLAUSES] == []
    text = "int a;\n// What it is, if\n// How much\n\n  /* Whether: */\n  b();\n  // Which one.\n"
    assert _first_words_in_c(text) == ["What", "Whether", "Which"]
