# SPDX-License-Identifier: GPL-3.0-or-later
"""Parses bone names: the body joint and the side that a rig's bone is named after.

A name counts only if all of it is understood (after the side, numbers and the rig's own
prefix are taken away), so that ``hand_ik.L``, ``upperarm_correctiveRoot_l`` or ``ORG-thigh.L``
are never taken for the joint that they resemble.

The words come from the public naming of Mixamo, Unity and VRM, VRoid Studio, Rigify, Auto-Rig
Pro, Unreal's mannequins, MakeHuman, the CMU motion capture files, Daz Genesis, Character Creator,
3ds Max Biped, MikuMikuDance, SMPL, Xsens, Maya's Advanced Skeleton and Second Life.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from .japanese import in_english

FINGERS: Final = ("thumb", "index", "middle", "ring", "pinky")
"""Finger ``n`` (from 1) of the canonical skeleton is ``FINGERS[n - 1]``."""

_SIDED_WORDS: Final = {
    "clavicle": "clavicle collar collarbone clav scapula",
    "shoulder": "shoulder",  # the collar bone or the upper arm, as the rest of the rig decides
    "upper_arm": "upperarm uparm armupper armup armstretch shldr shldrbend upperarmbend humerus",
    "upper_arm_twist": "shldrtwist upperarmtwist uparmtwist armtwist shoulderpart",
    "arm": "arm",  # the upper arm of Mixamo
    "forearm": "forearm lowerarm loarm armlower armlow forearmstretch forearmbend lowerarmbend "
    "elbow",
    "forearm_twist": "forearmtwist lowerarmtwist foretwist wristtwist elbowpart",
    "hand": "hand wrist armhand",
    "thigh": "thigh upleg upperleg legupper legup thighstretch thighbend femur",
    "thigh_twist": "thightwist uplegtwist upperlegtwist hippart",
    "leg": "leg",  # the shin of Mixamo, the thigh beside a bone called knee
    "hip": "hip",
    "shin": "shin calf lowerleg loleg leglower leglow legstretch knee tibia",
    "shin_twist": "shintwist calftwist lowerlegtwist legtwist kneepart",
    "foot": "foot ankle legfoot",
    "toe": "toe toes toebase ball",
    "toe 1": "bigtoe",
    "toe 2": "indextoe",
    "toe 3": "midtoe middletoe",
    "toe 4": "ringtoe",
    "toe 5": "pinkytoe littletoe",
    "small_toe": "smalltoe",
    "pelvis_half": "pelvis hipjoint",
    "breast": "breast pectoral",
    "eye": "eye faceeye adjfaceeye jadjfaceeye",
    "finger": "finger handfinger fingers",
    "finger_base": "fingerbase",
    "metacarpal": "metacarpal palm carpal",
}
_CENTRE_WORDS: Final = {
    "hips": "hips hip pelvis groin",
    "lower_body": "lowerbody",  # of MikuMikuDance: beside the upper body, not below it
    "spine": "spine chest upperchest chestupper chestlower abdomen abdomenlower abdomenupper "
    "lowerback torso waist stomach ribs ribcage thorax lowerspine upperspine spinelower "
    "spineupper upperbody",
    "neck": "neck necklower neckupper necktwist lowerneck upperneck",
    "head": "head",
    "jaw": "jaw lowerjaw jawroot",
}
_FINGER_WORDS: Final = {
    "thumb": "thumb",
    "index": "index pointer forefinger fore",
    "middle": "middle mid",
    "ring": "ring third",
    "pinky": "pinky pinkie little",
}


def _sided_vocabulary() -> dict[str, str]:
    found = {word: slot for slot, words in _SIDED_WORDS.items() for word in words.split()}
    for finger, words in _FINGER_WORDS.items():
        for word in words.split():
            for before in ("", "hand", "f", "finger"):
                for after in ("", "finger", "proximal", "intermediate", "distal"):
                    found[before + word + after] = f"finger {finger}"
            for metacarpal in (
                f"{word}metacarpal",
                f"metacarpal{word}",
                f"inhand{word}",
                f"{word}base",
            ):
                # The first joint of the thumb is its metacarpal in every rig.
                found[metacarpal] = f"{'finger' if finger == 'thumb' else 'metacarpal'} {finger}"
    return found


_SIDED: Final = _sided_vocabulary()
_CENTRE: Final = {word: slot for slot, words in _CENTRE_WORDS.items() for word in words.split()}

_SIDE_TOKENS: Final = {"l": "L", "left": "L", "lft": "L", "r": "R", "right": "R", "rgt": "R"}
_CENTRE_TOKENS: Final = {"c", "m", "x"}
_VERTEBRAE: Final = {"l5", "l3", "t12", "t8"}  # the spine of Xsens
_CARRIERS: Final = {"stretch", "skin"}
"""Marks of the one of two bones of a joint that the skin hangs on (Auto-Rig Pro, MikuMikuDance)."""
_CONTROL_TOKENS: Final = {"org", "mch", "vis", "wgt", "ctrl", "ik", "fk", "vb", "adj", "sec"}
_TOKEN: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_KNOWN_PREFIX: Final = re.compile(
    r"(?i:mixamorig\d*|j_bip|(?:valvebiped\.)?bip\d*|cc_base|def)(?=[\s_\-.:A-Z])"
)


@dataclass(frozen=True)
class BoneName:
    """Meaning of a bone name: the joint (``slot``), ``side`` ("L", "R" or "") and its numbers."""

    slot: str
    side: str
    numbers: tuple[str, ...]  # as written: "01" is not "1" in a Biped
    rank: int = 0  # of several bones of one joint the lowest is meant


def plain(name: str) -> str:
    """A name without namespace and without the prefix of a known kind of rig."""
    local = in_english(re.split(r"[:|]", name)[-1].strip())
    return local[match.end() :] if (match := _KNOWN_PREFIX.match(local)) else local


def is_deform(name: str) -> bool:
    """Test a name for Blender's mark of a deforming bone ("DEF-")."""
    return re.match(r"(?i:def)[\s_\-.]", name) is not None


def without_role(name: str) -> str:
    """A Rigify name without its role: ``ORG-spine`` and ``DEF-spine`` are both ``spine``."""
    return re.sub(r"^(?:DEF|ORG|MCH)-", "", name)


def _shared_prefix(names: Iterable[Sequence[str]]) -> list[str]:
    """Tokens that three quarters of the names begin with and that mean nothing here."""
    remaining = [list(tokens) for tokens in names if tokens]
    prefix: list[str] = []
    meaningful = _SIDED.keys() | _CENTRE.keys() | _SIDE_TOKENS.keys() | _CONTROL_TOKENS
    while remaining:
        token, count = Counter(tokens[0] for tokens in remaining).most_common(1)[0]
        if count < max(4, 0.75 * len(remaining)) or token in meaningful:
            break
        prefix.append(token)
        remaining = [tokens[1:] for tokens in remaining if tokens[0] == token and tokens[1:]]
    return prefix


def _understood(tokens: Sequence[str]) -> BoneName | None:
    sides = {_SIDE_TOKENS[token] for token in tokens if token in _SIDE_TOKENS}
    if len(sides) > 1:
        return None
    if "".join(tokens) in _VERTEBRAE:
        return BoneName("spine", "", ())
    numbers = tuple(token for token in tokens if token.isdigit())
    # "c_index1.l" is moved by hand where there is an "index1.l" too.
    rank = -1 if _CARRIERS & set(tokens) else int(tokens[:1] == ["c"] and len(tokens) > 1)
    tokens = [token for token in tokens if token != "skin"]
    words = [t for t in tokens if not t.isdigit() and t not in _SIDE_TOKENS]
    word = "".join(w for w in words if w not in _CENTRE_TOKENS)
    if sides:
        return BoneName(_SIDED[word], sides.pop(), numbers, rank) if word in _SIDED else None
    if word in _CENTRE:
        return BoneName(_CENTRE[word], "", numbers, rank)
    for mark, side in _SIDE_TOKENS.items():  # "lefthand", "handl": nothing separates the side
        for rest in (word.removeprefix(mark), word.removesuffix(mark)):
            if rest != word and rest in _SIDED:
                return BoneName(_SIDED[rest], side, numbers, rank)
    return None


def read_names(names: Iterable[str]) -> dict[str, BoneName]:
    """Understand the names of a rig.

    Parameters
    ----------
    names : iterable of str
        All bone names of one rig; they are read together, because a prefix that most of them
        share ("Hero_LeftArm") is no part of the name.

    Returns
    -------
    dict
        For each name that is a body joint's, what it says. Names of helpers, controls, hair,
        clothes and twist bones that stand beside the limb are left out or told apart by slot.
    """
    tokens = {name: [t.lower() for t in _TOKEN.findall(plain(name))] for name in names}
    prefix = _shared_prefix(tokens.values())
    found: dict[str, BoneName] = {}
    for name, own in tokens.items():
        shared = 0
        while shared < min(len(prefix), len(own)) and own[shared] == prefix[shared]:
            shared += 1
        if (understood := _understood(own[shared:])) is not None:
            found[name] = understood
    return found
