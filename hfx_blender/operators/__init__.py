# SPDX-License-Identifier: GPL-3.0-or-later
"""User actions: thin operators over plain functions, one file a topic."""

from __future__ import annotations

from types import ModuleType

from ..blender import registration


def _modules() -> tuple[ModuleType, ...]:
    from . import body, bones, export, media, values, workspace
    from .effects import (
        clips,
        dropped,
        effects,
        global_tools,
        hjif_import,
        response,
        sensation_library,
        vector_sensations,
    )
    from .live import live, live_setup, live_track
    from .painting import area, paint, paint_status
    from .paths import path_drawing, paths, spot_handles
    from .surfaces import generation, stroke_pad, surface_relief, surfaces

    return (
        body,
        bones,
        effects,
        paint,
        paint_status,
        area,
        clips,
        sensation_library,
        dropped,
        hjif_import,
        global_tools,
        export,
        live,
        live_setup,
        live_track,
        media,
        surfaces,
        surface_relief,
        stroke_pad,
        generation,
        values,
        response,
        paths,
        path_drawing,
        spot_handles,
        vector_sensations,
        workspace,
    )


register, unregister = registration.of_modules(_modules)
