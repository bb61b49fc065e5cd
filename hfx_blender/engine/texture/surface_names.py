# SPDX-License-Identifier: GPL-3.0-or-later
"""Names and defaults of the surface library, importable without numpy."""

from __future__ import annotations

from typing import Final

MATERIAL_TITLES: Final = {
    "gravel-fine": ("gravel", "Fine gravel"),
    "gravel-coarse": ("gravel", "Coarse gravel"),
    "gravel-pebbles": ("gravel", "Pebbles"),
    "gravel-sharp": ("gravel", "Crushed stone"),
    "metal-brushed": ("metal", "Brushed metal"),
    "metal-satin": ("metal", "Satin metal"),
    "metal-cast": ("metal", "Cast metal"),
    "metal-hammered": ("metal", "Hammered metal"),
    "fabric-shirting": ("fabric", "Shirting"),
    "fabric-denim": ("fabric", "Denim"),
    "fabric-twill": ("fabric", "Twill"),
    "fabric-basket": ("fabric", "Basket weave"),
    "fabric-satin": ("fabric", "Satin"),
    "fabric-corduroy": ("fabric", "Corduroy"),
    "wood-oak": ("wood", "Oak"),
    "wood-pine": ("wood", "Pine"),
    "wood-weathered": ("wood", "Weathered planks"),
    "wood-veneer": ("wood", "Veneer"),
}
"""Kind and title of each procedural material, in order of display."""

FABRICS: Final = ("shirting", "denim", "costume")
"""Reference cloths, from smooth to rough."""

DRIVE_PER_M: Final = 1.0e4
"""Default c_v: 50 micrometres RMS give a drive of 0.5."""
