# SPDX-License-Identifier: GPL-3.0-or-later
"""Translations of the extension's texts, from ``translations/LANGUAGE.json``.

Blender translates labels, tooltips and menu entries itself. :func:`translated` translates texts
with values, such as reports: a message has placeholders ``{0}``, ``{1}`` for the values.
"""

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


def _pattern(message: str, start: str = "") -> tuple[int, str, re.Pattern[str]]:
    """Number of letters outside of the values, longest constant part, and pattern of a message with
    a group for each value. A value right after another value is an ending of the sentence."""
    parts = re.split(r"\{\d+\}", message)
    groups = [_VALUE if k == 1 or parts[k - 1] else _ENDING for k in range(1, len(parts))]
    pattern = re.escape(parts[0]) + "".join(
        group + re.escape(part) for group, part in zip(groups, parts[1:], strict=True)
    )
    letters = sum(len(part.strip()) for part in parts)
    return letters, max(parts, key=len), re.compile(start + pattern, re.S)


class Translation:
    """Messages of a language, and patterns of the messages with values."""

    def __init__(self, messages: dict[str, str]) -> None:
        self._exact = messages
        # Endings are appended to other messages by the program. The most specific pattern is first.
        whole = [
            (*_pattern(message), text) for message, text in messages.items() if "{0}" in message
        ]
        endings = [
            (*_pattern(message, "(.+?)"), text)
            for message, text in messages.items()
            if message[:1] in " ,;"
        ]
        self._patterns = [
            *sorted(whole, key=lambda entry: -entry[0]),
            *sorted(endings, key=lambda entry: -entry[0]),
        ]

    def of(self, text: str) -> str:
        """Translation of a text, of its values, and of its sentences; unknown parts stay."""
        whole = self._whole(text)
        if whole is not None:
            return whole
        # Texts joined by the program: the longest known beginning, then the rest.
        gaps = [gap.end() for gap in re.finditer(r"[.:;,] ", text)]
        for gap in reversed(gaps):
            for mark in ("", text[gap - 2]):
                start = self._whole(text[: gap - 1].removesuffix(mark))
                if start is not None:
                    return f"{start}{mark} {self.of(text[gap:])}"
        return text if not gaps else text[: gaps[0]] + self.of(text[gaps[0] :])

    def _whole(self, text: str) -> str | None:
        """Translation of a text that is one message; None for other texts."""
        if text in self._exact:
            return self._exact[text]
        for letters, longest, pattern, message in self._patterns:
            match = pattern.fullmatch(text) if longest in text else None
            # A value has no end of a sentence: a shorter message may match the first sentence.
            end = ". " if letters > _SHORT else " "
            if match is not None and not any(end in value for value in match.groups()):
                values = [
                    value if self._is_quoted(text, *match.span(k)) else self._value(value)
                    for k, value in enumerate(match.groups(), 1)
                ]
                start = values.pop(0) if pattern.pattern.startswith("(.+?)") else ""
                return start + message.format(*values)
        lower = text[:1].lower() + text[1:]  # capitalized by the program
        whole = self._whole(lower) if lower != text else None
        return None if whole is None else whole[:1].upper() + whole[1:]

    @staticmethod
    def _is_quoted(text: str, begin: int, end: int) -> bool:
        return text[:begin].endswith("'") and text[end:].startswith("'")

    def _value(self, text: str) -> str:
        """Translation of a value: a part of a sentence. Capitalized words are names, and stay,
        as quoted values do."""
        if text == "s":  # of a plural
            return ""
        if re.fullmatch(r"[A-Z]\S*", text) or not re.search("[a-z]{2}", text):
            return text
        label = self._exact.get(text.title()) or self._exact.get(text.capitalize())
        return label or self.of(text)


@cache
def _messages(language: str) -> dict[str, str]:
    """Translations by message; empty for a language without a file."""
    path = _FOLDER / f"{language}.json"
    messages: dict[str, str] = json.loads(path.read_bytes()) if path.is_file() else {}
    return messages


_translation = cache(lambda language: Translation(_messages(language)))


@lru_cache(maxsize=2048)
def _translated(text: str, language: str) -> str:
    return _translation(language).of(text) if _messages(language) else text


def translated(text: str) -> str:
    """Text in the language of Blender's interface; unchanged without a translation."""
    if not bpy.context.preferences.view.use_translate_interface:
        return text
    return _translated(text, bpy.app.translations.locale.partition("_")[0])


def register() -> None:
    contexts = bpy.app.translations.contexts.default, bpy.app.translations.contexts.operator_default
    languages = {
        language: {
            (context, message): text
            for message, text in _messages(language).items()
            for context in (*contexts, "HFX")
        }
        for language in sorted(path.stem for path in _FOLDER.glob("*.json"))
    }
    bpy.app.translations.register(__package__, languages)


def unregister() -> None:
    bpy.app.translations.unregister(__package__)
