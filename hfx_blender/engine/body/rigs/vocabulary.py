# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabulary of bone names: joints, sides, filler words, Japanese names.

A joint is a set of words in any order, joined or not: ``upper arm`` matches ``ArmUpper``,
``upperarm`` and ``UPPER_ARM``. The words come from the public naming of Mixamo, Unity and VRM,
VRoid Studio, Rigify, Auto-Rig Pro, Unreal's mannequins, MakeHuman, the CMU motion capture files,
Daz Genesis, Character Creator, 3ds Max Biped, MikuMikuDance, SMPL, Xsens, Maya's Advanced Skeleton,
mGear and Second Life, and from anatomy.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

Words = frozenset[str]

FINGERS: Final = ("thumb", "index", "middle", "ring", "pinky")
"""Finger ``n`` (from 1) of the canonical skeleton is ``FINGERS[n - 1]``."""

# Slot: comma-separated sets of words.
_SIDED_WORDS: Final = {
    "clavicle": "clavicle, clav, collar, collar bone, scapula, scap, sternoclavicular",
    "shoulder": "shoulder, shldr",  # collar bone or upper arm, decided by the other bones
    "upper_arm": "upper arm, up arm, u arm, arm stretch, shldr bend, upper arm bend, shoulder bend,"
    "humerus, upper arm stretch, bicep, biceps",
    "upper_arm_twist": "shldr twist, upper arm twist, up arm twist, arm twist, shoulder part,"
    "shoulder twist",
    "arm": "arm, arm div loc",  # the upper arm of Mixamo
    "forearm": "fore arm, f arm, lower arm, lo arm, low arm, fore arm stretch, fore arm bend,"
    "lower arm bend, elbow, radius, ulna",
    "forearm_twist": "fore arm twist, lower arm twist, low arm twist, fore twist, wrist twist,"
    "elbow part",
    "hand": "hand, wrist, arm hand, fist, arm end",
    "thigh": "thigh, up leg, upper leg, thigh stretch, thigh bend, femur, upper thigh",
    "thigh_twist": "thigh twist, up leg twist, upper leg twist, hip part",
    "leg": "leg, leg div loc",  # the shin of Mixamo; the thigh in rigs with a knee
    "hip": "hip, hips",
    "shin": "shin, calf, lower leg, lo leg, low leg, leg stretch, knee, tibia, crus",
    "shin_twist": "shin twist, calf twist, lower leg twist, leg twist, knee part",
    "foot": "foot, ankle, leg foot, feet, leg end",
    "toe": "toe, toes, toe base, toes base, ball, foot ball, foot toe, foot toes,"
    "leg digit, foot digit",
    "toe 1": "big toe",
    "toe 2": "index toe",
    "toe 3": "mid toe, middle toe",
    "toe 4": "ring toe",
    "toe 5": "pinky toe, little toe",
    "small_toe": "small toe",
    "pelvis_half": "pelvis",
    "breast": "breast, pectoral",
    "eye": "eye, face eye, adj face eye, eye ball",
    "finger": "finger, hand finger, fingers, arm digit, hand digit",
    "finger_base": "finger base",
    "metacarpal": "metacarpal, palm, carpal",
}
_CENTRE_WORDS: Final = {
    "hips": "hips, hip, pelvis, groin, sacroiliac",
    "lower_body": "lower body",  # MikuMikuDance: sibling of the upper body
    "spine": "spine, chest, upper chest, lower chest, mid chest, abdomen, lower abdomen,"
    "upper abdomen, lower back, upper back, mid back, back, torso, upper torso, lower torso, waist,"
    "stomach, ribs, rib cage, thorax, lower spine, low spine, upper spine, up spine, mid spine,"
    "middle spine,"
    "upper body, trunk, sternum, vertebra, lumbar, ab, abs, bust, body, navel,"
    "spine base, spine shoulder",
    "neck": "neck, lower neck, upper neck, neck twist, cervical",
    "head": "head, skull, skull base",
    "jaw": "jaw, lower jaw, jaw root, mandible",
}
_FINGER_WORDS: Final = {
    "thumb": "thumb",
    "index": "index, ind, pointer, fore",
    "middle": "middle, mid",
    "ring": "ring, third",
    "pinky": "pinky, pinkie, little, lit",
}
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


def _entries(table: Mapping[str, str]) -> dict[Words, str]:
    """Slot by set of words, from slots with sets separated by commas."""
    return {
        frozenset(words.split()): slot for slot, sets in table.items() for words in sets.split(",")
    }


def _finger_entries() -> dict[Words, str]:
    """Slot "finger <name>" or "metacarpal <name>" by set of words, for all spellings of the five
    fingers."""
    entries: dict[Words, str] = {}
    for finger, names in _FINGER_WORDS.items():
        for name in names.split(","):
            word = name.strip()
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


SIDED: Final = _finger_entries() | _entries(_SIDED_WORDS)
"""Set of words to slot, for joints on both sides."""

CENTRE: Final = _entries(_CENTRE_WORDS)
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
    """Known words of a lower-case token: ``upperarm`` becomes ``upper``, ``arm``.

    A one-letter side may be joined to either end (``handl``, ``lthigh``). A token not covered by
    known words is returned unchanged, or completed if the start of one word ("clavic", "fing").
    """
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


_JAPANESE_JOINTS: Final = {
    "下半身": "lowerbody",
    "上半身": "upperbody",
    "首": "neck",
    "頭": "head",
    "肩": "shoulder",
    "腕": "upperarm",
    "腕捩": "upperarmtwist",
    "ひじ": "forearm",
    "肘": "forearm",
    "手捩": "forearmtwist",
    "手首": "hand",
    "足": "thigh",
    "ひざ": "shin",
    "膝": "shin",
    "足首": "foot",
    # The toe joint; "つま先" is the toe tip, a target of foot controls.
    "足先EX": "toe skin",
    "目": "eye",
    "胸": "breast",
    "親指": "thumb",
    "人指": "index",
    "人差指": "index",
    "人差し指": "index",
    "中指": "middle",
    "薬指": "ring",
    "小指": "pinky",
}
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
    is_carrier = stem not in _JAPANESE_JOINTS
    if is_carrier:  # "足D" carries the skin and follows the posed bone "足"
        stem = stem.removesuffix("D")
    if stem not in _JAPANESE_JOINTS:
        return name
    return " ".join(
        w for w in (side, _JAPANESE_JOINTS[stem], number, "skin" if is_carrier else "") if w
    )
