# SPDX-License-Identifier: GPL-3.0-or-later
"""Base class of the operators: faults of the user become reports, never tracebacks."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import StringProperty

from ..authoring.effects import effects, swarms
from ..avatars.avatar_meshes import armature_of
from ..errors import HfxError, InputError, fault_of_file
from ..files.atomic import inputs_kept
from ..playback.preview.preview import preview
from ..text import printable
from . import framing

_PACKAGES = {
    "numpy",
    "scipy",
    "trimesh",
    "fast_simplification",
    "serial",
    "sounddevice",
    "websockets",
}
"""Packages that the extension brings as wheels; its small zip brings the pure ones."""


Requirement = tuple[Callable[[bpy.types.Context], object], str]
"""Condition of an operator, and what the user has to do where it is not met."""

IN_OBJECT_MODE: Requirement = (lambda context: context.mode == "OBJECT", "Go to Object Mode first")
ON_MESH: Requirement = (
    lambda context: context.object is not None and context.object.type == "MESH",
    "Select a mesh",
)


class HfxOperator(bpy.types.Operator):
    """Base of the operators: runs ``work`` and turns :class:`HfxError` into an error report."""

    bl_options = {"REGISTER", "UNDO"}
    requires: ClassVar[tuple[Requirement, ...]] = ()
    leaves_mode: ClassVar[bool] = False
    """Go to Object Mode first: what is added becomes the active object."""

    def __init_subclass__(cls, **options: object) -> None:
        """Make the tooltip: paragraphs of the docstring become its sentences, without line
        breaks.
        """
        super().__init_subclass__(**options)
        if cls.__doc__ and "bl_description" not in cls.__dict__:
            paragraphs = (" ".join(each.split()) for each in cls.__doc__.split("\n\n"))
            cls.bl_description = ". ".join(each.rstrip(".") for each in paragraphs if each)

    def work(self, context: bpy.types.Context) -> str:
        """Do the operator's work, and return its report ("" for none)."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.reported(lambda: self._work_in_mode(context))

    def _work_in_mode(self, context: bpy.types.Context) -> str:
        if self.leaves_mode:
            to_object_mode(context)
        return self.work(context)

    def reported(self, work: Callable[[], str | None]) -> set[str]:
        """Call a function and report its result, if any, or the reason of its failure."""
        source = bpy.data.filepath
        try:
            with inputs_kept([Path(source)] if source else []):
                message = work()
        except HfxError as error:
            fault = str(error)
        except OSError as error:
            if error.filename is None:
                raise
            fault = str(fault_of_file(error))
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in _PACKAGES:
                raise
            fault = (
                f"This needs the Python package {package}, which this Blender lacks: install the "
                "extension's zip for your platform, which brings it, or run "
                f"'{sys.executable} -m pip install {package}'."
            )
        else:
            preview.schedule_check()
            if message:
                self.report({"INFO"}, printable(message))
            return {"FINISHED"}
        self.report({"ERROR"}, fault)
        return {"CANCELLED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return all(cls.needs(test(context), what) for test, what in cls.requires)

    @classmethod
    def needs(cls, found: object, what: str) -> bool:
        """Test a condition for ``poll``; if it fails, the tooltip tells the user what is needed."""
        if found:
            return True
        cls.poll_message_set(what)
        return False


class OnBodyOperator(HfxOperator):
    """Base of the operators that add something to a haptic body."""

    leaves_mode = True
    requires = (
        (
            lambda context: effects.bodies_of(context.scene),
            "Add an avatar, or mark an armature as haptic body first",
        ),
    )


class FileOperator(HfxOperator):
    """Base of the operators that ask for a file."""

    filepath: StringProperty(name="File", subtype="FILE_PATH")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or self.first_path(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def first_path(self, context: bpy.types.Context) -> str:
        """Path that the file selector begins with; empty: Blender's choice."""
        return ""

    def path(self) -> Path:
        """The chosen file.

        Raises
        ------
        InputError
            None was chosen.
        """
        if not self.filepath:
            raise InputError("Choose a file.")
        return Path(bpy.path.abspath(self.filepath))


class KeyBindings:
    """Keys of operators in one of Blender's keymaps, as long as the extension is on.

    Parameters
    ----------
    keymap : str
        Its name; of any editor.
    entries : (operator id, key, modifiers)
    """

    def __init__(self, keymap: str, *entries: tuple[str, str, dict[str, bool]]) -> None:
        self._keymap = keymap
        self._entries = entries
        self._added: list[tuple[bpy.types.KeyMap, bpy.types.KeyMapItem]] = []

    def register(self) -> None:
        keyconfig = bpy.context.window_manager.keyconfigs.addon
        if keyconfig is None:  # in the background there are no keys
            return
        keymap = keyconfig.keymaps.new(name=self._keymap, space_type="EMPTY")
        for operator, key, modifiers in self._entries:
            item = keymap.keymap_items.new(operator, key, "PRESS", **modifiers)
            self._added.append((keymap, item))

    def unregister(self) -> None:
        for keymap, item in self._added:
            keymap.keymap_items.remove(item)
        self._added.clear()


EnumItems = list[tuple[str, str, str]]


def kept_items(entries: Callable[[], EnumItems]) -> Callable[[object, object], EnumItems]:
    """Items of a dynamic enum, whose strings Blender does not keep alive by itself."""
    kept: EnumItems = []

    def items(_self: object, _context: object) -> EnumItems:
        kept[:] = entries()
        return kept

    return items


def to_object_mode(context: bpy.types.Context) -> None:
    """Leave the mode of the active object.

    Raises
    ------
    InputError
        An area is being painted on it.
    """
    active = context.object
    if active is None or active.mode == "OBJECT":
        return
    if active.get("hfx_painted_effect") is not None:
        raise InputError("Finish painting first.")
    bpy.ops.object.mode_set(mode="OBJECT")


def select_only(context: bpy.types.Context, *objects: bpy.types.Object) -> None:
    """Select the objects that the view layer has and nothing else, the first as the active one."""
    for other in context.selected_objects:
        other.select_set(False)
    found = [obj for obj in objects if is_in_view_layer(context, obj)]
    framing.show_locally(context, found)
    for obj in found:
        obj.select_set(True)
    if found and found[0] == objects[0]:
        context.view_layer.objects.active = found[0]


def is_in_view_layer(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    """Test that an object can be selected or hidden: it is not in excluded collections only."""
    return any(each == obj for each in context.view_layer.objects)


def active_effect(context: bpy.types.Context) -> bpy.types.Object | None:
    """Active object, if it is a haptic effect, or the only volume that it emits."""
    obj = context.object
    if obj is None or obj.hfx.role == "EFFECT":
        return obj
    emitted = swarms.volumes_of(obj)
    return emitted[0] if len(emitted) == 1 else None


def painted_effect(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active painted effect, also while the mesh that it is painted on is active."""
    obj = context.object
    if obj is None:
        return None
    effect = obj.get("hfx_painted_effect") or active_effect(context)
    return effect if effect is not None and effect.hfx.kind == "PAINTED" else None


def active_armature(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active armature, or the one that deforms the active mesh."""
    obj = context.object
    if obj is None:
        return None
    if obj.type == "ARMATURE":
        return obj
    return armature_of(obj) if obj.type == "MESH" else None


def active_body(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active haptic body, or the one that the active mesh shows."""
    armature = active_armature(context)
    return armature if armature is not None and armature.hfx.role == "BODY" else None


def target_body(context: bpy.types.Context) -> bpy.types.Object | None:
    """Body of a new effect: the active one, that of the active effect, or the only one, if any.

    Raises
    ------
    InputError
        There are several, and neither is active.
    """
    found = effects.bodies_of(context.scene)
    effect = active_effect(context)
    for body in (active_body(context), effect.hfx.body if effect is not None else None):
        if body in found:
            return body
    if len(found) > 1:
        raise InputError("Several haptic bodies: select the one that shall feel it.")
    return found[0] if found else None
