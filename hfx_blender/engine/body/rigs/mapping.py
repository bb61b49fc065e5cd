# SPDX-License-Identifier: GPL-3.0-or-later
"""Mapping of an armature's bones to the canonical skeleton (``load_avatar().skeleton``).

Joints are found by name (:mod:`.assignment`), otherwise by the shape of the hierarchy
(:mod:`.geometry`).
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

__all__ = ["BoneMapping", "RigBone", "from_json", "map_bones", "to_json", "with_corrections"]

FORMAT_VERSION: Final = 1
_SIDE_NAMES: Final = {"L": "left", "R": "right"}
_SIDES: Final = (".L", ".R")

# The first row whose names are all present (lower case, without namespace) decides.
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
    """Avatar bone for every bone of the canonical skeleton.

    Every canonical bone is in exactly one of ``bones`` and ``fallbacks``.
    """

    convention: str  # "mixamo", "vrm", "rigify", ..., "plain", "geometry"
    bones: dict[str, str]  # canonical bone -> its counterpart
    fallbacks: dict[str, str]  # canonical bone without counterpart -> avatar bone to follow
    report: tuple[str, ...]  # sentences about missing or doubtful bones


def map_bones(
    bones: Sequence[RigBone],
    labels: Mapping[str, str] | None = None,
    skin: Callable[[], Mapping[str, F64]] = dict,
) -> BoneMapping:
    """Map the bones of an avatar's armature to the canonical skeleton.

    Parameters
    ----------
    bones : sequence of RigBone
        All bones of the armature, control bones included.
    labels : mapping, optional
        Bone name to VRM human bone name, stored in the file; preferred to bone names.
    skin : callable, optional
        Returns points (n, 3) of the skin moved by each bone, in armature space; called only for
        rigs without toes.

    Raises
    ------
    InputError
        No human joints are recognised by name or hierarchy, or the armature has two characters.
    """
    notes: list[str] = []
    # In order: labels of the file, deforming bones, all bones, the shape of the hierarchy.
    rig = Rig(bones, labels)
    bone_of = assigned_by_name(rig)
    is_labelled = bool(labels) and is_human(bone_of)
    if labels and not is_labelled:
        rig = Rig(bones)
        bone_of = assigned_by_name(rig)
    if not is_human(bone_of) and len(rig.bones) < len(rig.by_name):
        all_deforming = Rig([replace(bone, deform=True) for bone in bones])
        if is_human(assigned_by_name(all_deforming)):
            rig, bone_of = all_deforming, assigned_by_name(all_deforming)
    check_single(rig)
    convention = "vrm" if is_labelled else convention_of(rig.bones)
    if not is_human(bone_of):
        by_geometry = assigned_by_geometry(rig)
        if by_geometry is None:
            raise InputError(
                f"None of the naming conventions fits the {len(bones)} bones of this armature, "
                "nor does their hierarchy look human: looked for hips or a spine with both "
                "thighs and shins or both upper arms and forearms (Mixamo, Unity or VRM, Rigify, "
                "Unreal, MakeHuman, CMU, Daz, Biped and plain left/right names). "
                "Assign the bones by hand in the HFX tab, under Bones, or choose another armature."
            )
        bone_of, convention = by_geometry, "geometry"
        notes.append(
            "The bone names say nothing; the joints were found by the shape of the hierarchy, "
            "so check them."
        )
    else:
        is_mirrored = _is_mirrored(rig, bone_of, skin)
        if is_mirrored:
            bone_of = {_mirrored(canonical): name for canonical, name in bone_of.items()}
        wrong = misnamed(rig, bone_of)
        if is_mirrored and len(wrong) > 0.5 * len(bone_of):
            notes.append(
                "The bone names are mirrored: bones named left lie on the body's right, as its "
                "feet point; they were mapped by where they lie."
            )
        elif wrong:
            notes.append(
                "Bones that are named after the other side of the body than the one where they lie "
                f"were mapped by where they lie: {len(wrong)}, '{wrong[0]}' first."
            )
    return _mapping(convention, bone_of, [*notes, *doubled_ends(rig, bone_of)])


def convention_of(names: Iterable[str]) -> str:
    """Naming convention of bone names, by prefixes, then by sets of names; "plain" if unknown."""
    all_names = list(names)
    for convention, prefix in _PREFIXES:
        if any(name.lower().startswith(prefix) for name in all_names):
            return convention
    present = {name.rsplit(":", 1)[-1].lower() for name in all_names}
    if "Root" in all_names and not any("twist" in name for name in present):
        # MakeHuman's game engine rig has the names of Unreal's first mannequin, without twists.
        present.add("~game engine")
    for convention, words in _SIGNATURES:
        if present.issuperset(words):
            return convention
    return "plain"


def with_corrections(mapping: BoneMapping, corrections: Mapping[str, str | None]) -> BoneMapping:
    """Mapping with some canonical bones reassigned to another avatar bone, or to none (None, "").

    Raises InputError: a name is not a canonical bone, or no bone remains.
    """
    _check_canonical(corrections)
    bones = mapping.bones | {name: bone for name, bone in corrections.items() if bone}
    for canonical, bone in corrections.items():
        if not bone:
            bones.pop(canonical, None)
    if not bones:
        raise InputError("The bone mapping has no bone left; at least one must be mapped.")
    old_sentences = _missing(mapping.bones, mapping.fallbacks)
    return _mapping(
        mapping.convention, bones, [s for s in mapping.report if s not in old_sentences]
    )


def to_json(mapping: BoneMapping) -> str:
    """Mapping as JSON text; inverse of :func:`from_json`."""
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
    """Mapping from the JSON text of :func:`to_json`.

    Raises InputError: the text is not a bone mapping, of a newer version, or has unknown canonical
    bones.
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


def _heads(rig: Rig, bone_of: Mapping[str, str]) -> dict[str, F64]:
    """Head (3,) of the avatar bone by canonical bone. Raises InputError: the armature lacks a
    bone."""
    for canonical, name in bone_of.items():
        if name not in rig.by_name:
            raise InputError(
                f"The bone mapping gives '{name}' for '{canonical}', but the armature has no "
                "bone of that name."
            )
    return {canonical: rig.head(name) for canonical, name in bone_of.items()}


def _is_mirrored(
    rig: Rig, bone_of: Mapping[str, str], skin: Callable[[], Mapping[str, F64]]
) -> bool:
    """True if left by bone names is opposite to left by toes, or, without any toe bone, by soles;
    False if either is unknown."""
    heads = _heads(rig, bone_of)
    named, geometric = named_left(heads), geometric_left(heads)
    if geometric is None and not any(name.startswith("toe") for name in heads):
        geometric = left_by_soles(rig, bone_of, heads, skin())
    return named is not None and geometric is not None and float(named @ geometric) < 0


def _mirrored(canonical: str) -> str:
    """Canonical bone of the opposite side; names of the centre unchanged."""
    opposite = {"L": "R", "R": "L"}.get(canonical[-1]) if canonical[-2:-1] == "." else None
    return canonical[:-1] + opposite if opposite else canonical


def _check_canonical(names: Mapping[str, object]) -> None:
    """Raise InputError at the first name that is no canonical bone; returns nothing."""
    for name in names:
        if name not in canonical_parents():
            raise InputError(
                f"'{name}' is no bone of the canonical skeleton (for instance 'upperarm01.L')."
            )


def _mapping(convention: str, bone_of: Mapping[str, str], notes: Sequence[str]) -> BoneMapping:
    """Mapping of ``bone_of`` (avatar bone by canonical bone), completed by fallbacks; the report is
    ``notes`` and sentences about missing bones."""
    order = canonical_parents()
    bones = {name: bone_of[name] for name in order if name in bone_of}
    fallbacks = {name: _fallback(name, bones) for name in order if name not in bones}
    return BoneMapping(convention, bones, fallbacks, (*notes, *_missing(bones, fallbacks)))


def _fallback(canonical: str, bones: Mapping[str, str]) -> str:
    """Avatar bone moving the skin of a canonical bone without counterpart: the only digit, the
    first trunk bone if there is no root, the nearest mapped ancestor, else the first mapped
    bone."""
    digit = _only_digit(canonical, bones)
    if digit is not None:
        return digit
    if not canonical.endswith(_SIDES) and "root" not in bones:
        # Trunk bones without a root follow the trunk, not a limb.
        trunk = [name for name in canonical_parents() if name in bones and name[-2:] not in _SIDES]
        if trunk:
            return bones[trunk[0]]
    # Skin without a bone of its own moves with the next bone towards the root.
    ancestor = canonical_parents()[canonical]
    while ancestor is not None:
        if ancestor in bones:
            return bones[ancestor]
        ancestor = canonical_parents()[ancestor]
    return next(iter(bones.values()))


def _only_digit(canonical: str, bones: Mapping[str, str]) -> str | None:
    """Avatar bone of the only toe of that side, or of the only finger next to the thumb (a mitten;
    its nearest joint towards the hand); None otherwise."""
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
    """Sentences about canonical bones in ``fallbacks``, from hips to jaw; sentences that differ
    only in the side are merged."""
    sentences: list[str] = []

    def report_missing(label: str, canonical: str) -> None:
        if canonical in fallbacks:
            sentences.append(
                f"No bone for {label}; the skin there follows '{fallbacks[canonical]}'."
            )

    report_missing("the hips", "root")
    if not any(name.startswith("spine") for name in bones):
        report_missing("the spine", "spine01")
    if not any(name.startswith("neck") for name in bones):
        report_missing("the neck", "neck01")
    report_missing("the head", "head")
    for side, side_name in _SIDE_NAMES.items():
        for label, bone in (
            ("collar bone", "clavicle"),
            ("upper arm", "upperarm01"),
            ("forearm", "lowerarm01"),
            ("hand", "wrist"),
            ("thigh", "upperleg01"),
            ("shin", "lowerleg01"),
            ("foot", "foot"),
        ):
            report_missing(f"the {side_name} {label}", f"{bone}.{side}")
        sentences += _missing_fingers(side, fallbacks)
        toes = [n for n in fallbacks if n.startswith("toe") and n.endswith(side)]
        if len({fallbacks[name] for name in toes}) == 1:
            report_missing(f"the single toes of the {side_name} foot", toes[0])
    split = [
        n for n in fallbacks if n[:-2] in ("upperarm02", "lowerarm02", "upperleg02", "lowerleg02")
    ]
    if split:
        sentences.append(
            f"{len(split)} of 8 twist bones of the limbs are missing or placed elsewhere; "
            "their skin follows the limb's main bone."
        )
    report_missing("the jaw", "jaw")
    return _both_sides(sentences)


def _both_sides(sentences: Sequence[str]) -> list[str]:
    """Merge pairs of sentences "... follows ..." that differ only in the side and the followed
    bone; others unchanged."""
    by_text: dict[str, list[str]] = {}
    for sentence in sentences:
        part, _, follows = sentence.partition(" follows ")
        key = part.replace(" left ", " right ") if follows else sentence
        by_text.setdefault(key, []).append(sentence)
    return [
        f"{pair[0].partition(' follows ')[0].replace(' left ', ' left and right ')} follows "
        + " and ".join(
            dict.fromkeys(sentence.partition(" follows ")[2].rstrip(".") for sentence in pair)
        )
        + "."
        if len(pair) == 2
        else pair[0]
        for pair in by_text.values()
    ]


def _missing_fingers(side: str, fallbacks: Mapping[str, str]) -> list[str]:
    """Sentences about missing finger joints of side "L" or "R"; fingers with equally many missing
    and the same followed bone share a sentence."""
    fingers_by: dict[tuple[int, str], list[str]] = {}
    for number, finger in enumerate(FINGERS, start=1):
        joints = [f"finger{number}-{joint}.{side}" for joint in (1, 2, 3)]
        absent = [joint for joint in joints if joint in fallbacks]
        if absent:
            follows = f"'{fallbacks[absent[0]]}'" if len(absent) == 3 else ""
            fingers_by.setdefault((len(absent), follows), []).append(finger)
    sentences = []
    for (count, follows), fingers in fingers_by.items():
        names = " and ".join(filter(None, (", ".join(fingers[:-1]), fingers[-1])))
        names += "" if fingers == ["thumb"] else " finger"
        part = "" if count == 3 else f"{count} of 3 joints of "
        target = follows or "the joint before"
        sentences.append(
            f"No bone for {part}the {_SIDE_NAMES[side]} {names}; the skin there follows {target}."
        )
    return sentences
