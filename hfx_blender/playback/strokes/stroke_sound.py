# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays vibration as sound through Blender's own audio; silent where there is none."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt

_log = logging.getLogger(__name__)


class StrokeSound:
    """Plays vibration as it comes, and a friction sound that follows the speed."""

    def __init__(self, full_m_s2: float, friction: Any = None) -> None:
        self._full = full_m_s2
        self._device: Any = None
        self._friction: Any = None
        try:
            import aud

            self._aud = aud
            self._device = aud.Device()
            if friction is not None:
                self._friction = self._device.play(friction.factory)
                self._friction.loop_count = -1
                self._friction.volume = 0.0
        except Exception as error:  # no aud, no sound card: it can still be felt
            _log.info("no sound: %s", error)
            self._device = None

    def play(self, waveform_m_s2: npt.ArrayLike, rate_hz: float) -> None:
        """Play a piece of a waveform."""
        if self._device is None:
            return
        samples = np.clip(np.asarray(waveform_m_s2, np.float32) / self._full, -1.0, 1.0)
        sound = self._aud.Sound.buffer(np.ascontiguousarray(samples.reshape(-1, 1)), rate_hz)
        self._device.play(sound)

    def set_friction(self, share: float) -> None:
        """Set the volume of the friction sound, 0 to 1."""
        if self._friction is not None:
            self._friction.volume = float(np.clip(share, 0.0, 1.0))

    def close(self) -> None:
        if self._device is not None:
            self._device.stopAll()
            self._device = None
