# SPDX-License-Identifier: GPL-3.0-or-later
"""Thermal grill illusion: warm and cool bars side by side feel burning hot.

Bars of 40 and 20 degC, neither of which hurts alone, feel like burning heat if they touch the skin
in turn (Thunberg 1896; Craig and Bushnell, Science 1994). Without the script a hot effect moves
only the warm bars, and a cold effect only the cool bars. The script moves both.
docs/device-scripts.md describes ``haptics``.
"""

import numpy as np


def render(haptics):
    """Returns the temperature of each bar, degrees Celsius."""
    skin_c = haptics.neutral
    controls = [actuator.type.strength for actuator in haptics.actuators]
    # The end of each bar's range that is away from the skin: 40 or 20 degC.
    ends_c = np.array([c.highest if c.highest > c.neutral else c.lowest for c in controls])
    shares = (haptics.values - skin_c) / (ends_c - skin_c)
    # A bar takes the share of a neighbour: the illusion needs both kinds at a place.
    padded = np.pad(shares, 1)
    shares = np.maximum.reduce([padded[:-2], shares, padded[2:]])
    return skin_c + shares * (ends_c - skin_c)
