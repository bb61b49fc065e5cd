# SPDX-License-Identifier: GPL-3.0-or-later
"""From understood bone names to the canonical bones that they are counterparts of."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from .names import FINGERS, read_names
from .rig import F64, Rig, canonical_heads, canonical_parents

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


def assigned_by_name(rig: Rig) -> dict[str, str]:
    """Counterparts of canonical bones, by the names of a rig's bones.

    Returns
    -------
    dict
        Canonical bone to avatar bone; empty if no name is understood.
    """
    own = _canonical_names(rig.bones)
    if {"upperarm01.L", "upperarm01.R", "upperleg01.L", "upperleg01.R", "spine01"} <= own.keys():
        return own  # MakeHuman's default rig, with or without toes
    return _Assignment(rig).found


def _canonical_names(names: Iterable[str]) -> dict[str, str]:
    """Bones called as in the canonical skeleton (exporters may change its dots and dashes)."""

    def key(name: str) -> str:
        return re.sub(r"[\s.\-]", "_", re.split(r"[:|]", name)[-1]).lower()

    canonical = {key(name): name for name in canonical_parents()}
    return {canonical[key(name)]: name for name in names if key(name) in canonical}


class _Assignment:
    """The steps share what was read: slots by side, and what is found so far."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.names = read_names(rig.bones)
        self.slots: dict[tuple[str, str], list[str]] = {}
        for name in sorted(self.names, key=self._order):
            said = self.names[name]
            self.slots.setdefault((said.slot, said.side), []).append(name)
        self.found: dict[str, str] = {}
        for side in "LR":
            self._arm(side)
            self._leg(side)
            self._fingers(side)
            self._toes(side)
            for slot in ("breast", "eye"):
                self._put(f"{slot}.{side}", self._take(slot, side))
        self._trunk()
        self._put("jaw", self._take("jaw", ""))
        for side in "LR":
            self._split_limbs(side)

    def _order(self, name: str) -> tuple[int, list[int], str]:
        return self.rig.depth(name), [int(n) for n in self.names[name].numbers], name

    def _take(self, slot: str, side: str) -> list[str]:
        return self.slots.get((slot, side), [])

    def _put(self, canonical: str, candidates: Sequence[str]) -> None:
        if candidates:
            self.found[canonical] = candidates[0]

    def _arm(self, side: str) -> None:
        clavicle = self._take("clavicle", side)
        shoulder = self._take("shoulder", side)
        upper = self._take("upper_arm", side) or self._take("arm", side)
        if not upper:  # joints are named, not bones: shoulder, elbow, wrist
            upper, shoulder = shoulder, []
        self._put(f"clavicle.{side}", clavicle or shoulder)
        self._put(f"upperarm01.{side}", upper)
        self._put(f"lowerarm01.{side}", self._take("forearm", side))
        self._put(f"wrist.{side}", self._take("hand", side))

    def _leg(self, side: str) -> None:
        thigh, hip = self._take("thigh", side), self._take("hip", side)
        leg, shin = self._take("leg", side), self._take("shin", side)
        half = self._take("pelvis_half", side)
        if thigh:
            half = half or hip
        elif hip:
            thigh = hip
        elif shin:  # leg and knee
            thigh, leg = leg, []
        self._put(f"pelvis.{side}", half)
        self._put(f"upperleg01.{side}", thigh)
        self._put(f"lowerleg01.{side}", shin or leg)
        self._put(f"foot.{side}", self._take("foot", side))

    def _split_limbs(self, side: str) -> None:
        """Second parts of limb bones that lie in the limb and are split at about our place."""
        for first, second, after, slot in _SPLIT:
            main = self.found.get(f"{first}.{side}")
            following = self.found.get(f"{after}.{side}")
            if main is None or following is None:
                continue
            above = set(self.rig.ancestors(following))
            parts = [
                name
                for name in self._take(slot, side)[1:] + self._take(f"{slot}_twist", side)
                if name in above and main in self.rig.ancestors(name)
            ]
            own = canonical_heads()
            wanted = _fraction(*(own[f"{bone}.{side}"] for bone in (first, after, second)))
            start, end = self.rig.head(main), self.rig.head(following)
            misses = {p: abs(_fraction(start, end, self.rig.head(p)) - wanted) for p in parts}
            close = [part for part in parts if misses[part] <= _SPLIT_TOLERANCE]
            self._put(f"{second}.{side}", sorted(close, key=misses.__getitem__))

    def _fingers(self, side: str) -> None:
        joints = {finger: list(self._take(f"finger {finger}", side)) for finger in FINGERS}
        palm = {finger: self._take(f"metacarpal {finger}", side) for finger in FINGERS}
        self._numbered_fingers(side, joints)
        numbered_palm = [n for n in self._take("metacarpal", side) if self.names[n].numbers]
        for name in numbered_palm:
            number = int(self.names[name].numbers[0])
            if 1 <= number <= 4:
                palm[FINGERS[number]] = [*palm[FINGERS[number]], name]
        if not any(palm.values()):
            palm["index"] = self._take("finger_base", side)
        hand = self.found.get(f"wrist.{side}")
        for number, finger in enumerate(FINGERS, start=1):
            chain = joints[finger]
            if number > 1:
                if len(chain) > 3 and hand and not palm[finger] and self._from_wrist(hand, chain):
                    palm[finger] = chain[:1]
                if palm[finger][:1] == chain[:1]:
                    chain = chain[1:]
                self._put(f"metacarpal{number - 1}.{side}", palm[finger])
            for joint, name in enumerate(chain[:3], start=1):
                self._put(f"finger{number}-{joint}.{side}", [name])

    def _from_wrist(self, hand: str, chain: Sequence[str]) -> bool:
        """Whether the first of four joints is a metacarpal (else the last is a fingertip)."""
        wrist, first, second = (self.rig.head(name) for name in (hand, *chain[:2]))
        return bool(np.linalg.norm(first - wrist) < np.linalg.norm(second - first))

    def _numbered_fingers(self, side: str, joints: dict[str, list[str]]) -> None:
        """Fingers with a number for a name: ``Finger01`` of a Biped, ``finger1-2`` of MakeHuman."""
        bones = self._take("finger", side)
        numbers = {name: self.names[name].numbers for name in bones}
        from_zero = any(own[:1] == ("0",) for own in numbers.values())
        fingers: dict[int, list[str]] = {}
        for name, own in numbers.items():
            if own:
                digits = own[0] if from_zero or len(own) > 1 else own[0].lstrip("0")
                first = int(digits[:1] or "0") if from_zero or len(own) == 1 else int(digits)
                fingers.setdefault(first + from_zero, []).append(name)
        if joints["thumb"]:  # the numbered ones are a mitten beside a named thumb
            if bones and not joints["index"]:
                joints["index"] = bones
            return
        for number, chain in fingers.items():
            if 1 <= number <= 5 and not joints[FINGERS[number - 1]]:
                joints[FINGERS[number - 1]] = chain
        if bones and not fingers:
            joints["middle"] = joints["middle"] or bones

    def _toes(self, side: str) -> None:
        chains = {number: list(self._take(f"toe {number}", side)) for number in range(1, 6)}
        for name in self._take("small_toe", side):
            own = self.names[name].numbers
            if own and 1 <= int(own[0]) <= 4:
                chains[int(own[0]) + 1].append(name)
        general = self._take("toe", side)
        paired = [name for name in general if len(self.names[name].numbers) == 2]
        for name in paired:
            number = int(self.names[name].numbers[0])
            if number in chains:
                chains[number].append(name)
        base = [name for name in general if name not in paired]
        if not any(chains.values()):
            starts: dict[str, list[str]] = {}
            for name in base:
                starts.setdefault("".join(self.names[name].numbers)[:1], []).append(name)
            if len(starts) == 5:  # a Biped with all toes, the big one first
                chains = dict(zip(range(1, 6), (starts[k] for k in sorted(starts)), strict=True))
            else:
                # One bone for all toes lies between the first and the second.
                self._put(f"toe2-1.{side}", base)
        for number, chain in chains.items():
            for joint, name in enumerate(chain[: 2 if number == 1 else 3], start=1):
                self._put(f"toe{number}-{joint}.{side}", [name])

    def _trunk(self) -> None:
        hips, spine = list(self._take("hips", "")), list(self._take("spine", ""))
        neck, head = list(self._take("neck", "")), self._take("head", "")
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
        self._put("root", hips)
        self._put("head", head)
        for side in "LR":
            # Daz has a hip above both a pelvis, which holds the thighs, and the spine.
            if f"pelvis.{side}" not in self.found:
                holder = self._attached(f"upperleg01.{side}", hips)
                if holder is not None and holder != hips[0]:
                    self.found[f"pelvis.{side}"] = holder
        thighs = [self.found.get(f"upperleg01.{side}") for side in "LR"]
        starts = [name for name in thighs if name] or hips[:1]
        ends = neck[:1] or head[:1]
        if starts and ends:
            low = np.mean([self.rig.head(name) for name in starts], axis=0)
            self.found |= spine_counterparts(self.rig, spine, low, self.rig.head(ends[0]))
        else:
            self.found |= dict(zip(_SPINE, spine, strict=False))
        if neck and head:
            own = canonical_heads()
            ends_of_neck = self.rig.head(neck[0]), self.rig.head(head[0])
            self.found |= _chain(self.rig, _NECK, own["neck01"], own["head"], neck, *ends_of_neck)
        else:
            self._put("neck01", neck)

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
    """Where a point lies between two others, along the line through them."""
    line = end - start
    length_squared = float(line @ line)
    return float((point - start) @ line) / length_squared if length_squared > 0 else 0.0
