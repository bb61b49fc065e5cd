# SPDX-License-Identifier: GPL-3.0-or-later
"""Base of operators that export the scene step by step in a window, until Esc ends them."""

from __future__ import annotations

import time
from collections.abc import Generator
from typing import TYPE_CHECKING

import bpy

from ..authoring import effects
from ..stepwise import finish
from .shared import HfxOperator

if TYPE_CHECKING:
    from ..export_report import ExportReport

_AT_ONCE_S = 0.2  # of work, before a window is drawn and Esc is looked for
_PAUSE_S = 0.01


class StepwiseExport(HfxOperator):
    """Base of the operators that export: in one go for a script, step by step in a window."""

    bl_options = {"REGISTER"}

    # Without annotations, which Blender would take for properties.
    _is_invoked = False
    _steps = None
    _timer = None
    _share = 0.0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return cls.needs(effects.effects_of(context.scene), "Add a haptic effect first")

    def export_steps(self, context: bpy.types.Context) -> Generator[float, None, ExportReport]:
        """Begin the export; the steps yield the share that is done, and return the report."""
        raise NotImplementedError

    def finished(self, context: bpy.types.Context, report: ExportReport) -> str:
        """Tell what was written."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Export in one go for a script; in a window step by step, so that Esc can end it."""
        if not self._is_invoked or bpy.app.background:
            return super().execute(context)
        begun = self.reported(lambda: self._begin(context))
        return {"RUNNING_MODAL"} if begun == {"FINISHED"} else begun

    def work(self, context: bpy.types.Context) -> str:
        return self.finished(context, finish(self.export_steps(context)))

    def _begin(self, context: bpy.types.Context) -> str:
        self._steps = self.export_steps(context)
        self._share = 0.0
        window_manager = context.window_manager
        self._timer = window_manager.event_timer_add(_PAUSE_S, window=context.window)
        window_manager.modal_handler_add(self)
        self._show(context)
        return ""

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Handle events of a running export; other actions are blocked, as the scene must not
        change.
        """
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"WARNING"}, "Export cancelled: nothing was written")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        went_on = self.reported(lambda: self._go_on(context))
        if self._steps is not None and went_on == {"FINISHED"}:
            self._show(context)
            return {"RUNNING_MODAL"}
        self.cancel(context)
        return went_on

    def _go_on(self, context: bpy.types.Context) -> str:
        """Do some more steps; returns the final report at the end."""
        assert self._steps is not None
        pause = time.monotonic() + _AT_ONCE_S
        try:
            while time.monotonic() < pause:
                self._share = next(self._steps)
        except StopIteration as end:
            self._steps = None
            return self.finished(context, end.value)
        return ""

    def _show(self, context: bpy.types.Context) -> None:
        share = self._share

        def draw(header: bpy.types.Header, _context: bpy.types.Context) -> None:
            row = header.layout.row()
            row.label(text="Exporting Haptics", icon="EXPORT")
            row.progress(factor=share, text=f"{share:.0%}")
            row.label(text="Cancel", icon="EVENT_ESC")

        context.workspace.status_text_set(draw)

    def cancel(self, context: bpy.types.Context) -> None:
        """End the export, with a result or without."""
        if self._steps is not None:
            self._steps.close()
            self._steps = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
            context.workspace.status_text_set(None)
