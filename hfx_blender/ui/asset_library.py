# SPDX-License-Identifier: GPL-3.0-or-later
"""Asset library of the built-in sensations in the user's preferences, while HFX is enabled."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import bpy

from ..authoring.effects.effect_assets import LIBRARY_FILE
from ..errors import HfxError
from ..files import resources

NAME = "HFX Haptics"


def _folder() -> Path | None:
    with suppress(HfxError):
        folder = resources.effect_library()
        if (folder / LIBRARY_FILE).is_file():
            return folder
    return None


def _ours() -> list[bpy.types.UserAssetLibrary]:
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return [library for library in libraries if library.name == NAME]


def register() -> None:
    folder = _folder()
    if folder is None:
        return
    libraries = bpy.context.preferences.filepaths.asset_libraries
    for old in _ours():  # left by another version, or after a crash
        libraries.remove(old)
    library = libraries.new(name=NAME, directory=str(folder))
    library.import_method = "APPEND"


def unregister() -> None:
    for library in _ours():
        bpy.context.preferences.filepaths.asset_libraries.remove(library)
