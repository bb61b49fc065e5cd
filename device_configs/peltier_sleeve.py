# SPDX-License-Identifier: GPL-3.0-or-later
"""The Peltier sleeve warms and cools in ramps, never at once.

A Peltier element pumps heat only so fast: told to jump from 33 to 15 degrees it is driven with
all its current, overshoots, and heats its own back side. This script lets what it is told rise
and fall no faster than the element can follow.

It is an example, too. To make a script for a device of your own, copy it beside the
configuration and give it the same name: ``my_sleeve.py`` beside ``my_sleeve.json``. The page
docs/device-scripts.md tells all that ``haptics`` holds.
"""

import numpy as np

WARMING_C_PER_S = 1.5
COOLING_C_PER_S = 1.0  # slower: waste heat of the element works against it
LONGEST_STEP_S = 0.5  # after a gap, as when you jump on the timeline: no leap for lost time

# A script may remember what was before. It is started anew when you press Play and for each
# file that is exported, and then called in the order of time: what it remembers is the same
# however an export is divided among processes.
last_time_s = None
given_c = None


def render(haptics):
    """Returns the elements' temperatures now, one for each of ``haptics.columns``."""
    global last_time_s, given_c

    # What is sent without a script: already where each element is, and within the device's
    # limits. Nothing has to be looked up in haptics.felt for a script that only smooths.
    wanted_c = haptics.values

    if last_time_s is None:
        given_c = haptics.neutral  # begin from silence
    else:
        # Use the scene's time, never the computer's clock: an export is not made in real time.
        # It may stand still, and jump back where a scene is played in a loop.
        step_s = min(max(haptics.time_s - last_time_s, 0.0), LONGEST_STEP_S)
        lowest_c = given_c - COOLING_C_PER_S * step_s
        highest_c = given_c + WARMING_C_PER_S * step_s
        given_c = np.clip(wanted_c, lowest_c, highest_c)
    last_time_s = haptics.time_s

    # The device's own limits come after this; a script cannot exceed them.
    return given_c
