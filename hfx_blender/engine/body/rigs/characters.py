# SPDX-License-Identifier: GPL-3.0-or-later
"""Detection of several characters in one armature, and of further heads and limbs of one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ....errors import InputError
from .assignment import assigned_by_name, is_human
from .digits import Digits
from .rig import Rig

_APART: Final = 0.1
"""Distance of like joints, as a share of the body's extent, from which two bodies are two."""

_ENDS: Final = {"head": "head", "hand": "wrist", "foot": "foot"}
"""Ends of a body: what their names say, and the canonical bone."""


def check_single(rig: Rig) -> None:
    """Refuse an armature in which two bodies stand at different places.

    A control rig, or a second set of bones, at the same place is one body.

    Raises
    ------
    InputError
        Two branches of the hierarchy are each a whole human, and lie apart.
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


def doubled_ends(rig: Rig, found: Mapping[str, str]) -> list[str]:
    """Name a body's second heads, further hands and feet, which are not felt."""
    extent = float(np.ptp([rig.head(name) for name in found.values()], axis=0).max())
    others = []
    for (slot, side), names in Digits(rig).slots.items():
        own = found.get(f"{_ENDS.get(slot)}{side and '.'}{side}")
        if own is None:
            continue
        for name in names:
            way = rig.head(name) - rig.head(own)
            is_in_chain = own in rig.ancestors(name) or name in (own, *rig.ancestors(own))
            if not is_in_chain and np.linalg.norm(way) > _APART * extent:
                others.append(f"'{name}'")
    found_more = " and ".join(others)
    return [f"Further heads or limbs ({found_more}) are not felt."] if others else []


def _bodies(rig: Rig, tops: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield top bone and joints of each branch that is a human, and does not hold several."""
    for top in tops:
        found = _joints_below(rig, top)
        if is_human(found):
            below = list(_bodies(rig, rig.children[top]))
            yield from below if len(below) > 1 else [(top, found)]


def _joints_below(rig: Rig, top: str) -> dict[str, str]:
    names, waiting = [], [top]
    while waiting:
        names.append(waiting.pop())
        waiting += rig.children[names[-1]]
    bones = [replace(rig.by_name[name], parent=rig.parent[name], deform=True) for name in names]
    return assigned_by_name(Rig(bones))
