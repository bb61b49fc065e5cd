# SPDX-License-Identifier: GPL-3.0-or-later
"""Translations of the extension's texts, from ``translations/LANGUAGE.json``.

Blender translates labels, tooltips and menu entries itself. :func:`translated` translates texts
with values, such as reports: a message has placeholders ``{0}``, ``{1}`` for the values.
"""

from __future__ import annotations

import json
import re
from functools import cache, lru_cache
from pathlib import Path
from typing import Final

import bpy

_FOLDER: Final = Path(__file__).resolve().parents[1] / "translations"
_VALUE: Final = "(.*?)"
_ENDING: Final = "((?:[,;] .*| and .*)?)"
_SHORT: Final = 4
"""Most letters of messages that match only with values of one word, such as "{0} to {1}"."""

_PLACEHOLDER: Final = re.compile(r"(\{\d+\})")


class _Pattern:
    """Pattern of a message, with a group for each value, and the message's translation."""

    def __init__(self, message: str, text: str, start: str = "") -> None:
        literals = _PLACEHOLDER.split(message)[::2]
        self.text = text
        self.size = sum(len(literal.strip()) for literal in literals)
        self._longest = max(literals, key=len)
        # A value right after another is an ending of the sentence.
        groups = [_VALUE, *(_VALUE if literal else _ENDING for literal in literals[1:-1])]
        parts = [re.escape(literals[0])]
        for group, literal in zip(groups, literals[1:], strict=False):
            parts += [group, re.escape(literal)]
        self._pattern = re.compile(start + "".join(parts), re.S)

    def values(self, text: str) -> tuple[str, ...] | None:
        """Values of a text, in the order of the message; None for another text."""
        match = self._pattern.fullmatch(text) if self._longest in text else None
        return None if match is None else match.groups()


class Translation:
    """Messages of a language, and patterns of the messages with values."""

    def __init__(self, messages: dict[str, str]) -> None:
        self._exact = messages
        # The most specific pattern first.
        self._patterns = sorted(
            (_Pattern(*entry) for entry in messages.items() if _PLACEHOLDER.search(entry[0])),
            key=lambda pattern: -pattern.size,
        )
        self._endings = sorted(
            (_Pattern(*entry, "(.+?)") for entry in messages.items() if entry[0][:1] in " ,;"),
            key=lambda pattern: -pattern.size,
        )

    def of(self, text: str) -> str:
        """Translation of a text, of its values, and of its sentences; unknown parts stay."""
        whole = self._whole(text)
        if whole is not None:
            return whole
        # Texts joined by the program: the longest known beginning, then the rest.
        gaps = [gap.end() for gap in re.finditer(r"[.:;,] ", text)]
        for gap in reversed(gaps):
            start = self._start(text[: gap - 1])
            if start is not None:
                return f"{start} {self.of(text[gap:])}"
        return text if not gaps else text[: gaps[0]] + self.of(text[gaps[0] :])

    def _start(self, text: str) -> str | None:
        """Translation of a text that ends in a punctuation mark; None for an unknown text."""
        whole = self._whole(text)
        if whole is None and self._whole(text[:-1]) is not None:
            return f"{self._whole(text[:-1])}{text[-1]}"
        return whole

    def _whole(self, text: str) -> str | None:
        """Translation of a text that is one message; None for other texts."""
        if text in self._exact:
            return self._exact[text]
        for pattern in self._patterns:
            values = pattern.values(text)
            # A value has no end of a sentence: a shorter message may match the first sentence.
            end = ". " if pattern.size > _SHORT else " "
            if values is not None and not any(end in value for value in values):
                return pattern.text.format(*map(self._value, values))
        for pattern in self._endings:  # parts that the program appends to a sentence
            values = pattern.values(text)
            if values is not None:
                start, *rest = map(self._value, values)
                return start + pattern.text.format(*rest)
        lower = text[:1].lower() + text[1:]  # capitalized by the program
        if lower != text:
            whole = self._whole(lower)
            return None if whole is None else whole[:1].upper() + whole[1:]
        return None

    def _value(self, text: str) -> str:
        """Translation of a value: a part of a sentence. Capitalized words are names, and stay."""
        if text == "s":  # of a plural
            return ""
        if re.fullmatch(r"[A-Z]\S*", text) or not re.search("[a-z]{2}", text):
            return text
        label = self._exact.get(text.title()) or self._exact.get(text.capitalize())
        return label or self.of(text)


@cache
def translation(language: str) -> Translation | None:
    """Translation into a language, such as "de"; None for a language without a file."""
    path = _FOLDER / f"{language}.json"
    return Translation(_messages(path)) if path.is_file() else None


@lru_cache(maxsize=2048)
def _translated(text: str, language: str) -> str:
    chosen = translation(language)
    return text if chosen is None else chosen.of(text)


def translated(text: str) -> str:
    """Text in the language of Blender's interface; unchanged without a translation."""
    if not bpy.context.preferences.view.use_translate_interface:
        return text
    return _translated(text, bpy.app.translations.locale.partition("_")[0])


def _messages(path: Path) -> dict[str, str]:
    messages: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
    return messages


def register() -> None:
    contexts = bpy.app.translations.contexts
    languages = {
        path.stem: {
            (context, message): text
            for message, text in _messages(path).items()
            for context in (contexts.default, contexts.operator_default)
        }
        for path in sorted(_FOLDER.glob("*.json"))
    }
    bpy.app.translations.register(__package__, languages)


def unregister() -> None:
    bpy.app.translations.unregister(__package__)
