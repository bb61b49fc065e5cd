# SPDX-License-Identifier: GPL-3.0-or-later
"""HFX: a haptic editor for full-body immersive experiences.

Importing this package imports no ``bpy``; :func:`register` does.

Packages, lowest first; a package imports only from packages above.

files        reading and writing of files: limits, hashes, atomic results, JSON
blender      differences of Blender's versions, events, values stored in a .blend
processes    processes of this package, and Blender without a screen
engine       scene description to samples, tracks and rasters; no bpy
devices      device configurations, live output; no bpy
formats      foreign file formats; no bpy
generation   surfaces from words, and from pictures of generators; no bpy
tracking     tracked bodies, values and time of other programs, by OSC; no bpy
avatars      avatars in Blender, and perceptual models bound to avatars
authoring    effects, volumes, surfaces and clips of a user
reading      Blender's data as a scene description
playback     preview and live devices
properties   properties in a .blend and in the preferences
export       exports of scenes, and batches of exports
commands     the command line
operators    buttons and tools
ui           panels, menus, gizmos
"""

from .version import __version__ as __version__


def register() -> None:
    """Register the add-on with Blender."""
    from . import addon

    addon.register()


def unregister() -> None:
    """Unregister the add-on from Blender."""
    from . import addon

    addon.unregister()
