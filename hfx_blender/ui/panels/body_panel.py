# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels of the active haptic body: avatar, bone table, quality of the fit."""

import re
from functools import cache

import bpy

from ...authoring.effects import effects
from ...avatars import avatar_meshes
from ...blender import early_imports
from ...blender.translation import translated
from ...engine.body.model_library import model_sets
from ...engine.body.parts import REGIONS
from ...errors import InputError
from ...operators.shared import active_armature
from ..sidebar import HfxPanel, draw_text, filtered

_SIDES = {"L": " L", "R": " R"}
_WORDS = {
    "root": "Hips",
    "pelvis": "Pelvis",
    "upperleg01": "Thigh",
    "upperleg02": "Thigh Twist",
    "lowerleg01": "Shin",
    "lowerleg02": "Shin Twist",
    "foot": "Foot",
    "breast": "Breast",
    "clavicle": "Collar Bone",
    "shoulder01": "Shoulder Blade",
    "upperarm01": "Upper Arm",
    "upperarm02": "Upper Arm Twist",
    "lowerarm01": "Forearm",
    "lowerarm02": "Forearm Twist",
    "wrist": "Hand",
    "head": "Head",
    "jaw": "Jaw",
    "eye": "Eye",
}
_SPINE = {f"spine{number:02d}": f"Spine {6 - number}" for number in range(1, 6)}  # from below
_NECK = {f"neck{number:02d}": f"Neck {number}" for number in range(1, 4)}
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
_BODY = {*_WORDS, *_SPINE, *_NECK} - {"jaw", "eye"}
_DIGIT = re.compile(r"(finger|toe|metacarpal)(\d)(?:-(\d))?")


def label_of(bone: str) -> str:
    """A canonical bone in words: "upperarm01.L" is "Upper Arm L", in the language of the
    interface; unknown names in title case."""
    stem, side = _split(bone)
    words = {**_WORDS, **_SPINE, **_NECK}.get(stem)
    # Metacarpals are numbered from the index finger, fingers from the thumb.
    digit = _DIGIT.fullmatch(stem)
    if digit is not None:
        kind, number, joint = digit[1], int(digit[2]), digit[3]
        if kind == "toe":
            words = f"Toe {number} Joint {joint}"
        elif kind == "finger":
            words = f"{translated(_FINGERS[number - 1])} {joint}"
        else:
            words = f"{translated(_FINGERS[number])} Palm"
    return translated(words or stem.title()) + _SIDES.get(side, "")


@cache
def region_of(bone: str) -> str:
    """Part of the bone table for a canonical bone, regardless of the side ".L" or ".R".

    "HANDS" for names starting with finger or metacarpal, "FEET" with toe; "BODY" for trunk, neck,
    head and limbs, with wrist and foot; "FACE" for jaw, eye and unknown names.
    """
    stem, _ = _split(bone)
    if stem in _BODY:
        return "BODY"
    if stem.startswith(("finger", "metacarpal")):
        return "HANDS"
    return "FEET" if stem.startswith("toe") else "FACE"


def _split(bone: str) -> tuple[str, str]:
    stem, dot, side = bone.rpartition(".")
    return (stem, side) if dot and side in _SIDES else (bone, "")


_FOUND, _CORRECTED, _FOLLOWING, _WRONG = "CHECKMARK", "GREASEPENCIL", "FILE_PARENT", "ERROR"


class HFX_UL_bones(bpy.types.UIList):
    """Canonical bones and the avatar's bones"""

    def draw_item(
        self,
        _context: bpy.types.Context,
        layout: bpy.types.UILayout,
        hfx: bpy.types.PropertyGroup,
        row: bpy.types.PropertyGroup,
        _icon: int,
        _active_data: object,
        _active_property: str,
    ) -> None:
        armature = hfx.id_data
        split = layout.split(factor=0.55)  # a search field would leave no width for names
        split.label(text=label_of(row.name), icon=icon_of(row, armature))
        split.label(text=row.bone, translate=False)

    def filter_items(
        self, _context: bpy.types.Context, hfx: bpy.types.PropertyGroup, name: str
    ) -> tuple[list[int], list[int]]:
        shown = [
            (
                f"{label_of(row.name)} {row.name} {row.bone}",
                region_of(row.name) == hfx.bone_map_region,
            )
            for row in getattr(hfx, name)
        ]
        return filtered(self, shown)


def icon_of(row: bpy.types.PropertyGroup, armature: bpy.types.Object) -> str:
    """Icon of a joint's state: found, corrected, following another, or missing."""
    if row.bone and row.bone not in armature.data.bones:
        return _WRONG
    if row.bone != row.found:
        return _CORRECTED
    return _FOUND if row.bone else _FOLLOWING


def sentence_of(row: bpy.types.PropertyGroup, armature: bpy.types.Object) -> str:
    """Sentence on the bone of a joint: found, set by hand, missing, or the joint followed."""
    icon, label = icon_of(row, armature), label_of(row.name)
    if icon == _WRONG:
        return f"{label}: the armature has no bone '{row.bone}'"
    if row.bone:
        was = f"; found: '{row.found}'" if row.found else "; none was found"
        return f"{label}: '{row.bone}'" + (f", by hand{was}" if icon == _CORRECTED else ", found")
    by = f"none, by hand (found: '{row.found}')" if icon == _CORRECTED else "no bone found"
    return f"{label}: {by}" + (f"; follows '{row.follows}'" if row.follows else "")


class HFX_PT_body(HfxPanel, bpy.types.Panel):
    """The active haptic body, or an armature without one"""

    bl_label = "Haptic Body"
    bl_order = 4

    subject = staticmethod(active_armature)

    def draw(self, context: bpy.types.Context) -> None:
        from ...avatars import stored_fits

        layout = self.layout
        body = active_armature(context)
        if body.hfx.role != "BODY":
            early_imports.begin()
            layout.label(
                text=translated(f"'{body.name}' is not a haptic body yet"), icon="ARMATURE_DATA"
            )
            layout.operator("hfx.mark_body", icon="ADD")
            return
        elsewhere = [
            effect
            for effect in effects.effects_of(context.scene)
            if effect.hfx.kind in effects.ON_A_BODY
            and effects.body_in(context.scene, effect) != body
            and not effects.is_locked(effect)
        ]
        if elsewhere:
            is_single = len(elsewhere) == 1
            text = f"Take {len(elsewhere)} {'Effect' if is_single else 'Effects'} of Other Bodies"
            take = layout.operator("hfx.move_to_body", text=translated(text), icon="FORWARD")
            take.which, take.body = "ALL", body.name
        layout.label(text=body.name, icon="ARMATURE_DATA", translate=False)
        for mesh in avatar_meshes.meshes_of(body):
            layout.label(text=mesh.name, icon="MESH_DATA", translate=False)
        column = layout.column()
        column.use_property_split = True
        column.prop(body.hfx, "follow")
        column.prop(body.hfx, "felt_layer")
        draw_text(context, layout, how_followed(body), "INFO")
        if stored_fits.is_fitted(body):
            layout.operator("hfx.fit_body", icon="FILE_REFRESH")
        else:
            layout.operator("hfx.mark_body", text="Choose Other Meshes", icon="FILE_REFRESH")
        layout.operator_menu_enum("hfx.show_model", "model", icon="HIDE_OFF")
        sets, ids = model_sets(), body.hfx.body_models
        if sets or ids:
            names = {"": "Default", **{" ".join(own): name for name, own in sets.items()}}
            text = translated(f"Body Models: {names.get(ids, ids)}")
            layout.operator_menu_enum("hfx.use_models", "models", text=text, icon="MESH_ICOSPHERE")


def how_followed(body: bpy.types.Object) -> str:
    """Sentence: the body follows bones or the evaluated surface, and why; or the error's text."""
    from ...avatars import body_binding

    # A drawing must not measure: that evaluates copies of the avatar.
    if body.hfx.follow != "SURFACE" and not body_binding.is_measured(body):
        return "The effect of modifiers and shape keys on the avatar is measured during playback"
    try:
        reason = body_binding.surface_reason(body)
    except InputError as error:
        return str(error)
    if reason is not None:
        return f"Follows the evaluated surface, because {reason}"
    is_lossy = body.hfx.follow == "BONES" and body_binding.warning_of(body) is not None
    return "Follows the bones" + (
        ", although other modifiers deform the avatar" if is_lossy else ""
    )


class HFX_PT_bones(HfxPanel, bpy.types.Panel):
    """Bones of the avatar, for each joint"""

    bl_label = "Bones"
    bl_parent_id = "HFX_PT_body"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        from ...avatars import stored_fits

        layout = self.layout
        armature = active_armature(context)
        hfx = armature.hfx
        row = layout.row(align=True)
        row.operator("hfx.find_bones", icon="VIEWZOOM")
        row.operator("hfx.load_bones", text="", icon="FILE_FOLDER")
        if not hfx.bone_map:
            return
        row.operator("hfx.save_bones", text="", icon="FILE_TICK")
        row.operator("hfx.reset_bones", text="", icon="LOOP_BACK")
        layout.row().prop(hfx, "bone_map_region", expand=True)
        layout.template_list("HFX_UL_bones", "", hfx, "bone_map", hfx, "bone_map_active", rows=8)
        if 0 <= hfx.bone_map_active < len(hfx.bone_map):
            chosen = hfx.bone_map[hfx.bone_map_active]
            layout.prop_search(chosen, "bone", armature.data, "bones", text="", icon="BONE_DATA")
            draw_text(context, layout, sentence_of(chosen, armature), icon_of(chosen, armature))
        if stored_fits.is_fitted(armature):
            layout.operator("hfx.fit_body", text="Fit with These Bones", icon="FILE_REFRESH")


class HFX_PT_fit(HfxPanel, bpy.types.Panel):
    """Fit of the perceptual models to the avatar, the worst part first"""

    bl_label = "Fit"
    bl_parent_id = "HFX_PT_body"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        armature = active_armature(context)
        if armature is None:
            return False
        from ...avatars import stored_fits  # slow to import, and polled often

        return stored_fits.is_fitted(armature)

    def draw(self, context: bpy.types.Context) -> None:
        from ...avatars import stored_fits

        layout = self.layout
        body = active_armature(context)
        qualities = stored_fits.quality_of(body)
        labels = {region.id: region.label for region in REGIONS}
        table = layout.column(align=True)
        _draw_row(table, "Part", "NONE", ("mm off", "placed", "area"))
        for part in stored_fits.worst_first(qualities):
            values = (
                f"{part.distance_p95_mm:.1f}",
                f"{100 * part.in_place:.0f} %",
                f"{part.area_ratio:.2f}",
            )
            icon = "ERROR" if part.faults else "CHECKMARK"
            _draw_row(table, labels.get(part.part, part.part), icon, values)
        sides = min((quality.sides for quality in qualities), default=1.0)
        forward = min((quality.feet_forward for quality in qualities), default=1.0)
        sentence = f"On its own side: {100 * sides:.0f} %; feet forward: {100 * forward:.0f} %"
        draw_text(context, layout, sentence)
        for warning in stored_fits.messages_of(body, "warnings"):
            draw_text(context, layout, warning, "ERROR")
        for note in stored_fits.messages_of(body, "notes"):
            draw_text(context, layout, note, "INFO")


def _draw_row(
    table: bpy.types.UILayout, title: str, icon: str, values: tuple[str, str, str]
) -> None:
    split = table.split(factor=0.45)
    split.label(text=title, icon=icon)
    row = split.row()
    for value in values:
        row.label(text=value)
