# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone hierarchies of an avatar's armature and of the canonical skeleton."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Final

import numpy as np

from ...arrays import F64
from ..model import load_skeleton
from .names import is_deform, read_names, without_role

Point = tuple[float, float, float]

_FEWEST_JOINTS: Final = 10  # smallest number of bones with joint names in a body


@dataclass(frozen=True)
class RigBone:
    """Rest pose of a bone of an avatar's armature; metres, armature space."""

    name: str
    parent: str | None
    head: Point
    tail: Point
    deform: bool = True  # Blender's "Deform"; False for control bones


def upwards(parents: Mapping[str, str | None], name: str) -> Iterator[str]:
    """Yield a bone and its ancestors, nearest first; stops at a cycle."""
    bone: str | None = name
    seen: set[str] = set()
    while bone is not None and bone not in seen:
        yield bone
        seen.add(bone)
        bone = parents.get(bone)


class Rig:
    """Bones by name, and the hierarchy of deforming bones.

    The bones considered (``bones``) are the first sufficient set for a body: bones with Blender's
    "DEF-" prefix, deforming bones, all bones. A parent outside of ``bones`` is replaced by its
    counterpart: Rigify's ``DEF-thigh.L`` is a child of ``ORG-spine``, here of ``DEF-spine``.

    ``labels`` maps bone names to texts read instead; then all bones are considered, and bones
    without a label are unnamed.
    """

    def __init__(self, bones: Sequence[RigBone], labels: Mapping[str, str] | None = None) -> None:
        self.by_name = {bone.name: bone for bone in bones}
        marked = {name: bone for name, bone in self.by_name.items() if is_deform(name)}
        deform = {name: bone for name, bone in self.by_name.items() if bone.deform}
        self.bones = self.by_name
        # Control rigs double all names, so a sufficient set of deforming bones wins.
        for subset in () if labels else (marked, deform):
            if len(read_names(subset)) >= _FEWEST_JOINTS:
                self.bones = subset
                break
        self.labels = dict(labels or {name: name for name in self.bones})
        deforming = {without_role(name): name for name in self.bones}
        parents = {bone.name: bone.parent for bone in bones}
        self.parent = {
            name: self._deforming_parent(name, parents, deforming) for name in self.bones
        }
        self.children: dict[str, list[str]] = {name: [] for name in self.bones}
        for name, parent in self.parent.items():
            if parent is not None:
                self.children[parent].append(name)

    def _deforming_parent(
        self, name: str, parents: Mapping[str, str | None], deforming: Mapping[str, str]
    ) -> str | None:
        """Nearest ancestor in ``bones``, or counterpart of an ancestor; None at the top.
        ``deforming`` maps names without a Rigify role to the considered bones."""
        for above in islice(upwards(parents, name), 1, None):
            counterpart = deforming.get(without_role(above))
            if above in self.by_name and counterpart is not None and counterpart != name:
                return counterpart
        return None

    def ancestors(self, name: str) -> Iterator[str]:
        """Yield the ancestors of a bone, nearest first; stops at a cycle."""
        return islice(upwards(self.parent, name), 1, None)

    def depth(self, name: str) -> int:
        """Number of ancestors of a bone."""
        return sum(1 for _ in self.ancestors(name))

    def head(self, name: str) -> F64:
        """Head of a bone, (3,) metres, armature space."""
        return np.array(self.by_name[name].head, np.float64)

    def tail(self, name: str) -> F64:
        """Tail of a bone, (3,) metres, armature space."""
        return np.array(self.by_name[name].tail, np.float64)


@lru_cache(maxsize=1)
def canonical_parents() -> dict[str, str | None]:
    """Parent name of each canonical bone (None for roots), parents first; cached."""
    skeleton = load_skeleton()
    names = skeleton.bone_names
    return {
        name: None if parent < 0 else names[parent]
        for name, parent in zip(names, skeleton.parents.tolist(), strict=True)
    }


def canonical_heads() -> dict[str, F64]:
    """Head (3,) of each canonical bone, metres, rest space; cached."""
    return load_skeleton().heads
