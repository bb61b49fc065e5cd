# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic bodies: built-in avatar, fit to an avatar, bone table, shown models, walk."""

from collections.abc import Callable, Generator
from functools import cache

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ..authoring import painting
from ..authoring.effects import effects
from ..avatars import avatar_meshes
from ..blender.translation import translated
from ..engine.body import model_library
from ..engine.modality import MODALITIES
from ..engine.stepwise import within
from ..errors import InputError
from ..properties.objects import FELT_LAYERS
from ..text import named, printable
from . import framing, shared


@shared.kept_items
def _people() -> shared.EnumItems:
    from ..engine.body.model import AVATAR_ID
    from ..engine.body.model_library import people

    own = [
        (person.id, person.folder.name, f"{person.facts.get('height_m', '?')} m tall, {person.id}")
        for person in people()
    ]
    return [(AVATAR_ID, "Average Adult", "1.8 m tall"), *own]


class HFX_OT_add_avatar(shared.HfxOperator):
    """Add the built-in avatar, a haptic body that is posed like any armature"""

    leaves_mode = True
    bl_label = "Avatar"

    person: EnumProperty(
        name="Person", description="The average adult, or a body model of your own", items=_people
    )
    stands_free: BoolProperty(
        name="Stand Free",
        description="Next to objects at the 3D cursor, not inside them",
        default=False,
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("stands_free"):
            # A moved 3D cursor is an explicit position.
            self.stands_free = context.scene.cursor.location.length == 0.0
        return self.execute(context)

    def work(self, context: bpy.types.Context) -> str:
        from ..avatars import bodies
        from ..engine.body.model import AVATAR_ID

        armature, skin = bodies.add_avatar(context, avatar_id=self.person or AVATAR_ID)
        framing.show_locally(context, (armature, skin))
        armature.location = (
            bodies.free_place(context, armature)
            if self.stands_free
            else context.scene.cursor.location
        )
        framing.frame(context, [armature])
        return f"'{armature.name}' is a haptic body{_adopt_effects(context, armature)}"


class _FittingOperator(shared.StepwiseOperator):
    """Base of operators that fit a haptic body to an avatar."""

    doing, doing_icon = "Fitting the Haptic Body", "OUTLINER_OB_ARMATURE"
    cancelled = "Fit cancelled: nothing was changed"

    def fitting(
        self,
        context: bpy.types.Context,
        body: bpy.types.Object,
        choosing: Callable[..., Generator[float, None, list[bpy.types.Object]]],
    ) -> Generator[float, None, str]:
        """Choose meshes of armature ``body`` by ``choosing(context, body, mapping_of)``, then fit
        the body to these; yields progress (0..1) and returns the report. Bones are searched once.
        """
        from ..avatars import bodies, bone_table

        mapping_of = cache(bone_table.mapping_of)
        selected = [
            obj
            for obj in context.selected_objects
            if obj.type == "MESH" and not avatar_meshes.is_model_mesh(obj)
        ]
        meshes = yield from within(choosing(context, body, mapping_of), 0.0, 0.3)
        steps = bodies.adding_body(body, next(iter(meshes), None), meshes[1:], mapping_of)
        for warning in (yield from within(steps, 0.3, 1.0)):
            self.report({"WARNING"}, translated(printable(f"{body.name}: {warning}")))
        # The report names all candidates, so that a missing mesh of the avatar is noticed.
        taken = avatar_meshes.meshes_of(body)
        there = dict.fromkeys((*avatar_meshes.visible_meshes(context, body), *selected))
        others = [mesh for mesh in there if mesh not in taken]
        shown = f", shown by {_quoted(taken)}" if taken else ""
        rest = f"; left out, as they show no skin: {_quoted(others)}" if others else ""
        return f"'{body.name}' is a haptic body{shown}{rest}"


class HFX_OT_mark_body(_FittingOperator):
    """Make the active armature a haptic body. The selected meshes become its avatar; without a
    selection, all skin meshes of the armature"""

    bl_label = "Add Haptic Body"

    layer: EnumProperty(
        name="Felt On", description="Meshes to use where clothes cover skin", items=FELT_LAYERS
    )

    requires = (
        (
            lambda context: _armature_for(context),  # defined below
            "Select an armature, or a mesh that has one",
        ),
    )

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        from ..avatars import bodies

        body = _armature_for(context)
        # World matrices of objects that were just moved are stale before an update.
        context.view_layer.update()
        before = body.hfx.felt_layer
        if self.properties.is_property_set("layer"):
            body.hfx.felt_layer = self.layer
        try:
            message = yield from self.fitting(context, body, bodies.choosing_meshes)
        except BaseException:  # Esc closes this generator
            body.hfx.felt_layer = before
            raise
        framing.frame(context, [body, *avatar_meshes.meshes_of(body)])
        return message + _adopt_effects(context, body)


def _armature_for(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active armature, else the only selected one, else the active mesh's; None without any."""
    if context.object is not None and context.object.type == "ARMATURE":
        return context.object
    selected = [obj for obj in context.selected_objects if obj.type == "ARMATURE"]
    return selected[0] if len(selected) == 1 else shared.active_armature(context)


def _adopt_effects(context: bpy.types.Context, body: bpy.types.Object) -> str:
    """Assign effects of deleted bodies to ``body``, if the only body of the scene.

    Returns the end of a sentence with the names of these effects; empty without any.
    """
    bodiless = effects.effects_without_body(context.scene)
    bodiless = [effect for effect in bodiless if not effects.is_locked(effect)]
    if effects.bodies_of(context.scene) != [body] or not bodiless:
        return ""
    effects.move_to_body(bodiless, body)
    return f"; it now feels the effects of deleted bodies: {named([e.name for e in bodiless])}"


def _quoted(meshes: list[bpy.types.Object]) -> str:
    return " and ".join(f"'{mesh.name}'" for mesh in meshes)


@shared.kept_items
def _bodies() -> shared.EnumItems:
    bodies_in_scene = effects.bodies_of(bpy.context.scene)
    return [(obj.name, obj.name, f"Felt on {obj.name}") for obj in bodies_in_scene]


class HFX_OT_move_to_body(shared.OnBodyOperator):
    """Assign effects to another body; painted areas keep their place on the body"""

    leaves_mode = False
    bl_label = "Move to Body"
    requires = (*shared.OnBodyOperator.requires, shared.IS_EDITABLE)

    body: EnumProperty(name="Body", description="Body for the effects", items=_bodies)
    which: EnumProperty(
        name="Effects",
        description="Effects to move",
        items=(
            ("ACTIVE", "Active", "The active effect and the selected ones"),
            ("GONE", "Whose Body Is Gone", "Effects whose body is not in this scene"),
            ("ALL", "All", "All effects of the scene that belong to a body"),
        ),
    )

    def work(self, context: bpy.types.Context) -> str:
        every = effects.bodies_of(context.scene)
        body = next(candidate for candidate in every if candidate.name == self.body)
        if self.which == "ACTIVE":
            active = shared.active_effect(context)
            moved = [active] if active is not None else []
            moved += [o for o in context.selected_objects if o.hfx.role == "EFFECT"]
        elif self.which == "GONE":
            moved = effects.effects_without_body(context.scene)
        else:
            moved = effects.effects_of(context.scene)
        if any(painting.canvas_of(effect) is not None for effect in moved):
            raise InputError("Finish painting first.")
        moved, ending = effects.without_locked(
            obj
            for obj in dict.fromkeys(moved)  # the active effect may be selected, too
            if obj.hfx.kind in effects.ON_A_BODY and obj.hfx.body != body
        )
        report = f"Moved {effects.move_to_body(moved, body)} effects to '{body.name}'"
        return report + ending


def _is_fitted(body: bpy.types.Object) -> bool:
    from ..avatars import stored_fits  # slow to import

    return stored_fits.is_fitted(body)


class HFX_OT_fit_body(_FittingOperator):
    """Fit the active haptic body to its avatar again, using the bone table. Id and painted areas
    are kept"""

    bl_label = "Fit Again"

    requires = (
        (shared.active_body, "Select a haptic body"),
        (
            lambda context: _is_fitted(shared.active_body(context)),
            "The built-in avatar needs no fit",
        ),
    )

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        from ..avatars import bodies, model_mesh

        body = shared.active_body(context)
        context.view_layer.update()
        # Shown models have the shape of the old fit, and are made again after the fit.
        was_shown = [obj[model_mesh.MODEL] for obj in model_mesh.shown_meshes(body)]
        message = yield from self.fitting(context, body, bodies.choosing_skin_meshes)
        for model_id in was_shown:
            model_mesh.show(context, body, model_id)
        return message


@shared.kept_items
def _model_sets() -> shared.EnumItems:
    sets = model_library.model_sets().items()
    return [
        ("DEFAULT", "Default", "Even cells of skin, one threshold apart"),
        *((name, name, ", ".join(ids)) for name, ids in sets),
    ]


class HFX_OT_use_models(_FittingOperator):
    """Choose the perceptual models that the bodies of the scene feel on. Painted areas move to the
    nearest vertices"""

    bl_label = "Body Models"

    models: EnumProperty(name="Body Models", description="Installed set", items=_model_sets)
    requires = ((shared.active_body, "Select a haptic body"),)

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        from ..avatars import bodies, model_mesh, stored_fits
        from ..engine.body.model import load_model

        ids = model_library.model_sets().get(self.models, ())
        for model_id in ids:
            load_model(model_id)  # a damaged set changes nothing
        every = effects.bodies_of(context.scene)
        for body in every:
            effects.without_locked([body])
        if any(painting.canvas_of(effect) is not None for effect in bpy.data.objects):
            raise InputError("Finish painting first.")
        before = [body.hfx.body_models for body in every]
        try:
            for body in every:
                body.hfx.body_models = " ".join(ids)
                if stored_fits.lacks_models(body):
                    yield from self.fitting(context, body, bodies.choosing_skin_meshes)
            counts, names = painting.transfer_areas(context.scene, every)
        except BaseException:  # Esc closes this generator
            for body, earlier in zip(every, before, strict=True):
                body.hfx.body_models = earlier
            raise
        for body in every:
            for model_id in model_mesh.hide(body):
                modality = load_model(model_id).modality
                model_mesh.show(context, body, effects.model_id_for(modality, body))
        if names:
            text = f"Areas that stay on the earlier models: {named(names)}"
            self.report({"WARNING"}, translated(text))
        old, new = (sum(numbers) for numbers in zip((0, 0), *counts, strict=True))
        moved = f"Painted areas moved: {len(counts)}, from {old} vertices to {new}"
        return f"{moved}. Body models: {' '.join(ids) or 'default'}"


class HFX_OT_show_model(shared.HfxOperator):
    """Show or hide the perceptual model on the avatar, with a colour for each body part"""

    leaves_mode = True
    bl_label = "Show Perceptual Model"

    model: EnumProperty(
        name="Model",
        description="Perceptual model to show",
        items=[
            (name, name.title(), f"The model that {name} is felt on")
            for name in sorted({modality.model for modality in MODALITIES.values()})
        ],
        default="pressure",
    )
    requires = ((shared.active_body, "Select a haptic body"),)

    def work(self, context: bpy.types.Context) -> str:
        from ..avatars import model_mesh

        body = shared.active_body(context)
        model_id = effects.model_id_for(self.model, body)
        removed = model_mesh.hide(body)
        shared.select_only(context, body)
        if model_id in removed:
            return f"The {self.model} model of '{body.name}' is removed"
        obj = model_mesh.show(context, body, model_id)
        framing.show_locally(context, [obj])
        return f"'{obj.name}' shows {len(obj.data.vertices)} vertices"


class _BonesOperator(shared.HfxOperator):
    """Base of operators on the bone table of the active armature."""

    requires = ((shared.active_armature, "Select an armature, or a mesh that has one"),)

    def work(self, context: bpy.types.Context) -> str:
        from ..avatars import bodies

        armature = shared.active_armature(context)
        bodies.check_armature(armature)
        return self.work_on(armature)

    def work_on(self, armature: bpy.types.Object) -> str:
        """Change the table of a checked armature; returns the report, or "" without a report."""
        raise NotImplementedError

    def fill(self, armature: bpy.types.Object, *, keep_corrections: bool) -> str:
        """Detect the bones of all joints; ``keep_corrections`` leaves rows edited by the user.

        Returns the report. An armature without known bones is a warning, and the report is "".
        """
        from ..avatars import bone_table

        try:
            bone_table.fill(armature, keep_corrections=keep_corrections)
        except InputError as error:
            self.report({"WARNING"}, translated(str(error)))
            return ""
        count = sum(1 for row in armature.hfx.bone_map if row.found)
        return f"{count} bones found ({armature.hfx.bone_map_convention})"


class HFX_OT_find_bones(_BonesOperator):
    """Find the bone of each joint; rows edited by you are kept"""

    bl_label = "Find Bones"

    def work_on(self, armature: bpy.types.Object) -> str:
        return self.fill(armature, keep_corrections=True)


class HFX_OT_reset_bones(_BonesOperator):
    """Drop all corrections and return to the automatic mapping"""

    bl_label = "Reset"

    def work_on(self, armature: bpy.types.Object) -> str:
        return self.fill(armature, keep_corrections=False)


class _BonesFileOperator(_BonesOperator, shared.FileOperator):
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def first_path(self, context: bpy.types.Context) -> str:
        return bpy.path.clean_name(shared.active_armature(context).name) + "_bones.json"


class HFX_OT_save_bones(_BonesFileOperator):
    """Save the bone table for other avatars with the same bone names"""

    bl_label = "Save Bone Mapping"

    check_existing: BoolProperty(default=True, options={"HIDDEN"})

    def work_on(self, armature: bpy.types.Object) -> str:
        from ..avatars import bone_table

        path = self.path()
        if not path.suffix:
            path = path.with_suffix(".json")
        count = bone_table.save(armature, path)
        return f"{count} bones saved to {path}"


class HFX_OT_load_bones(_BonesFileOperator):
    """Load a mapping of bones to joints; fit the body again afterwards"""

    bl_label = "Load Bone Mapping"

    def work_on(self, armature: bpy.types.Object) -> str:
        from ..avatars import bone_table

        for warning in bone_table.load(armature, self.path()):
            self.report({"WARNING"}, translated(printable(warning)))
        count = sum(1 for row in armature.hfx.bone_map if row.bone)
        return f"{count} bones loaded"
