# SPDX-License-Identifier: GPL-3.0-or-later
"""Parser of bone names: the body joint and side named by a rig's bone.

A name counts only if every word is known, apart from side, numbers, filler words and words shared
by most names of the rig. So ``hand_ik.L``, ``upperarm_correctiveRoot_l`` and ``ORG-thigh.L`` are
not mistaken for joints.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from . import vocabulary

_TOKEN: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_CASELESS_TOKEN: Final = re.compile(r"[a-z]+|\d+")
_KNOWN_PREFIX: Final = re.compile(
    r"(?i:mixamorig\d*|j_bip|(?:valvebiped\.)?bip\d*|cc_base|def)(?=[\s_\-.:A-Z])"
)
# Fraction of a rig's names with the same unknown word above which the word is a prefix
_SHARED: Final = 0.6
# Fraction of names with a unique last number above which the numbers only count bones
_NUMBERED: Final = 0.75


@dataclass(frozen=True)
class BoneName:
    """Parsed bone name: joint (``slot``), ``side`` and numbers. ``side`` is "L", "R", "" (centre,
    or a limb bone without a side), or "LR" / "RL" for both in order."""

    slot: str
    side: str
    numbers: tuple[str, ...]  # as written; a Biped distinguishes "01" and "1"
    rank: int = 0  # lowest first among bones of one joint


def plain(name: str) -> str:
    """Name without namespace, bracketed part and known rig prefix; MikuMikuDance names in
    English."""
    unbracketed = re.sub(r"\s*\[[^\]]*\]", "", name) or name  # "NPC L Thigh [LThg]"
    local = vocabulary.in_english(re.split(r"[:|]", unbracketed.rstrip(":| "))[-1].strip())
    return local[match.end() :] if (match := _KNOWN_PREFIX.match(local)) else local


def is_deform(name: str) -> bool:
    """True for names with Blender's prefix of deforming bones ("DEF-", also "def_", "Def.")."""
    return re.match(r"(?i:def)[\s_\-.]", name) is not None


def without_role(name: str) -> str:
    """Name without Rigify's role prefix: ``ORG-spine`` and ``DEF-spine`` become ``spine``."""
    return re.sub(r"^(?:DEF|ORG|MCH)-", "", name)


def read_names(names: Iterable[str]) -> dict[str, BoneName]:
    """Parse the bone names of one rig: name to parsed name, for names of body joints.

    ``names`` must be all names of the rig, because words shared by most names are ignored
    ("Hero_LeftArm", "LeftArm_09" with a number for each bone). Helpers, controls, hair and clothes
    are left out; twist bones have slots of their own.
    """
    local = {name: plain(name) for name in names}
    parsed_names: dict[str, BoneName] = {}
    for pattern, spelling in ((_TOKEN, str), (_CASELESS_TOKEN, str.lower)):
        tokens = {
            name: [t.lower() for t in pattern.findall(spelling(text))]
            for name, text in local.items()
        }
        # The second, caseless spelling serves only names that made no sense in the first.
        for name, words in _without_shared_words(tokens).items():
            if name not in parsed_names and (parsed := _parse_words(words)) is not None:
                parsed_names[name] = parsed
    return parsed_names


def _without_shared_words(tokens: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Known words and numbers of each name, without words and numbers shared by most names."""
    parts = {}
    for name, words in tokens.items():
        # "larm" is lower arm and "uarm" upper arm if the name has a separate side.
        halves = vocabulary.HALVES if vocabulary.SIDES.keys() & set(words) else {}
        parts[name] = [w for token in words for w in halves.get(token) or vocabulary.parted(token)]
    least_count = max(4.0, _SHARED * len(parts))
    counts = Counter(word for words in parts.values() for word in set(words))
    shared = {word for word, count in counts.items() if count >= least_count}
    marks = {word for word in shared - vocabulary.KNOWN if not word.isdigit()}
    remaining, first = {}, {}
    for name, words in parts.items():
        start = 0
        while start < len(words) and words[start] in marks | vocabulary.FILLERS:
            start += 1
        # A number after marks and fillers may count characters.
        remaining[name] = [word for word in words if word not in marks]
        first[name] = words[start] if 0 < start < len(words) else ""
    number, count = Counter(first.values()).most_common(1)[0] if first else ("", 0)
    if number.isdigit() and count >= least_count:  # "Hero3_LeftArm"
        for name in (name for name, words in first.items() if words == number):
            remaining[name].remove(number)
    return _without_counting(remaining)


def _without_counting(parts: dict[str, list[str]]) -> dict[str, list[str]]:
    """Remove last numbers from the words of each name if most names end in a number, and nearly all
    of these are equal or differ: such numbers only count bones. Otherwise unchanged."""
    last_numbers = [words[-1] for words in parts.values() if len(words) > 1 and words[-1].isdigit()]
    if len(last_numbers) < max(10.0, _NUMBERED * len(parts)):
        return parts
    counts = Counter(last_numbers)
    if len(counts) >= _NUMBERED * len(last_numbers):
        counting = set(counts)
    else:
        counting = {
            number for number, count in counts.items() if count >= _NUMBERED * len(last_numbers)
        }
    return {
        name: words[:-1] if len(words) > 1 and words[-1] in counting else words
        for name, words in parts.items()
    }


def _parse_words(parts: list[str]) -> BoneName | None:
    """Parsed bone name from lower-case words and numbers; None if a word is unknown or no joint is
    named."""
    if len(parts) == 2 and parts[0] in vocabulary.VERTEBRAE and parts[1].isdigit():  # "L5", "vt10"
        return BoneName(vocabulary.VERTEBRAE[parts[0]], "", ())
    sides = "".join(
        dict.fromkeys(
            vocabulary.SIDES[word] for word in reversed(parts) if word in vocabulary.SIDES
        )
    )[::-1]
    numbers = tuple(word for word in parts if word.isdigit())
    # "c_index1.l" (control) and "shoulderP_L" (helper) rank after "index1.l" and "shoulder_L".
    is_second = parts[:1] == ["c"] and len(parts) > 1
    is_second |= bool(sides and vocabulary.LETTERS & set(parts[1:]))
    # Bones that carry the skin come first, helpers last.
    rank = -1 if vocabulary.CARRIERS & set(parts) else int(is_second)
    words = frozenset(
        word
        for word in parts
        if not word.isdigit()
        and word not in vocabulary.SIDES
        and word not in vocabulary.CENTRE_MARKS
    )
    slot = _slot(words, sides)
    return None if slot is None else BoneName(slot, sides, numbers, rank)


def _slot(words: vocabulary.Words, side: str) -> str | None:
    """Slot of a set of words with ``side`` ("" for the centre): all words, then without fillers and
    letters, then without one word of the body part; None if unknown."""
    for known in (
        words,
        words - vocabulary.FILLERS,
        words - vocabulary.FILLERS - vocabulary.LETTERS,
    ):
        if not side and known in vocabulary.CENTRE:
            return vocabulary.CENTRE[known]
        if known in vocabulary.SIDED:
            return vocabulary.SIDED[known]
    # "arm hand" is a hand: the part of the body is dropped if it fits the remaining words.
    for part in vocabulary.CONTEXT.keys() & words:
        slot = _slot(words - {part} - vocabulary.FILLERS, side)
        if slot is not None and slot.split()[0] in vocabulary.CONTEXT[part]:
            return slot
    return None
