# SPDX-License-Identifier: GPL-3.0-or-later
"""Side of the body of a rig's limb bones, from their names and from where they lie.

A copied half of a rig often keeps the other half's names, or gets a second side
(``J_Bip_L_Hand.R``, ``Hand_L.001``). Where names tell both sides, none, or the side that a limb
does not lie on, the limb's place decides.
"""

from __future__ import annotations

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
_BESIDE: Final = 0.02
"""Distance from the body's middle, as a share of its extent, from which a limb lies on a side."""

_ACROSS: Final = 0.7
"""Share of the distances within pairs of limbs that must lie along one line across the body."""


def with_sides(rig: Rig, names: Mapping[str, BoneName]) -> dict[str, BoneName]:
    """Names with one side each; limb bones without any side are left out."""
    names = {
        name: replace(said, numbers=said.numbers[:-1]) if _is_copy(rig, name) else said
        for name, said in names.items()
    }
    roots = {name: _limb_root(rig, names, name) for name in names if not _is_centre(names[name])}
    placed = _placed_sides(rig, names, roots)
    found = {name: said for name, said in names.items() if _is_centre(said)}
    for name in roots:
        said = names[name]
        above = (names[bone].side for bone in rig.ancestors(name) if bone in names)
        side = placed.get(name) or said.side or next(filter(None, above), "")
        if side:
            # A bone that tells one side comes before one that tells both.
            rank = said.rank + (2 if len(said.side) == 2 else 0)
            found[name] = replace(said, side=side[-1], rank=rank)
    return found


def _placed_sides(
    rig: Rig, names: Mapping[str, BoneName], roots: Mapping[str, str]
) -> dict[str, str]:
    """Sides of bones by the limb that they belong to, where a bone does not lie on the other."""
    left = _Left.of(rig, names, roots)
    if left is None:
        return {}
    limbs: dict[str, list[F64]] = {}
    for name, root in roots.items():
        limbs.setdefault(root, []).append(rig.head(name))
    limb_sides = {root: left.side_of(np.median(heads, axis=0)) for root, heads in limbs.items()}
    return {
        name: limb_sides[root]
        for name, root in roots.items()
        if len(names[name].side) != 1 or left.side_of(rig.head(name)) in (limb_sides[root], "")
    }


def misnamed(rig: Rig, found: Mapping[str, str]) -> list[str]:
    """Bones among those found whose names tell the other side of the body alone."""
    read, other = read_names(rig.labels.values()), {".L": "R", ".R": "L"}
    told = {canonical: read.get(rig.labels.get(name, "")) for canonical, name in found.items()}
    return [
        found[canonical]
        for canonical, said in told.items()
        if said is not None and said.side == other.get(canonical[-2:])
    ]


def _is_centre(said: BoneName) -> bool:
    return not said.side and said.slot in _CENTRE_SLOTS


def _is_copy(rig: Rig, name: str) -> bool:
    """Test for the number that Blender gives the copy of a bone ("Hand_L.001")."""
    original = re.sub(r"\.\d{3}$", "", name)
    # "spine.001" on "spine" is its second part.
    return original != name and original in rig.bones and original not in rig.ancestors(name)


def _limb_root(rig: Rig, names: Mapping[str, BoneName], name: str) -> str:
    """First bone of the limb that a bone belongs to."""
    above = [bone for bone in rig.ancestors(name) if bone in names and not _is_centre(names[bone])]
    return above[-1] if above else name


@dataclass(frozen=True)
class _Left:
    """Direction and middle of a body, found from limbs of which there are two."""

    way: F64  # (3,) unit vector to the body's left
    middle: F64  # (3,)
    least: float  # distance from the middle from which a place is beside it

    @classmethod
    def of(cls, rig: Rig, names: Mapping[str, BoneName], roots: Mapping[str, str]) -> _Left | None:
        """Find the left of a rig; None where its limbs do not lie in pairs across one plane."""
        main = [name for name in roots if names[name].slot.split()[0] not in _DIGITS]
        alike: dict[tuple[str, int], list[str]] = {}
        for name in main:
            alike.setdefault((names[name].slot, rig.depth(name)), []).append(name)
        pairs = [pair for pair in alike.values() if len(pair) == 2]
        if len(pairs) < 2:
            return None
        ends = np.array([[rig.head(name) for name in pair] for pair in pairs])  # (P, 2, 3)
        extent = float(np.ptp([rig.head(name) for name in names], axis=0).max())
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        ends, lengths = ends[lengths > _BESIDE * extent], lengths[lengths > _BESIDE * extent]
        if len(ends) < 2:
            return None
        ways = (ends[:, 0] - ends[:, 1]) / lengths[:, None]
        way = np.linalg.svd(ways)[2][0]
        if np.mean(np.abs(ways @ way)) < _ACROSS:
            return None
        middle = ends.mean(axis=(0, 1))
        votes = 0.0
        for name in main:
            side = names[name].side[-1:]
            offset = float((rig.head(name) - middle) @ way)
            if side and abs(offset) > _BESIDE * extent:
                is_clear = len(names[name].side) == 1 and not _is_copy(rig, name)
                weight = 1.0 if is_clear else 0.1
                # Of arms and legs that contradict each other the legs are believed.
                weight *= 2.0 if names[name].slot in _LEGS else 1.0
                votes += weight * np.sign(offset) * (1.0 if side == "L" else -1.0)
        return None if votes == 0.0 else cls(way * np.sign(votes), middle, _BESIDE * extent)

    def side_of(self, place: F64) -> str:
        """Side on which a place lies; "" near the middle."""
        offset = float((place - self.middle) @ self.way)
        return "" if abs(offset) < self.least else "L" if offset > 0.0 else "R"
