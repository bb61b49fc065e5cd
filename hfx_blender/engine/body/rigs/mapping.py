# SPDX-License-Identifier: GPL-3.0-or-later
"""Mapping of an armature's bones to the canonical skeleton (``load_avatar().skeleton``).

Joints are found by name (:mod:`.assignment`), otherwise by the shape of the hierarchy
(:mod:`.geometry`).
"""

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from ....errors import InputError
from ...arrays import F64
from .assignment import assigned_by_name, is_human
from .digits import Digits
from .geometry import assigned_by_geometry, geometric_left, left_by_soles, named_left
from .rig import Rig, RigBone, canonical_parents
from .sides import misnamed
from .vocabulary import FINGERS

__all__ = ["BoneMapping", "RigBone", "from_json", "map_bones", "to_json", "with_corrections"]

FORMAT_VERSION: Final = 1
_SIDE_NAMES: Final = {"L": "left", "R": "right"}
_SIDES: Final = (".L", ".R")

# The first row whose names are all present (lower case, without namespace) decides.
with Path(__file__).with_name("signatures.csv").open(encoding="utf-8", newline="") as _file:
    _SIGNATURES: Final = [
        (row["convention"], row["bones"].split(", ")) for row in csv.DictReader(_file)
    ]
_PREFIXES: Final = (
    ("mixamo", "mixamorig"),
    ("biped", "valvebiped.bip"),
    ("biped", "bip0"),
    ("character creator", "cc_base_"),
)

# Distance between equal joints of separate bodies, as a fraction of the body's extent
_APART: Final = 0.1
# Slot of an end of the body to its canonical bone
_ENDS: Final = {"head": "head", "hand": "wrist", "foot": "foot"}


@dataclass(frozen=True)
class BoneMapping:
    """Avatar bone for every bone of the canonical skeleton. Every canonical bone is in exactly one
    of ``bones`` and ``fallbacks``."""

    convention: str  # "mixamo", "vrm", "rigify", ..., "plain", "geometry"
    bones: dict[str, str]  # canonical bone -> its counterpart
    fallbacks: dict[str, str]  # canonical bone without counterpart -> avatar bone to follow
    report: tuple[str, ...]  # sentences about missing or doubtful bones


def map_bones(
    bones: Sequence[RigBone],
    labels: Mapping[str, str] | None = None,
    skin: Callable[[], Mapping[str, F64]] = dict,
) -> BoneMapping:
    """Map all bones of an avatar's armature, control bones included, to the canonical skeleton.

    ``labels`` are VRM human bone names by bone name, stored in the file; preferred to bone names.
    ``skin`` returns points (n, 3) of the skin moved by each bone, in armature space; called only
    for rigs without toes. Raises InputError: no human joints are recognised by name or hierarchy,
    or the armature has two characters.
    """
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
    _check_single(rig)
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
        notes = [
            "The bone names say nothing; the joints were found by the shape of the hierarchy, "
            "so check them."
        ]
    else:
        bone_of, notes = _on_true_sides(rig, bone_of, skin)
    return _mapping(convention, bone_of, [*notes, *_doubled_ends(rig, bone_of)])


def _on_true_sides(
    rig: Rig, bone_of: dict[str, str], skin: Callable[[], Mapping[str, F64]]
) -> tuple[dict[str, str], list[str]]:
    """Avatar bone by canonical bone with left and right swapped if the feet point the other way,
    and a list of at most one sentence about bones named after the other side."""
    # Toes, or without any toe bone the soles, show the body's true left.
    heads = {canonical: rig.head(name) for canonical, name in bone_of.items()}
    named, geometric = named_left(heads), geometric_left(heads)
    if geometric is None and not any(name.startswith("toe") for name in heads):
        geometric = left_by_soles(rig, bone_of, heads, skin())
    is_mirrored = named is not None and geometric is not None and float(named @ geometric) < 0
    if is_mirrored:
        opposite = {".L": ".R", ".R": ".L"}
        bone_of = {n[:-2] + opposite.get(n[-2:], n[-2:]): name for n, name in bone_of.items()}
    wrong = misnamed(rig, bone_of)
    if is_mirrored and len(wrong) > 0.5 * len(bone_of):
        return bone_of, [
            "The bone names are mirrored: bones named left lie on the body's right, as its "
            "feet point; they were mapped by where they lie."
        ]
    return bone_of, [
        "Bones that are named after the other side of the body than the one where they lie "
        f"were mapped by where they lie: {len(wrong)}, '{name}' first."
        for name in wrong[:1]
    ]


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
    Fallbacks and the report's sentences about missing bones are new; an avatar bone may be mapped
    twice. Raises InputError: a name is not a canonical bone, or no bone remains."""
    _check_canonical(corrections)
    bones = mapping.bones | {name: bone for name, bone in corrections.items() if bone}
    # An empty correction leaves the joint open: its skin follows a fallback.
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
    """Mapping from the JSON text of :func:`to_json`. Raises InputError: the text is not a bone
    mapping, of a newer version, or has unknown canonical bones."""
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


def _check_canonical(names: Mapping[str, object]) -> None:
    """Raise InputError at the first name that is no canonical bone; returns nothing."""
    for name in names:
        if name not in canonical_parents():
            raise InputError(
                f"'{name}' is no bone of the canonical skeleton (for instance 'upperarm01.L')."
            )


def _check_single(rig: Rig) -> None:
    """Reject an armature with two human bodies at different places; returns nothing. Control rigs
    or duplicate bones at the same place count as one body. Raises InputError: equal joints of two
    human branches are, by the median, over a tenth of the body apart."""
    bodies = list(_bodies(rig, [name for name, above in rig.parent.items() if above is None]))
    for number, (top, first) in enumerate(bodies):
        heads = np.array([rig.head(name) for name in first.values()])
        extent = float(np.ptp(heads, axis=0).max())
        for other_top, second in bodies[number + 1 :]:
            shared = [(first[bone], second[bone]) for bone in first.keys() & second.keys()]
            apart = [float(np.linalg.norm(rig.head(a) - rig.head(b))) for a, b in shared]
            if apart and np.median(apart) > _APART * extent:
                raise InputError(
                    f"The armature holds two characters: the bones from '{top}' on and those from "
                    f"'{other_top}' on are each a whole body. Give each an armature of its own (in "
                    "Edit Mode select the bones of one, Armature > Separate), with its own meshes."
                )


def _doubled_ends(rig: Rig, bones_of: Mapping[str, str]) -> list[str]:
    """List of one sentence about heads, hands and feet besides the assigned ones, over a tenth of
    the body away and in another branch; empty without any. ``bones_of`` maps canonical bones to
    avatar bones."""
    extent = float(np.ptp([rig.head(name) for name in bones_of.values()], axis=0).max())
    extra_names = []
    for (slot, side), names in Digits(rig).slots.items():
        main_name = bones_of.get(f"{_ENDS.get(slot)}{side and '.'}{side}")
        if main_name is None:
            continue
        for name in names:
            offset = rig.head(name) - rig.head(main_name)
            # A second head bone above or below the first is a part of the same head.
            own_chain = (main_name, *rig.ancestors(main_name))
            is_in_chain = main_name in rig.ancestors(name) or name in own_chain
            if not is_in_chain and np.linalg.norm(offset) > _APART * extent:
                extra_names.append(f"'{name}'")
    names_text = " and ".join(extra_names)
    return [f"Further heads or limbs ({names_text}) are not felt."] if extra_names else []


def _bodies(rig: Rig, tops: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield (top bone, avatar bone by canonical bone) of human branches below ``tops``; a branch
    with several human branches below its top is replaced by these."""
    for top in tops:
        # The branch from ``top`` down as a rig of its own, control bones included.
        names, waiting = [], [top]
        while waiting:
            names.append(waiting.pop())
            waiting += rig.children[names[-1]]
        bones = [replace(rig.by_name[name], parent=rig.parent[name], deform=True) for name in names]
        joints = assigned_by_name(Rig(bones))
        if is_human(joints):
            below = list(_bodies(rig, rig.children[top]))
            yield from below if len(below) > 1 else [(top, joints)]


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
