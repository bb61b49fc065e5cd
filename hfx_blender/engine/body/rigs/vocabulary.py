# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabulary of bone names: joints, sides, filler words, Japanese names.

A joint is a set of words in any order, joined or not: ``upper arm`` matches ``ArmUpper``,
``upperarm`` and ``UPPER_ARM``. The words are in ``vocabulary.csv``. They come from the public
naming of Mixamo, Unity and VRM, VRoid Studio, Rigify, Auto-Rig Pro, Unreal's mannequins, MakeHuman,
the CMU motion capture files, Daz Genesis, Character Creator, 3ds Max Biped, MikuMikuDance, SMPL,
Xsens, Maya's Advanced Skeleton, mGear and Second Life, and from anatomy.
"""

import csv
import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Final

Words = frozenset[str]

FINGERS: Final = ("thumb", "index", "middle", "ring", "pinky")
"""Finger ``n`` (from 1) of the canonical skeleton is ``FINGERS[n - 1]``."""

# Words by table and slot. A note of the file explains a slot to its readers.
_WORDS: Final[dict[str, dict[str, list[str]]]] = {}
with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _file:
    for _row in csv.DictReader(_file):
        _WORDS.setdefault(_row["table"], {})[_row["slot"]] = _row["words"].split(", ")
_PHALANGES: Final = "proximal intermediate med medial distal phalanx mcp pip dip ip cmc".split()

SIDES: Final = {
    **dict.fromkeys(("l", "left", "lft", "lf", "lt"), "L"),
    **dict.fromkeys(("r", "right", "rgt", "rt"), "R"),
}
CENTRE_MARKS: Final = frozenset({"c", "m", "x", "center", "centre", "md"})
VERTEBRAE: Final = {
    "l": "spine",
    "t": "spine",
    "c": "neck",
    "vl": "spine",
    "vt": "spine",
    "vc": "neck",
}
"""Letters of lumbar, thoracic and cervical vertebrae (Xsens, H-Anim) -> slot."""

LETTERS: Final = frozenset("abdeghijknopqstvwyz")
"""Single letters that number or mark bones ("Spine_A", "HandN"); sides excluded."""

CARRIERS: Final = frozenset({"stretch", "skin"})
"""Marks of the skinned bone among two bones of a joint (Auto-Rig Pro, MikuMikuDance)."""

FILLERS: Final = frozenset(
    "bone bones bn bnd jnt jnts joint joints jt jo j b bind bound binding sk skin skinned skel "
    "skeleton env def deform deformer rig hub bip biped valve".split()
)
"""Words without meaning for the joint, in any position."""

CONTROLS: Final = frozenset(
    "org mch vis wgt ctrl ctl control controller ik fk vb adj sec pole target helper tweak end nub "
    "tip twist roll share corrective socket attach slot prop grp group offset null driver".split()
)
"""Words of controls and helpers, significant however many names share one."""


def _entries(table: Mapping[str, list[str]]) -> dict[Words, str]:
    """Slot by set of words."""
    return {frozenset(words.split()): slot for slot, sets in table.items() for words in sets}


def _finger_entries() -> dict[Words, str]:
    """Slot "finger <name>" or "metacarpal <name>" by set of words, for all spellings of the five
    fingers."""
    entries: dict[Words, str] = {}
    for finger, words in _WORDS["finger"].items():
        for word in words:
            for around in ((), ("hand",), ("f",), ("finger",), ("hand", "finger"), ("fingers",)):
                for phalanx in ((), *((name,) for name in _PHALANGES)):
                    entries[frozenset((word, *around, *phalanx))] = f"finger {finger}"
            for marks in (
                *(("metacarpal",), ("meta",), ("carpal",), ("in", "hand"), ("base",), ("palm",)),
                ("start",),
                *(("finger", "meta"), ("finger", "metacarpal")),
            ):
                # All rigs count the thumb's metacarpal as its first joint.
                slot = f"{'finger' if finger == 'thumb' else 'metacarpal'} {finger}"
                entries[frozenset((word, *marks))] = slot
    return entries


SIDED: Final = _finger_entries() | _entries(_WORDS["sided"])
"""Set of words to slot, for joints on both sides."""

CENTRE: Final = _entries(_WORDS["centre"])
"""Set of words to slot, for joints in the middle of the body."""

CONTEXT: Final = {
    "arm": ("clavicle", "shoulder", "upper_arm", "forearm", "hand", "finger"),
    "hand": ("hand", "finger", "metacarpal"),
    "leg": ("hip", "thigh", "shin", "foot", "toe"),
    "foot": ("toe",),
    "spine": ("spine", "neck", "hips"),
    "head": ("head", "neck", "jaw", "eye"),
    "face": ("jaw", "eye"),
}
"""Word for a body part, to the slots whose bone names may contain the word in addition.

``hand_index_finger`` names a finger, although ``hand`` alone names the hand.
"""

_LONG_SIDES: Final = frozenset(side for side in SIDES if len(side) > 3)
_JOINT_WORDS: Final = frozenset().union(*SIDED, *CENTRE)
KNOWN: Final = _JOINT_WORDS | SIDES.keys() | CENTRE_MARKS | FILLERS | CONTROLS | LETTERS
_GLUED: Final = frozenset(
    word
    for word in _JOINT_WORDS | _LONG_SIDES | {"bone", "joint", "jnt", "twist"}
    if len(word) > 2 or word in ("up", "lo")
)

HALVES: Final = {
    initial + limb: (half, limb)
    for initial, half in (("u", "upper"), ("l", "lower"))
    for limb in ("arm", "leg")
}
"""Limbs with the initial of their half, as in ``r_uarm``, ``r_larm``."""

# Side and initial of "upper" or "fore", as in ``LUArm``
_INITIALS: Final = frozenset({"lu", "ru", "lf", "rf"})


@lru_cache(maxsize=4096)
def parted(token: str) -> tuple[str, ...]:
    """Known words of a lower-case token: ``upperarm`` becomes ``upper``, ``arm``. A one-letter side
    may be joined to either end (``handl``, ``lthigh``). A token not covered by known words is
    returned unchanged, or completed if the start of one word ("clavic", "fing")."""
    if token in KNOWN or token.isdigit():
        return (token,)
    if token in _INITIALS:
        return tuple(token)
    for start, core, end in (
        ("", token, ""),
        ("", token[:-1], token[-1:]),
        (token[:1], token[1:], ""),
    ):
        if start + end in ("", "l", "r") and (words := _words(core)):
            return tuple(word for word in (start, *words, end) if word)
    # The start of exactly one word and its longer forms ("clavic": clavicle).
    completions = [word for word in _JOINT_WORDS if len(token) > 3 and word.startswith(token)]
    shortest = min(completions, key=len, default=token)
    return (shortest if all(word.startswith(shortest) for word in completions) else token,)


def _words(text: str) -> tuple[str, ...]:
    """Shortest sequence of joint words and sides that make up a text without gaps; empty if there
    is none."""
    # shortest[n]: fewest words for the first n letters, None without any.
    shortest: list[tuple[str, ...] | None] = [()]
    # Dynamic programming over prefixes: a prefix is a shorter prefix and one known word.
    for stop in range(1, len(text) + 1):
        splits = [
            (*before, text[start:stop])
            for start in range(stop)
            if (before := shortest[start]) is not None and text[start:stop] in _GLUED
        ]
        shortest.append(min(splits, key=len) if splits else None)
    return shortest[-1] or ()


_JAPANESE: Final = {name: slot for slot, names in _WORDS["japanese"].items() for name in names}
_JAPANESE_SIDES: Final = {"左": "left", "右": "right"}
_NUMERALS: Final = str.maketrans("一二三", "123")
_JAPANESE_NAME: Final = re.compile(r"([左右]?)(.+?)(\d*)([左右]?)(?:[._ ]([LR]))?")


def in_english(name: str) -> str:
    """English words of a MikuMikuDance bone name, ``左ひじ`` as ``left forearm``. Other names, and
    names of controls and helpers, are returned unchanged."""
    if name.isascii():
        return name
    folded = unicodedata.normalize("NFKC", name).translate(_NUMERALS)
    # Sides stand before the joint or after joint and number.
    match = _JAPANESE_NAME.fullmatch(folded)
    if match is None:
        return name
    before, stem, number, after, mark = match.groups()
    side = _JAPANESE_SIDES.get(before or after, {"L": "left", "R": "right"}.get(mark or "", ""))
    is_carrier = stem not in _JAPANESE
    if is_carrier:  # "足D" carries the skin and follows the posed bone "足"
        stem = stem.removesuffix("D")
    if stem not in _JAPANESE:
        return name
    return " ".join(w for w in (side, _JAPANESE[stem], number, "skin" if is_carrier else "") if w)
