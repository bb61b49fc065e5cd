# SPDX-License-Identifier: GPL-3.0-or-later
"""User actions: thin operators over plain functions, one file a topic."""

from __future__ import annotations

from types import ModuleType

from .. import registration


def _modules() -> tuple[ModuleType, ...]:
    from . import (
        area,
        body,
        bones,
        clips,
        dropped,
        effects,
        export,
        generation,
        global_tools,
        hjif_import,
        live,
        live_setup,
        live_track,
        media,
        paint,
        paint_status,
        path_drawing,
        paths,
        response,
        sensation_library,
        spot_handles,
        stroke_pad,
        surface_relief,
        surfaces,
        values,
        vector_sensations,
        workspace,
    )

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
