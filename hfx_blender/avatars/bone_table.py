# SPDX-License-Identifier: GPL-3.0-or-later
"""Table in which a user sees and corrects the mapping from joints to an avatar's bones.

It is kept on the armature object (``hfx.bone_map``, one row for each canonical bone) and used by
the next fit; it can be saved as JSON and loaded for another avatar with the same bones.
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path

import bpy

from ..engine.body.rigs.mapping import (
    BoneMapping,
    from_json,
    map_bones,
    to_json,
    with_corrections,
)
from ..engine.body.rigs.rig import canonical_parents
from ..errors import InputError, refuse_no_file
from ..files.atomic import atomic_file
from .avatar_meshes import read_bones, skin_by_bone
from .human_bones import human_bones_of

BY_HAND = "by hand"
"""Convention of a mapping that was not found automatically."""

_LARGEST_FILE = 4_000_000

_is_filling = False


def is_corrected(armature: bpy.types.Object) -> bool:
    """Test for a table that the user changed."""
    return any(row.bone != row.found for row in armature.hfx.bone_map)


def automatic(armature: bpy.types.Object) -> BoneMapping:
    """Mapping that is found from an armature's bones.

    Raises
    ------
    InputError
        No human bones are recognisable.
    """
    try:
        labels = human_bones_of(armature)
        return map_bones(read_bones(armature), labels, partial(skin_by_bone, armature))
    except InputError as error:
        raise InputError(f"Armature '{armature.name}': {error}") from None


def mapping_of(armature: bpy.types.Object) -> BoneMapping:
    """Mapping for the next fit: the table if a user corrected it, else found anew.

    Raises
    ------
    InputError
        Nothing is mapped, a bone is not there, or one stands for two joints.
    """
    if not is_corrected(armature):
        return automatic(armature)
    bones = {row.name: row.bone for row in armature.hfx.bone_map if row.bone}
    _check_bones(armature, bones)
    return _mapping(armature.hfx.bone_map_convention, bones)


def fill(armature: bpy.types.Object, *, keep_corrections: bool = False) -> None:
    """Fill the table with the automatic mapping.

    Raises
    ------
    InputError
        No human bones are recognisable; the table is there nevertheless, to be filled by hand.
    """
    kept = {
        row.name: row.bone
        for row in armature.hfx.bone_map
        if keep_corrections and row.bone != row.found
    }
    try:
        found = automatic(armature)
    except InputError:
        _write(armature, BY_HAND, {}, kept)
        raise
    _write(armature, found.convention, found.bones, found.bones | kept)


def keep(armature: bpy.types.Object, mapping: BoneMapping, *, is_automatic: bool = False) -> None:
    """Show a mapping; what of it is not automatic, unless all is, are corrections."""
    try:
        found = (mapping if is_automatic else automatic(armature)).bones
    except InputError:
        found = {}
    _write(armature, mapping.convention, found, mapping.bones)


def refresh(armature: bpy.types.Object) -> None:
    """Update, for each joint without a bone, the bone that its skin follows."""
    if _is_filling:
        return
    rows = armature.hfx.bone_map
    bones = {row.name: row.bone for row in rows if row.bone}
    fallbacks = _mapping("", bones).fallbacks if bones else {}
    for row in rows:
        row.follows = fallbacks.get(row.name, "")


def save(armature: bpy.types.Object, path: Path) -> int:
    """Write the mapping as JSON; how many bones it maps."""
    mapping = mapping_of(armature)
    with atomic_file(path) as file:
        file.write((to_json(mapping) + "\n").encode())
    return len(mapping.bones)


def load(armature: bpy.types.Object, path: Path) -> list[str]:
    """Load a saved mapping into the table; returns notes for the user.

    Raises
    ------
    InputError
        The file cannot be read, is no bone mapping, or maps none of this armature's bones; the
        table is as it was.
    """
    refuse_no_file(path)
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise InputError(
                f"{path}: {path.stat().st_size} bytes are too many for a bone mapping."
            )
        mapping = from_json(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: is no bone mapping (not a JSON text).") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    there = armature.data.bones
    bones = {name: bone for name, bone in mapping.bones.items() if bone in there}
    absent = [bone for bone in mapping.bones.values() if bone not in there]
    if not bones:
        raise InputError(
            f"{path}: it maps {len(mapping.bones)} bones, none of which '{armature.name}' has "
            f"('{absent[0]}' first); it was saved for another kind of rig."
            if absent
            else f"{path}: it maps no bone."
        )
    _check_bones(armature, bones)
    keep(armature, _mapping(mapping.convention, bones))
    if not absent:
        return []
    return [
        f"'{armature.name}' lacks {len(absent)} of {len(mapping.bones)} bones of '{path.name}' "
        f"('{absent[0]}' first); those joints were left open"
    ]


def _mapping(convention: str, bones: dict[str, str]) -> BoneMapping:
    return with_corrections(BoneMapping(convention or BY_HAND, {}, {}, ()), bones)


def _check_bones(armature: bpy.types.Object, bones: dict[str, str]) -> None:
    if not bones:
        raise InputError(
            f"Armature '{armature.name}': no bone is assigned in its table; find or assign them "
            "first."
        )
    for joint, bone in bones.items():
        if bone not in armature.data.bones:
            raise InputError(
                f"Armature '{armature.name}': its table gives '{bone}' for '{joint}', but there is "
                "no bone of that name (any more); correct that row, or find the bones again."
            )
    bone, count = Counter(bones.values()).most_common(1)[0]
    if count > 1:
        joints = [f"'{joint}'" for joint, name in bones.items() if name == bone]
        raise InputError(
            f"Armature '{armature.name}': bone '{bone}' is given for {count} joints "
            f"({' and '.join(joints[:3])}); it can stand for one only."
        )


def _write(
    armature: bpy.types.Object, convention: str, found: dict[str, str], bones: dict[str, str]
) -> None:
    global _is_filling
    rows = armature.hfx.bone_map
    _is_filling = True
    try:
        rows.clear()
        for name in canonical_parents():
            row = rows.add()
            row.name = name
            row.found = found.get(name, "")
            row.bone = bones.get(name, "")
    finally:
        _is_filling = False
    armature.hfx.bone_map_convention = convention
    refresh(armature)
