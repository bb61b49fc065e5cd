# SPDX-License-Identifier: GPL-3.0-or-later
"""Two-point thresholds: smallest distance between two touches felt as separate.

Source: Danieau et al., VRST 2018, section 3.1 (after Weber, Weinstein et al.) and Table 1. All
tables are millimetres, in the order of :data:`~.parts.PARTS`.
"""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Final

from hfx_blender.engine.body.parts import PARTS
from hfx_blender.errors import InputError

MODALITIES: Final = ("pressure", "vibration", "temperature")

Targets = dict[str, tuple[float, ...]]
"""Modality to spacings in millimetres, in the order of the parts."""

SMALLEST_MM: Final = 1.0
LARGEST_MM: Final = 300.0

LITERATURE_MM: Final[Targets] = {
    "pressure": (7.5, 12.5, 22.5, 17.5, 15.0, 7.5, 2.5, 23.0, 27.5, 17.5, 7.5),
    "vibration": (2.5, 20.0, 50.0, 25.0, 16.0, 10.0, 2.0, 30.0, 30.0, 20.0, 10.0),
    "temperature": (50.0, 50.0, 150.0, 150.0, 19.0, 19.0, 19.0, 150.0, 150.0, 150.0, 150.0),
}
"""Thresholds in the paper's text, the targets of the shipped models."""

TABLE_1_MM: Final[Targets] = {
    "pressure": (7.72, 13.0, 22.3, 15.3, 15.2, 7.2, 2.59, 25.2, 27.6, 17.3, 7.58),
    "vibration": (2.62, 20.1, 50.9, 25.5, 16.1, 10.0, 1.93, 30.0, 30.5, 20.5, 16.1),
    "temperature": (48.8, 50.4, 150.4, 150.0, 20.0, 20.0, 20.0, 149.0, 155.5, 147.7, 147.7),
}
"""Results of the paper's authors, as printed."""

NOTE_ON_TABLE_1: Final = (
    "Table 1 prints 16.1 (10.7) for the vibration of the foot sole, which repeats the hand "
    "dorsum's row; the paper's text says 10 mm, which is used."
)

TABLE_1_SD_MM: Final[Targets] = {
    "pressure": (3.50, 6.94, 14.3, 12.6, 10.4, 4.56, 1.64, 16.2, 19.1, 9.0, 4.7),
    "vibration": (1.22, 10.4, 31.0, 19.5, 10.7, 6.10, 0.69, 18.4, 21.0, 10.4, 10.7),
    "temperature": (22.8, 24.6, 86.3, 87.63, 11.0, 11.0, 11.0, 82.1, 89.9, 62.8, 62.8),
}
"""Standard deviations of Table 1, as printed."""

_TABLE_1_USED: Final[Targets] = TABLE_1_MM | {"vibration": (*TABLE_1_MM["vibration"][:-1], 10.0)}
"""Table 1 as targets; see :data:`NOTE_ON_TABLE_1`."""


def read(name: str) -> Targets:
    """Read targets by name (``literature``, ``table1``) or from a JSON file.

    The file maps modalities to parts to millimetres; missing parts have the literature's values:
    ``{"pressure": {"head": 10, "fingers": 4}}``. Missing modalities are left out.

    Raises
    ------
    InputError
        The file cannot be read, or has an unknown modality or part, or a spacing outside of
        :data:`SMALLEST_MM` to :data:`LARGEST_MM`.
    """
    if name in ("literature", "table1"):
        return LITERATURE_MM if name == "literature" else _TABLE_1_USED
    try:
        table = json.loads(Path(name).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: cannot be read as a table of thresholds ({error}).") from error
    if not isinstance(table, dict) or not table:
        raise InputError(f"{name}: expected an object of modalities ({', '.join(MODALITIES)}).")
    return {modality: _row(name, modality, parts) for modality, parts in table.items()}


def _row(name: str, modality: str, parts: object) -> tuple[float, ...]:
    if modality not in MODALITIES:
        raise InputError(
            f"{name}: modality '{modality}' is unknown; there are: {', '.join(MODALITIES)}."
        )
    if not isinstance(parts, dict):
        raise InputError(f"{name}: '{modality}' must be an object of parts and millimetres.")
    row = dict(zip(PARTS, LITERATURE_MM[modality], strict=True))
    for part, value in parts.items():
        if part not in row:
            raise InputError(
                f"{name}: part '{part}' of '{modality}' is unknown; there are: {', '.join(PARTS)}."
            )
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or not SMALLEST_MM <= value <= LARGEST_MM:
            raise InputError(
                f"{name}: '{modality}.{part}' is {value!r}; allowed are numbers from "
                f"{SMALLEST_MM:g} to {LARGEST_MM:g} (millimetres)."
            )
        row[part] = float(value)
    return tuple(row[part] for part in PARTS)


AGES: Final = (20.0, 80.0)
"""Youngest and oldest age, years, of the measured rise of touch thresholds."""

_RISE_PER_YEAR: Final = 0.01
"""Rise of spatial thresholds of touch from 20 to 80 years (Stevens and Patterson, Somatosensory and
Motor Research 1995: "approximately 1% per annum")."""


def aged(targets: Targets, years: float) -> Targets:
    """Targets of a person of an age, from those of young adults; a new table.

    Pressure and vibration rise by 1 % of the young value each year from 20 on. Temperature stays:
    no rate of its spatial thresholds is published. Raises InputError for an age outside ``AGES``.
    """
    youngest, oldest = AGES
    if not youngest <= years <= oldest:
        raise InputError(f"--age {years:g}: allowed are {youngest:g} to {oldest:g} years.")
    factor = 1.0 + _RISE_PER_YEAR * (years - youngest)
    return {
        modality: row
        if modality == "temperature"
        else tuple(min(round(factor * value, 4), LARGEST_MM) for value in row)
        for modality, row in targets.items()
    }


def canonical_id(modality: str) -> str:
    """Id of the shipped model of a modality."""
    return f"hfx-{modality}-1"


def model_id(
    modality: str,
    spacings_mm: tuple[float, ...],
    method: str = "cells",
    joint_factor: float = 1.0,
) -> str:
    """Id of a model: the canonical id, for other spacings or a joint gradient with a hash of both,
    for another method with its name.
    """
    identity = canonical_id(modality)
    if spacings_mm != LITERATURE_MM[modality] or joint_factor != 1.0:
        facts = [f"{value:.4f}" for value in spacings_mm]
        if joint_factor != 1.0:
            facts.append(f"joints {joint_factor:.4f}")
        digest = hashlib.sha256(",".join(facts).encode())
        identity = f"{identity}-{digest.hexdigest()[:8]}"
    return identity if method == "cells" else f"{identity}-{method}"
