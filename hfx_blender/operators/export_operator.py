# SPDX-License-Identifier: GPL-3.0-or-later
"""Exporting the scene from within Blender."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..authoring import clips, painting
from ..authoring.effects import effects, swarms
from ..blender.events import add_handlers, remove_handlers
from ..blender.translation import translated
from ..errors import InputError
from ..export.result_files import scene_stem
from ..formats.registry import EXPORTED, FORMATS
from ..playback.live.live import live
from ..text import printable, shortened
from .shared import HfxOperator, StepwiseExport, draw_wrapped

if TYPE_CHECKING:
    from ..export.report import ExportReport

_INFOS = [FORMATS[id] for id in EXPORTED]
_TRACK = FORMATS["track"].suffix
FORMAT_ITEMS = tuple(
    (info.id, info.dialog[0], info.dialog[1], 1 << info.dialog[2]) for info in _INFOS if info.dialog
)
_RECORD_ITEMS = (
    ("positions", "Positions", "Position of each vertex", 1),
    ("velocities", "Velocities", "Velocity of each vertex", 2),
    ("depth", "Depth", "Depth of each vertex inside a volume", 4),
)
_LINE = 36  # letters in a line of the file browser's sidebar
_NAMED = 3  # number of files named in the report
_POPUP_UNITS = 26  # width of the popup, in Blender's units of 20 pixels
_POPUP_LINE, _LINES = 90, 4  # letters, and lines, of a sentence
_WARNINGS, _EFFECTS = 8, 12  # limits of the popup: with two lines each, a window holds them
_REPORT = "Haptic Export Report"
_PURPOSES: dict[str, tuple[str, str, set[str], str]] = {
    "GAME": ("My Game", "Game Clip, for the players in games", {"clip"}, "oculus_touch"),
    "PHONE": ("My Phone", "AHAP for iPhone, .he for Android", {"ahap", "he"}, "phone_wide_band"),
    "BHAPTICS": ("bHaptics", "Projects of bHaptics", {"tact"}, "bhaptics_tactsuit_x40"),
    "HARDWARE": ("My Own Hardware", "Track and CSV", {"track", "csv"}, "arduino_uno_pwm"),
    "SOUND": ("Sound Card", "WAV, a channel for each actuator", {"wav"}, "sound_card_8"),
}
"""Label, tooltip, formats and a device with output in these formats, by purpose."""


@dataclass(frozen=True)
class LastExport:
    """Result of an export of the open file, for the panel and the popup."""

    text: str
    report: ExportReport
    has_clips_outside: bool  # True: clips outside of the scene's frame range

    @property
    def warned(self) -> str:
        """End of a sentence with the number of warnings; empty without warnings."""
        count = len(self.report.warnings)
        return "" if not count else ", 1 warning" if count == 1 else f", {count} warnings"


last_written: list[LastExport] = []  # at most one entry


def _box_of(flags: str, name: str) -> str:
    """Property name of the check box of item ``name`` of an enum of flags, as ``formats_csv``."""
    return f"{flags}_{name.replace('-', '_')}"


def _check_box(flags: str, name: str, label: str, tip: str) -> BoolProperty:
    """Check box for an item ``name`` of the property ``flags``: a click on an enum flag itself
    would clear all other flags."""

    def is_chosen(self: HFX_OT_export) -> bool:
        return name in getattr(self, flags)

    def choose(self: HFX_OT_export, is_on: bool) -> None:
        others = getattr(self, flags) - {name}
        setattr(self, flags, others | {name} if is_on else others)

    options = {"SKIP_SAVE", "HIDDEN"}
    return BoolProperty(name=label, description=tip, get=is_chosen, set=choose, options=options)


def _purpose(operator: HFX_OT_export) -> int:
    """Number of the purpose with the chosen formats; that of "Other" without any."""
    formats = [purpose[2] for purpose in _PURPOSES.values()]
    return formats.index(operator.formats) if operator.formats in formats else len(formats)


def _choose_purpose(operator: HFX_OT_export, number: int) -> None:
    for _, _, formats, _ in [*_PURPOSES.values()][number : number + 1]:
        operator.formats = formats


def _has_area(context: bpy.types.Context) -> bool:
    """Test for an effect that is not painted, has an area, or is being painted; True without
    effects in the scene itself."""
    own = effects.effects_of(context.scene)
    return not own or any(
        effect.hfx.kind != "PAINTED" or effect.get(effects.VERTICES) or painting.canvas_of(effect)
        for effect in own
    )


class HFX_OT_export(StepwiseExport, ExportHelper):
    """Record the scene's haptic track, and what its devices play, into a folder"""

    bl_label = "Export Haptics"
    bl_options = {"REGISTER", "PRESET"}
    requires = (*StepwiseExport.requires, (_has_area, "Paint the effect first: it has no area yet"))

    filter_glob: StringProperty(default=f"*{_TRACK}", options={"HIDDEN"})
    formats: EnumProperty(
        name="Formats",
        description="Formats to write; formats of devices are written for each device of the scene",
        items=FORMAT_ITEMS,
        options={"ENUM_FLAG"},
        default={"track", "csv"},
    )
    purpose: EnumProperty(
        name="For",
        description="Purpose of the export, which selects the formats",
        items=(
            *((name, *texts[:2]) for name, texts in _PURPOSES.items()),
            ("OTHER", "Other", "The formats chosen below"),
        ),
        options={"SKIP_SAVE"},
        get=_purpose,
        set=_choose_purpose,
    )
    per_clip: BoolProperty(
        name="Each Clip by Itself",
        description="Separate files for each named clip, starting at time 0, instead of the "
        "whole timeline",
    )
    record: EnumProperty(
        name="Also Record",
        description="Additional data of each vertex in the track",
        items=_RECORD_ITEMS,
        options={"ENUM_FLAG"},
        default=set(),
    )
    full_precision: BoolProperty(
        name="Full Precision", description="Weights as 32-bit floats instead of 8 bits"
    )

    # Blender makes properties of annotations, and the formats are known only here.
    __annotations__ |= {
        _box_of(flags, name): _check_box(flags, name, *rest)
        for flags, items in (("formats", FORMAT_ITEMS), ("record", _RECORD_ITEMS))
        for name, *rest, _ in items
    }

    @property
    def filename_ext(self) -> str:
        """End of the proposed file name: that of the first chosen format."""
        suffixes = (info.suffix for info in _INFOS if info.id in self.formats)
        # Blender replaces the part after the last dot.
        return "." + next(suffixes, _TRACK).rpartition(".")[2]

    def draw(self, context: bpy.types.Context) -> None:
        from ..devices.configurations.device_facts import facts_of
        from ..formats.writing import why_nothing

        layout = self.layout
        exported = [entry for entry in context.scene.hfx.devices if entry.is_exported]
        facts = [facts_of(entry.name).device for entry in exported]
        devices = [device for device in facts if device is not None]
        reasons = {info.id: why_nothing(info.id, devices) for info in _INFOS}
        layout.label(text="Export For", icon="EXPORT")
        layout.column(align=True).prop(self, "purpose", expand=True)
        missing = [reasons[name] for name in EXPORTED if name in self.formats and reasons[name]]
        for reason in dict.fromkeys(missing):
            draw_wrapped(layout.column(align=True), reason, _LINE, "ERROR")
        if missing and self.purpose in _PURPOSES:
            device = _PURPOSES[self.purpose][3]
            add = layout.operator(
                "hfx.live_add", text=translated(f"Add {facts_of(device).title}"), icon="ADD"
            )
            add.name = device
        labels = [label for name, label, *_ in FORMAT_ITEMS if name in self.formats]
        writes = f"Writes {', '.join(labels)}" if labels else "Choose the formats below"
        draw_wrapped(layout.column(align=True), writes, _LINE, "FILE_TICK")
        layout.label(text="Devices", icon="OUTLINER_OB_FORCE_FIELD")
        draw_devices(context, layout)
        header, body = layout.panel("hfx_export_formats", default_closed=True)
        header.label(text="Formats")
        if body is None:
            return
        for title, is_of_device in (("Of the Track", False), ("Of Devices", True)):
            column = body.column(align=True)
            names = [info.id for info in _INFOS if info.is_of_device == is_of_device]
            column.label(text=title)
            for name in names:
                row = column.row()
                row.enabled = not reasons[name]
                row.prop(self, _box_of("formats", name))
            for reason in dict.fromkeys(reasons[name] for name in names if reasons[name]):
                draw_wrapped(column, reason, _LINE, "INFO")
        body.prop(self, "per_clip")
        body.prop(self, "full_precision")
        column = body.column(align=True)
        column.label(text="Also Record")
        for name, *_ in _RECORD_ITEMS:
            column.prop(self, _box_of("record", name))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        from ..reading.description import scene_description
        from ..reading.description.scene_settings import scene_devices

        self._is_invoked = True
        # A scene that cannot be exported is refused before the questions of the dialog.
        scene_description.find(context.scene, context.view_layer)
        devices, _ = scene_devices(context.scene)
        if not self.properties.is_property_set("formats"):
            # Special purposes only for devices made for them: .tact could hold other layouts, too.
            makers = {device.id.partition("_")[0] for device in devices}
            special = (name for name in ("BHAPTICS", "PHONE", "SOUND") if name.lower() in makers)
            name = next(special, "HARDWARE")
            self.formats = _PURPOSES[name][2] if devices else {"track"}
        return ExportHelper.invoke(self, context, event)  # type: ignore[no-any-return]

    def export_steps(self, context: bpy.types.Context) -> Generator[float, None, ExportReport]:
        from ..export.scene_export import ExportSettings, SceneExport
        from ..formats.writing import why_nothing
        from ..reading.description.scene_settings import formats_without, scene_devices

        scene = context.scene
        devices, missing = scene_devices(scene)
        # Sort by the list of formats: sets have no order.
        formats = tuple(id for id in EXPORTED if id in self.formats)
        formats = formats_without(missing, formats, devices)
        if self._is_invoked:  # disabled formats count as cleared
            formats = tuple(name for name in formats if not why_nothing(name, devices))
        # The defaults include formats of devices: only a choice of these needs devices.
        if not devices:
            of_devices = {id for id in formats if FORMATS[id].is_of_device}
            if self.properties.is_property_set("formats") and of_devices:
                raise InputError(
                    f"Scene '{scene.name}' has no devices to export: add or tick one in the panel "
                    "Haptic Export, or choose formats that need no device."
                )
            formats = tuple(id for id in formats if id not in of_devices)
        if not formats:
            raise InputError("Choose at least one format to export.")
        path = Path(bpy.path.abspath(self.filepath)).absolute()
        if not self.filepath or path.is_dir():
            raise InputError(f"Choose a file to export to; '{self.filepath}' is not a file name.")
        settings = ExportSettings(
            formats,
            devices,
            missing=missing,
            full_precision=self.full_precision,
            record=tuple(name for name, *_ in _RECORD_ITEMS if name in self.record),
            per_clip=self.per_clip,
        )
        return SceneExport(scene, settings).steps(path.parent, scene_stem(path))

    def finished(self, context: bpy.types.Context, report: ExportReport) -> str:
        for warning in report.warnings:
            self.report({"WARNING"}, translated(printable(warning)))
        track = next((file for file in report.files if file.suffix == _TRACK), None)
        if track is not None:
            live.tracks.select_written(context.scene, str(track))
        names = [file.name for file in report.files]
        more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        shown = f"{', '.join(names[:_NAMED])}{more}"
        listed = swarms.listed_effects(context.scene)
        strips = (strip for effect in listed for _, strip in clips.strips_of(effect))
        is_outside = any(clips.outside_scene(context.scene, strip) is not None for strip in strips)
        written = LastExport(f"Wrote {shown}", report, is_outside)
        last_written[:] = [written]
        if self._is_invoked and not bpy.app.background:
            # Unlike a menu, a popover does not open with the mouse on the button clicked last.
            context.window_manager.popover(draw_written, ui_units_x=_POPUP_UNITS)
        return f"Wrote {shown} to {report.folder}{written.warned}"


def draw_devices(context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
    """Draw a check box for each device of the scene, and the menu that adds a device."""
    from ..devices.configurations.device_facts import facts_of

    column = layout.column(align=True)
    for device in context.scene.hfx.devices:
        column.prop(device, "is_exported", text=facts_of(device.name).title)
    column.operator_menu_enum("hfx.live_add", "name", icon="ADD")


def draw_written(menu: bpy.types.UIPopover, context: bpy.types.Context) -> None:
    """Draw the last export: warnings, unfelt effects with reasons, times of felt effects, files,
    and buttons with cures."""
    layout = menu.layout

    def button(operator: str, **texts: str) -> bpy.types.OperatorProperties:
        # A popover opens with the mouse in its middle, at the height of the first button.
        return layout.split(factor=0.4).operator(operator, **texts)

    layout.label(text="Haptic Export", icon="EXPORT")
    for written in last_written:
        report = written.report
        for warning in shortened(report.warnings, _WARNINGS):
            text = printable(warning[:1].upper() + warning[1:])
            draw_wrapped(layout, text, _POPUP_LINE, "ERROR", _LINES)
        if written.has_clips_outside:
            button("hfx.extend_scene", icon="PREVIEW_RANGE").which = "ALL"
        if report.warnings:
            layout.separator()
        unplayed = {lost["effect"] for lost in report.unrendered if lost["share"] == 1.0}
        facts = sorted(
            report.effects, key=lambda fact: (bool(fact["felt"]), fact["effect"] not in unplayed)
        )
        for fact in facts[:_EFFECTS]:
            name, icon = fact["effect"], "CHECKMARK"
            if not fact["felt"]:
                text, icon = f"{name}: not felt, as it {fact['reason']}", "X"
            else:
                times = translated(_times_of(context.scene, fact))
                text = f"{name}: felt {times}"
                if name in unplayed:
                    text, icon = f"{name}: {times}, but no chosen device plays it", "ERROR"
            draw_wrapped(layout, printable(text), _POPUP_LINE, icon, _LINES)
        if len(facts) > _EFFECTS:
            layout.label(
                text=translated(f"... and {len(facts) - _EFFECTS} more effects"), icon="BLANK1"
            )
        layout.separator()
        layout.label(text=translated(printable(written.text)), icon="FILE_TICK")
        folder = str(report.folder)
        button("wm.path_open", text="Open Folder", icon="FILE_FOLDER").filepath = folder
        button("hfx.show_report", icon="TEXT")


def _times_of(scene: bpy.types.Scene, fact: Mapping[str, Any]) -> str:
    """First and last second of a felt effect, and the number of its clips if several."""
    effect = scene.objects.get(fact["effect"])
    strips = [] if effect is None else [s for _, s in clips.strips_of(effect) if not s.mute]
    times = f"from {fact['from_s']:.2f} to {fact['to_s']:.2f} s"
    return f"{times}, in {len(strips)} clips" if len(strips) > 1 else times


class HFX_OT_show_report(HfxOperator):
    """Show the whole report of the last export in a Text Editor"""

    bl_label = "Show Report"
    bl_options = {"REGISTER"}
    requires = ((lambda _context: last_written, "Export first"),)

    def work(self, context: bpy.types.Context) -> None:
        from ..export.report import describe

        text = bpy.data.texts.get(_REPORT) or bpy.data.texts.new(_REPORT)
        text.from_string(describe(last_written[0].report))
        text.cursor_set(0)
        if not bpy.app.background:
            bpy.ops.wm.window_new()
            area = context.window_manager.windows[-1].screen.areas[0]
            area.type = "TEXT_EDITOR"
            area.spaces.active.text = text
            area.spaces.active.show_word_wrap = True


@bpy.app.handlers.persistent
def _forget(file: object) -> None:
    last_written.clear()  # of another file, or another state of this file
    if isinstance(file, str):  # undo and redo pass a scene
        live.tracks.written.clear()
    else:
        live.tracks.restore_written()


_HANDLERS = dict.fromkeys(("load_post", "undo_post", "redo_post"), _forget)


def register() -> None:
    add_handlers(_HANDLERS)


def unregister() -> None:
    remove_handlers(_HANDLERS)
