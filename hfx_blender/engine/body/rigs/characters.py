# SPDX-License-Identifier: GPL-3.0-or-later
"""Detection of several characters, or additional heads and limbs, in one armature."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ....errors import InputError
from .assignment import assigned_by_name, is_human
from .digits import Digits
from .rig import Rig

# Distance between equal joints of separate bodies, as a fraction of the body's extent
_APART: Final = 0.1
# Slot of an end of the body to its canonical bone
_ENDS: Final = {"head": "head", "hand": "wrist", "foot": "foot"}


def check_single(rig: Rig) -> None:
    """Reject an armature with two human bodies at different places; returns nothing.

    Control rigs or duplicate bones at the same place count as one body. Raises InputError: equal
    joints of two human branches are, by the median, over a tenth of the body apart.
    """
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


def doubled_ends(rig: Rig, bones_of: Mapping[str, str]) -> list[str]:
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
        joints = _joints_below(rig, top)
        if is_human(joints):
            below = list(_bodies(rig, rig.children[top]))
            yield from below if len(below) > 1 else [(top, joints)]


def _joints_below(rig: Rig, top: str) -> dict[str, str]:
    """Avatar bone by canonical bone, found by name in the branch from bone ``top`` down, control
    bones included."""
    names, waiting = [], [top]
    while waiting:
        names.append(waiting.pop())
        waiting += rig.children[names[-1]]
    bones = [replace(rig.by_name[name], parent=rig.parent[name], deform=True) for name in names]
    return assigned_by_name(Rig(bones))
