# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators on many effects at once, and compound effects such as rain."""

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from ...authoring.effects import effects, global_tools, swarms
from ...blender.scene_info import animation_fps
from ...errors import InputError
from .. import framing, shared

SCOPES = (
    ("SELECTED", "Selected", "The selected effects"),
    ("COLLECTION", "Collection", "All effects in the active effect's collections"),
    ("ALL", "All", "Every effect of the scene"),
)


class _ManyEffects(shared.HfxOperator):
    scope: EnumProperty(name="Scope", description="Effects to change", items=SCOPES)

    requires = ((lambda context: swarms.listed_effects(context.scene), "There are no effects"),)

    def work(self, context: bpy.types.Context) -> str:
        listed = swarms.listed_effects(context.scene)
        if self.scope == "SELECTED":
            listed = swarms.selected_effects(context.scene)
        elif self.scope == "COLLECTION":
            own = set(context.object.users_collection) if context.object else set()
            listed = [effect for effect in listed if own & set(effect.users_collection)]
        if not listed:
            raise InputError("This scope has no effects; select some, or choose another scope.")
        editable, ending = effects.without_locked(listed)
        return self.changed(context, editable) + ending

    def changed(self, context: bpy.types.Context, chosen: list[bpy.types.Object]) -> str:
        """Change editable effects; returns the report."""
        raise NotImplementedError


class HFX_OT_scale_strength(_ManyEffects):
    """Make effects stronger or weaker, keyframes included"""

    bl_label = "Gain"

    factor: FloatProperty(
        name="Factor",
        description="Factor of the strength; for temperature, of the difference from neutral",
        default=1.0,
        min=0.0,
        max=100.0,
    )

    def changed(self, _context: bpy.types.Context, chosen: list[bpy.types.Object]) -> str:
        count = global_tools.scale_strength(chosen, self.factor)
        return f"Effects scaled by {self.factor:g}: {count}"


class HFX_OT_scale_frequency(_ManyEffects):
    """Make vibrations higher or lower, keyframes included"""

    bl_label = "Frequency"

    factor: FloatProperty(
        name="Factor",
        description="Factor for their frequency; 2 is an octave higher",
        default=1.0,
        min=0.01,
        max=100.0,
    )

    def changed(self, _context: bpy.types.Context, chosen: list[bpy.types.Object]) -> str:
        count = global_tools.scale_frequency(chosen, self.factor)
        return f"{count} vibrations scaled by {self.factor:g}"


class HFX_OT_modulate(_ManyEffects):
    """Modulate the intensity of effects; a depth of 0 removes the modulation"""

    bl_label = "Modulation"

    rate: FloatProperty(name="Rate", description="Modulations per second", default=2.0, min=0.01)
    depth: FloatProperty(
        name="Depth",
        description="Depth of the modulation: 1 lowers the intensity to nothing",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )

    def changed(self, context: bpy.types.Context, chosen: list[bpy.types.Object]) -> str:
        fps = animation_fps(context.scene)
        count = global_tools.modulate(chosen, self.rate, self.depth, fps)
        return f"Effects modulated: {count}"


class _SelectedEffects(shared.HfxOperator):
    leaves_mode = True
    requires = ((lambda context: swarms.selected_effects(context.scene), "Select effects first"),)


class HFX_OT_remove_effects(_SelectedEffects):
    """Delete the selected effects"""

    bl_label = "Delete Effects"

    def work(self, context: bpy.types.Context) -> str:
        chosen, ending = effects.without_locked(swarms.selected_effects(context.scene))
        bpy.data.batch_remove(chosen)
        report = f"Deleted {len(chosen)} {'effect' if len(chosen) == 1 else 'effects'}"
        return report + ending


@shared.kept_items
def _groups() -> shared.EnumItems:
    listed = swarms.listed_effects(bpy.context.scene)
    names = sorted({effects.group_of(effect) for effect in listed} - {""})
    return [
        ("NEW", "New Group", "A new group; double-click its row in the list to rename it"),
        *((f"TO {name}", name, "This group") for name in names),
        ("NONE", "No Group", "Out of any group"),
    ]


class HFX_OT_move_to_group(_SelectedEffects, shared.MenuOperator):
    """Move the selected effects to a group with a common gain, mute and start. Select them by the
    dots of the list or with Shift; the menu is below the minus beside the list. Key over the HFX
    tab: M"""

    bl_label = "Move to Group"
    bl_property = "group"

    group: EnumProperty(name="Group", description="Group of the effects", items=_groups)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show a list of the groups; the key M outside of the HFX tab is passed on."""
        is_in_tab = getattr(context.region, "active_panel_category", "") == "HFX"
        is_by_key = event.type == "M" and not self.properties.is_property_set("group")
        return {"PASS_THROUGH"} if is_by_key and not is_in_tab else super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> str:
        chosen, ending = effects.without_locked(swarms.selected_effects(context.scene))
        name = self.group.removeprefix("TO ")
        if name == self.group:
            name = effects.free_group(context.scene, "Group") if name == "NEW" else ""
        effects.set_group(context.scene, chosen, name)
        report = f"Effects moved: {len(chosen)}"
        return report + ending if ending else ""


class HFX_OT_add_rain(shared.OnBodyOperator):
    """Add rain on the body, or replace the rain of the same name"""

    bl_label = "Rain"
    adds_clips = True

    drops_per_second: FloatProperty(
        name="Drops per Second",
        description="On the whole body, at random times: 2 is a drizzle, 30 a shower",
        default=8.0,
        min=0.1,
        max=200.0,
    )
    drop_size: FloatProperty(
        name="Drop Size (mm)",
        description="Diameter of the skin area of a drop",
        default=20.0,
        min=1.0,
        max=200.0,
    )
    duration: FloatProperty(
        name="Duration",
        description="Duration of the rain, from the current frame on",
        default=4.0,
        min=0.1,
        unit="TIME_ABSOLUTE",
    )
    strength: FloatProperty(
        name="Strength (m/s²)",
        description="Peak acceleration of a drop's tap",
        default=5.0,
        min=0.0,
        max=100.0,
    )
    seed: IntProperty(name="Seed", description="Seed of the random drops", default=0, min=0)
    name: StringProperty(
        name="Name", description="Replaces rain of the same name on the same body", default="Rain"
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return framing.execute_with_room(self, context)

    def work(self, context: bpy.types.Context) -> str:
        from ...authoring.effects import rain

        rain_objects = rain.add_rain(
            context.scene,
            shared.target_body(context),
            name=self.name or "Rain",
            drops_per_second=self.drops_per_second,
            drop_size_m=self.drop_size / 1000.0,
            frame=float(context.scene.frame_current),
            duration_s=self.duration,
            strength_m_s2=self.strength,
            seed=self.seed,
        )
        shared.select_only(context, *rain_objects)
        return f"{round(self.drops_per_second * self.duration)} drops"


_keys = shared.KeyBindings("User Interface", ("hfx.move_to_group", "M", {}, {}))
register, unregister = _keys.register, _keys.unregister
