# SPDX-License-Identifier: GPL-3.0-or-later
"""Human bones of VRM avatars, stored with an armature by the VRM add-on or a glTF file.

Sources, in this order: the VRM add-on's data (``Armature.vrm_addon_extension``, readable without
the add-on too), the glTF extension ``VRMC_vrm`` (1.0) or ``VRM`` (0.x) stored as a custom property,
and the custom properties per human bone of early editions of the add-on.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Any, Final

import bpy

from ..blender import compat

_ADD_ON: Final = "vrm_addon_extension"
_EXTENSIONS: Final = ("VRMC_vrm", "VRM")
_FEWEST: Final = 8
"""Bones from which a table says something."""

_HUMAN_BONE: Final = re.compile(
    r"hips|spine|chest|upperchest|neck|head|jaw"
    r"|(left|right)(eye|shoulder|upperarm|lowerarm|hand|upperleg|lowerleg|foot|toes"
    r"|thumb(metacarpal|proximal|intermediate|distal)"
    r"|(index|middle|ring|little)(proximal|intermediate|distal))"
)


def human_bones_of(armature: bpy.types.Object) -> dict[str, str]:
    """VRM names of human bones by the armature's bone names; empty without a table of 8 bones."""
    sources = (_rows_of_add_on, _rows_of_gltf, _rows_of_properties)
    tables = (_valid_rows(armature, source(armature)) for source in sources)
    return next((table for table in tables if len(table) >= _FEWEST), {})


def _valid_rows(armature: bpy.types.Object, pairs: Iterable[tuple[Any, Any]]) -> dict[str, str]:
    """VRM names by bone name, from (VRM name, bone) rows; unknown names, missing bones, other types
    and repetitions are left out, the first row counts.
    """
    bones: dict[str, str] = {}
    # Custom properties hold anything, so every value is checked.
    for human_bone, bone in pairs:
        if isinstance(human_bone, str) and isinstance(bone, str) and bone in armature.data.bones:
            if _HUMAN_BONE.fullmatch(_key(human_bone)) and bone not in bones.values():
                bones.setdefault(human_bone, bone)
    return {bone: human_bone for human_bone, bone in bones.items()}


def _key(human_bone: str) -> str:
    """Name of a human bone in lower case without underscores, equal in all versions of VRM."""
    return human_bone.replace("_", "").lower()


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
    """Rows (human bone, node) of a stored glTF extension; a numeric node names no bone."""
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
