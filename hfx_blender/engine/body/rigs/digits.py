# SPDX-License-Identifier: GPL-3.0-or-later
"""Assignment of fingers and toes by bone names."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from .names import read_names
from .rig import Rig, canonical_heads
from .sides import with_sides
from .vocabulary import FINGERS


class Digits:
    """Recognised bones of a rig by (slot, side), and canonical bones assigned so far (``found``).
    Lists in ``slots`` are sorted by rank, depth, numbers and name."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        read = read_names(rig.labels.values())
        named = {name: read[label] for name, label in rig.labels.items() if label in read}
        self.names = with_sides(rig, named)
        self.slots: dict[tuple[str, str], list[str]] = {}
        for name in sorted(self.names, key=self._order):
            parsed = self.names[name]
            self.slots.setdefault((parsed.slot, parsed.side), []).append(name)
        self.found: dict[str, str] = {}

    def _order(self, name: str) -> tuple[int, int, list[int], str]:
        """Sort key of a bone: rank, number of ancestors, numbers in the name, name."""
        parsed = self.names[name]
        return parsed.rank, self.rig.depth(name), [int(n) for n in parsed.numbers], name

    def _take(self, slot: str, side: str) -> list[str]:
        """Bones of a slot and side, best first; empty without any."""
        return self.slots.get((slot, side), [])

    def _put(self, canonical: str, candidates: Sequence[str]) -> None:
        """Assign the first candidate, if any, to a canonical bone."""
        if candidates:
            self.found[canonical] = candidates[0]

    def _fingers(self, side: str) -> None:
        """Assign metacarpals and up to three joints of each finger of side "L" or "R". A fourth
        bone is the metacarpal if it begins near the wrist, else the tip; a thumb without base
        starts at joint 2."""
        joints = {finger: self._joints(self._take(f"finger {finger}", side)) for finger in FINGERS}
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
                # Four bones: metacarpal and three joints, or three joints and a fingertip.
                # A first bone that begins nearer to the wrist than to the second is a metacarpal.
                if len(chain) > 3 and hand and not palm[finger]:
                    wrist, first, second = (self.rig.head(name) for name in (hand, *chain[:2]))
                    if np.linalg.norm(first - wrist) < np.linalg.norm(second - first):
                        palm[finger] = chain[:1]
                if palm[finger][:1] == chain[:1]:
                    chain = chain[1:]
                self._put(f"metacarpal{number - 1}.{side}", palm[finger])
            start = 2 if number == 1 and self._is_thumb_without_base(hand, chain, joints) else 1
            for joint, name in enumerate(chain[:3], start=start):
                self._put(f"finger{number}-{joint}.{side}", [name])

    def _joints(self, bones: Sequence[str]) -> list[str]:
        """Bones of a finger from hand to tip, of equal numbers in the name the first; all bones if
        none has numbers. ``bones`` are in order of rank."""
        by_number = {self.names[name].numbers: name for name in reversed(bones)}
        return self._outwards([*by_number.values()] if any(by_number) else bones)

    def _outwards(self, chain: Sequence[str]) -> list[str]:
        """Sort the joints of a digit from the hand to the tip: by depth, numbers, then name."""
        return sorted(chain, key=lambda name: self._order(name)[1:])

    def _is_thumb_without_base(
        self, hand: str | None, chain: Sequence[str], joints: dict[str, list[str]]
    ) -> bool:
        """True if a thumb of two bones begins at the knuckle, as in MikuMikuDance. Compares the
        distance from the wrist, relative to the index finger, with the canonical hand."""
        if hand is None or len(chain) != 2 or not joints["index"]:
            return False
        wrist, thumb, index = (self.rig.head(n) for n in (hand, chain[0], joints["index"][-1]))
        canonical = canonical_heads()
        shares = [
            np.linalg.norm(canonical[f"finger1-{joint}.L"] - canonical["wrist.L"])
            / np.linalg.norm(
                canonical[f"finger2-{min(3, len(joints['index']))}.L"] - canonical["wrist.L"]
            )
            for joint in (1, 2)
        ]
        reach = float(np.linalg.norm(index - wrist))
        share = float(np.linalg.norm(thumb - wrist)) / reach if reach > 0.0 else 0.0
        return bool(abs(share - shares[1]) < abs(share - shares[0]))

    def _numbered_fingers(self, side: str, joints: dict[str, list[str]]) -> None:
        """Add bones with a number instead of a finger name to ``joints`` (bones by finger), in
        place: ``Finger01`` of a Biped, ``finger1-2`` of MakeHuman. Next to a named thumb, or
        without usable numbers, all become a single finger."""
        bones = self._take("finger", side)
        numbers = {name: self.names[name].numbers for name in bones}
        fingers = _by_finger(numbers)
        # Fingers by number only: with a named thumb, the numbers start at the index finger.
        if joints["thumb"] and not joints["index"] and len(fingers) > 1:
            # mGear: "thumb_L0_1", then "finger_L0_1" of the index finger and so on.
            if all(len(own) == 2 for own in numbers.values()):
                for finger, number in zip(FINGERS[1:], sorted(fingers), strict=False):
                    joints[finger] = self._outwards(fingers[number])
                return
        if joints["thumb"]:  # numbered bones next to a named thumb are a mitten
            mitten_finger = "middle" if joints["index"] else "index"
            joints[mitten_finger] = joints[mitten_finger] or bones
            return
        for number, finger in enumerate(FINGERS, start=1):
            if not joints[finger]:
                chain = fingers.get(number, [])
                # "finger 1a" and "finger 1b" are one finger if chained, from hand to tip.
                if all(len(numbers[name]) == len(numbers[name][0]) == 1 for name in chain):
                    chain = self._outwards(chain)
                    if not all(a in self.rig.ancestors(name) for a, name in pairwise(chain)):
                        chain = []
                joints[finger] = chain
        if not fingers:
            joints["middle"] = joints["middle"] or bones

    def _toes(self, side: str) -> None:
        """Assign toe joints of side "L" or "R", at most 3 of a toe, 2 of the big one; a single toe
        bone becomes the second toe's first joint."""
        chains = {number: list(self._take(f"toe {number}", side)) for number in range(1, 6)}
        for name in self._take("small_toe", side):
            own = self.names[name].numbers
            if own and 1 <= int(own[0]) <= 4:
                chains[int(own[0]) + 1].append(name)
        base = self._ball_of_foot(side, self._numbered_toes(side, chains))
        if not any(chains.values()):
            starts: dict[str, list[str]] = {}
            for name in base:
                starts.setdefault("".join(self.names[name].numbers)[:1], []).append(name)
            if len(starts) == 5:  # a Biped with all toes, the big one first
                chains = dict(zip(range(1, 6), (starts[k] for k in sorted(starts)), strict=True))
            else:
                # A single toe bone stands for the second toe, the middle of the weights.
                self._put(f"toe2-1.{side}", base)
        for number, chain in chains.items():
            for joint, name in enumerate(chain[: 2 if number == 1 else 3], start=1):
                self._put(f"toe{number}-{joint}.{side}", [name])

    def _numbered_toes(self, side: str, chains: dict[int, list[str]]) -> list[str]:
        """Add bones of slot "toe" with two numbers, toe and joint, to ``chains`` (toe 1 to 5), in
        place; toes counted from 0 are shifted. Returns the remaining bones of the slot: all if
        every toe number is 0, a single toe bone."""
        general = self._take("toe", side)
        paired = [name for name in general if len(self.names[name].numbers) == 2]
        firsts = {int(self.names[name].numbers[0]) for name in paired}
        if firsts == {0}:
            return general
        for name in paired:
            number = int(self.names[name].numbers[0]) + (0 in firsts)
            if number in chains:
                chains[number].append(name)
        return [name for name in general if name not in paired]

    def _ball_of_foot(self, side: str, toes: list[str]) -> list[str]:
        """Bones at the ball of the foot: the second of two chained feet if nearer to the toes, else
        ``toes``; in MikuMikuDance rigs only skinned ones."""
        if self._take("lower_body", ""):  # in MikuMikuDance, "toe" is the tip of the toes
            # Rank below 0: the bone carries the skin.
            toes = [name for name in toes if self.names[name].rank < 0]
        feet = self._take("foot", side)
        # Two foot bones in a chain: the second begins at the ball if nearer to the toes.
        if len(feet) > 1 and feet[0] in self.rig.ancestors(feet[1]):
            ankle, ball = (self.rig.head(name) for name in feet[:2])
            tip = self.rig.head(toes[0]) if toes else ball
            if np.linalg.norm(ball - ankle) >= np.linalg.norm(tip - ball):
                return feet[1:2]  # SMPL: the joint "foot" is the ball of the foot
        return toes


def _by_finger(numbers: Mapping[str, Sequence[str]]) -> dict[int, list[str]]:
    """Bones by finger number (from 1), from the numbers in their names; without any, left out.
    Fingers counted from 0 are shifted; of a two-digit number the first digit is the finger."""
    from_zero = any(parts[:1] in (("0",), ("00",)) for parts in numbers.values())
    fingers: dict[int, list[str]] = {}
    for name, parts in numbers.items():
        if parts:
            digits = parts[0] if from_zero or len(parts) > 1 else parts[0].lstrip("0")
            first = int(digits[:1] or "0") if from_zero or len(parts) == 1 else int(digits)
            fingers.setdefault(first + from_zero, []).append(name)
    return fingers
