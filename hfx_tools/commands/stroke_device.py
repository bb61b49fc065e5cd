# SPDX-License-Identifier: GPL-3.0-or-later
"""Strokes over surfaces within the range, frequencies and update interval of one device."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hfx_blender.engine.rendering.conditioning.actuator_limits import limited
from hfx_blender.engine.rendering.device_config import ActuatorType, DeviceConfig
from hfx_blender.engine.texture.haptic_map import STANDARD_GRAVITY, DeviceRange
from hfx_blender.engine.texture.stroke_rendering import StrokeSignal, carrier
from hfx_blender.errors import InputError


class StrokeDevice:
    """First vibration actuator of a device, which plays strokes; InputError without one."""

    def __init__(self, device: DeviceConfig) -> None:
        kinds = [a.type for a in device.actuators if a.type.modality == "vibration"]
        if not kinds:
            raise InputError(f"Device '{device.id}': no actuator of it vibrates.")
        self._kind: ActuatorType = kinds[0]
        self._gain = device.gain

    @property
    def update_s(self) -> float:
        """Time between two values, seconds."""
        return self._kind.update_interval_ms / 1000.0

    @property
    def range(self) -> DeviceRange:
        """Range for the files of a stroke: amplitude from 0 to the highest, in units of standard
        gravity; frequency, its neutral value, and the interval between values."""
        strength, frequency = self._kind.modality_controls
        return DeviceRange(
            (0.0, strength.highest / STANDARD_GRAVITY),
            (frequency.lowest, frequency.highest),
            frequency.neutral,
            self.update_s,
        )

    def played(self, stroke: StrokeSignal) -> StrokeSignal:
        """Copy of a stroke as the device plays it, with a new waveform.

        The amplitude is multiplied by the device's gain. Amplitude and frequency are clipped to the
        limits of the actuator's controls; at a NaN or infinite value of either, both are neutral.
        """
        controls = self._kind.modality_controls
        values = limited(
            np.stack([stroke.amplitude_m_s2 * self._gain, stroke.frequency_hz], axis=1),
            [control.lowest for control in controls],
            [control.highest for control in controls],
            [control.neutral for control in controls],
        )
        amplitude, frequency = np.ascontiguousarray(values.T)
        return replace(
            stroke,
            amplitude_m_s2=amplitude,
            frequency_hz=frequency,
            waveform_m_s2=carrier(amplitude, frequency, stroke.step_s, stroke.waveform_rate_hz),
        )
