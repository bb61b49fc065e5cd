# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of body parts and regions in the words of people, in groups for menus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

HEAD: Final = "Head and Trunk"
ARMS: Final = "Arms"
HANDS: Final = "Hands"
LEGS: Final = "Legs and Feet"
GROUPS: Final = (HEAD, ARMS, HANDS, LEGS)


@dataclass(frozen=True)
class Region:
    """Named region, or a whole body part."""

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
    Region("foot_dorsum", "Feet (Upper Side)", LEGS),
    Region("foot_sole", "Feet (Under Side)", LEGS),
)
"""The body parts, with the ids of ``parts.PARTS``."""

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
