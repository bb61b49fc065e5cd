# SPDX-License-Identifier: GPL-3.0-or-later
"""Mapping the bones of a user's armature to the canonical skeleton.

Joints are found by name first (:mod:`.bone_names`); where names say nothing, by the shape of
the hierarchy (:mod:`.bone_geometry`). Canonical names are those of ``load_avatar().skeleton``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from ....errors import InputError
from ...arrays import F64
from .assignment import assigned_by_name, is_human
from .characters import check_single, doubled_ends
from .geometry import assigned_by_geometry, geometric_left, left_by_soles, named_left
from .rig import Rig, RigBone, canonical_parents
from .sides import misnamed
from .vocabulary import FINGERS

__all__ = [
    "BoneMapping",
    "RigBone",
    "from_json",
    "map_bones",
    "to_json",
    "with_corrections",
]

FORMAT_VERSION: Final = 1
_SIDE_NAMES: Final = {"L": "left", "R": "right"}
_SIDES: Final = (".L", ".R")

# The first row with all of its words among the names (lower case, without namespace) wins.
_SIGNATURES: Final = (
    ("makehuman default", ("upperarm01.l", "metacarpal1.l", "spine05")),
    ("makehuman default", ("upperarm01_l", "metacarpal1_l", "spine05")),
    ("rigify", ("def-upper_arm.l",)),
    ("rigify", ("upper_arm.l", "forearm.l", "shin.l", "spine.001")),
    ("vrm", ("j_bip_c_hips",)),
    ("auto-rig pro", ("arm_stretch.l", "thigh_stretch.l")),
    ("mmd", ("上半身", "下半身")),
    ("mmd", ("upper body", "lower body")),
    ("xsens", ("pelvis", "l5", "t8", "leftupperleg")),
    ("smpl", ("pelvis", "l_hip", "l_collar", "spine3")),
    ("second life", ("mpelvis", "mtorso", "mhipleft")),
    ("cmu", ("lhipjoint", "leftupleg")),
    ("mixamo", ("hips", "leftupleg", "leftforearm", "lefttoebase")),
    ("mixamo", ("hips", "leftupleg", "leftforearm", "spine1")),
    ("vrm", ("hips", "leftupperarm", "leftlowerleg")),
    ("daz", ("lshldrbend",)),
    ("daz", ("lshldr", "lforearm")),
    ("daz", ("l_upperarm", "l_forearm", "l_shin")),
    ("game engine", ("upperarm_l", "calf_l", "spine_01", "root", "~game engine")),
    ("unreal", ("upperarm_l", "calf_l", "spine_01")),
)
_PREFIXES: Final = (
    ("mixamo", "mixamorig"),
    ("biped", "valvebiped.bip"),
    ("biped", "bip0"),
    ("character creator", "cc_base_"),
)


@dataclass(frozen=True)
class BoneMapping:
    """Mapping from each bone of the canonical skeleton to the bone of an avatar that moves it.

    Every canonical bone is in exactly one of ``bones`` and ``fallbacks``.
    """

    convention: str  # "mixamo", "vrm", "rigify", ..., "plain", "geometry"
    bones: dict[str, str]  # canonical bone -> its counterpart
    fallbacks: dict[str, str]  # canonical bone without counterpart -> the bone it follows
    report: tuple[str, ...]  # sentences about what is missing or doubtful


def map_bones(
    bones: Sequence[RigBone],
    labels: Mapping[str, str] | None = None,
    skin: Callable[[], Mapping[str, F64]] = dict,
) -> BoneMapping:
    """Map the bones of an avatar's armature to the canonical skeleton.

    Parameters
    ----------
    bones : sequence of RigBone
        All bones of the armature in rest pose, control bones included.
    labels : mapping, optional
        Bone to the name of VRM's human bone that it is, where the armature's file tells; believed
        before the bones' own names.
    skin : callable, optional
        Places (n, 3) of the skin that follows each bone: tells sides of rigs without toes.

    Raises
    ------
    InputError
        No human joints are recognisable, neither by name nor by the shape of the hierarchy; or
        those of two humans are.
    """
    notes: list[str] = []
    rig = Rig(bones, labels)
    found = assigned_by_name(rig)
    is_labelled = bool(labels) and is_human(found)
    if labels and not is_labelled:
        rig = Rig(bones)
        found = assigned_by_name(rig)
    if not is_human(found) and len(rig.bones) < len(rig.by_name):
        every = Rig([replace(bone, deform=True) for bone in bones])
        if is_human(assigned_by_name(every)):
            rig, found = every, assigned_by_name(every)
    check_single(rig)
    convention = "vrm" if is_labelled else convention_of(rig.bones)
    if not is_human(found):
        by_geometry = assigned_by_geometry(rig)
        if by_geometry is None:
            raise InputError(
                f"None of the naming conventions fits the {len(bones)} bones of this armature, "
                "nor does their hierarchy look human: looked for hips or a spine with both "
                "thighs and shins or both upper arms and forearms (Mixamo, Unity or VRM, Rigify, "
                "Unreal, MakeHuman, CMU, Daz, Biped and plain left/right names). "
                "Assign the bones by hand in the HFX tab, under Bones, or choose another armature."
            )
        found, convention = by_geometry, "geometry"
        notes.append(
            "The bone names say nothing; the joints were found by the shape of the hierarchy, "
            "so check them."
        )
    else:
        is_mirrored = _is_mirrored(rig, found, skin)
        if is_mirrored:
            found = {_mirrored(canonical): name for canonical, name in found.items()}
        wrong = misnamed(rig, found)
        if is_mirrored and len(wrong) > 0.5 * len(found):
            notes.append(
                "The bone names are mirrored: bones named left lie on the body's right, as its "
                "feet point; they were mapped by where they lie."
            )
        elif wrong:
            notes.append(
                "Bones that are named after the other side of the body than the one where they lie "
                f"were mapped by where they lie: {len(wrong)}, '{wrong[0]}' first."
            )
    return _mapping(convention, found, [*notes, *doubled_ends(rig, found)])


def convention_of(names: Iterable[str]) -> str:
    """The convention of a rig's bone names; "plain" if it is none of the known ones."""
    written = list(names)
    for convention, prefix in _PREFIXES:
        if any(name.lower().startswith(prefix) for name in written):
            return convention
    present = {name.rsplit(":", 1)[-1].lower() for name in written}
    if "Root" in written and not any("twist" in name for name in present):
        # MakeHuman's game engine rig is Unreal's first mannequin without its helpers.
        present.add("~game engine")
    for convention, words in _SIGNATURES:
        if present.issuperset(words):
            return convention
    return "plain"


def with_corrections(mapping: BoneMapping, corrections: Mapping[str, str | None]) -> BoneMapping:
    """A mapping with some canonical bones given another avatar bone, or none.

    Raises
    ------
    InputError
        A corrected bone is not of the canonical skeleton, or nothing is left.
    """
    _check_canonical(corrections)
    bones = mapping.bones | {name: bone for name, bone in corrections.items() if bone}
    for canonical, bone in corrections.items():
        if not bone:
            bones.pop(canonical, None)
    if not bones:
        raise InputError("The bone mapping has no bone left; at least one must be mapped.")
    old = _missing(mapping.bones, mapping.fallbacks)
    return _mapping(mapping.convention, bones, [s for s in mapping.report if s not in old])


def to_json(mapping: BoneMapping) -> str:
    """A mapping as JSON, for saving; :func:`from_json` reads it."""
    return json.dumps(
        {
            "format": "hfx bone mapping",
            "version": FORMAT_VERSION,
            "convention": mapping.convention,
            "bones": mapping.bones,
            "fallbacks": mapping.fallbacks,
            "report": list(mapping.report),
        },
        indent=1,
        ensure_ascii=False,
    )


def from_json(text: str) -> BoneMapping:
    """Read what :func:`to_json` wrote.

    Raises
    ------
    InputError
        The text is not a bone mapping, is of a newer version or names unknown canonical bones.
    """
    try:
        stored = json.loads(text)
        if stored["format"] != "hfx bone mapping":
            raise ValueError(f"its format is {stored['format']!r}")
        if stored["version"] > FORMAT_VERSION:
            raise ValueError(f"its version is {stored['version']}, newer than {FORMAT_VERSION}")
        tables = stored["bones"], stored["fallbacks"]
        strings = [stored["convention"], *stored["report"]]
        for table in tables:
            strings += [part for item in table.items() for part in item]
        if not all(isinstance(string, str) for string in strings):
            raise ValueError("a bone name is not a text")
        mapping = BoneMapping(stored["convention"], *tables, tuple(stored["report"]))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"The text is not a bone mapping ({error}).") from error
    _check_canonical(mapping.bones | mapping.fallbacks)
    return mapping


def _heads(rig: Rig, found: Mapping[str, str]) -> dict[str, F64]:
    for canonical, name in found.items():
        if name not in rig.by_name:
            raise InputError(
                f"The bone mapping gives '{name}' for '{canonical}', but the armature has no "
                "bone of that name."
            )
    return {canonical: rig.head(name) for canonical, name in found.items()}


def _is_mirrored(rig: Rig, found: Mapping[str, str], skin: Callable[[], Mapping[str, F64]]) -> bool:
    heads = _heads(rig, found)
    named, geometric = named_left(heads), geometric_left(heads)
    if geometric is None and not any(name.startswith("toe") for name in heads):
        geometric = left_by_soles(rig, found, heads, skin())
    return named is not None and geometric is not None and float(named @ geometric) < 0


def _mirrored(canonical: str) -> str:
    other = {"L": "R", "R": "L"}.get(canonical[-1]) if canonical[-2:-1] == "." else None
    return canonical[:-1] + other if other else canonical


def _check_canonical(names: Mapping[str, object]) -> None:
    for name in names:
        if name not in canonical_parents():
            raise InputError(
                f"'{name}' is no bone of the canonical skeleton (for instance 'upperarm01.L')."
            )


def _mapping(convention: str, found: Mapping[str, str], notes: Sequence[str]) -> BoneMapping:
    order = canonical_parents()
    bones = {name: found[name] for name in order if name in found}
    fallbacks = {name: _followed(name, bones) for name in order if name not in bones}
    return BoneMapping(convention, bones, fallbacks, (*notes, *_missing(bones, fallbacks)))


def _followed(canonical: str, bones: Mapping[str, str]) -> str:
    """Avatar bone that a canonical bone without counterpart follows."""
    digit = _only_digit(canonical, bones)
    if digit is not None:
        return digit
    if not canonical.endswith(_SIDES) and "root" not in bones:
        # The middle of the body never follows a limb.
        trunk = [name for name in canonical_parents() if name in bones and name[-2:] not in _SIDES]
        if trunk:
            return bones[trunk[0]]
    ancestor = canonical_parents()[canonical]
    while ancestor is not None:
        if ancestor in bones:
            return bones[ancestor]
        ancestor = canonical_parents()[ancestor]
    return next(iter(bones.values()))


def _only_digit(canonical: str, bones: Mapping[str, str]) -> str | None:
    """Avatar bone of the only toe, or finger beside the thumb: it moves all of them."""
    side = canonical[-2:]
    if canonical.startswith("toe"):
        toes = [n for n in bones if n.startswith("toe") and n.endswith(side)]
        if len({name[3] for name in toes}) == 1:
            return bones[toes[0]]
    if canonical.startswith("finger") and canonical[6] != "1":  # of a mitten
        joints = [n for n in bones if n[:6] == "finger" and n[6] != "1" and n.endswith(side)]
        reached = [n for n in joints if n[8] <= canonical[8]]
        if reached and len({name[6] for name in joints}) == 1:
            return bones[max(reached)]
    return None


def _missing(bones: Mapping[str, str], fallbacks: Mapping[str, str]) -> list[str]:
    sentences: list[str] = []

    def tell(what: str, canonical: str) -> None:
        if canonical in fallbacks:
            sentences.append(
                f"No bone for {what}; the skin there follows '{fallbacks[canonical]}'."
            )

    tell("the hips", "root")
    if not any(name.startswith("spine") for name in bones):
        tell("the spine", "spine01")
    if not any(name.startswith("neck") for name in bones):
        tell("the neck", "neck01")
    tell("the head", "head")
    for side, side_name in _SIDE_NAMES.items():
        for what, bone in (
            ("collar bone", "clavicle"),
            ("upper arm", "upperarm01"),
            ("forearm", "lowerarm01"),
            ("hand", "wrist"),
            ("thigh", "upperleg01"),
            ("shin", "lowerleg01"),
            ("foot", "foot"),
        ):
            tell(f"the {side_name} {what}", f"{bone}.{side}")
        sentences += _missing_fingers(side, fallbacks)
        toes = [n for n in fallbacks if n.startswith("toe") and n.endswith(side)]
        if len({fallbacks[name] for name in toes}) == 1:
            tell(f"the single toes of the {side_name} foot", toes[0])
    split = [
        n for n in fallbacks if n[:-2] in ("upperarm02", "lowerarm02", "upperleg02", "lowerleg02")
    ]
    if split:
        sentences.append(
            f"{len(split)} of 8 twist bones of the limbs are missing or placed elsewhere; "
            "their skin follows the limb's main bone."
        )
    tell("the jaw", "jaw")
    return _both_sides(sentences)


def _both_sides(sentences: Sequence[str]) -> list[str]:
    """Sentences of which two that differ in the side only are one."""
    found: dict[str, list[str]] = {}
    for sentence in sentences:
        part, _, follows = sentence.partition(" follows ")
        key = part.replace(" left ", " right ") if follows else sentence
        found.setdefault(key, []).append(sentence)
    return [
        f"{pair[0].partition(' follows ')[0].replace(' left ', ' left and right ')} follows "
        + " and ".join(dict.fromkeys(each.partition(" follows ")[2].rstrip(".") for each in pair))
        + "."
        if len(pair) == 2
        else pair[0]
        for pair in found.values()
    ]


def _missing_fingers(side: str, fallbacks: Mapping[str, str]) -> list[str]:
    """A sentence for all fingers of a hand that lack the same joints and follow the same bone."""
    alike: dict[tuple[int, str], list[str]] = {}
    for number, finger in enumerate(FINGERS, start=1):
        joints = [f"finger{number}-{joint}.{side}" for joint in (1, 2, 3)]
        absent = [joint for joint in joints if joint in fallbacks]
        if absent:
            follows = f"'{fallbacks[absent[0]]}'" if len(absent) == 3 else ""
            alike.setdefault((len(absent), follows), []).append(finger)
    found = []
    for (count, follows), fingers in alike.items():
        names = " and ".join(filter(None, (", ".join(fingers[:-1]), fingers[-1])))
        names += "" if fingers == ["thumb"] else " finger"
        part = "" if count == 3 else f"{count} of 3 joints of "
        which = follows or "the joint before"
        found.append(
            f"No bone for {part}the {_SIDE_NAMES[side]} {names}; the skin there follows {which}."
        )
    return found
