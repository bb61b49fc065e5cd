# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings about effects that are not felt; imported before Blender starts."""

import re
from collections.abc import Iterable
from typing import Final

from ...text import MOST_NAMES, named

NO_TOUCH: Final = "touches no body"
NEVER_ON: Final = "is never on"


def missed_warnings(missed: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Warnings about unfelt effects, from (name, reason); one warning for each reason."""
    reasons: dict[str, list[str]] = {}
    for name, why in missed:
        reasons.setdefault(why, []).append(name)
    return tuple(
        f"effect '{names[0]}' {why}: it is not felt"
        if len(names) == 1
        else f"effects are not felt, as each {why}: {len(names)} ({named(names, MOST_NAMES)})"
        for why, names in reasons.items()
    )


def joined(warnings: Iterable[str]) -> tuple[str, ...]:
    """Join warnings "effect 'NAME' ... (N times)" with equal words between into one with counts;
    other warnings stay. In the order of the first of each."""
    groups: dict[str, list[tuple[str, str, int]]] = {}  # warning, name and count by words
    for text in warnings:
        found = re.fullmatch(r"effect '(.+?)' (.+) \((\d+) times\)", text)
        name, words, count = found.groups() if found else ("", text, 0)
        groups.setdefault(words, []).append((text, name, int(count)))
    texts = []
    for words, group in groups.items():
        names, times = [name for _, name, _ in group], sum(count for _, _, count in group)
        many = f"each of {len(group)} effects {words} ({times} times): {named(names, MOST_NAMES)}"
        texts.append(group[0][0] if len(group) == 1 else many)
    return tuple(texts)
