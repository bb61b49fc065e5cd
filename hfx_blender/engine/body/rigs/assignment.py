# SPDX-License-Identifier: GPL-3.0-or-later
"""Assignment of a rig's bones to canonical bones by their names."""

import re
from collections.abc import Mapping, Sequence
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
_SPLIT_TOLERANCE: Final = 0.15  # largest offset of a limb's split, fraction of its length
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
_TRIED: Final = 4  # candidates per joint
_MAIN: Final = frozenset(
    ["head"]
    + [
        f"{bone}.{side}"
        for side in "LR"
        for bone in ("upperarm01", "lowerarm01", "wrist", "upperleg01", "lowerleg01", "foot")
    ]
)


def assigned_by_name(rig: Rig) -> dict[str, str]:
    """Avatar bone of each canonical bone recognised by name; empty if none is. Canonical names
    decide for MakeHuman's default rig, parsed words otherwise."""
    # Names equal to a canonical name apart from case, dots, dashes, spaces and namespace.
    canonical = {_plain(name): name for name in canonical_parents()}
    exact = {canonical[_plain(name)]: name for name in rig.bones if _plain(name) in canonical}
    parsed = _Assignment(rig).found
    if {"upperarm01.L", "upperarm01.R", "upperleg01.L", "upperleg01.R", "spine01"} <= exact.keys():
        # MakeHuman's default rig, unless only remnants of that rig are in another rig.
        if _MAIN.intersection(exact) >= _MAIN.intersection(parsed):
            return exact
    return parsed


def _plain(name: str) -> str:
    """Lower-case name without namespace; dots, dashes and spaces as underscores."""
    return re.sub(r"[\s.\-]", "_", re.split(r"[:|]", name)[-1]).lower()


def is_human(bone_of: Mapping[str, str]) -> bool:
    """True if canonical bones include the root or a spine bone, and upper and lower part of both
    arms or both legs."""
    has_trunk = "root" in bone_of or any(name.startswith("spine") for name in bone_of)
    return has_trunk and any(
        all(f"{bone}.{side}" in bone_of for bone in limb for side in "LR") for limb in (_ARM, _LEG)
    )


class _Assignment(Digits):
    """Assignment of a whole rig: limbs, digits, trunk, in this order. ``slots`` lists bones by
    (slot, side), ``found`` maps canonical bones to avatar bones."""

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
        """Assign clavicle, upper arm, forearm and hand of side "L" or "R", as far as recognised."""
        clavicle, shoulder = self._take("clavicle", side), self._take("shoulder", side)
        arm = self._take("arm", side)
        fore = self._take("forearm", side)
        palm = [name for name in self._take("metacarpal", side) if not self.names[name].numbers]
        hand = self._take("hand", side) or (palm if len(palm) == 1 else [])
        upper = self._either(self._take("upper_arm", side), arm)
        # Numbered limbs: "Arm1", "Arm2"; a third bone is a forearm below a collar bone.
        if not fore:
            chain = self._hanging(upper)
            upper, fore, hand, rest = self._numbered(upper, fore, hand)
            if len(chain) > 3 or (rest and (clavicle or shoulder)):
                fore = self._nearest_to(f"lowerarm01.{side}", chain, hand)
            elif rest:
                clavicle, upper, fore = upper, fore, rest
        if not upper and not clavicle:  # "Shoulder1" is the collar bone, "Shoulder2" the arm
            first, second, _, _ = self._numbered(shoulder, [], [])
            clavicle, shoulder = (first, second) if second else ([], shoulder)
        # Some rigs name joints (shoulder, elbow, wrist): the shoulder then is the upper arm.
        upper = [*upper, *shoulder]
        bones = ("upperarm01", "lowerarm01", "wrist")
        self._put_chain(side, bones, (upper, fore, hand))
        upper_name = self.found.get(f"upperarm01.{side}")
        self._put(f"clavicle.{side}", clavicle or [name for name in shoulder if name != upper_name])

    def _leg(self, side: str) -> None:
        """Assign half of the pelvis, thigh, shin and foot of side "L" or "R", if recognised."""
        hip, leg = self._take("hip", side), self._take("leg", side)
        thigh, shin = self._take("thigh", side), self._take("shin", side)
        foot = self._take("foot", side)
        below = self._either(shin, leg)
        if not thigh and not hip and shin:  # with a "knee", "leg" is the thigh
            thigh, below = leg, shin
        elif not thigh and not shin and len(leg) > 1:  # "Leg1", "Leg2", perhaps "Leg3"
            chain = self._hanging(leg)
            thigh, below, last, toe = self._numbered(leg, [], foot)
            if foot and len(chain) > 2:
                # A "foot" more than 37 degrees off the line down the leg is the ball of the foot:
                # the last leg bone then is the ankle.
                down = self.rig.head(chain[-1]) - self.rig.head(chain[0])
                to_foot = self.rig.head(foot[0]) - self.rig.head(chain[-1])
                if to_foot @ down < _STRAIGHT * np.linalg.norm(to_foot) * np.linalg.norm(down):
                    self.slots.setdefault(("toe", side), foot)
                    last, chain = chain[-1:], chain[:-1]
                below = self._nearest_to(f"lowerleg01.{side}", chain, last)
            if not foot:
                self.slots.setdefault(("toe", side), toe)
            foot = last
        thigh = [*thigh, *hip]
        self._put_chain(side, ("upperleg01", "lowerleg01", "foot"), (thigh, below, foot))
        thigh_name = self.found.get(f"upperleg01.{side}")
        # A hip bone above the thigh carries half of the pelvis.
        half = self._take("pelvis_half", side) or [name for name in hip if name != thigh_name]
        self._put(f"pelvis.{side}", half)

    def _numbered(
        self, first: list[str], second: list[str], third: list[str]
    ) -> tuple[list[str], list[str], list[str], list[str]]:
        """Split numbered bones into the joints of a limb: first, second, third, remainder. The
        remainder are toes, or the last of three bones above a hand. Unchanged without a chain."""
        chain = self._hanging(first)
        if len(chain) < 2:
            return first, second, third, []
        return chain[:1], chain[1:2], third or chain[2:3], chain[2:3] if third else chain[3:4]

    def _hanging(self, names: Sequence[str]) -> list[str]:
        """Chain from the first name on: each next name below the previous name of the chain, others
        skipped; empty for none."""
        chain = list(names[:1])
        for name in names[1:]:
            if chain[-1] in self.rig.ancestors(name):
                chain.append(name)
        return chain

    def _nearest_to(self, joint: str, chain: Sequence[str], end: Sequence[str]) -> list[str]:
        """Bone with its head nearest to a canonical elbow or knee, as a list of length one.
        Compares fractions of the length from the chain's first head to the head of ``end``."""
        first, last = _ENDS[joint[:-2]]
        canonical, ends = canonical_heads(), (self.rig.head(chain[0]), self.rig.head(end[0]))
        side = joint[-2:]
        target = _fraction(canonical[first + side], canonical[last + side], canonical[joint])
        return [min(chain[1:], key=lambda n: abs(_fraction(*ends, self.rig.head(n)) - target))]

    def _either(self, clear: list[str], doubtful: list[str]) -> list[str]:
        """Clear candidates followed by doubtful ones; only the clear ones if the first names the
        skinned bone."""
        marked = bool(clear) and self.names[clear[0]].rank < 0
        return clear if marked else [*clear, *doubtful]

    def _put_chain(
        self, side: str, bones: Sequence[str], candidates: Sequence[Sequence[str]]
    ) -> None:
        """Assign the combination of candidates with most ancestor links, the first of equals, to
        the bones of a limb; at most four candidates per joint, joints without any skipped. Remnants
        of a second rig do not form a chain with the limb."""
        given = [(bone, names) for bone, names in zip(bones, candidates, strict=True) if names]
        choices = product(*(names[:_TRIED] for _, names in given))
        best = max(  # the first of equal combinations
            choices,
            key=lambda chain: sum(a in self.rig.ancestors(name) for a, name in pairwise(chain)),
        )
        self.found |= {f"{bone}.{side}": name for (bone, _), name in zip(given, best, strict=True)}

    def _complete(self) -> None:
        """Assign to a missing elbow, wrist, knee or ankle the only child of the bone above, if it
        has no recognised name and another place; only if both sides then have the joint."""
        for above, below in _NEXT:
            added = {}
            for side in "LR":
                name = self.found.get(f"{above}.{side}")
                children = [] if name is None else self.rig.children[name]
                if f"{below}.{side}" not in self.found and len(children) == 1 and name is not None:
                    offset = self.rig.head(children[0]) - self.rig.head(name)
                    if children[0] not in self.names and np.linalg.norm(offset) > 0.0:
                        added[f"{below}.{side}"] = children[0]
            # A joint of one side alone would be a guess.
            if all(f"{below}.{side}" in {**self.found, **added} for side in "LR"):
                self.found |= added

    def _split_limbs(self, side: str) -> None:
        """Assign second parts of limb bones, if split within 15 % of the limb of the canonical
        place, nearest first; an early twist bone becomes the first part."""
        for first, second, after, slot in _SPLIT:
            main = self.found.get(f"{first}.{side}")
            following = self.found.get(f"{after}.{side}")
            if main is None or following is None:
                continue
            twists = self._take(f"{slot}_twist", side)
            start, end = self.rig.head(main), self.rig.head(following)
            if twists:
                # Auto-Rig Pro: a twist bone that begins clearly (30 %) farther from the limb's end
                # than the main bone is the first half of the limb.
                length, own = (np.linalg.norm(at - end) for at in (self.rig.head(twists[0]), start))
                if length > (1.0 + 2.0 * _SPLIT_TOLERANCE) * own:
                    self.found |= {f"{first}.{side}": twists[0], f"{second}.{side}": main}
                    continue
            ancestors = set(self.rig.ancestors(following))
            counted = self._take("arm" if slot in ("upper_arm", "forearm") else "leg", side)
            parts_named = self._take(slot, side)[1:] + self._take(f"{slot}_twist", side)
            # Candidates lie between the limb's bone and its next joint.
            parts = [
                name
                for name in (*parts_named, *counted)
                if name in ancestors and main in self.rig.ancestors(name)
            ]
            canonical = canonical_heads()
            target = _fraction(*(canonical[f"{bone}.{side}"] for bone in (first, after, second)))
            misses = {p: abs(_fraction(start, end, self.rig.head(p)) - target) for p in parts}
            matching = [part for part in parts if misses[part] <= _SPLIT_TOLERANCE]
            self._put(f"{second}.{side}", sorted(matching, key=misses.__getitem__))

    def _trunk(self) -> None:
        """Assign root, pelvis halves, spine, neck and head, as far as known. Spine and several neck
        bones are matched by position; a spine without thighs and hips, or without neck and head
        above, in order from the hips up."""
        hips, spine, neck, head = self._parts_of_trunk()
        self._put("root", hips)
        self._put("head", head)
        for side in "LR":
            # Daz: the hip has two children, the spine and a pelvis with both thighs.
            holder = self._attached(f"upperleg01.{side}", hips)
            if f"pelvis.{side}" not in self.found and holder is not None and holder != hips[0]:
                self.found[f"pelvis.{side}"] = holder
        thighs = [self.found.get(f"upperleg01.{side}") for side in "LR"]
        starts, above = [name for name in thighs if name] or hips[:1], [*neck, *head]
        if starts and above:
            low = np.mean([self.rig.head(name) for name in starts], axis=0)
            self.found |= spine_counterparts(self.rig, spine, low, self.rig.head(above[0]))
        else:
            self.found |= dict(zip(_SPINE, spine, strict=False))
        if neck and head:
            canonical = canonical_heads()
            ends_of_neck = self.rig.head(neck[0]), self.rig.head(head[0])
            self.found |= _chain(
                self.rig, _NECK, canonical["neck01"], canonical["head"], neck, *ends_of_neck
            )
        else:
            self._put("neck01", neck)

    def _parts_of_trunk(self) -> tuple[list[str], list[str], list[str], list[str]]:
        """Bones of hips, spine, neck and head, from the hips up, any may be empty; divided where a
        rig uses one name for several."""
        hips = list(self._take("lower_body", "") or self._take("hips", ""))
        spine = list(self._take("spine", ""))
        neck, head = self._neck_and_head()
        ends = [*neck, *head]
        if ends and hips:
            # The spine lies between the hips and the neck: excludes bones above the hips and
            # remnants of other rigs.
            carrying = set(self.rig.ancestors(ends[0])) - set(self.rig.ancestors(hips[0]))
            spine = [name for name in spine if name in carrying] or spine
        # One chain from hips to head is divided at the bone that carries the arms.
        if not ends:  # Rigify: one chain called spine, from hips to head
            collar = self._attached("clavicle.L", spine) or self._attached("upperarm01.L", spine)
            if collar and collar != spine[-1]:
                top = spine.index(collar) + 1
                spine, neck, head = spine[:top], spine[top:-1], spine[-1:]
        if not hips and spine[:1] == [self._attached("upperleg01.L", spine)]:
            hips, spine = spine[:1], spine[1:]
        if not hips:
            # Unnamed hips: the nearest bone above both thighs, so no part of the spine.
            thighs = [self.found.get(f"upperleg01.{side}", "") for side in "LR"]
            left, right = ([*self.rig.ancestors(name)] for name in thighs)
            hips = [name for name in right if name in left][:1]
            spine = [name for name in spine if name not in hips]
        return hips, spine, neck, head

    def _neck_and_head(self) -> tuple[list[str], list[str]]:
        """Neck and head by name; without a head, the last of several chained necks is the head."""
        neck, head = list(self._take("neck", "")), self._take("head", "")
        if len(neck) > 1 and not head and neck[-2] in self.rig.ancestors(neck[-1]):
            return neck[:-1], neck[-1:]
        return neck, head

    def _attached(self, canonical: str, chain: Sequence[str]) -> str | None:
        """Nearest ancestor, in ``chain``, of the bone assigned to ``canonical``; or None."""
        name = self.found.get(canonical)
        if name is None:
            return None
        return next((above for above in self.rig.ancestors(name) if above in chain), None)


def spine_counterparts(rig: Rig, names: Sequence[str], low: F64, high: F64) -> dict[str, str]:
    """Avatar bone of each canonical spine bone with one, from thighs to neck, by relative height.
    ``names`` is the rig's spine from the hips up, without hips; ``low`` (3,) the middle of the
    thighs' heads and ``high`` (3,) the head of the neck, metres."""
    canonical = canonical_heads()
    own_low = (canonical["upperleg01.L"] + canonical["upperleg01.R"]) / 2
    return _chain(rig, _SPINE, own_low, canonical["neck01"], names, low, high)


def _chain(
    rig: Rig, bones: Sequence[str], low: F64, high: F64, names: Sequence[str], start: F64, end: F64
) -> dict[str, str]:
    """Avatar bone of canonical bones: order-preserving pairs of ``bones`` and ``names``, as many as
    the shorter has, with the least total difference of relative positions (0 at the start, 1 at the
    end). ``low`` and ``high`` (3,) are the ends of the canonical chain, ``start`` and ``end`` (3,)
    of the avatar's."""
    targets = [_fraction(low, high, canonical_heads()[bone]) for bone in bones]
    fractions = [_fraction(start, end, rig.head(name)) for name in names]
    # Exhaustive: at most five bones against the joints of a spine or neck.
    count = min(len(bones), len(names))
    pairings = (
        tuple(zip(own_indices, rig_indices, strict=True))
        for own_indices in combinations(range(len(bones)), count)
        for rig_indices in combinations(range(len(names)), count)
    )
    pairs_of_least_error = min(
        pairings, key=lambda pairs: sum(abs(targets[i] - fractions[j]) for i, j in pairs)
    )
    return {bones[i]: names[j] for i, j in pairs_of_least_error}


def _fraction(start: F64, end: F64, point: F64) -> float:
    """Position of a point projected on a line: 0 at ``start``, 1 at ``end``; 0 for length 0."""
    line = end - start
    length_squared = float(line @ line)
    return float((point - start) @ line) / length_squared if length_squared > 0 else 0.0
