# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of devices for panels, loaded when they are drawn first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy.utils.previews

_loaded: list[Any] = []  # a collection of previews, or none yet


def icon_of(picture: Path) -> int:
    """Number of a picture's icon."""
    if not _loaded:
        _loaded.append(bpy.utils.previews.new())
    known, name = _loaded[0], str(picture)
    if name not in known:
        found = known.load(name, name, "IMAGE")
        found.image_size[:]  # loads it now: nothing else would draw the panel again
    return int(known[name].icon_id)


def forget_icons() -> None:
    """Free all pictures."""
    for known in _loaded:
        bpy.utils.previews.remove(known)
    _loaded.clear()
