# SPDX-License-Identifier: GPL-3.0-or-later
"""Blind comparison of two effects while the timeline loops."""

import random
from typing import ClassVar

import bpy

from ...authoring.effects import swarms
from ...blender.translation import translated
from ..shared import HfxOperator

_SHOWN = ("hfx_preview", "hfx_show_actuators", "hfx_show_values")
_HINT = "Take {0}     X: other take     Enter: prefer this take     Esc: end"


class BlindTakes:
    """Two effects in a secret order, one of them muted; ``counts`` are preferences by name.

    :meth:`end` restores the mutes. Effects are looked up by name, as undo replaces objects.
    """

    def __init__(self, takes: list[bpy.types.Object], rng: random.Random) -> None:
        self._rng = rng
        self._mutes = {take.name: take.hfx.is_muted for take in takes}
        self.counts = dict.fromkeys(self._mutes, 0)
        self.shuffle()

    @property
    def letter(self) -> str:
        return "AB"[self._order.index(self.present)]

    def shuffle(self) -> None:
        """Draw a new order, and begin with its first take."""
        self._order = self._rng.sample(sorted(self._mutes), 2)
        self._play(self._order[0])

    def switch(self) -> None:
        """Mute the present take, and play the second one."""
        self._play(self._order[self._order[0] == self.present])

    def prefer(self) -> None:
        """Count a preference for the present take, and draw a new order."""
        self.counts[self.present] += 1
        self.shuffle()

    def end(self) -> str:
        """Restore the mutes, and return the counts as text."""
        self._set(self._mutes)
        return ", ".join(f"{name}: {count}" for name, count in self.counts.items())

    def _play(self, present: str) -> None:
        self.present = present
        self._set({name: name != present for name in self._order})

    def _set(self, mutes: dict[str, bool]) -> None:
        for name in mutes.keys() & bpy.data.objects.keys():
            bpy.data.objects[name].hfx.is_muted = mutes[name]


class HFX_OT_compare_takes(HfxOperator):
    """Compare the two selected effects blind while the timeline loops: X switches, Enter prefers
    the present take and draws a new order, Esc ends and shows the counts. Names and colours are
    hidden"""

    bl_label = "Compare Blind"
    bl_options: ClassVar = {"REGISTER"}  # the scene is as before
    requires = (
        (lambda context: len(swarms.selected_effects(context.scene)) == 2, "Select two effects"),
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self._takes = BlindTakes(swarms.selected_effects(context.scene), random.SystemRandom())
        manager = context.window_manager
        self._shown = {name: getattr(manager, name) for name in _SHOWN}
        for name in _SHOWN:
            setattr(manager, name, False)
        # List and strips show muted effects: only the viewport stays.
        self._is_full = not context.screen.show_fullscreen
        if self._is_full:
            bpy.ops.screen.screen_full_area(use_hide_panels=True)
        self._is_started = not context.window.screen.is_animation_playing
        if self._is_started:
            bpy.ops.screen.animation_play()
        self._show_hint(context)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type.startswith(("TIMER", "MOUSE", "MIDDLE", "WHEEL")):
            return {"PASS_THROUGH"}
        if event.value == "PRESS" and not event.is_repeat:
            if event.type == "ESC":
                return self._end(context)
            if event.type == "X":
                self._takes.switch()
            elif event.type in ("RET", "NUMPAD_ENTER"):
                self._takes.prefer()
            self._show_hint(context)
        return {"RUNNING_MODAL"}

    def _show_hint(self, context: bpy.types.Context, is_over: bool = False) -> None:
        text = None if is_over else translated(_HINT.format(self._takes.letter))
        for area in context.window.screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.show_region_header = True  # hidden with the panels
                area.header_text_set(text)

    def _end(self, context: bpy.types.Context) -> set[str]:
        self._show_hint(context, is_over=True)
        for name, value in self._shown.items():
            setattr(context.window_manager, name, value)
        if self._is_started:
            bpy.ops.screen.animation_cancel(restore_frame=False)
        if self._is_full:
            bpy.ops.screen.back_to_previous()
        return self.reported(self._takes.end)
