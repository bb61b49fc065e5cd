# SPDX-License-Identifier: GPL-3.0-or-later
"""Base of operators that export the scene step by step in a window, until Esc ends them."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

import bpy

from ..authoring.effects import swarms
from .stepwise_operator import StepwiseOperator

if TYPE_CHECKING:
    from ..export.report import ExportReport


class StepwiseExport(StepwiseOperator):
    """Base of the operators that export: in one go for a script, step by step in a window."""

    bl_options = {"REGISTER"}
    doing, doing_icon = "Exporting Haptics", "EXPORT"
    cancelled = "Export cancelled: nothing was written"
    requires = (
        (lambda context: swarms.listed_effects(context.scene), "Add a haptic effect first"),
    )

    def export_steps(self, context: bpy.types.Context) -> Generator[float, None, ExportReport]:
        """Begin the export; the steps yield the share that is done, and return the report."""
        raise NotImplementedError

    def finished(self, context: bpy.types.Context, report: ExportReport) -> str:
        """Tell what was written."""
        raise NotImplementedError

    def steps(self, context: bpy.types.Context) -> Generator[float, None, str]:
        return self._reporting(context, self.export_steps(context))

    def _reporting(
        self, context: bpy.types.Context, steps: Generator[float, None, ExportReport]
    ) -> Generator[float, None, str]:
        return self.finished(context, (yield from steps))
