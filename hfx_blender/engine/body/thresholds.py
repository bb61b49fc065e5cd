# SPDX-License-Identifier: GPL-3.0-or-later
"""Two-point thresholds: how far apart two touches must be to be felt as two.

Source: Danieau et al., VRST 2018, section 3.1 (after Weber, Weinstein and others) and Table 1.
All in millimetres, in the order of :data:`~.parts.PARTS`.
"""

from __future__ import annotations

from typing import Final

MODALITIES: Final = ("pressure", "vibration", "temperature")

LITERATURE_MM: Final[dict[str, tuple[float, ...]]] = {
    "pressure": (7.5, 12.5, 22.5, 17.5, 15.0, 7.5, 2.5, 23.0, 27.5, 17.5, 7.5),
    "vibration": (2.5, 20.0, 50.0, 25.0, 16.0, 10.0, 2.0, 30.0, 30.0, 20.0, 10.0),
    "temperature": (50.0, 50.0, 150.0, 150.0, 19.0, 19.0, 19.0, 150.0, 150.0, 150.0, 150.0),
}
"""The thresholds that the paper names: what the shipped models are made to."""

TABLE_1_MM: Final[dict[str, tuple[float, ...]]] = {
    "pressure": (7.72, 13.0, 22.3, 15.3, 15.2, 7.2, 2.59, 25.2, 27.6, 17.3, 7.58),
    "vibration": (2.62, 20.1, 50.9, 25.5, 16.1, 10.0, 1.93, 30.0, 30.5, 20.5, 10.0),
    "temperature": (48.8, 50.4, 150.4, 150.0, 20.0, 20.0, 20.0, 149.0, 155.5, 147.7, 147.7),
}
"""What the authors got. Their vibration sole repeats the dorsum of the hand (16.1); the text
says 10, which stands here."""

TABLE_1_SD_MM: Final[dict[str, tuple[float, ...]]] = {
    "pressure": (3.50, 6.94, 14.3, 12.6, 10.4, 4.56, 1.64, 16.2, 19.1, 9.0, 4.7),
    "vibration": (1.22, 10.4, 31.0, 19.5, 10.7, 6.10, 0.69, 18.4, 21.0, 10.4, 10.7),
    "temperature": (22.8, 24.6, 86.3, 87.63, 11.0, 11.0, 11.0, 82.1, 89.9, 62.8, 62.8),
}
"""Standard deviations of Table 1; the vibration sole's is the repeated one."""
