# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone mapping of an armature: detection, with VRM labels, and the user's table of corrections.

The table is stored on the armature object (``hfx.bone_map``, a row per canonical bone) and is used
by the next fit. The mapping can be saved as JSON, and loaded for an avatar of the same bone names.
"""

import json
import re
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any, Final

import bpy

from ..blender import compat
from ..engine.body.rigs.mapping import BoneMapping, from_json, map_bones, to_json, with_corrections
from ..engine.body.rigs.rig import canonical_parents
from ..errors import InputError
from ..files.atomic import atomic_file
from ..files.strict_json import read_bytes
from .avatar_meshes import read_bones, skin_by_bone

BY_HAND = "by hand"  # convention of a mapping that was not found automatically
_LARGEST_FILE = 4 << 20  # bytes

_ADD_ON: Final = "vrm_addon_extension"
_EXTENSIONS: Final = ("VRMC_vrm", "VRM")
_FEWEST: Final = 8  # bones from which a table says something
_HUMAN_BONE: Final = re.compile(
    r"hips|spine|chest|upperchest|neck|head|jaw"
    r"|(left|right)(eye|shoulder|upperarm|lowerarm|hand|upperleg|lowerleg|foot|toes"
    r"|thumb(metacarpal|proximal|intermediate|distal)"
    r"|(index|middle|ring|little)(proximal|intermediate|distal))"
)

_is_filling = False


def is_corrected(armature: bpy.types.Object) -> bool:
    """Test for rows that differ from the automatic mapping."""
    return any(row.bone != row.found for row in armature.hfx.bone_map)


def detected_mapping(armature: bpy.types.Object) -> BoneMapping:
    """Mapping detected from an armature's bones, their skin and VRM labels. Raises InputError: no
    human bones were recognised."""
    try:
        labels = human_bones_of(armature)
        return map_bones(read_bones(armature), labels, partial(skin_by_bone, armature))
    except InputError as error:
        raise InputError(f"Armature '{armature.name}': {error}") from None


def mapping_of(armature: bpy.types.Object) -> BoneMapping:
    """Mapping for the next fit: the corrected table, or the detected mapping without corrections.
    Raises InputError: the mapping is empty, names a missing bone, or assigns a bone to two
    joints."""
    if not is_corrected(armature):
        return detected_mapping(armature)
    bones = {row.name: row.bone for row in armature.hfx.bone_map if row.bone}
    _check_bones(armature, bones)
    return _mapping(armature.hfx.bone_map_convention, bones)


def fill(armature: bpy.types.Object, *, keep_corrections: bool = False) -> None:
    """Fill the table with the detected mapping; with ``keep_corrections``, corrected rows stay.
    Raises InputError: no human bones were recognised. The table is filled with the corrections
    alone."""
    # A correction is a row unlike the mapping detected before.
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
    """Fill the table with a mapping. Rows unlike the detected mapping count as corrections. With
    ``is_automatic`` no row does; if no bones are recognised, all do."""
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
    """Load a saved mapping into the table, without bones that the armature lacks; return notes for
    the user about these.

    Raises InputError: the file is unreadable, is no bone mapping, or maps none of this armature's
    bones. The table is unchanged.
    """
    content = read_bytes(path, _LARGEST_FILE)
    try:
        # Text editors may have added a byte order mark.
        mapping = from_json(content.decode("utf-8-sig"))
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
    convention "by hand" for ""."""
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
    ``detected`` or ``bones`` have ""."""
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


def human_bones_of(armature: bpy.types.Object) -> dict[str, str]:
    """VRM names of human bones by the armature's bone names; empty without a table of 8 bones.

    Stored by, in this order: the VRM add-on (``Armature.vrm_addon_extension``, readable without the
    add-on too); the glTF extension ``VRMC_vrm`` (1.0) or ``VRM`` (0.x), as a custom property; early
    editions of the add-on, as custom properties per human bone.
    """
    sources = (_rows_of_add_on, _rows_of_gltf, _rows_of_properties)
    for source in sources:
        bones: dict[str, str] = {}
        # Custom properties hold anything, so every value is checked. First rows count.
        for name, bone in source(armature):
            if isinstance(name, str) and isinstance(bone, str) and bone in armature.data.bones:
                # Without underscores and case a name is equal in all versions of VRM.
                is_human = _HUMAN_BONE.fullmatch(name.replace("_", "").lower())
                if is_human and bone not in bones.values():
                    bones.setdefault(name, bone)
        if len(bones) >= _FEWEST:
            return {bone: name for name, bone in bones.items()}
    return {}


def _rows_of_add_on(armature: bpy.types.Object) -> list[tuple[Any, Any]]:
    """Rows (human bone, bone) of the add-on's chosen VRM version, or else of the filled version."""
    extension = _stored(armature.data)
    uuids = {
        _field(group, "uuid"): bone.name
        for bone in armature.data.bones
        if (group := _stored(bone)) is not None
    }
    tables = {}
    # The add-on stores tables of both versions; often a single table is filled.
    # Version 1 first: preferred if both tables are filled and the chosen version is unclear.
    for version in "10":
        bones = _field(extension, f"vrm{version}", "humanoid", "human_bones")
        if bones is None:
            continue
        if version == "1":
            fields = bones.bl_rna.properties if hasattr(bones, "bl_rna") else bones
            rows = [(name, _field(bones, name)) for name in fields.keys()]
        else:
            rows = [(_field(row, "bone"), row) for row in bones]
        tables[version] = [
            (human_bone, _bone_of(_field(row, "node"), uuids))
            for human_bone, row in rows
            if row is not None
        ]
    spec_version = str(_field(extension, "spec_version"))[:1]
    usable_versions = [
        version for version in tables if sum(bool(b) for _, b in tables[version]) >= _FEWEST
    ]
    return (
        tables[spec_version if spec_version in usable_versions else usable_versions[0]]
        if usable_versions
        else []
    )


def _bone_of(node: Any, uuids: dict[Any, str]) -> str | None:
    """Bone name stored in a node, else found in ``uuids`` by its bone's uuid; or None."""
    for field in ("bone_name", "value"):
        if isinstance(name := _field(node, field), str) and name:
            return name
    uuid = _field(node, "bone_uuid")
    return uuids.get(uuid) if uuid else None


def _rows_of_gltf(armature: bpy.types.Object) -> list[tuple[Any, Any]]:
    """Rows (human bone, node) of the first glTF extension stored in armature, its data or scene;
    empty without. A numeric node names no bone."""
    for holder in (armature, armature.data, bpy.context.scene):
        for name in _EXTENSIONS:
            extension = _json(holder.get(name)) or _field(_json(holder.get("extensions")), name)
            bones = _field(_json(extension), "humanoid", "humanBones")
            if bones is None:
                continue
            if hasattr(bones, "keys"):
                return [
                    (human_bone, _field(bones, human_bone, "node")) for human_bone in bones.keys()
                ]
            return [(_field(row, "bone"), _field(row, "node")) for row in bones]
    return []


def _rows_of_properties(armature: bpy.types.Object) -> list[tuple[Any, Any]]:
    """Custom properties (name, value) of the armature's data, then of the object."""
    return [(name, value) for holder in (armature.data, armature) for name, value in holder.items()]


def _stored(owner: bpy.types.ID | bpy.types.Bone) -> Any:
    """The add-on's data of a datablock or bone: properties, or a dictionary without the add-on."""
    if hasattr(owner, _ADD_ON):
        return getattr(owner, _ADD_ON)
    return compat.stored_properties(owner).get(_ADD_ON) or owner.get(_ADD_ON)


def _field(holder: Any, *path: str) -> Any:
    """Nested value by RNA attributes or dictionary keys; None if a step is missing."""
    for name in path:
        if hasattr(holder, "bl_rna"):
            holder = getattr(holder, name, None)
        else:
            holder = holder.get(name) if hasattr(holder, "get") else None
    return holder


def _json(value: Any) -> Any:
    """Parsed JSON of a string, None if invalid; further values are unchanged."""
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except (ValueError, RecursionError):
        return None
