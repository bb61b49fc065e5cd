# SPDX-License-Identifier: GPL-3.0-or-later
"""Regions and segments of the canonical skeleton.

A *segment* has one affine transform in the pose of the canonical body. A *region* limits the search
for nearest skin: a finger cannot take a neighbour's skin.
"""

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
"""Canonical bone to the joint at its head, for joints at the same place on all rigs."""


def region_of(bone: str) -> str:
    """Region of the skin of a canonical bone, with side for limbs; "head" for neck, head and
    unknown bones, "foot" for toes, "torso" for the trunk."""
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
    """Regions as text in the order of first occurrence, with both sides and all fingers of a side
    merged: "head, left hand, feet"; empty for none."""
    sides: dict[str, dict[str, None]] = {}
    for region in regions:
        stem, _, side = region.partition(".")
        sides.setdefault(stem.rstrip("12345"), {})[side] = None
    phrases = []
    for stem, region_sides in sides.items():
        word = _WORDS.get(stem, stem)
        many = stem == "finger" or len(region_sides) > 1
        name = next(iter(region_sides)) if len(region_sides) == 1 else ""
        side = {"L": "left ", "R": "right "}.get(name, "")
        phrases.append(side + (_PLURALS.get(stem, f"{word}s") if many else word))
    return ", ".join(phrases)


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
    """Parent region on the same side; "torso" for torso, head and the first limb bones."""
    stem, _, side = region.partition(".")
    upper = _ABOVE.get(stem.rstrip("12345"), "torso")
    return upper if upper == "torso" else f"{upper}.{side}"


def known_regions(mapped: Mapping[str, str]) -> dict[str, str]:
    """Region used for each region on a rig: itself, or the nearest parent with a bone. On a rig
    without finger bones, the hand represents the fingers."""
    present = {region_of(bone) for bone in mapped}
    substitutes: dict[str, str] = {}
    for region in REGIONS:
        # Upwards along the limb to a region with a bone, at last to the torso.
        region_above = region
        while region_above not in present and region_above != "torso":
            region_above = above(region_above)
        substitutes[region] = region_above
    return substitutes
