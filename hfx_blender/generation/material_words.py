# SPDX-License-Identifier: GPL-3.0-or-later
"""Vocabulary of materials: the library material nearest to each word that people use for one.

The table is ``material_words.csv``; where a word stands twice, its first row counts.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final


@dataclass(frozen=True)
class MaterialWord:
    """A word that names a material, an object made of it, or its finish.

    Parameters
    ----------
    material : str
        The nearest one of :data:`.procedural.MATERIALS`.
    scale, depth : float
        Size of its features, and height besides, relative to that material.
    colour : str
        A key of :data:`.colour_words.COLOURS`.
    weight : float
        3 names the material itself, 2 an object or a trade name, 1 a finish that other materials
        may have as well.
    """

    material: str
    scale: float
    depth: float
    colour: str
    weight: float

    @property
    def kind(self) -> str:
        """Kind of the material: gravel, metal, fabric or wood."""
        return self.material.partition("-")[0]


def _words() -> dict[str, MaterialWord]:
    found: dict[str, MaterialWord] = {}
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
                found.setdefault(word.strip(), entry)
    return found


WORDS: Final = _words()
"""Each word or phrase, in lower case, singular, without hyphens."""

LONGEST_PHRASE: Final = max(len(phrase.split()) for phrase in WORDS)
