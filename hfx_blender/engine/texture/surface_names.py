# SPDX-License-Identifier: GPL-3.0-or-later
"""Names and defaults of the surface library, importable without numpy."""

import csv
from pathlib import Path
from typing import Final

with Path(__file__).with_name("materials.csv").open(encoding="utf-8", newline="") as _file:
    MATERIAL_TITLES: Final = {
        row["name"]: (row["kind"], row["title"]) for row in csv.DictReader(_file)
    }
"""Kind and title of each procedural material, in order of display."""

FABRICS: Final = ("shirting", "denim", "costume")  # reference cloths, from smooth to rough
DRIVE_PER_M: Final = 1.0e4  # default c_v: 50 micrometres RMS give a drive of 0.5
