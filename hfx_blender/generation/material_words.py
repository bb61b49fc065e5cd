# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabularies: sRGB of colours, and the nearest library material of each material word.

Materials are in ``material_words.csv``; of a word in several rows the first row counts.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

COLOURS: Final = {
    "grey": (0.50, 0.50, 0.49), "gray": (0.50, 0.50, 0.49), "black": (0.10, 0.10, 0.10),
    "white": (0.90, 0.89, 0.87), "red": (0.66, 0.12, 0.11), "green": (0.20, 0.42, 0.18),
    "blue": (0.16, 0.28, 0.58), "yellow": (0.85, 0.72, 0.20), "orange": (0.82, 0.44, 0.12),
    "purple": (0.40, 0.20, 0.48), "violet": (0.45, 0.25, 0.60), "pink": (0.88, 0.58, 0.64),
    "brown": (0.42, 0.27, 0.16), "beige": (0.76, 0.68, 0.55), "tan": (0.70, 0.57, 0.40),
    "cream": (0.91, 0.86, 0.74), "ivory": (0.92, 0.89, 0.80), "navy": (0.10, 0.13, 0.30),
    "crimson": (0.60, 0.07, 0.16), "scarlet": (0.75, 0.12, 0.08), "maroon": (0.38, 0.08, 0.12),
    "burgundy": (0.40, 0.06, 0.16), "turquoise": (0.22, 0.65, 0.64), "teal": (0.10, 0.42, 0.44),
    "indigo": (0.16, 0.17, 0.40), "charcoal": (0.22, 0.22, 0.23), "khaki": (0.60, 0.55, 0.38),
    "olive": (0.40, 0.40, 0.18), "ochre": (0.74, 0.52, 0.18), "amber": (0.80, 0.52, 0.14),
    "sepia": (0.44, 0.31, 0.20), "magenta": (0.70, 0.16, 0.50), "cyan": (0.20, 0.66, 0.74),
    "lilac": (0.72, 0.62, 0.80), "emerald": (0.10, 0.48, 0.30), "golden": (0.80, 0.62, 0.28),
    "silvery": (0.72, 0.73, 0.74), "coppery": (0.72, 0.43, 0.30), "greyish": (0.52, 0.52, 0.50),
    "sand": (0.76, 0.66, 0.48), "silver": (0.72, 0.73, 0.74), "gold": (0.83, 0.66, 0.32),
    "copper": (0.72, 0.43, 0.30), "bronze": (0.55, 0.40, 0.24), "brass": (0.74, 0.62, 0.35),
    "iron": (0.30, 0.30, 0.31), "steel": (0.62, 0.63, 0.65), "rust": (0.50, 0.25, 0.13),
    "denim": (0.20, 0.28, 0.44), "wool": (0.62, 0.56, 0.48), "jute": (0.62, 0.50, 0.34),
    "wood": (0.56, 0.39, 0.24), "oak": (0.64, 0.48, 0.31), "walnut": (0.36, 0.24, 0.16),
    "mahogany": (0.42, 0.19, 0.12), "pine": (0.79, 0.62, 0.41), "birch": (0.83, 0.72, 0.56),
    "cherry": (0.58, 0.29, 0.18), "driftwood": (0.55, 0.52, 0.48), "cork": (0.68, 0.49, 0.32),
    "slate": (0.33, 0.37, 0.41), "rose": (0.82, 0.50, 0.52), "lavender": (0.68, 0.62, 0.80),
    "mint": (0.62, 0.82, 0.70), "coral": (0.88, 0.46, 0.38), "chocolate": (0.30, 0.18, 0.11),
    "honey": (0.78, 0.55, 0.24), "chestnut": (0.44, 0.23, 0.14), "ebony": (0.14, 0.11, 0.09),
    "snow": (0.94, 0.94, 0.94), "jet": (0.06, 0.06, 0.06), "reddish": (0.56, 0.28, 0.20),
    "bluish": (0.42, 0.48, 0.58), "greenish": (0.42, 0.50, 0.38), "yellowish": (0.78, 0.70, 0.46),
    "brownish": (0.46, 0.35, 0.25), "mossy": (0.34, 0.42, 0.22), "mustard": (0.74, 0.58, 0.16),
}  # fmt: skip
"""sRGB of each colour, 0..1. Material words among the keys are colours before other materials."""


@dataclass(frozen=True)
class MaterialWord:
    """Library material that is nearest to a material word, and the differences from it."""

    material: str  # key of procedural.MATERIALS
    scale: float  # factor of all lengths
    depth: float  # further factor of heights
    colour: str  # key of COLOURS
    weight: float  # 3 a material, 2 an object or trade name, 1 a finish of several materials

    @property
    def kind(self) -> str:
        """Kind of the material: gravel, metal, fabric or wood."""
        return self.material.partition("-")[0]


def _words() -> dict[str, MaterialWord]:
    words: dict[str, MaterialWord] = {}
    with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as table:
        for row in csv.DictReader(table):
            entry = MaterialWord(
                row["material"],
                float(row["scale"]),
                float(row["depth"]),
                row["colour"],
                int(row["weight"]),
            )
            for word in row["words"].split(","):
                words.setdefault(word.strip(), entry)
    return words


WORDS: Final = _words()
"""Material of each word or phrase; keys are lower case, singular, without hyphens."""

LONGEST_PHRASE: Final = max(len(phrase.split()) for phrase in WORDS)
