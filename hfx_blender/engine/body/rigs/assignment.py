# SPDX-License-Identifier: GPL-3.0-or-later
"""Assigns canonical bones to a rig's bones, from the names that were understood."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, pairwise, product
from typing import Final

import numpy as np

from ...arrays import F64
from .digits import Digits
from .rig import Rig, canonical_heads, canonical_parents

_SPINE: Final = ("spine05", "spine04", "spine03", "spine02", "spine01")  # from the hips up
_NECK: Final = ("neck01", "neck02", "neck03")
# Limb bone, its second part, the next joint.
_SPLIT: Final = (
    ("upperarm01", "upperarm02", "lowerarm01", "upper_arm"),
    ("lowerarm01", "lowerarm02", "wrist", "forearm"),
    ("upperleg01", "upperleg02", "lowerleg01", "thigh"),
    ("lowerleg01", "lowerleg02", "foot", "shin"),
)
_SPLIT_TOLERANCE: Final = 0.15  # of the limb's length; beyond, a second part is no counterpart
_NEXT: Final = (
    ("upperarm01", "lowerarm01"),
    ("lowerarm01", "wrist"),
    ("upperleg01", "lowerleg01"),
    ("lowerleg01", "foot"),
)
_ENDS: Final = {"lowerarm01": ("upperarm01", "wrist"), "lowerleg01": ("upperleg01", "foot")}
_ARM: Final = ("upperarm01", "lowerarm01")
_LEG: Final = ("upperleg01", "lowerleg01")
_STRAIGHT: Final = 0.8  # least cosine between parts of one limb
_TRIED: Final = 4  # bones with the same joint's name
_MAIN: Final = frozenset(
    ["head"]
    + [
        f"{bone}.{side}"
        for side in "LR"
        for bone in ("upperarm01", "lowerarm01", "wrist", "upperleg01", "lowerleg01", "foot")
    ]
)


def assigned_by_name(rig: Rig) -> dict[str, str]:
    """Counterparts of canonical bones, by the names of a rig's bones.

    Returns
    -------
    dict
        Canonical bone to avatar bone; empty if no name is understood.
    """
    own, read = _canonical_names(rig.bones), _Assignment(rig).found
    if {"upperarm01.L", "upperarm01.R", "upperleg01.L", "upperleg01.R", "spine01"} <= own.keys():
        # MakeHuman's default rig, with or without toes; not what is left of it in another rig.
        if _MAIN.intersection(own) >= _MAIN.intersection(read):
            return own
    return read


def _canonical_names(names: Iterable[str]) -> dict[str, str]:
    """Bones called as in the canonical skeleton (exporters may change its dots and dashes)."""

    def key(name: str) -> str:
        return re.sub(r"[\s.\-]", "_", re.split(r"[:|]", name)[-1]).lower()

    canonical = {key(name): name for name in canonical_parents()}
    return {canonical[key(name)]: name for name in names if key(name) in canonical}


def is_human(found: Mapping[str, str]) -> bool:
    """Test joints for a trunk with both arms or both legs."""
    has_trunk = "root" in found or any(name.startswith("spine") for name in found)
    return has_trunk and any(
        all(f"{bone}.{side}" in found for bone in limb for side in "LR") for limb in (_ARM, _LEG)
    )


class _Assignment(Digits):
    """Steps of the assignment, which share the names read and the counterparts found so far."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        for side in "LR":
            self._arm(side)
            self._leg(side)
        self._complete()
        for side in "LR":
            self._fingers(side)
            self._toes(side)
            for slot in ("breast", "eye"):
                self._put(f"{slot}.{side}", self._take(slot, side))
            self._split_limbs(side)
        self._trunk()
        self._put("jaw", self._take("jaw", ""))

    def _arm(self, side: str) -> None:
        clavicle, shoulder = self._take("clavicle", side), self._take("shoulder", side)
        arm = self._take("arm", side)
        fore = self._take("forearm", side)
        palm = [name for name in self._take("metacarpal", side) if not self.names[name].numbers]
        hand = self._take("hand", side) or (palm if len(palm) == 1 else [])
        upper = self._either(self._take("upper_arm", side), arm)
        if not fore:  # "Arm1", "Arm2", perhaps "Arm3" or a collar bone "Arm"
            chain = self._hanging(upper)
            upper, fore, hand, rest = self._numbered(upper, fore, hand)
            if len(chain) > 3 or (rest and (clavicle or shoulder)):
                fore = self._nearest_to(f"lowerarm01.{side}", chain, hand)
            elif rest:
                clavicle, upper, fore = upper, fore, rest
        if not upper and not clavicle:  # "Shoulder1", "Shoulder2"
            first, second, _, _ = self._numbered(shoulder, [], [])
            clavicle, shoulder = (first, second) if second else ([], shoulder)
        # Joints may be named, not bones: shoulder, elbow, wrist.
        upper = [*upper, *shoulder]
        bones = ("upperarm01", "lowerarm01", "wrist")
        self._put_chain(side, bones, (upper, fore, hand))
        taken = self.found.get(f"upperarm01.{side}")
        self._put(f"clavicle.{side}", clavicle or [name for name in shoulder if name != taken])

    def _leg(self, side: str) -> None:
        hip, leg = self._take("hip", side), self._take("leg", side)
        thigh, shin = self._take("thigh", side), self._take("shin", side)
        foot = self._take("foot", side)
        below = self._either(shin, leg)
        if not thigh and not hip and shin:  # leg and knee
            thigh, below = leg, shin
        elif not thigh and not shin and len(leg) > 1:  # "Leg1", "Leg2", perhaps "Leg3"
            chain = self._hanging(leg)
            thigh, below, last, toe = self._numbered(leg, [], foot)
            if foot and len(chain) > 2:
                if self._turns_forward(chain, foot[0]):  # the foot's joint is the ball's
                    self.slots.setdefault(("toe", side), foot)
                    last, chain = chain[-1:], chain[:-1]
                below = self._nearest_to(f"lowerleg01.{side}", chain, last)
            if not foot:
                self.slots.setdefault(("toe", side), toe)
            foot = last
        thigh = [*thigh, *hip]
        self._put_chain(side, ("upperleg01", "lowerleg01", "foot"), (thigh, below, foot))
        taken = self.found.get(f"upperleg01.{side}")
        half = self._take("pelvis_half", side) or [name for name in hip if name != taken]
        self._put(f"pelvis.{side}", half)

    def _numbered(
        self, first: list[str], second: list[str], third: list[str]
    ) -> tuple[list[str], list[str], list[str], list[str]]:
        """Spread bones of one name that hang on each other over the joints of a limb.

        The fourth list holds what is left over: toes, or the last of three above a hand.
        """
        chain = self._hanging(first)
        if len(chain) < 2:
            return first, second, third, []
        return chain[:1], chain[1:2], third or chain[2:3], chain[2:3] if third else chain[3:4]

    def _hanging(self, names: Sequence[str]) -> list[str]:
        """Bones that hang on each other, from the first on."""
        chain = list(names[:1])
        for name in names[1:]:
            if chain[-1] in self.rig.ancestors(name):
                chain.append(name)
        return chain

    def _nearest_to(self, joint: str, chain: Sequence[str], end: Sequence[str]) -> list[str]:
        """Bone of a limb of several parts, above its end, that begins nearest to a canonical
        elbow or knee.
        """
        first, last = _ENDS[joint[:-2]]
        own, ends = canonical_heads(), (self.rig.head(chain[0]), self.rig.head(end[0]))
        side = joint[-2:]
        wanted = _fraction(own[first + side], own[last + side], own[joint])
        return [min(chain[1:], key=lambda n: abs(_fraction(*ends, self.rig.head(n)) - wanted))]

    def _turns_forward(self, leg: Sequence[str], foot: str) -> bool:
        """Test that the way from a leg's last bone to the foot leads forward, not down."""
        down = self.rig.head(leg[-1]) - self.rig.head(leg[0])
        way = self.rig.head(foot) - self.rig.head(leg[-1])
        return bool(way @ down < _STRAIGHT * np.linalg.norm(way) * np.linalg.norm(down))

    def _either(self, clear: list[str], doubtful: list[str]) -> list[str]:
        """Unambiguous bones of a joint, then those that could belong to another."""
        marked = bool(clear) and self.names[clear[0]].rank < 0
        return clear if marked else [*clear, *doubtful]

    def _put_chain(
        self, side: str, bones: Sequence[str], candidates: Sequence[Sequence[str]]
    ) -> None:
        """Assign the bones of one limb that form a chain; leftovers of another rig do not."""
        known = [(bone, names) for bone, names in zip(bones, candidates, strict=True) if names]
        choices = product(*(names[:_TRIED] for _, names in known))
        best = max(choices, key=lambda chain: self._links(chain))  # the first of the best
        self.found |= {f"{bone}.{side}": name for (bone, _), name in zip(known, best, strict=True)}

    def _complete(self) -> None:
        """Assign joints whose bones have uninformative names: the only children of those above
        them.
        """
        for above, below in _NEXT:
            added = {}
            for side in "LR":
                name = self.found.get(f"{above}.{side}")
                children = [] if name is None else self.rig.children[name]
                if f"{below}.{side}" not in self.found and len(children) == 1 and name is not None:
                    way = self.rig.head(children[0]) - self.rig.head(name)
                    if children[0] not in self.names and np.linalg.norm(way) > 0.0:
                        added[f"{below}.{side}"] = children[0]
            if all(f"{below}.{side}" in {**self.found, **added} for side in "LR"):
                self.found |= added

    def _links(self, chain: Sequence[str]) -> int:
        return sum(above in self.rig.ancestors(name) for above, name in pairwise(chain))

    def _split_limbs(self, side: str) -> None:
        """Second parts of limb bones that lie in the limb and are split at about our place."""
        for first, second, after, slot in _SPLIT:
            main = self.found.get(f"{first}.{side}")
            following = self.found.get(f"{after}.{side}")
            if main is None or following is None:
                continue
            twists = self._take(f"{slot}_twist", side)
            if twists and self._begins_before(twists[0], main, following):
                # Auto-Rig Pro: the first half of a limb twists, the second is the bone proper.
                self.found |= {f"{first}.{side}": twists[0], f"{second}.{side}": main}
                continue
            above = set(self.rig.ancestors(following))
            counted = self._take("arm" if slot in ("upper_arm", "forearm") else "leg", side)
            named = self._take(slot, side)[1:] + self._take(f"{slot}_twist", side)
            parts = [
                name
                for name in (*named, *counted)
                if name in above and main in self.rig.ancestors(name)
            ]
            own = canonical_heads()
            wanted = _fraction(*(own[f"{bone}.{side}"] for bone in (first, after, second)))
            start, end = self.rig.head(main), self.rig.head(following)
            misses = {p: abs(_fraction(start, end, self.rig.head(p)) - wanted) for p in parts}
            close = [part for part in parts if misses[part] <= _SPLIT_TOLERANCE]
            self._put(f"{second}.{side}", sorted(close, key=misses.__getitem__))

    def _begins_before(self, twist: str, main: str, following: str) -> bool:
        """Test a twist bone: is it nearer to a limb's beginning than the limb's named bone?"""
        end = self.rig.head(following)
        length, own = (float(np.linalg.norm(self.rig.head(n) - end)) for n in (twist, main))
        return length > (1.0 + 2.0 * _SPLIT_TOLERANCE) * own

    def _trunk(self) -> None:
        hips, spine, neck, head = self._parts_of_trunk()
        self._put("root", hips)
        self._put("head", head)
        self._pelvis_halves(hips)
        self._spine(hips, spine, [*neck, *head])
        if neck and head:
            own = canonical_heads()
            ends_of_neck = self.rig.head(neck[0]), self.rig.head(head[0])
            self.found |= _chain(self.rig, _NECK, own["neck01"], own["head"], neck, *ends_of_neck)
        else:
            self._put("neck01", neck)

    def _parts_of_trunk(self) -> tuple[list[str], list[str], list[str], list[str]]:
        """Bones of hips, spine, neck and head, told apart where a rig calls several alike."""
        hips = list(self._take("lower_body", "") or self._take("hips", ""))
        spine = list(self._take("spine", ""))
        neck, head = self._neck_and_head()
        if (ends := [*neck, *head]) and hips:
            # What holds the hips, or nothing, is no spine (nor what is left of another rig).
            carrying = set(self.rig.ancestors(ends[0])) - set(self.rig.ancestors(hips[0]))
            spine = [name for name in spine if name in carrying] or spine
        if not neck and not head:  # Rigify: one chain called spine, from hips to head
            collar = self._attached("clavicle.L", spine) or self._attached("upperarm01.L", spine)
            if collar is not None and spine[-1] != collar:
                top = spine.index(collar) + 1
                spine, neck, head = spine[:top], spine[top:-1], spine[-1:]
        if not hips and spine and self._attached("upperleg01.L", spine) == spine[0]:
            hips, spine = spine[:1], spine[1:]
        if not hips:
            hips = self._common_ancestor("upperleg01.L", "upperleg01.R")
            spine = [name for name in spine if name not in hips]
        return hips, spine, neck, head

    def _neck_and_head(self) -> tuple[list[str], list[str]]:
        """Bones called so; of several necks that hang on each other the last one is the head."""
        neck, head = list(self._take("neck", "")), self._take("head", "")
        if len(neck) > 1 and not head and neck[-2] in self.rig.ancestors(neck[-1]):
            return neck[:-1], neck[-1:]
        return neck, head

    def _pelvis_halves(self, hips: Sequence[str]) -> None:
        """Bones between the hips and the thighs."""
        for side in "LR":
            # Daz has a hip above both a pelvis, which holds the thighs, and the spine.
            if f"pelvis.{side}" not in self.found:
                holder = self._attached(f"upperleg01.{side}", hips)
                if holder is not None and holder != hips[0]:
                    self.found[f"pelvis.{side}"] = holder

    def _spine(self, hips: Sequence[str], spine: Sequence[str], above: Sequence[str]) -> None:
        """Counterparts of the spine between the thighs, or the hips, and the bones above it."""
        thighs = [self.found.get(f"upperleg01.{side}") for side in "LR"]
        starts = [name for name in thighs if name] or hips[:1]
        if starts and above:
            low = np.mean([self.rig.head(name) for name in starts], axis=0)
            self.found |= spine_counterparts(self.rig, spine, low, self.rig.head(above[0]))
        else:
            self.found |= dict(zip(_SPINE, spine, strict=False))

    def _attached(self, canonical: str, chain: Sequence[str]) -> str | None:
        name = self.found.get(canonical)
        if name is None:
            return None
        return next((above for above in self.rig.ancestors(name) if above in chain), None)

    def _common_ancestor(self, one: str, other: str) -> list[str]:
        if one not in self.found or other not in self.found:
            return []
        above = set(self.rig.ancestors(self.found[one]))
        return [n for n in self.rig.ancestors(self.found[other]) if n in above][:1]


def spine_counterparts(rig: Rig, names: Sequence[str], low: F64, high: F64) -> dict[str, str]:
    """Counterparts of the spine's bones among a rig's, from the thighs to the neck.

    Parameters
    ----------
    names : sequence of str
        The rig's spine, hips first and without them.
    low, high : (3,) float64
        Middle of the heads of the thighs, and head of the neck, metres.
    """
    own = canonical_heads()
    own_low = (own["upperleg01.L"] + own["upperleg01.R"]) / 2
    return _chain(rig, _SPINE, own_low, own["neck01"], names, low, high)


def _chain(
    rig: Rig,
    bones: Sequence[str],
    low: F64,
    high: F64,
    names: Sequence[str],
    start: F64,
    end: F64,
) -> dict[str, str]:
    """Pair two chains in order, so that joints lie at like fractions of their lengths."""
    wanted = [_fraction(low, high, canonical_heads()[bone]) for bone in bones]
    given = [_fraction(start, end, rig.head(name)) for name in names]
    count = min(len(bones), len(names))
    pairings = (
        tuple(zip(ours, theirs, strict=True))
        for ours in combinations(range(len(bones)), count)
        for theirs in combinations(range(len(names)), count)
    )
    best = min(pairings, key=lambda pairs: sum(abs(wanted[i] - given[j]) for i, j in pairs))
    return {bones[i]: names[j] for i, j in best}


def _fraction(start: F64, end: F64, point: F64) -> float:
    """Position of a point along the line from one point (0) to another (1)."""
    line = end - start
    length_squared = float(line @ line)
    return float((point - start) @ line) / length_squared if length_squared > 0 else 0.0
