# SPDX-License-Identifier: GPL-3.0-or-later
"""VRM's table of human bones, where an armature holds one: which bone is the left upper arm.

It is read from the VRM add-on's own data (``Armature.vrm_addon_extension``, also where the add-on
that stored it is not there), from the file's extension ``VRMC_vrm`` (1.0) or ``VRM`` (0.x) kept as
a custom property, and from the custom property for each human bone of the add-on's early editions.
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
    """Names of the human bones, by the armature's bones; empty without a table."""
    sources = (_of_add_on, _of_file, _of_properties)
    found = (_sound(armature, source(armature)) for source in sources)
    return next((table for table in found if len(table) >= _FEWEST), {})


def _sound(armature: bpy.types.Object, pairs: Iterable[tuple[Any, Any]]) -> dict[str, str]:
    """Bone to human bone, the first row of each, of rows that name what is there."""
    bones: dict[str, str] = {}
    for human, bone in pairs:
        if isinstance(human, str) and isinstance(bone, str) and bone in armature.data.bones:
            if _HUMAN_BONE.fullmatch(_key(human)) and bone not in bones.values():
                bones.setdefault(human, bone)
    return {bone: human for human, bone in bones.items()}


def _key(human: str) -> str:
    return human.replace("_", "").lower()


def _of_add_on(armature: bpy.types.Object) -> list[tuple[Any, Any]]:
    extension = _stored(armature.data)
    uuids = {
        _field(group, "uuid"): bone.name
        for bone in armature.data.bones
        if (group := _stored(bone)) is not None
    }
    tables = {}
    for version in "10":
        bones = _field(extension, f"vrm{version}", "humanoid", "human_bones")
        if bones is None:
            continue
        if version == "1":
            rows = [(name, _field(bones, name)) for name in _fields(bones)]
        else:
            rows = [(_field(row, "bone"), row) for row in bones]
        tables[version] = [
            (human, _bone_of(_field(row, "node"), uuids)) for human, row in rows if row is not None
        ]
    chosen = str(_field(extension, "spec_version"))[:1]
    filled = [version for version in tables if sum(bool(b) for _, b in tables[version]) >= _FEWEST]
    return tables[chosen if chosen in filled else filled[0]] if filled else []


def _bone_of(node: Any, uuids: dict[Any, str]) -> str | None:
    for field in ("bone_name", "value"):
        if isinstance(name := _field(node, field), str) and name:
            return name
    uuid = _field(node, "bone_uuid")
    return uuids.get(uuid) if uuid else None


def _of_file(armature: bpy.types.Object) -> list[tuple[Any, Any]]:
    """Rows of a kept glTF extension; a node may be a bone's name, not a number of the file."""
    for holder in (armature, armature.data, bpy.context.scene):
        for name in _EXTENSIONS:
            kept = _json(holder.get(name)) or _field(_json(holder.get("extensions")), name)
            bones = _field(_json(kept), "humanoid", "humanBones")
            if bones is None:
                continue
            if hasattr(bones, "keys"):
                return [(human, _field(bones, human, "node")) for human in bones.keys()]
            return [(_field(row, "bone"), _field(row, "node")) for row in bones]
    return []


def _of_properties(armature: bpy.types.Object) -> list[tuple[Any, Any]]:
    return [(name, value) for holder in (armature.data, armature) for name, value in holder.items()]


def _stored(owner: bpy.types.ID | bpy.types.Bone) -> Any:
    """Data that the add-on stores on something: properties, or plain data without it."""
    if hasattr(owner, _ADD_ON):
        return getattr(owner, _ADD_ON)
    return compat.stored_properties(owner).get(_ADD_ON) or owner.get(_ADD_ON)


def _field(holder: Any, *path: str) -> Any:
    for name in path:
        if hasattr(holder, "bl_rna"):
            holder = getattr(holder, name, None)
        else:
            holder = holder.get(name) if hasattr(holder, "get") else None
    return holder


def _fields(holder: Any) -> list[str]:
    return list(holder.bl_rna.properties.keys() if hasattr(holder, "bl_rna") else holder.keys())


def _json(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    try:
        return json.loads(value)
    except (ValueError, RecursionError):
        return None
