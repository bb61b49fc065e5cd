# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX: a haptic editor for full-body immersive experiences.

Importing this package imports no ``bpy``; :func:`register` does.

Packages, lowest first: each imports only from those above it in this list.

engine       scene description to samples, tracks and rasters; no bpy
devices      device configurations, live output; no bpy
formats      files of other programs; no bpy
generation   surfaces from words, and from pictures of generators; no bpy
avatars      avatars in Blender, and perceptual models bound to them
authoring    effects, volumes, surfaces, clips: what a user makes
reading      Blender's data as a scene description
playback     preview and live devices
batch        exports shared among processes and machines
commands     the command line
operators    buttons and tools
ui           panels, menus, gizmos
maintenance  body building, benches, demo scenes; not in the extension
"""

from __future__ import annotations

import atexit
from types import ModuleType

from .blender import registration

__version__ = "0.1.0"


def _modules() -> tuple[ModuleType, ...]:
    from . import operators, ui
    from .authoring import handlers
    from .blender import events
    from .playback.live import live
    from .playback.preview import preview
    from .playback.timeline import timeline_clips
    from .properties import objects, preferences

    return (
        *(events, preferences, objects, operators, ui, handlers),
        *(preview, timeline_clips, live),
    )


_register, _unregister = registration.of_modules(_modules)


def register() -> None:
    """Make Blender know the add-on.

    Blender's Python module takes itself down after Python. What is still registered then hangs or
    crashes 4.5, so a script that only ends takes it back; a whole Blender does so by itself.
    """
    from .processes.blender_session import inside_blender

    _register()
    if not inside_blender():
        atexit.register(unregister)


def unregister() -> None:
    """Unregister the add-on from Blender."""
    atexit.unregister(unregister)
    _unregister()
