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
_PLACEHOLDER: Final = re.compile(r"(\{\d+\})")


class Translation:
    """Messages of a language, and patterns of the messages with values."""

    def __init__(self, messages: dict[str, str]) -> None:
        self._exact = messages
        patterns = []
        for message, text in messages.items():
            parts = _PLACEHOLDER.split(message)
            if len(parts) > 1:
                literals = parts[::2]
                pattern = "(.*?)".join(map(re.escape, literals))
                size = sum(len(literal.strip()) for literal in literals)
                patterns.append((size, max(literals, key=len), re.compile(pattern, re.S), text))
        # The most specific pattern first.
        self._patterns = sorted(patterns, key=lambda entry: -entry[0])

    def of(self, text: str) -> str:
        """Translation of a text, of its values, and of its sentences; unknown parts stay."""
        whole = self._whole(text)
        if whole is not None:
            return whole
        # Sentences joined by the program, each a message by itself.
        sentences = re.split(r"(?<=[.:;,]) ", text)
        if len(sentences) == 1:
            return text
        return " ".join(self._sentence(sentence) for sentence in sentences)

    def _sentence(self, text: str) -> str:
        whole = self._whole(text)
        if whole is None and text[-1:] in ".:;,":
            whole = self._whole(text[:-1])
            whole = None if whole is None else whole + text[-1]
        return text if whole is None else whole

    def _whole(self, text: str) -> str | None:
        """Translation of a text that is one message; None for other texts."""
        if text in self._exact:
            return self._exact[text]
        for _, literal, pattern, message in self._patterns:
            match = pattern.fullmatch(text) if literal in text else None
            if match is not None:
                return message.format(*map(self._value, match.groups()))
        lower = text[:1].lower() + text[1:]  # capitalized by the program
        if lower != text:
            whole = self._whole(lower)
            return None if whole is None else whole[:1].upper() + whole[1:]
        return None

    def _value(self, text: str) -> str:
        """Translation of a value: a part of a sentence. Capitalized words are names, and stay."""
        if re.fullmatch(r"[A-Z]\S*", text) or not re.search("[a-z]{2}", text):
            return text
        return self.of(text)


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
