# SPDX-License-Identifier: GPL-3.0-or-later
"""Focal point of an ultrasound array: the middle of the strongest vibration on the palms.

The array stands where the configuration places it, level, with its X and Y along the axes of the
scene. Its program makes the phases of the transducers from the focal point (Hoshi et al. 2010).
docs/device-scripts.md describes ``haptics``.
"""

import numpy as np


def render(haptics):
    """Returns amplitude, frequency and focal point, in metres from the array's centre."""
    felt = [e for e in haptics.felt if e.modality == "vibration" and e.gains[0] > 0.0]
    if not felt or haptics.values[0] <= 0.0:
        return None
    effect = max(felt, key=lambda e: e.level * e.gains[0] * e.parameters["amplitude_m_s2"])
    amplitude, frequency = haptics.values[:2]
    answer = {"amplitude_m_s2": amplitude, "frequency_hz": frequency}
    if effect.positions is not None:
        middle = np.average(effect.positions, axis=0, weights=effect.weights)
        focus = middle - haptics.actuators[0].place.at_m
        answer |= dict(zip(("focus_x", "focus_y", "focus_z"), focus.tolist(), strict=True))
    return {"focus": answer}
