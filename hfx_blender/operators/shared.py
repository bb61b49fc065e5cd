# SPDX-License-Identifier: GPL-3.0-or-later
"""Base classes of the operators, and lookups of the active effect and body."""

from __future__ import annotations

import sys
import textwrap
import time
from collections.abc import Callable, Generator
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar
from unicodedata import east_asian_width

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..authoring import clips, painting
from ..authoring.effects import effects, swarms
from ..avatars.avatar_meshes import armature_of
from ..blender.translation import translated
from ..engine.stepwise import finish
from ..errors import HfxError, InputError, fault_of_file
from ..files.atomic import inputs_kept
from ..playback.preview.preview import preview
from ..reading.stepped.reached import has_effects
from ..text import printable
from . import framing

if TYPE_CHECKING:
    from ..export.report import ExportReport

_AT_ONCE_S = 0.2  # work of a stepwise operator between two redraws
_PAUSE_S = 0.01

_PACKAGES = set("numpy scipy trimesh fast_simplification serial sounddevice websockets".split())
"""Packages bundled as wheels; the small zip has only those in pure Python."""

Requirement = tuple[Callable[[bpy.types.Context], object], str]
"""Condition of an operator, and the instruction for the user if it is false."""

IN_OBJECT_MODE: Requirement = (lambda context: context.mode == "OBJECT", "Go to Object Mode first")
ON_MESH: Requirement = (
    lambda context: context.object is not None and context.object.type == "MESH",
    "Select a mesh",
)


class HfxOperator(bpy.types.Operator):
    """Base of the operators: runs :meth:`work` and turns :class:`HfxError` into an error report."""

    bl_options = {"REGISTER", "UNDO"}
    requires: ClassVar[tuple[Requirement, ...]] = ()
    leaves_mode: ClassVar[bool] = False
    """True for operators that start in Object Mode, as new objects become active."""
    adds_clips: ClassVar[bool] = False
    """True for operators whose NLA strips shall be the only selected strips, as new objects are."""

    def __init_subclass__(cls, **options: object) -> None:
        """Set id and tooltip: ``HFX_OT_add_clip`` is ``hfx.add_clip``, as Blender names the class
        of an id; the tooltip is the docstring's paragraphs as sentences, without line breaks."""
        super().__init_subclass__(**options)
        if cls.__name__.startswith("HFX_OT_"):
            cls.bl_idname = "hfx." + cls.__name__.removeprefix("HFX_OT_")
        if cls.__doc__ and "bl_description" not in cls.__dict__:
            paragraphs = (" ".join(paragraph.split()) for paragraph in cls.__doc__.split("\n\n"))
            cls.bl_description = ". ".join(
                paragraph.rstrip(".") for paragraph in paragraphs if paragraph
            )
        for name in ("invoke", "modal"):
            if name in cls.__dict__:
                setattr(cls, name, _reporting_faults(cls.__dict__[name]))

    def work(self, context: bpy.types.Context) -> str | None:
        """Run the operator; returns the report, or None or "" without a report."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        def work_in_mode() -> str | None:
            if self.leaves_mode:
                to_object_mode(context)
            if self.adds_clips:
                clips.deselect_all()
            return self.work(context)

        return self.reported(work_in_mode)

    def reported(self, work: Callable[[], str | None]) -> set[str]:
        """Call a function and report the returned text, if any.

        :class:`HfxError`, errors of files and missing bundled packages become error reports; other
        exceptions pass. Returns the operator's result, ``{"FINISHED"}`` or ``{"CANCELLED"}``.
        """
        source = bpy.data.filepath
        try:
            # The open .blend file must not be overwritten by a result.
            with inputs_kept([Path(source)] if source else []):
                message = work()
        except (HfxError, OSError, ModuleNotFoundError) as error:
            self.report({"ERROR"}, translated(_fault_of(error)))
            return {"CANCELLED"}
        preview.schedule_check()
        if message:
            self.report({"INFO"}, translated(printable(message)))
        return {"FINISHED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        # The first unmet requirement is the hint in the tooltip of the disabled button. Later
        # conditions may rely on earlier ones.
        for is_met, hint in cls.requires:
            if not is_met(context):
                cls.poll_message_set(translated(hint))
                return False
        return True


def _fault_of(error: Exception) -> str:
    """Text of an error that a user can cause; raises the error again if it is a defect."""
    if isinstance(error, HfxError):
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return str(fault_of_file(error))
    # Packages missing from the small zip are named; other modules are defects.
    package = (getattr(error, "name", None) or "").partition(".")[0]
    if package not in _PACKAGES:
        raise error
    return (
        f"This needs the Python package {package}, which this Blender lacks: install the "
        "extension's zip for your platform, which brings it, or run "
        f"'{sys.executable} -m pip install {package}'."
    )


def _reporting_faults(method: Callable[..., set[str]]) -> Callable[..., set[str]]:
    """Wrap ``invoke`` or ``modal`` of an operator: errors of :func:`_fault_of` cancel with a
    report, after ``cancel`` of a modal operator, which Blender does not call after an exception."""

    @wraps(method)
    def reporting(
        self: HfxOperator, context: bpy.types.Context, event: bpy.types.Event
    ) -> set[str]:
        try:
            return method(self, context, event)
        except (HfxError, OSError, ModuleNotFoundError) as error:
            fault = _fault_of(error)
        if method.__name__ == "modal" and hasattr(self, "cancel"):
            self.cancel(context)
        self.report({"ERROR"}, translated(fault))
        return {"CANCELLED"}

    return reporting


def _is_editable(context: bpy.types.Context) -> bool:
    effect = painted_effect(context) or active_effect(context)
    return effect is None or not effects.is_locked(effect)


IS_EDITABLE: Requirement = (
    _is_editable,
    "The effect belongs to a linked file. Press Make Editable first",
)

ARE_TARGETS_EDITABLE: Requirement = (
    lambda context: (
        not any(
            effects.is_locked(target)
            for target in context.selected_objects
            if target.hfx.role == "EFFECT" and target != context.object
        )
    ),
    "A selected effect belongs to a linked file. Press Make Editable first",
)


class OnBodyOperator(HfxOperator):
    """Base of operators that add an object to a haptic body."""

    leaves_mode = True
    requires = (
        (
            lambda context: effects.bodies_of(context.scene),
            "Add an avatar, or mark an armature as haptic body first",
        ),
    )


class MenuOperator(HfxOperator):
    """Base of operators whose ``bl_property``, an enum, is chosen in a menu."""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run with a choice; without one, as from *Menu Search*, show the choices as a menu."""
        name, kind = self.bl_property, type(self)
        if self.properties.is_property_set(name):
            return self.execute(context)

        def draw(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
            menu.layout.operator_enum(kind.bl_idname, name)

        context.window_manager.popup_menu(draw, title=kind.bl_label)
        return {"CANCELLED"}


class ImportOperator(HfxOperator, ImportHelper):
    """Base of operators that read a file: a file dropped on the window, or one of a selector."""

    # Not remembered: a path that is set is a dropped file.
    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.properties.is_property_set("filepath"):
            return self.execute(context)
        return ImportHelper.invoke(self, context, event)  # type: ignore[no-any-return]


class FileOperator(HfxOperator):
    """Base of operators with a file selector."""

    filepath: StringProperty(name="File", subtype="FILE_PATH")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or self.first_path(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def first_path(self, context: bpy.types.Context) -> str:
        """Initial path of the file selector; empty for Blender's default."""
        return ""

    def path(self) -> Path:
        """Chosen file as an absolute path. Raises InputError: no file was chosen."""
        if not self.filepath:
            raise InputError("Choose a file.")
        return Path(bpy.path.abspath(self.filepath)).absolute()


class ModalTimer:
    """Mixin of modal operators that run on a timer of their window."""

    _timer = None  # no annotation: Blender would register a property

    def start_modal(self, context: bpy.types.Context, interval_s: float) -> None:
        """Add the timer and the modal handler."""
        self._timer = context.window_manager.event_timer_add(interval_s, window=context.window)
        context.window_manager.modal_handler_add(self)

    def stop_timer(self, context: bpy.types.Context) -> None:
        """Remove the timer and the status text; no effect without a timer."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
            context.workspace.status_text_set(None)


class StepwiseOperator(ModalTimer, HfxOperator):
    """Base of operators whose work is a generator of steps (:mod:`...stepwise`).

    A script runs all steps at once. In a window, steps run between redraws; the status bar shows
    progress, and other input is blocked, as the scene must not change.
    """

    doing: ClassVar[str]
    """Name of the work in the status bar."""

    doing_icon: ClassVar[str]

    cancelled: ClassVar[str]
    """Report after Esc."""

    # No annotations, of which Blender would make properties.
    _is_invoked = False
    _steps = None
    _share = 0.0

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        """Check the input; return a generator of progress (0..1), which returns the report."""
        raise NotImplementedError

    def work(self, context: bpy.types.Context) -> str:
        return finish(self.steps(context))

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self._is_invoked = True
        return self.execute(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self._is_invoked or bpy.app.background or context.window is None:
            return super().execute(context)

        def begin() -> None:
            self._steps = self.steps(context)
            self._share = 0.0
            self.start_modal(context, _PAUSE_S)
            self._show(context)

        # Errors of the input are reported now; only a begun generator makes the operator modal.
        begun = self.reported(begin)
        return {"RUNNING_MODAL"} if begun == {"FINISHED"} else begun

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run steps at timer events and report the end; Esc cancels; other input is blocked."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"WARNING"}, translated(self.cancelled))
            return {"CANCELLED"}
        # Input is swallowed: a change of the scene would invalidate what the generator has read.
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        # `reported` returns FINISHED after each piece; `_steps` is None after the last.
        went_on = self.reported(self._go_on)
        if self._steps is not None and went_on == {"FINISHED"}:
            self._show(context)
            return {"RUNNING_MODAL"}
        self.cancel(context)
        return went_on

    def _go_on(self) -> str:
        """Run steps for :data:`_AT_ONCE_S`; returns the report at the end, "" before."""
        assert self._steps is not None
        pause = time.monotonic() + _AT_ONCE_S
        try:
            while time.monotonic() < pause:
                self._share = next(self._steps)
        except StopIteration as end:
            self._steps = None
            return str(end.value)
        return ""

    def _show(self, context: bpy.types.Context) -> None:
        share, doing, icon = self._share, self.doing, self.doing_icon

        def draw(header: bpy.types.Header, _context: bpy.types.Context) -> None:
            row = header.layout.row()
            row.label(text=doing, icon=icon)
            row.progress(factor=share, text=f"{share:.0%}")
            row.label(text="Cancel", icon="EVENT_ESC")

        context.workspace.status_text_set(draw)

    def cancel(self, context: bpy.types.Context) -> None:
        """Close an unfinished generator, and remove timer and status text; also after the end."""
        self._is_invoked = False  # Blender's redo reuses this operator, without invoke
        if self._steps is not None:
            self._steps.close()
            self._steps = None
        self.stop_timer(context)


class StepwiseExport(StepwiseOperator):
    """Base of export operators: at once for a script, stepwise in a window."""

    bl_options = {"REGISTER"}
    doing, doing_icon = "Exporting Haptics", "EXPORT"
    cancelled = "Export cancelled: nothing was written"
    requires = ((lambda context: has_effects(context.scene), "Add a haptic effect first"),)

    def export_steps(self, context: bpy.types.Context) -> Generator[float, None, ExportReport]:
        """Start the export; the generator yields progress (0..1) and returns the export report."""
        raise NotImplementedError

    def finished(self, context: bpy.types.Context, report: ExportReport) -> str:
        """Text of the operator's report after an export."""
        raise NotImplementedError

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        painting.store_all_painted()  # as when a file is saved during painting
        # Errors in the input are raised here, by this call, before the generator's first step.
        steps = self.export_steps(context)

        def reporting() -> Generator[float, None, str]:
            return self.finished(context, (yield from steps))

        return reporting()


class KeyBindings:
    """Keys of operators in Blender's keymap ``keymap``, while the extension is enabled.

    The keys work in all editors. An entry is an operator's id, a key, its modifiers, and properties
    of the operator.
    """

    def __init__(
        self, keymap: str, *entries: tuple[str, str, dict[str, bool], dict[str, str]]
    ) -> None:
        self._keymap = keymap
        self._entries = entries
        self._added: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []

    def register(self) -> None:
        keyconfig = bpy.context.window_manager.keyconfigs.addon
        if keyconfig is None:  # no key configuration in background mode
            return
        keymap = keyconfig.keymaps.new(name=self._keymap, space_type="EMPTY")
        for operator, key, modifiers, properties in self._entries:
            item = keymap.keymap_items.new(operator, key, "PRESS", **modifiers)
            for name, value in properties.items():
                setattr(item.properties, name, value)
            self._added.append((keymap, item))

    def unregister(self) -> None:
        for keymap, item in self._added:
            keymap.keymap_items.remove(item)
        self._added.clear()


EnumItems = list[tuple[str, str, str]]


def kept_items(entries: Callable[[], EnumItems]) -> Callable[[object, object], EnumItems]:
    """Items function of a dynamic enum from a function of its entries, called at each query; keeps
    the strings alive, as Blender requires."""
    cached: EnumItems = []

    def items(_self: object, _context: object) -> EnumItems:
        cached[:] = entries()
        return cached

    return items


def draw_wrapped(
    layout: bpy.types.UILayout, text: str, letters: int, icon: str = "NONE", most: int = 1000
) -> None:
    """Draw a text, translated, in at most ``most`` lines of ``letters``; the icon precedes the
    first line."""
    text = translated(text)
    # Letters of Chinese, Japanese and Korean are as wide as two.
    wide = sum(east_asian_width(letter) in "WF" for letter in text)
    if wide:
        letters = letters * len(text) // (len(text) + wide)
    for number, line in enumerate(textwrap.wrap(text, letters, max_lines=most)):
        line_icon = "BLANK1" if number and icon != "NONE" else icon
        layout.label(text=line, icon=line_icon, translate=False)


def to_object_mode(context: bpy.types.Context) -> None:
    """Set the active object, if any, to Object Mode; InputError for a canvas in painting."""
    active = context.object
    if active is None or active.mode == "OBJECT":
        return
    if active.get("hfx_painted_effect") is not None:
        raise InputError("Finish painting first.")
    bpy.ops.object.mode_set(mode="OBJECT")


def select_only(context: bpy.types.Context, *objects: bpy.types.Object) -> None:
    """Deselect all objects, then select the given ones in the view layer.

    The first becomes active, if in the view layer. In a local view, the objects are added to the
    view. NLA strips of other objects are deselected.
    """
    clips.deselect_all(objects)
    for selected in context.selected_objects:
        selected.select_set(False)
    # Blender refuses to select objects of excluded collections, which are not in the view layer.
    visible = [obj for obj in objects if is_in_view_layer(context, obj)]
    framing.show_locally(context, visible)
    for obj in visible:
        obj.select_set(True)
    if visible and visible[0] == objects[0]:
        context.view_layer.objects.active = visible[0]


def is_in_view_layer(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Test for an object that can be selected or hidden: not only in excluded collections."""
    return any(member == obj for member in context.view_layer.objects)


def active_effect(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active object if an effect, or the only volume emitted by the active object or of its shape;
    else None."""
    # A timer has no active object while areas of the window change.
    obj = getattr(context, "object", None)
    if obj is None or obj.hfx.role == "EFFECT":
        return obj
    # A particle system or instancer stands for its volume, which is usually hidden itself, and a
    # mesh for the volume of its shape.
    shown = swarms.volumes_of(obj) or [o for o in obj.children if o.hfx.shape == "MESH"]
    volumes = [volume for volume in shown if volume.hfx.role == "EFFECT"]
    return volumes[0] if len(volumes) == 1 else None


def painted_effect(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active painted effect, also while its canvas mesh is active; None without any."""
    obj = context.object
    if obj is None:
        return None
    effect = obj.get("hfx_painted_effect") or active_effect(context)
    return effect if effect is not None and effect.hfx.kind == "PAINTED" else None


def active_armature(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active armature, or the armature deforming the active mesh; None without any."""
    obj = context.object
    if obj is None:
        return None
    if obj.type == "ARMATURE":
        return obj
    return armature_of(obj) if obj.type == "MESH" else None


def active_body(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active haptic body, or the body shown by the active mesh; None without any."""
    armature = active_armature(context)
    return armature if armature is not None and armature.hfx.role == "BODY" else None


def target_body(context: bpy.types.Context) -> bpy.types.Object | None:
    """Body for a new effect: active body, body of the active effect, or only body of the scene.

    None without a body. Raises InputError: several bodies, and none of them is active.
    """
    bodies = effects.bodies_of(context.scene)
    effect = active_effect(context)
    for body in (active_body(context), effect.hfx.body if effect is not None else None):
        if body in bodies:
            return body
    if len(bodies) > 1:
        raise InputError("Several haptic bodies: select the body of the new effect.")
    return bodies[0] if bodies else None
