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
        effects,
        export,
        global_tools,
        hjif_import,
        library,
        live,
        paint,
        paint_status,
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
        hjif_import,
        global_tools,
        export,
        live,
    )


register, unregister = registration.of_modules(_modules)
