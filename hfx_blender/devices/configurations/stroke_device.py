# SPDX-License-Identifier: GPL-3.0-or-later
"""A stroke over a surface as one device plays it: its range, frequencies and update interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...engine.rendering.conditioning.actuator_limits import limited
from ...engine.rendering.device_config import ActuatorType, DeviceConfig
from ...engine.texture.haptic_map import STANDARD_GRAVITY, DeviceRange
from ...engine.texture.stroke_rendering import StrokeSignal, carrier
from ...errors import InputError


class StrokeDevice:
    """Vibration actuator of a device that plays strokes, the first of its configuration.

    Raises
    ------
    InputError
        The device has none.
    """

    def __init__(self, device: DeviceConfig) -> None:
        kinds = [each.type for each in device.actuators if each.type.modality == "vibration"]
        if not kinds:
            raise InputError(f"Device '{device.id}': no actuator of it vibrates.")
        self._kind: ActuatorType = kinds[0]
        self._gain = device.gain

    @property
    def update_s(self) -> float:
        """Time between two values."""
        return self._kind.update_interval_ms / 1000.0

    @property
    def range(self) -> DeviceRange:
        """Range to which files of a stroke refer."""
        strength, frequency = self._kind.controls
        return DeviceRange(
            (0.0, strength.highest / STANDARD_GRAVITY),
            (frequency.lowest, frequency.highest),
            frequency.neutral,
            self.update_s,
        )

    def played(self, felt: StrokeSignal) -> StrokeSignal:
        """A stroke within the limits of the device, as an export of it is."""
        controls = self._kind.controls
        values = limited(
            np.stack([felt.amplitude_m_s2 * self._gain, felt.frequency_hz], axis=1),
            [each.lowest for each in controls],
            [each.highest for each in controls],
            [each.neutral for each in controls],
        )
        amplitude, frequency = np.ascontiguousarray(values.T)
        return replace(
            felt,
            amplitude_m_s2=amplitude,
            frequency_hz=frequency,
            waveform_m_s2=carrier(amplitude, frequency, felt.step_s, felt.waveform_rate_hz),
        )
