# SPDX-License-Identifier: GPL-3.0-or-later
"""Body parts and sides of perceptual vertices; labels and menu groups of regions.

The eleven parts are the parts of HFX Studio (Danieau et al., VRST 2018, Table 1).
"""

from __future__ import annotations

from dataclasses import dataclass
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
GROUPS: Final = (HEAD, ARMS, HANDS, LEGS)


@dataclass(frozen=True)
class Region:
    """Id, label and menu group of a region or whole body part."""

    id: str
    label: str
    group: str


PARTS_BY_NAME: Final = (
    Region("head", "Head", HEAD),
    Region("torso", "Trunk", HEAD),
    Region("upper_arm", "Upper Arms", ARMS),
    Region("forearm", "Forearms", ARMS),
    Region("hand_palm", "Palms", HANDS),
    Region("hand_dorsum", "Backs of the Hands", HANDS),
    Region("fingers", "Fingers", HANDS),
    Region("upper_leg", "Thighs", LEGS),
    Region("lower_leg", "Lower Legs", LEGS),
    Region("foot_dorsum", "Tops of the Feet with Toes", LEGS),
    Region("foot_sole", "Soles with Toes", LEGS),
)
"""Whole body parts, with the ids of ``PARTS``."""

FINER: Final = (
    Region("face", "Face", HEAD),
    Region("back_of_head", "Back of the Head", HEAD),
    Region("neck", "Neck", HEAD),
    Region("shoulders", "Shoulders", HEAD),
    Region("chest", "Chest", HEAD),
    Region("belly", "Belly", HEAD),
    Region("upper_back", "Upper Back", HEAD),
    Region("lower_back", "Lower Back", HEAD),
    Region("buttocks", "Buttocks", HEAD),
    Region("upper_arm_front", "Upper Arms (Front)", ARMS),
    Region("upper_arm_back", "Upper Arms (Back)", ARMS),
    Region("forearm_inner", "Forearms (Inner Side)", ARMS),
    Region("forearm_outer", "Forearms (Outer Side)", ARMS),
    Region("thumb", "Thumbs", HANDS),
    Region("index_finger", "Index Fingers", HANDS),
    Region("middle_finger", "Middle Fingers", HANDS),
    Region("ring_finger", "Ring Fingers", HANDS),
    Region("little_finger", "Little Fingers", HANDS),
    Region("thigh_front", "Thighs (Front)", LEGS),
    Region("thigh_back", "Thighs (Back)", LEGS),
    Region("shin", "Shins", LEGS),
    Region("calf", "Calves", LEGS),
    Region("top_of_foot", "Tops of the Feet", LEGS),
    Region("sole", "Soles", LEGS),
    Region("toes", "Toes", LEGS),
)
"""Finer regions of head, trunk, limbs, fingers and feet."""

REGIONS: Final = (*PARTS_BY_NAME, *FINER)
"""Body parts, then finer regions."""
