# SPDX-License-Identifier: GPL-3.0-or-later
"""Body parts and sides of perceptual vertices; labels and menu groups of regions.

The eleven parts are the parts of HFX Studio (Danieau et al., VRST 2018, Table 1).
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

PARTS: Final = (
    "head",
    "torso",
    "upper_arm",
    "forearm",
    "hand_dorsum",
    "hand_palm",
    "fingers",
    "upper_leg",
    "lower_leg",
    "foot_dorsum",
    "foot_sole",
)
"""Ids of body parts; ``PerceptualModel.part`` holds indices into this tuple."""

SIDES: Final = ("centre", "left", "right")
"""Sides; ``PerceptualModel.side`` holds indices into this tuple.

``centre`` is exactly on the midline. Left and right are the body's own: left is +X in rest space.
"""

CENTRE: Final = 0
LEFT: Final = 1
RIGHT: Final = 2

HEAD: Final = "Head and Trunk"
ARMS: Final = "Arms"
HANDS: Final = "Hands"
LEGS: Final = "Legs and Feet"


@dataclass(frozen=True)
class Region:
    """Id, label and menu group of a region or whole body part."""

    id: str
    label: str
    group: str


with Path(__file__).with_name("regions.csv").open(encoding="utf-8", newline="") as _file:
    REGIONS: Final = tuple(Region(**row) for row in csv.DictReader(_file))
"""Body parts, then finer regions of head, trunk, limbs, fingers and feet, in menu order."""
