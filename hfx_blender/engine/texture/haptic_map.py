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
"""Metres per second squared in one g."""


@dataclass(frozen=True)
class DeviceRange:
    """Range of amplitudes and frequencies that a device can play.

    The defaults are those of the reference phone of Liu and Gu (2025, section 3.2).
    """

    amplitude_g: tuple[float, float] = (0.0, 1.3)  # at intensity 0 and 1, peak, in g
    frequency_hz: tuple[float, float] = (80.0, 260.0)  # at sharpness 0 and 1
    carrier_hz: float = 160.0  # of a device that plays one frequency only
    update_s: float = 0.05  # no two changes are nearer to each other

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
        """Peak acceleration of intensities 0..1; 0 is silent on any device."""
        low, high = self.amplitude_g
        share = np.clip(np.asarray(intensity, np.float64), 0.0, 1.0)
        return np.where(share > 0.0, (low + share * (high - low)) * STANDARD_GRAVITY, 0.0)

    def frequency_of(self, sharpness: npt.ArrayLike) -> F64:
        """Frequency of sharpness 0..1, Hz."""
        low, high = self.frequency_hz
        share = np.minimum(np.maximum(np.asarray(sharpness, np.float64), 0.0), 1.0)
        return np.asarray(low + share * (high - low))


@dataclass(frozen=True)
class NoticeableSteps:
    """Just-noticeable differences: people cannot tell finer levels apart.

    Defaults: Liu and Gu (2025, section 3.4.1): silence and six levels up to 1.2 g, and five
    frequencies from 80 to 240 Hz.
    """

    amplitude_g: float = 0.2
    frequency_hz: float = 40.0

    def __post_init__(self) -> None:
        for name, value in (
            ("amplitude_g", self.amplitude_g),
            ("frequency_hz", self.frequency_hz),
        ):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Noticeable steps: {name} is {value:g}; expected more than 0.")

    def intensity(self, intensity: F32, device: DeviceRange) -> F32:
        """Intensities moved to the nearest step that the device can play."""
        return _stepped(intensity, device.amplitude_g, self.amplitude_g)

    def sharpness(self, sharpness: F32, device: DeviceRange) -> F32:
        """Sharpness moved to the nearest step that the device can play."""
        return _stepped(sharpness, device.frequency_hz, self.frequency_hz)


def _stepped(share: F32, limits: tuple[float, float], step: float) -> F32:
    low, high = limits
    if high == low:
        return share
    count = np.floor((high - low) / step * (1.0 + 1e-9))
    steps = np.clip(np.rint(share * ((high - low) / step)), 0.0, count)
    return (steps * (step / (high - low))).astype(np.float32)


@dataclass(frozen=True, eq=False)
class HapticMap:
    """Haptic map: the two layers of Liu and Gu (2025, section 3.2), relative to a device's range.

    Parameters
    ----------
    intensity : (H, W) float32
        0 silent, 1 the strongest. Row 0 is at the bottom, as in :class:`.HeightField`.
    sharpness : (H, W) float32
        0 the lowest frequency (rough), 1 the highest (smooth).
    texel_m : (float, float)
        Size of a texel along x and along y.
    device : DeviceRange
        What 0 and 1 mean in g and Hz.
    steps : NoticeableSteps, optional
        The steps that both layers were moved to.

    Raises
    ------
    InputError
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
            low, high = float(values.min()), float(values.max())  # NaN if any is
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
        """Peak acceleration of each texel, (H, W)."""
        return self.device.amplitude_m_s2(self.intensity)

    @property
    def frequency_hz(self) -> F64:
        """Frequency of each texel, (H, W)."""
        return self.device.frequency_of(self.sharpness)

    def in_steps(self, steps: NoticeableSteps | None = None) -> HapticMap:
        """The map with both layers moved to just-noticeable steps."""
        steps = steps or NoticeableSteps()
        return replace(
            self,
            intensity=steps.intensity(self.intensity, self.device),
            sharpness=steps.sharpness(self.sharpness, self.device),
            steps=steps,
        )
