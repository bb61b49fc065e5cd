# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers the add-on's modules with Blender, in order."""

import atexit
from contextlib import ExitStack
from importlib.util import find_spec

from . import cli, operators, ui
from .authoring import handlers
from .blender import events, translation
from .playback.live import body_tracking, live
from .playback.preview import effect_overlay, preview
from .playback.timeline import timeline_clips
from .processes.blender_session import inside_blender
from .properties import objects, preferences

_MODULES = (
    *(translation, events, preferences, objects, operators, ui, handlers),
    *(preview, effect_overlay, timeline_clips, live, body_tracking, cli),
)


def register() -> None:
    """Register every module; in Blender's Python module, unregister at the end of the process.

    Blender's Python module shuts down after Python. Classes still registered then hang the process
    or crash Blender 4.5; a full Blender unregisters add-ons itself. After an exception of a module,
    the earlier modules are unregistered.

    Raises ModuleNotFoundError in a Blender without NumPy.
    """
    if find_spec("numpy") is None:  # not among the packages that Debian 13 installs with Blender
        raise ModuleNotFoundError(
            translation.translated(
                "HFX Haptics needs NumPy, which the Python of this Blender lacks. "
                "Debian and Ubuntu: sudo apt install python3-numpy"
            ),
            name="numpy",
        )
    with ExitStack() as undo:
        for module in _MODULES:
            module.register()
            undo.callback(module.unregister)
        undo.pop_all()
    if not inside_blender():
        atexit.register(unregister)


def unregister() -> None:
    """Unregister every module, in reverse order."""
    atexit.unregister(unregister)
    for module in reversed(_MODULES):
        module.unregister()
