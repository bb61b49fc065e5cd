# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions and segments of the canonical skeleton: bones that move as one, and their skin.

A *segment* is moved by one affine transform when the canonical body is posed onto a target. A
*region* is a stretch of skin within which a place of the target may be looked for: a finger
never takes its neighbour's skin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

_LIMB: Final = {
    "upperarm01": "upperarm",
    "upperarm02": "upperarm",
    "lowerarm01": "forearm",
    "lowerarm02": "forearm",
    "wrist": "hand",
    **{f"metacarpal{number}": "hand" for number in range(1, 5)},
    "upperleg01": "upperleg",
    "upperleg02": "upperleg",
    "lowerleg01": "lowerleg",
    "lowerleg02": "lowerleg",
    "foot": "foot",
}

JOINT_OF: Final = {
    "neck01": "neck",
    "head": "head",
    **{
        f"{bone}.{side}": f"{joint}.{side}"
        for side in "LR"
        for bone, joint in (
            ("clavicle", "clavicle"),
            ("upperarm01", "shoulder"),
            ("lowerarm01", "elbow"),
            ("wrist", "wrist"),
            ("upperleg01", "hip"),
            ("lowerleg01", "knee"),
            ("foot", "ankle"),
        )
    },
}
"""Joint at the head of a canonical bone; only joints that mean the same place on any rig."""


def region_of(bone: str) -> str:
    """Region of the skin that a canonical bone moves."""
    stem, _, side = bone.rpartition(".") if bone[-2:] in (".L", ".R") else (bone, "", "")
    if stem in _LIMB:
        return f"{_LIMB[stem]}.{side}"
    if stem.startswith("finger"):
        return f"finger{stem[6]}.{side}"
    if stem.startswith("toe"):
        return f"foot.{side}"
    if stem.startswith(("root", "pelvis", "spine", "breast", "clavicle", "shoulder")):
        return "torso"
    return "head"


REGIONS: Final = (
    "torso",
    "head",
    *(
        f"{name}.{side}"
        for side in "LR"
        for name in (
            *("upperarm", "forearm", "hand", "upperleg", "lowerleg", "foot"),
            *(f"finger{number}" for number in range(1, 6)),
        )
    ),
)

_WORDS: Final = {"upperarm": "upper arm", "upperleg": "thigh", "lowerleg": "lower leg"}
_PLURALS: Final = {"foot": "feet", "finger": "fingers"}


def words_of(regions: Sequence[str]) -> str:
    """Regions in words, both sides and all fingers folded: "head, left hand, feet"."""
    sides: dict[str, dict[str, None]] = {}
    for region in regions:
        stem, _, side = region.partition(".")
        sides.setdefault(stem.rstrip("12345"), {})[side] = None
    found = []
    for stem, of in sides.items():
        word = _WORDS.get(stem, stem)
        many = stem == "finger" or len(of) > 1
        side = {"L": "left ", "R": "right "}.get(next(iter(of)), "") if len(of) == 1 else ""
        found.append(side + (_PLURALS.get(stem, f"{word}s") if many else word))
    return ", ".join(found)


_ABOVE: Final = {
    "finger": "hand",
    "hand": "forearm",
    "forearm": "upperarm",
    "upperarm": "torso",
    "foot": "lowerleg",
    "lowerleg": "upperleg",
    "upperleg": "torso",
    "head": "torso",
}


def above(region: str) -> str:
    """Parent of a limb's region in the hierarchy of regions; the torso is its own parent."""
    stem, _, side = region.partition(".")
    upper = _ABOVE.get(stem.rstrip("12345"), "torso")
    return upper if upper == "torso" else f"{upper}.{side}"


def known_regions(mapped: Mapping[str, str]) -> dict[str, str]:
    """Region that stands for each region on a rig: itself, or the nearest parent that the rig has.

    A rig without finger bones has hands that hold their fingers.
    """
    have = {region_of(bone) for bone in mapped}
    found: dict[str, str] = {}
    for region in REGIONS:
        at = region
        while at not in have and at != "torso":
            at = above(at)
        found[region] = at
    return found
