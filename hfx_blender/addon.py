# SPDX-License-Identifier: GPL-3.0-or-later
"""Registration of the add-on's modules with Blender, in order."""

from __future__ import annotations

import atexit

from . import cli, operators, ui
from .authoring import handlers
from .blender import events
from .playback.live import live
from .playback.preview import preview
from .playback.timeline import timeline_clips
from .processes.blender_session import inside_blender
from .properties import objects, preferences

_MODULES = (
    *(events, preferences, objects, operators, ui, handlers),
    *(preview, timeline_clips, live, cli),
)


def register() -> None:
    """Register every module.

    Blender's Python module takes itself down after Python. What is still registered then hangs or
    crashes 4.5, so a script that only ends takes it back; a whole Blender does so by itself.
    """
    for module in _MODULES:
        module.register()
    if not inside_blender():
        atexit.register(unregister)


def unregister() -> None:
    """Unregister every module, in reverse order."""
    atexit.unregister(unregister)
    for module in reversed(_MODULES):
        module.unregister()
