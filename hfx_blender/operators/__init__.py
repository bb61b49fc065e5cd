# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can do: thin operators over plain functions, one file a topic."""

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
        global_tools,
        hjif_import,
        library,
        live,
        media,
        paint,
        paint_status,
        path_drawing,
        paths,
        response,
        stroke_pad,
        surfaces,
        values,
        vector_sensations,
    )

    return (
        body,
        bones,
        effects,
        paint,
        paint_status,
        area,
        clips,
        library,
        dropped,
        hjif_import,
        global_tools,
        export,
        live,
        media,
        surfaces,
        stroke_pad,
        values,
        response,
        paths,
        path_drawing,
        vector_sensations,
    )


register, unregister = registration.of_modules(_modules)
