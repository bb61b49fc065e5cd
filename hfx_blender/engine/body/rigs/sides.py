# SPDX-License-Identifier: GPL-3.0-or-later
"""Body sides of limb bones, from names and from positions.

A copied half of a rig often keeps the other half's names, or has two sides
(``J_Bip_L_Hand.R``, ``Hand_L.001``). The position decides where a name has both sides or none, or
contradicts the limb's position.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ...arrays import F64
from .names import BoneName, read_names
from .rig import Rig
from .vocabulary import CENTRE

_CENTRE_SLOTS: Final = frozenset(CENTRE.values())
_LEGS: Final = frozenset("hip thigh leg shin foot pelvis_half".split())
_DIGITS: Final = frozenset("finger finger_base metacarpal toe small_toe".split())
# Smallest distance of a limb from the median plane, as a fraction of the body's extent
_BESIDE: Final = 0.02
# Smallest mean cosine between the lines within pairs of limbs and the common axis
_ACROSS: Final = 0.7


def with_sides(rig: Rig, names: Mapping[str, BoneName]) -> dict[str, BoneName]:
    """Copies of parsed names with exactly one side; limb bones of unknown side are left out. The
    side follows from the position, then the name, then the nearest ancestor with a side."""
    names = {
        name: replace(parsed, numbers=parsed.numbers[:-1]) if _is_copy(rig, name) else parsed
        for name, parsed in names.items()
    }
    # Topmost recognised limb bone above each limb bone, or the bone itself.
    roots = {}
    for name in names:
        if not _is_centre(names[name]):
            above = [n for n in rig.ancestors(name) if n in names and not _is_centre(names[n])]
            roots[name] = above[-1] if above else name
    position_sides = _placed_sides(rig, names, roots)
    sided = {name: parsed for name, parsed in names.items() if _is_centre(parsed)}
    for name in roots:
        parsed = names[name]
        ancestor_sides = (names[bone].side for bone in rig.ancestors(name) if bone in names)
        side = position_sides.get(name) or parsed.side or next(filter(None, ancestor_sides), "")
        if side:
            # Bones with both sides in the name rank after bones with one.
            rank = parsed.rank + (2 if len(parsed.side) == 2 else 0)
            sided[name] = replace(parsed, side=side[-1], rank=rank)
    return sided


def _placed_sides(
    rig: Rig, names: Mapping[str, BoneName], roots: Mapping[str, str]
) -> dict[str, str]:
    """Sides ("" near the middle) of bones by the median position of all bones of their
    limb; empty without an axis.
    Leaves out bones named after one side and lying on the other side than their limb."""
    axis = _LeftAxis.of(rig, names, roots)
    if axis is None:
        return {}
    limbs: dict[str, list[F64]] = {}
    for name, root in roots.items():
        limbs.setdefault(root, []).append(rig.head(name))
    # A limb lies on one side: the median of its bones decides, not bones crossing the middle.
    limb_sides = {root: axis.side_of(np.median(heads, axis=0)) for root, heads in limbs.items()}
    return {
        name: limb_sides[root]
        for name, root in roots.items()
        if len(names[name].side) != 1 or axis.side_of(rig.head(name)) in (limb_sides[root], "")
    }


def misnamed(rig: Rig, bone_of: Mapping[str, str]) -> list[str]:
    """Avatar bones, of the assigned, whose name has only the side opposite to their canonical
    bone's."""
    parsed_names, opposite = read_names(rig.labels.values()), {".L": "R", ".R": "L"}
    parsed_of = {
        canonical: parsed_names.get(rig.labels.get(name, "")) for canonical, name in bone_of.items()
    }
    return [
        bone_of[canonical]
        for canonical, parsed in parsed_of.items()
        if parsed is not None and parsed.side == opposite.get(canonical[-2:])
    ]


def _is_centre(parsed: BoneName) -> bool:
    """True for a name without side whose slot is in the middle of the body."""
    return not parsed.side and parsed.slot in _CENTRE_SLOTS


def _is_copy(rig: Rig, name: str) -> bool:
    """True if the name ends in Blender's copy number (".001") after the name of another bone, not
    an ancestor."""
    original = re.sub(r"\.\d{3}$", "", name)
    # "spine.001" below "spine" is a second part, not a copy.
    return original != name and original in rig.bones and original not in rig.ancestors(name)


@dataclass(frozen=True)
class _LeftAxis:
    """Left-right axis and middle of a body, from pairs of limbs."""

    way: F64  # (3,) unit vector to the body's left
    middle: F64  # (3,) metres
    least: float  # largest distance from the median plane without a side, metres

    @classmethod
    def of(
        cls, rig: Rig, names: Mapping[str, BoneName], roots: Mapping[str, str]
    ) -> "_LeftAxis | None":
        """Left-right axis of a rig from pairs of limb bones of one slot and depth; None without two
        pairs across one plane, or if names do not tell left from right."""
        main = [name for name in roots if names[name].slot.split()[0] not in _DIGITS]
        by_slot: dict[tuple[str, int], list[str]] = {}
        for name in main:
            by_slot.setdefault((names[name].slot, rig.depth(name)), []).append(name)
        pairs = [pair for pair in by_slot.values() if len(pair) == 2]
        if len(pairs) < 2:
            return None
        ends = np.array([[rig.head(name) for name in pair] for pair in pairs])  # (P, 2, 3)
        extent = float(np.ptp([rig.head(name) for name in names], axis=0).max())
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        ends, lengths = ends[lengths > _BESIDE * extent], lengths[lengths > _BESIDE * extent]
        if len(ends) < 2:
            return None
        # Directions from one limb to its partner; the order in a pair is arbitrary.
        ways = (ends[:, 0] - ends[:, 1]) / lengths[:, None]
        way = np.linalg.svd(ways)[2][0]  # common axis regardless of signs
        if np.mean(np.abs(ways @ way)) < _ACROSS:
            return None
        middle = ends.mean(axis=(0, 1))
        # The sign of the axis by vote: names with one side weigh ten times those of copies.
        votes = 0.0
        for name in main:
            side = names[name].side[-1:]
            offset = float((rig.head(name) - middle) @ way)
            if side and abs(offset) > _BESIDE * extent:
                is_clear = len(names[name].side) == 1 and not _is_copy(rig, name)
                weight = 1.0 if is_clear else 0.1
                # Names of legs count more than contradicting names of arms.
                weight *= 2.0 if names[name].slot in _LEGS else 1.0
                votes += weight * np.sign(offset) * (1.0 if side == "L" else -1.0)
        return None if votes == 0.0 else cls(way * np.sign(votes), middle, _BESIDE * extent)

    def side_of(self, place: F64) -> str:
        """Side of a point (3,): "L", "R", or "" within ``least`` of the median plane."""
        offset = float((place - self.middle) @ self.way)
        return "" if abs(offset) < self.least else "L" if offset > 0.0 else "R"
