# SPDX-License-Identifier: GPL-3.0-or-later
"""Endings of files that the user interface names before their formats are imported."""

from __future__ import annotations

from typing import Final

EFFECT: Final = ".hfxeffect"
PATH: Final = ".hfxpath"
TEXTURE_MAP: Final = ".texture.json"
GENERATED: Final = ".generated.json"
STROKES: Final = (".wav", ".ahap", ".he", ".haptic", ".csv")
