# SPDX-License-Identifier: GPL-3.0-or-later
"""Statements of a file about itself: author, project, tags, from format to format."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, fields
from typing import Any

_SHOWN = 60  # characters of a statement that a note repeats


@dataclass(frozen=True)
class Credits:
    """Statements about a file's origin; empty where it has none.

    ``others`` are members of its metadata that no other format has: name and text.
    """

    author: str = ""
    project: str = ""
    source: str = ""
    created: str = ""
    description: str = ""
    tags: tuple[str, ...] = ()
    others: tuple[tuple[str, str], ...] = ()

    @property
    def texts(self) -> dict[str, str]:
        """Statements that there are, by what they are about."""
        found = {each.name: getattr(self, each.name) for each in fields(self)[:-2]}
        found |= {"tags": ", ".join(self.tags), **dict(self.others)}
        return {name: text for name, text in found.items() if text}

    def lost(self, held: Container[str], title: str) -> tuple[str, ...]:
        """Sentence about statements that a format has no place for, if there are any."""
        others = dict(self.others)
        lost = [
            f"{name} '{text[:_SHOWN]}'"
            for name, text in self.texts.items()
            if ("others" if name in others else name) not in held
        ]
        return (f"{title} has no place for {', '.join(lost)}",) if lost else ()


def text_of(record: Any, key: str) -> str:
    """Text of a member of a document; empty if it has none, or no text."""
    found = record.get(key) if isinstance(record, dict) else None
    return found.strip() if isinstance(found, str) else ""
