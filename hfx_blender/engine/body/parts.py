# SPDX-License-Identifier: GPL-3.0-or-later
"""Body parts and sides: the labels that every perceptual vertex carries.

The eleven parts are those of HFX Studio (Danieau et al., VRST 2018, Table 1).
"""

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
"""A vertex's ``part`` is an index into this tuple."""

SIDES: Final = ("centre", "left", "right")
"""A vertex's ``side`` is an index into this tuple; ``centre`` is exactly on the midline.

Left and right are the body's own: left is +X in rest space.
"""

CENTRE: Final = 0
LEFT: Final = 1
RIGHT: Final = 2
