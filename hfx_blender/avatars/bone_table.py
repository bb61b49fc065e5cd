# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone mapping table: the user's view and correction of the mapping from joints to bones.

The table is stored on the armature object (``hfx.bone_map``, a row per canonical bone) and is
used by the next fit. The mapping can be saved as JSON, and loaded for an avatar with the same
bone names.
"""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path

import bpy

from ..engine.body.rigs.mapping import BoneMapping, from_json, map_bones, to_json, with_corrections
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
    """Test for rows that differ from the automatic mapping."""
    return any(row.bone != row.found for row in armature.hfx.bone_map)


def detected_mapping(armature: bpy.types.Object) -> BoneMapping:
    """Mapping detected from an armature's bones, their skin and VRM labels.

    Raises InputError: no human bones were recognised.
    """
    try:
        labels = human_bones_of(armature)
        return map_bones(read_bones(armature), labels, partial(skin_by_bone, armature))
    except InputError as error:
        raise InputError(f"Armature '{armature.name}': {error}") from None


def mapping_of(armature: bpy.types.Object) -> BoneMapping:
    """Mapping for the next fit: the corrected table, or the detected mapping without corrections.

    Raises InputError: the mapping is empty, names a missing bone, or assigns a bone to two joints.
    """
    if not is_corrected(armature):
        return detected_mapping(armature)
    bones = {row.name: row.bone for row in armature.hfx.bone_map if row.bone}
    _check_bones(armature, bones)
    return _mapping(armature.hfx.bone_map_convention, bones)


def fill(armature: bpy.types.Object, *, keep_corrections: bool = False) -> None:
    """Fill the table with the detected mapping; with ``keep_corrections``, corrected rows stay.

    Raises InputError: no human bones were recognised. The table is filled with the corrections
    alone.
    """
    corrections = {
        row.name: row.bone
        for row in armature.hfx.bone_map
        if keep_corrections and row.bone != row.found
    }
    try:
        detected = detected_mapping(armature)
    except InputError:
        _write(armature, BY_HAND, {}, corrections)
        raise
    _write(armature, detected.convention, detected.bones, detected.bones | corrections)


def show_mapping(
    armature: bpy.types.Object, mapping: BoneMapping, *, is_automatic: bool = False
) -> None:
    """Fill the table with a mapping. Rows unlike the detected mapping count as corrections.

    With ``is_automatic`` no row does; if no bones are recognised, all do.
    """
    try:
        detected = (mapping if is_automatic else detected_mapping(armature)).bones
    except InputError:
        detected = {}
    _write(armature, mapping.convention, detected, mapping.bones)


def refresh(armature: bpy.types.Object) -> None:
    """Update the column *follows*: the joint that moves the skin of a joint without a bone."""
    if _is_filling:
        return
    rows = armature.hfx.bone_map
    bones = {row.name: row.bone for row in rows if row.bone}
    fallbacks = _mapping("", bones).fallbacks if bones else {}
    for row in rows:
        row.follows = fallbacks.get(row.name, "")


def save(armature: bpy.types.Object, path: Path) -> int:
    """Write the mapping as JSON; return the number of bones. InputError for an invalid mapping."""
    mapping = mapping_of(armature)
    with atomic_file(path) as file:
        file.write((to_json(mapping) + "\n").encode())
    return len(mapping.bones)


def load(armature: bpy.types.Object, path: Path) -> list[str]:
    """Load a saved mapping into the table; return a note for the user if bones are missing.

    Raises InputError: the file is unreadable, is no bone mapping, or maps none of this armature's
    bones. The table is unchanged.
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
    armature_bones = armature.data.bones
    bones = {name: bone for name, bone in mapping.bones.items() if bone in armature_bones}
    missing_bones = [bone for bone in mapping.bones.values() if bone not in armature_bones]
    if not bones:
        raise InputError(
            f"{path}: it maps {len(mapping.bones)} bones, none of which '{armature.name}' has "
            f"('{missing_bones[0]}' first); it was saved for another kind of rig."
            if missing_bones
            else f"{path}: it maps no bone."
        )
    _check_bones(armature, bones)
    show_mapping(armature, _mapping(mapping.convention, bones))
    if not missing_bones:
        return []
    return [
        f"'{armature.name}' lacks {len(missing_bones)} of {len(mapping.bones)} bones of "
        f"'{path.name}' ('{missing_bones[0]}' first); those joints were left open"
    ]


def _mapping(convention: str, bones: dict[str, str]) -> BoneMapping:
    """Mapping of ``bones`` (bone by joint), with a fallback joint for each joint without a bone;
    convention "by hand" for "".
    """
    return with_corrections(BoneMapping(convention or BY_HAND, {}, {}, ()), bones)


def _check_bones(armature: bpy.types.Object, bones: dict[str, str]) -> None:
    """Raise InputError for an empty mapping, a missing bone, or a bone of several joints."""
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
    armature: bpy.types.Object, convention: str, detected: dict[str, str], bones: dict[str, str]
) -> None:
    """Replace all rows of the table, and update the column *follows* once. Joints without a bone in
    ``detected`` or ``bones`` have "".
    """
    global _is_filling
    rows = armature.hfx.bone_map
    # Each assignment to a row calls the property's update, which is refresh().
    _is_filling = True
    try:
        rows.clear()
        for name in canonical_parents():
            row = rows.add()
            row.name = name
            row.found = detected.get(name, "")
            row.bone = bones.get(name, "")
    finally:
        _is_filling = False
    armature.hfx.bone_map_convention = convention
    refresh(armature)
