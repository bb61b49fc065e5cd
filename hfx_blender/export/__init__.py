# SPDX-License-Identifier: GPL-3.0-or-later
"""One export of a scene, and batches of exports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .scene_export import ExportSettings as ExportSettings
    from .scene_export import export_scene as export_scene


def __getattr__(name: str) -> Any:
    # Loaded on first use: an export needs ``bpy``, the modules of batches do not.
    if name in ("ExportSettings", "export_scene"):
        from . import scene_export

        return getattr(scene_export, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
