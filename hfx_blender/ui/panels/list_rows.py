# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows of the sidebar: list of all effects of a scene, and times of the active effect's clips.

Effects of one group (rain, a sensation) are an expandable row. NLA strips cannot have custom
properties, so their times in the scene's unit are properties of rows. All rows are stored in the
window manager, not in files, and rebuilt after a check of the scene, if effects or the number of
clips have changed.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, StringProperty

from ...authoring import clips
from ...authoring.effects import effects, swarms
from ...blender.events import push_undo_soon
from ...blender.scene_info import frame_at, frames_per_shown_unit, shown_time
from ...engine.modality import MODALITIES
from ...errors import InputError
from ...operators import shared
from ...operators.effects.clip_operators import TIMES, join_tracks, label_of
from ...playback.preview.preview import preview
from ..sidebar import filtered

_open: set[str] = set()
"""Names of the open groups."""


def rows_of(scene: bpy.types.Scene) -> list[tuple[str, str]]:
    """Rows of the list as (effect, group): a group's row has an empty effect, and precedes its
    effects.

    A group of a single effect has no row of its own, unless its gain differs from 1.
    """
    grouped: dict[tuple[str, str], list[str]] = {}
    gains: dict[str, float] = {}
    for effect in _in_order(scene):
        group = effects.group_of(effect)
        gains[group] = effect.hfx.group_gain
        grouped.setdefault((group, "" if group else effect.name), []).append(effect.name)
    named_rows: list[tuple[str, str]] = []
    for (group, _), names in grouped.items():
        is_alone = len(names) == 1 and (not group or gains[group] == 1.0)
        named_rows += [] if is_alone else [("", group)]
        named_rows += [(name, "" if is_alone else group) for name in names]
    return named_rows


def _in_order(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Listed effects by name, or by the start of the first clip; without clips first."""

    def first_start(effect: bpy.types.Object) -> float:
        return min((strip.frame_start for _, strip in clips.strips_of(effect)), default=-inf)

    listed = swarms.listed_effects(scene)
    return sorted(listed, key=first_start) if scene.hfx.list_order == "TIME" else listed


def refresh() -> None:
    """Rebuild rows if the scene's effects, or the number of the active effect's clips, have
    changed; never call this while Blender draws."""
    join_tracks()
    manager = bpy.context.window_manager
    new_rows = rows_of(bpy.context.scene)
    if [(row.effect, row.group) for row in manager.hfx_rows] != new_rows:
        _select_strips_of_copies({row.effect for row in manager.hfx_rows})
        manager.hfx_rows.clear()
        for effect_name, group in new_rows:
            row = manager.hfx_rows.add()
            row.name, row.effect, row.group = effect_name or group, effect_name, group
        preview.redraw()
    # A timer right after loading has no window, hence no active object.
    effect = shared.active_effect(bpy.context) if hasattr(bpy.context, "object") else None
    count = 0 if effect is None else len(clips.strips_of(effect))
    if len(manager.hfx_clips) != count:
        manager.hfx_clips.clear()
        for _ in range(count):
            manager.hfx_clips.add()
        preview.redraw()


def _select_strips_of_copies(known: set[str]) -> None:
    """Select the NLA strips of new selected copies of effects, and no others; ``known``: names of
    the effects before. Blender's *Duplicate* keeps and copies the selection of strips."""
    listed = swarms.listed_effects(bpy.context.scene)
    ids = {effect.hfx.uid for effect in listed if effect.name in known}
    added = [effect for effect in listed if effect.name not in known and effect.select_get()]
    copies = [effect for effect in added if effect.hfx.uid in ids]
    if copies and len(listed) > len(known - {""}):  # a renamed effect adds none
        clips.deselect_all()
        for _, strip in (found for copy in copies for found in clips.strips_of(copy)):
            strip.select = True


def _effects_of_row(row: HfxEffectRow) -> list[bpy.types.Object]:
    """Effects of a row: one, or all of its group; empty after they were deleted or renamed."""
    scene = bpy.context.scene
    own = scene.objects.get(row.effect)
    if own is not None and own.hfx.role == "EFFECT":
        return [own]
    listed = swarms.listed_effects(scene)
    if row.effect:  # effects of a swarm
        return [effect for effect in listed if effect.name == row.effect]
    return [effect for effect in listed if effects.group_of(effect) == row.group]


def is_shown(row: HfxEffectRow) -> bool:
    """Test for a row in the list without a search: not of an effect in a closed group."""
    return not (row.effect and row.group) or row.is_open


def _has(name: str) -> Callable[[HfxEffectRow], bool]:
    return lambda row: all(
        getattr(effect.hfx, _stored(row, name)) for effect in _effects_of_row(row)
    )


def _stored(row: HfxEffectRow, name: str) -> str:
    """Property of the effects of a row: a group is muted apart from its effects."""
    return "is_group_muted" if name == "is_muted" and not row.effect else name


def _set(name: str) -> Callable[[HfxEffectRow, bool], None]:
    def set_all(row: HfxEffectRow, value: bool) -> None:
        for effect in _effects_of_row(row):
            setattr(effect.hfx, _stored(row, name), value)
        # Values set from Python cause no depsgraph update: the check tags the effects.
        preview.schedule_check()
        push_undo_soon()

    return set_all


def _is_open(row: HfxEffectRow) -> bool:
    return row.group in _open  # in a lambda of an annotation, Blender does not know the name


def _set_open(row: HfxEffectRow, value: bool) -> None:
    (_open.add if value else _open.discard)(row.group)


def _is_selected(row: HfxEffectRow) -> bool:
    row_effects = _effects_of_row(row)
    scene = bpy.context.scene
    return bool(row_effects) and all(swarms.is_selected(scene, effect) for effect in row_effects)


def _set_selected(row: HfxEffectRow, value: bool) -> None:
    context = bpy.context
    for obj in _objects_of(row):
        if shared.is_in_view_layer(context, obj):
            obj.select_set(value)
            if value and (context.object is None or not context.object.select_get()):
                context.view_layer.objects.active = obj
    push_undo_soon()


def _objects_of(row: HfxEffectRow) -> list[bpy.types.Object]:
    """Objects that show the effects of a row."""
    scene = bpy.context.scene
    shown = (swarms.objects_showing(scene, effect) for effect in _effects_of_row(row))
    return [obj for objects in shown for obj in objects]


def _rename_group(row: HfxEffectRow, name: str) -> None:
    members = _effects_of_row(row)
    if members and name and name != row.group:
        free_name = effects.free_group(bpy.context.scene, name)
        _open.update({free_name} if row.is_open else ())
        for member in members:
            member.hfx.group = free_name
        preview.schedule_check()
        push_undo_soon()


class HfxEffectRow(bpy.types.PropertyGroup):
    """Row of the list: an effect, or a group of effects."""

    effect: StringProperty(name="Effect", description="The effect's name; empty: a group")
    group: StringProperty(name="Group", description="Group of the effect")
    title: StringProperty(
        name="Group",
        description="Name of the group. Double-click to rename it",
        get=lambda row: row.group,
        set=_rename_group,
    )
    is_selected: BoolProperty(
        name="Select",
        description="Selected. Drag over several icons to select or deselect several effects",
        get=_is_selected,
        set=_set_selected,
    )
    is_open: BoolProperty(
        name="Open", description="Show the effects of the group", get=_is_open, set=_set_open
    )
    is_muted: BoolProperty(
        name="Mute",
        description="Silent, also in exports",
        get=_has("is_muted"),
        set=_set("is_muted"),
    )
    is_solo: BoolProperty(
        name="Solo",
        description="Only effects that are solo are felt and exported",
        get=_has("is_solo"),
        set=_set("is_solo"),
    )


class HFX_UL_effects(bpy.types.UIList):
    """Effects and groups of effects"""

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        _data: object,
        row: HfxEffectRow,
        _icon: int,
        _active_data: object,
        _active_property: str,
    ) -> None:
        row_effects = _effects_of_row(row)
        if not row_effects:  # deleted or renamed since the last check
            layout.label(text=row.name, translate=False)
            return
        column = layout.column(align=True)
        line = column.row(align=True)
        has_several = bool(row.effect) and len(effects.bodies_of(context.scene)) > 1
        shows_body = has_several and row_effects[0].hfx.kind in effects.ON_A_BODY
        if row.effect and row.group:
            line.separator(factor=0.5)
        elif not row.effect:
            icon = "DOWNARROW_HLT" if row.is_open else "RIGHTARROW"
            line.prop(row, "is_open", text="", icon=icon, emboss=False)
        strips = clips.strips_of(row_effects[0]) if row.effect else []
        is_alert = any(effects.needs_body(context.scene, effect) for effect in row_effects) or any(
            clips.outside_scene(context.scene, strip) is not None for _, strip in strips
        )
        # The icon is the switch, as a column of switches would shorten the name.
        icon = MODALITIES[row_effects[0].hfx.modality].icon if row.effect else "OUTLINER_COLLECTION"
        icon = "ERROR" if row.effect and is_alert else icon
        switch = line.row(align=True)
        switch.scale_x = 0.9
        switch.prop(row, "is_selected", text="", icon=icon, emboss=row.is_selected)
        title = line.row(align=True)
        title.alert = is_alert
        if row.effect:
            effect = row_effects[0]
            if effect.is_editable and effect.override_library is None:
                title.prop(effect, "name", text="", emboss=False)
            else:  # a greyed name could not be read in red
                title.label(text=effect.name, translate=False)
            if shows_body:
                body = effects.body_in(context.scene, effect)
                below = column.row()
                below.scale_y, below.active = 0.7, False
                below.label(text=body.name if body else "", icon="BLANK1", translate=False)
            title.active = not effects.is_locked(effect)
            if not title.active:
                line.label(text="", icon="LINKED")
        else:
            title.prop(row, "title", text="", emboss=False)
            line.label(text=f"{len(row_effects)}")
        line = line.row(align=True)
        line.alignment, line.scale_x = "RIGHT", 0.85  # most of the width is for the name
        for name, on, off in (
            ("is_solo", "SOLO_ON", "SOLO_OFF"),
            ("is_muted", "MUTE_IPO_OFF", "MUTE_IPO_ON"),  # Blender's "on" is the sound
        ):
            icon = on if getattr(row, name) else off
            locked = next(filter(effects.is_locked, row_effects), None)
            if locked is None:
                line.prop(row, name, text="", icon=icon, emboss=False)
            else:  # Blender greys out a property of a linked object, and its tooltip says why
                line.prop(locked.hfx, _stored(row, name), text="", icon=icon, emboss=False)

    def filter_items(
        self, _context: bpy.types.Context, manager: bpy.types.WindowManager, name: str
    ) -> tuple[list[int], list[int]]:
        rows = getattr(manager, name)
        return filtered(self, ((f"{row.effect} {row.group}", is_shown(row)) for row in rows))


def _active_row(manager: bpy.types.WindowManager) -> int:
    """Index of the active effect's row, or of the row of its closed group; -1 without any."""
    active = bpy.context.object
    if active is None:
        return -1
    shown = active.get("hfx_painted_effect") or shared.active_effect(bpy.context) or active
    group = effects.group_of(shown)
    for index, row in enumerate(manager.hfx_rows):
        # In a closed group, the row of the group is highlighted instead of the effect's.
        if row.effect == shown.name or (not row.effect and row.group == group and group):
            if row.effect or group not in _open:
                return index
    return -1


def _select_row(_manager: bpy.types.WindowManager, index: int) -> None:
    # Blender hands no modifier keys to properties, but to operators.
    bpy.ops.hfx.select_effects("INVOKE_DEFAULT", row=index)


class HFX_OT_select_effects(shared.HfxOperator):
    """Select the effects of a row of the list"""

    bl_label = "Select Effects"
    bl_options = {"INTERNAL"}

    row: IntProperty(name="Row", description="Number of the row, from 0")
    extend: BoolProperty(
        name="Extend", description="Select all rows from the active row on, as with Shift"
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.extend = event.shift
        return self.execute(context)

    def work(self, context: bpy.types.Context) -> None:
        manager = context.window_manager
        try:
            shared.to_object_mode(context)
        except InputError:
            return  # painting goes on
        if 0 <= self.row < len(manager.hfx_rows):
            first = _active_row(manager) if self.extend else self.row
            first = self.row if first < 0 else first
            between = range(min(first, self.row), max(first, self.row) + 1)
            rows = [self.row, *(index for index in between if index != self.row)]
            shown = [obj for index in rows for obj in _objects_of(manager.hfx_rows[index])]
            shared.select_only(context, *shown)
            push_undo_soon()


def _strip(row: HfxClipRow) -> bpy.types.NlaStrip | None:
    """NLA strip of the active effect at the row's position; None beyond the last strip."""
    effect, rows = shared.active_effect(bpy.context), bpy.context.window_manager.hfx_clips
    # Blender passes the row alone. The position of the row is that of the strip.
    index = next(k for k, candidate in enumerate(rows) if candidate == row)
    strips = [] if effect is None else clips.strips_of(effect)
    return strips[index][1] if index < len(strips) else None


def _time(time: str, of_strip: str, **limits: float) -> FloatProperty:
    """Property for an attribute of a row's NLA strip, in the scene's time unit; else 0."""
    is_length = time.startswith("fade")

    def get(row: HfxClipRow) -> float:
        strip = _strip(row)
        if strip is None:
            return 0.0
        scene, frame = bpy.context.scene, getattr(strip, of_strip)
        return frame / frames_per_shown_unit(scene) if is_length else shown_time(scene, frame)

    def set_time(row: HfxClipRow, value: float) -> None:
        strip, scene = _strip(row), bpy.context.scene
        if strip is not None:
            frame = value * frames_per_shown_unit(scene) if is_length else frame_at(scene, value)
            setattr(strip, of_strip, frame)
            preview.schedule_check()
            push_undo_soon()

    return FloatProperty(
        name=label_of(time), description=TIMES[time], get=get, set=set_time, **limits
    )


def active_group() -> list[bpy.types.Object]:
    """Listed effects of the active effect's group; empty without a group."""
    effect = shared.active_effect(bpy.context)
    name = "" if effect is None else effects.group_of(effect)
    listed = swarms.listed_effects(bpy.context.scene) if name else []
    return [member for member in listed if effects.group_of(member) == name]


def _start(_manager: object) -> float:
    starts = [
        strip.frame_start for effect in active_group() for _, strip in clips.strips_of(effect)
    ]
    return shown_time(bpy.context.scene, min(starts)) if starts else 0.0


def _gain(_manager: object) -> float:
    members = active_group()
    return float(members[0].hfx.group_gain) if members else 1.0


def _set_gain(_manager: object, value: float) -> None:
    for member in active_group():
        member.hfx.group_gain = value
    preview.schedule_check()
    push_undo_soon()


def _set_start(manager: object, value: float) -> None:
    frames = (value - _start(manager)) * frames_per_shown_unit(bpy.context.scene)
    clips.shift_times(active_group(), frames)
    preview.schedule_check()
    push_undo_soon()


class HfxClipRow(bpy.types.PropertyGroup):
    """Times of a clip in the scene's unit."""

    start: _time("start", "frame_start_ui")
    end: _time("end", "frame_end_ui")
    fade_in: _time("fade_in", "blend_in", min=0.0)
    fade_out: _time("fade_out", "blend_out", min=0.0)


def register() -> None:
    bpy.types.WindowManager.hfx_rows = CollectionProperty(type=HfxEffectRow)
    bpy.types.WindowManager.hfx_row = IntProperty(
        name="Effect", description="Select the effect", get=_active_row, set=_select_row
    )
    bpy.types.WindowManager.hfx_clips = CollectionProperty(type=HfxClipRow)
    bpy.types.WindowManager.hfx_group_start = FloatProperty(
        name="Start of the Group",
        description="Start of the group's first clip; all its clips and keyframes move along",
        get=_start,
        set=_set_start,
    )
    bpy.types.WindowManager.hfx_group_gain = FloatProperty(
        name="Gain of the Group",
        description="Common factor of the intensities of all effects of the group",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        get=_gain,
        set=_set_gain,
    )
    preview.on_scene_checked.append(refresh)


def unregister() -> None:
    preview.on_scene_checked.remove(refresh)
    del bpy.types.WindowManager.hfx_group_gain
    del bpy.types.WindowManager.hfx_group_start
    del bpy.types.WindowManager.hfx_clips
    del bpy.types.WindowManager.hfx_row
    del bpy.types.WindowManager.hfx_rows
