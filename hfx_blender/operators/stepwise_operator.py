# SPDX-License-Identifier: GPL-3.0-or-later
"""Base classes of operators with long work: progress in the status bar, Esc cancels."""

from __future__ import annotations

import time
from collections.abc import Generator
from typing import TYPE_CHECKING, ClassVar

import bpy

from ..engine.stepwise import finish
from ..reading.stepped.reached import has_effects
from .shared import HfxOperator, ModalTimer

if TYPE_CHECKING:
    from ..export.report import ExportReport

_AT_ONCE_S = 0.2  # work between two redraws
_PAUSE_S = 0.01


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

        begun = self.reported(begin)
        return {"RUNNING_MODAL"} if begun == {"FINISHED"} else begun

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run steps at timer events and report the end; Esc cancels; other input is blocked."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"WARNING"}, self.cancelled)
            return {"CANCELLED"}
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
        # Errors in the input are raised here, by this call, before the generator's first step.
        steps = self.export_steps(context)

        def reporting() -> Generator[float, None, str]:
            return self.finished(context, (yield from steps))

        return reporting()
