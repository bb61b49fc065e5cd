# SPDX-License-Identifier: GPL-3.0-or-later
"""The bone table: find the bones of an avatar, drop corrections, save and load a mapping."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, StringProperty

from ..errors import InputError
from ..text import printable
from .shared import FileOperator, HfxOperator, active_armature


class _BonesOperator(HfxOperator):
    """Base of operators on the bone table of the active armature."""

    requires = ((active_armature, "Select an armature, or a mesh that has one"),)

    def work(self, context: bpy.types.Context) -> str:
        from ..avatars import bodies

        armature = active_armature(context)
        bodies.check_armature(armature)
        return self.work_on(armature)

    def work_on(self, armature: bpy.types.Object) -> str:
        raise NotImplementedError


class HFX_OT_find_bones(_BonesOperator):
    """Find the bone of each joint; rows edited by you are kept"""

    bl_idname = "hfx.find_bones"
    bl_label = "Find Bones"

    def work_on(self, armature: bpy.types.Object) -> str:
        return _fill(self, armature, keep_corrections=True)


class HFX_OT_reset_bones(_BonesOperator):
    """Drop all corrections and return to the automatic mapping"""

    bl_idname = "hfx.reset_bones"
    bl_label = "Reset"

    def work_on(self, armature: bpy.types.Object) -> str:
        return _fill(self, armature, keep_corrections=False)


def _fill(operator: HfxOperator, armature: bpy.types.Object, *, keep_corrections: bool) -> str:
    from ..avatars import bone_table

    try:
        bone_table.fill(armature, keep_corrections=keep_corrections)
    except InputError as error:
        operator.report({"WARNING"}, str(error))
        return ""
    count = sum(1 for row in armature.hfx.bone_map if row.found)
    return f"{count} bones found ({armature.hfx.bone_map_convention})"


class _FileOperator(_BonesOperator, FileOperator):
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def first_path(self, context: bpy.types.Context) -> str:
        return bpy.path.clean_name(active_armature(context).name) + "_bones.json"


class HFX_OT_save_bones(_FileOperator):
    """Save the bone table for other avatars with the same bone names"""

    bl_idname = "hfx.save_bones"
    bl_label = "Save Bone Mapping"

    check_existing: BoolProperty(default=True, options={"HIDDEN"})

    def work_on(self, armature: bpy.types.Object) -> str:
        from ..avatars import bone_table

        path = self.path()
        if not path.suffix:
            path = path.with_suffix(".json")
        count = bone_table.save(armature, path)
        return f"{count} bones saved to {path}"


class HFX_OT_load_bones(_FileOperator):
    """Load a mapping of bones to joints; fit the body again afterwards"""

    bl_idname = "hfx.load_bones"
    bl_label = "Load Bone Mapping"

    def work_on(self, armature: bpy.types.Object) -> str:
        from ..avatars import bone_table

        for warning in bone_table.load(armature, self.path()):
            self.report({"WARNING"}, printable(warning))
        count = sum(1 for row in armature.hfx.bone_map if row.bone)
        return f"{count} bones loaded"
