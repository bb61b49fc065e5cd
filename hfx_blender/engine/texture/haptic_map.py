# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic maps: intensity and sharpness of each texel, relative to the range of a device."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F32, F64
from .height_field import check_texel

STANDARD_GRAVITY: Final = 9.80665
"""Acceleration of 1 g, m/s^2."""


@dataclass(frozen=True)
class DeviceRange:
    """Range of amplitudes and frequencies of a vibration device.

    Defaults: the reference phone of Liu and Gu (2025, section 3.2). Raises InputError for a range
    that is not finite, ascending and positive.
    """

    amplitude_g: tuple[float, float] = (0.0, 1.3)  # peak at intensity 0 and 1, g
    frequency_hz: tuple[float, float] = (80.0, 260.0)  # at sharpness 0 and 1
    carrier_hz: float = 160.0  # of a device with a single frequency
    update_s: float = 0.05  # least time between two changes

    def __post_init__(self) -> None:
        for name, (low, high) in (
            ("amplitude", self.amplitude_g),
            ("frequency", self.frequency_hz),
        ):
            if not (np.isfinite([low, high]).all() and 0.0 <= low <= high and high > 0.0):
                raise InputError(
                    f"Device range: {name} {low:g} to {high:g}; expected 0 <= low <= high."
                )
        for name, value in (("carrier_hz", self.carrier_hz), ("update_s", self.update_s)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Device range: {name} is {value:g}; expected more than 0.")

    def amplitude_m_s2(self, intensity: npt.ArrayLike) -> F64:
        """Peak acceleration, m/s^2, of intensities clipped to 0..1; exactly 0 for intensity 0."""
        low, high = self.amplitude_g
        share = np.clip(np.asarray(intensity, np.float64), 0.0, 1.0)
        return np.where(share > 0.0, (low + share * (high - low)) * STANDARD_GRAVITY, 0.0)

    def frequency_of(self, sharpness: npt.ArrayLike) -> F64:
        """Frequency, Hz, of sharpness clipped to 0..1."""
        low, high = self.frequency_hz
        share = np.minimum(np.maximum(np.asarray(sharpness, np.float64), 0.0), 1.0)
        return np.asarray(low + share * (high - low))


@dataclass(frozen=True)
class NoticeableSteps:
    """Just-noticeable differences of amplitude and frequency.

    Defaults: Liu and Gu (2025, section 3.4.1), silence and six levels up to 1.2 g, five frequencies
    from 80 to 240 Hz. Raises InputError for steps of 0 or less.
    """

    amplitude_g: float = 0.2
    frequency_hz: float = 40.0

    def __post_init__(self) -> None:
        for name, value in (("amplitude_g", self.amplitude_g), ("frequency_hz", self.frequency_hz)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Noticeable steps: {name} is {value:g}; expected more than 0.")


def _stepped(share: F32, limits: tuple[float, float], step: float) -> F32:
    """Shares 0..1 of the range ``limits``, rounded to whole steps from its lower limit.

    Steps beyond the range are not used; unchanged for a range without width.
    """
    low, high = limits
    if high == low:
        return share
    count = np.floor((high - low) / step * (1.0 + 1e-9))
    steps = np.clip(np.rint(share * ((high - low) / step)), 0.0, count)
    return (steps * (step / (high - low))).astype(np.float32)


@dataclass(frozen=True, eq=False)
class HapticMap:
    """Two layers of Liu and Gu (2025, section 3.2), relative to a device's range.

    Raises InputError for layers that differ in size or leave 0..1, or a texel without size.

    Parameters
    ----------
    intensity : (H, W) float32
        0 silent to 1 strongest. Row 0 is at the bottom, as in :class:`.HeightField`.
    sharpness : (H, W) float32
        0 lowest frequency (rough) to 1 highest (smooth).
    texel_m : (float, float)
        Size of a texel along x and y.
    device : DeviceRange
        Meaning of 0 and 1 in g and Hz.
    steps : NoticeableSteps, optional
        Steps to which both layers are rounded.
    """

    intensity: F32
    sharpness: F32
    texel_m: tuple[float, float]
    tiles: bool = True
    device: DeviceRange = field(default_factory=DeviceRange)
    steps: NoticeableSteps | None = None

    def __post_init__(self) -> None:
        check_texel(self.texel_m, "Haptic map")
        if self.intensity.ndim != 2 or self.intensity.size == 0:
            raise InputError(
                f"Haptic map: expected rows and columns of intensity, got {self.intensity.shape}."
            )
        if self.sharpness.shape != self.intensity.shape:
            raise InputError(
                f"Haptic map: the layers differ in size, {self.intensity.shape} and "
                f"{self.sharpness.shape}."
            )
        for name in ("intensity", "sharpness"):
            values = np.asarray(getattr(self, name), np.float32)
            low, high = float(values.min()), float(values.max())  # NaN if any texel is
            if not (low >= 0.0 and high <= 1.0):
                raise InputError(f"Haptic map: {name} from {low:g} to {high:g}; expected 0 to 1.")
            object.__setattr__(self, name, values)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the map, metres."""
        rows, columns = self.intensity.shape
        return columns * self.texel_m[0], rows * self.texel_m[1]

    @property
    def amplitude_m_s2(self) -> F64:
        """Peak acceleration of each texel, (H, W), m/s^2."""
        return self.device.amplitude_m_s2(self.intensity)

    @property
    def frequency_hz(self) -> F64:
        """Frequency of each texel, (H, W), Hz."""
        return self.device.frequency_of(self.sharpness)

    def in_steps(self, steps: NoticeableSteps | None = None) -> HapticMap:
        """Copy with both layers rounded to noticeable steps; None: the default steps."""
        steps = steps or NoticeableSteps()
        return replace(
            self,
            intensity=_stepped(self.intensity, self.device.amplitude_g, steps.amplitude_g),
            sharpness=_stepped(self.sharpness, self.device.frequency_hz, steps.frequency_hz),
            steps=steps,
        )
