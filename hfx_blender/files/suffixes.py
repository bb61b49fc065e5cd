# SPDX-License-Identifier: GPL-3.0-or-later
"""File name suffixes for the user interface, available before the formats are imported."""

from __future__ import annotations

from typing import Final

EFFECT: Final = ".hfxeffect"
PATH: Final = ".hfxpath"
TEXTURE_MAP: Final = ".texture.json"
GENERATED: Final = ".generated.json"
STROKES: Final = (".wav", ".ahap", ".he", ".haptic", ".csv")
PICTURES: Final = (".exr", ".jpeg", ".jpg", ".png", ".tif", ".tiff")  # of heights
