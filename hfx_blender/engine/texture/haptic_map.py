# SPDX-License-Identifier: GPL-3.0-or-later
"""A haptic map: how strong and how sharp the collisions with each texel are."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...errors import InputError
from ..arrays import F32, F64
from .device_range import DeviceRange, NoticeableSteps
from .height_field import check_texel


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
