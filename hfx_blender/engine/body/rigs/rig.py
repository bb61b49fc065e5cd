# SPDX-License-Identifier: GPL-3.0-or-later
"""The bones of an avatar's armature as a hierarchy, and those of the canonical skeleton."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from ...arrays import F64
from ..model import load_skeleton
from .names import is_deform, read_names, without_role

Point = tuple[float, float, float]

_ENOUGH: Final = 10
"""Bones with a joint's name that a body has at least."""


@dataclass(frozen=True)
class RigBone:
    """Bone of an avatar's armature in rest pose; metres, armature space."""

    name: str
    parent: str | None
    head: Point
    tail: Point
    deform: bool = True  # whether skin may hang on it; controls do not


class Rig:
    """Bones by name, with the hierarchy of those that deform.

    Where bones carry Blender's "DEF-" mark only they count, else those that are said to deform, if
    they are enough for a body. A parent that does not deform stands for the bone that deforms in
    its place (Rigify hangs ``DEF-thigh.L`` on ``ORG-spine``).

    Parameters
    ----------
    labels : mapping, optional
        What to read instead of the names: bone to label. Bones without one are read as nothing.
    """

    def __init__(self, bones: Sequence[RigBone], labels: Mapping[str, str] | None = None) -> None:
        every = {bone.name: bone for bone in bones}
        marked = {name: bone for name, bone in every.items() if is_deform(name)}
        self.by_name = every
        deform = {name: bone for name, bone in every.items() if bone.deform}
        choices = () if labels else (marked, deform)
        self.bones = next((some for some in choices if len(read_names(some)) >= _ENOUGH), every)
        self.labels = dict(labels or {name: name for name in self.bones})
        deforming = {without_role(name): name for name in self.bones}
        self.parent = {name: self._deforming_parent(name, deforming) for name in self.bones}
        self.children: dict[str, list[str]] = {name: [] for name in self.bones}
        for name, parent in self.parent.items():
            if parent is not None:
                self.children[parent].append(name)

    def _deforming_parent(self, name: str, deforming: Mapping[str, str]) -> str | None:
        """Nearest bone above one that deforms, or whose counterpart does; None at the top.

        ``deforming`` holds the bones that do by their names without a rig's marks.
        """
        above = self.by_name[name].parent
        seen = {name}
        while above is not None and above in self.by_name and above not in seen:
            seen.add(above)
            counterpart = deforming.get(without_role(above))
            if counterpart is not None and counterpart != name:
                return counterpart
            above = self.by_name[above].parent
        return None

    def ancestors(self, name: str) -> Iterator[str]:
        """Yield the ancestors of a bone, nearest first."""
        seen = {name}
        above = self.parent[name]
        while above is not None and above not in seen:
            seen.add(above)
            yield above
            above = self.parent[above]

    def depth(self, name: str) -> int:
        """Number of ancestors of a bone."""
        return sum(1 for _ in self.ancestors(name))

    def head(self, name: str) -> F64:
        """Start of a bone, (3,) metres."""
        return np.array(self.by_name[name].head, np.float64)

    def tail(self, name: str) -> F64:
        """End of a bone, (3,) metres."""
        return np.array(self.by_name[name].tail, np.float64)


@lru_cache(maxsize=1)
def canonical_parents() -> dict[str, str | None]:
    """Parent of each canonical bone, parents before children."""
    skeleton = load_skeleton()
    names = skeleton.bone_names
    return {
        name: None if parent < 0 else names[parent]
        for name, parent in zip(names, skeleton.parents.tolist(), strict=True)
    }


@lru_cache(maxsize=1)
def canonical_heads() -> dict[str, F64]:
    """Head of each canonical bone, (3,) metres in rest space."""
    skeleton = load_skeleton()
    heads = skeleton.rest[:, :3, 3].astype(np.float64)
    return dict(zip(skeleton.bone_names, heads, strict=True))
