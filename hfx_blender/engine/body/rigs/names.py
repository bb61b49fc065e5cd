# SPDX-License-Identifier: GPL-3.0-or-later
"""Parses bone names: the body joint and the side that a rig's bone is named after.

A name counts only if all of it is understood (after the side, numbers, words such as ``bone`` and
what most names of the rig share are taken away), so that ``hand_ik.L``,
``upperarm_correctiveRoot_l`` or ``ORG-thigh.L`` are never taken for the joint that they resemble.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from .japanese import in_english
from .vocabulary import (
    CARRIERS,
    CENTRE,
    CENTRE_MARKS,
    CONTEXT,
    FILLERS,
    HALVES,
    KNOWN,
    LETTERS,
    SIDED,
    SIDES,
    VERTEBRAE,
    Words,
    parted,
)

_TOKEN: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_CASELESS_TOKEN: Final = re.compile(r"[a-z]+|\d+")
_KNOWN_PREFIX: Final = re.compile(
    r"(?i:mixamorig\d*|j_bip|(?:valvebiped\.)?bip\d*|cc_base|def)(?=[\s_\-.:A-Z])"
)
_SHARED: Final = 0.6
"""Share of a rig's names that have an unknown word, from which it is the rig's own mark."""

_NUMBERED: Final = 0.75
"""Share of names that end in a number of their own, from which the numbers only count bones."""


@dataclass(frozen=True)
class BoneName:
    """Meaning of a bone name: the joint (``slot``), ``side`` ("L", "R" or "") and its numbers.

    A joint of a limb whose name tells no side has side "" too: that of the limb it hangs on. A
    name that tells both has side "LR" or "RL", the last as told last.
    """

    slot: str
    side: str
    numbers: tuple[str, ...]  # as written: "01" is not "1" in a Biped
    rank: int = 0  # of several bones of one joint the lowest is meant


def plain(name: str) -> str:
    """A name without namespace and without the prefix of a known kind of rig."""
    own = re.sub(r"\s*\[[^\]]*\]", "", name) or name  # "NPC L Thigh [LThg]"
    local = in_english(re.split(r"[:|]", own.rstrip(":| "))[-1].strip())
    return local[match.end() :] if (match := _KNOWN_PREFIX.match(local)) else local


def is_deform(name: str) -> bool:
    """Test a name for Blender's mark of a deforming bone ("DEF-")."""
    return re.match(r"(?i:def)[\s_\-.]", name) is not None


def without_role(name: str) -> str:
    """A Rigify name without its role: ``ORG-spine`` and ``DEF-spine`` are both ``spine``."""
    return re.sub(r"^(?:DEF|ORG|MCH)-", "", name)


def read_names(names: Iterable[str]) -> dict[str, BoneName]:
    """Understand the names of a rig.

    Parameters
    ----------
    names : iterable of str
        All bone names of one rig; they are read together, because what most of them share
        ("Hero_LeftArm", "LeftArm_09" with a number for each bone) is no part of the name.

    Returns
    -------
    dict
        For each name that is a body joint's, what it says. Names of helpers, controls, hair,
        clothes and twist bones that stand beside the limb are left out or told apart by slot.
    """
    local = {name: plain(name) for name in names}
    found: dict[str, BoneName] = {}
    for pattern, spelling in ((_TOKEN, str), (_CASELESS_TOKEN, str.lower)):
        tokens = {
            name: [t.lower() for t in pattern.findall(spelling(text))]
            for name, text in local.items()
        }
        for name, own in _without_shared(tokens).items():
            if name not in found and (understood := _understood(own)) is not None:
                found[name] = understood
    return found


def _without_shared(tokens: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Known words and numbers of each name, without what most of the names share."""
    parts = {
        name: [w for token in own for w in _parted(token, own)] for name, own in tokens.items()
    }
    enough = max(4.0, _SHARED * len(parts))
    marks = _shared_words(parts.values(), enough)
    found, first = {}, {}
    for name, own in parts.items():
        start = 0
        while start < len(own) and own[start] in marks | FILLERS:
            start += 1
        found[name] = [word for word in own if word not in marks]
        first[name] = own[start] if 0 < start < len(own) else ""
    number, count = Counter(first.values()).most_common(1)[0] if first else ("", 0)
    if number.isdigit() and count >= enough:  # "Hero3_LeftArm"
        for name in (name for name, own in first.items() if own == number):
            found[name].remove(number)
    return _without_counting(found)


def _shared_words(names: Iterable[Sequence[str]], enough: float) -> set[str]:
    """Words without a meaning that at least so many names have."""
    counts = Counter(word for own in names for word in set(own))
    return {
        word
        for word, count in counts.items()
        if count >= enough and word not in KNOWN and not word.isdigit()
    }


def _parted(token: str, name: Sequence[str]) -> tuple[str, ...]:
    """Words of a token; beside a side of its own, "larm" is the lower arm and not the left one."""
    return HALVES[token] if token in HALVES and SIDES.keys() & set(name) else parted(token)


def _without_counting(parts: dict[str, list[str]]) -> dict[str, list[str]]:
    """Names without a last number that is the same for most of them, or differs for each."""
    last = [own[-1] for own in parts.values() if len(own) > 1 and own[-1].isdigit()]
    if len(last) < max(10.0, _NUMBERED * len(parts)):
        return parts
    counts = Counter(last)
    if len(counts) >= _NUMBERED * len(last):
        gone = set(counts)
    else:
        gone = {number for number, count in counts.items() if count >= _NUMBERED * len(last)}
    return {
        name: own[:-1] if len(own) > 1 and own[-1] in gone else own for name, own in parts.items()
    }


def _understood(parts: list[str]) -> BoneName | None:
    if len(parts) == 2 and parts[0] in VERTEBRAE and parts[1].isdigit():  # "L5", "vt10"
        return BoneName(VERTEBRAE[parts[0]], "", ())
    sides = "".join(dict.fromkeys(SIDES[word] for word in reversed(parts) if word in SIDES))[::-1]
    numbers = tuple(word for word in parts if word.isdigit())
    # "c_index1.l" is moved by hand where there is an "index1.l" too.
    # "shoulderP_L" is a helper where there is a "shoulder_L" too.
    is_second = parts[:1] == ["c"] and len(parts) > 1
    is_second |= bool(sides and LETTERS & set(parts[1:]))
    rank = -1 if CARRIERS & set(parts) else int(is_second)
    words = frozenset(
        word
        for word in parts
        if not word.isdigit() and word not in SIDES and word not in CENTRE_MARKS
    )
    slot = _slot(words, sides)
    return None if slot is None else BoneName(slot, sides, numbers, rank)


def _slot(words: Words, side: str) -> str | None:
    """Slot of a set of words, first with all of them, then without those that say little."""
    for known in (words, words - FILLERS, words - FILLERS - LETTERS):
        if not side and known in CENTRE:
            return CENTRE[known]
        if known in SIDED:
            return SIDED[known]
    for part in CONTEXT.keys() & words:
        slot = _slot(words - {part} - FILLERS, side)
        if slot is not None and slot.split()[0] in CONTEXT[part]:
            return slot
    return None
