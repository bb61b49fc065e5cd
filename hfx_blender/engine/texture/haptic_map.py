# SPDX-License-Identifier: GPL-3.0-or-later
"""Material of a haptic surface: heights, renderer, and haptic map relative to a device's range."""

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F32, F64
from .height_field import HeightField, check_texel
from .surface_names import DRIVE_PER_M

STANDARD_GRAVITY: Final = 9.80665  # acceleration of 1 g, m/s^2


@dataclass(frozen=True)
class DeviceRange:
    """Range of amplitudes and frequencies of a vibration device. Defaults: the reference phone of
    Liu and Gu (2025, section 3.2). Raises InputError for a range that is not finite, ascending and
    positive."""

    amplitude_g: tuple[float, float] = (0.0, 1.3)  # peak at intensity 0 and 1, g
    frequency_hz: tuple[float, float] = (80.0, 260.0)  # at sharpness 0 and 1
    carrier_hz: float = 160.0  # of a device with a single frequency
    update_s: float = 0.05  # least time between two changes

    def __post_init__(self) -> None:
        for name, limits in (("amplitude", self.amplitude_g), ("frequency", self.frequency_hz)):
            low, high = limits
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
        # Silence stays silent, though the range of a device may begin above 0.
        share = np.clip(np.asarray(intensity, np.float64), 0.0, 1.0)
        return np.where(share > 0.0, (low + share * (high - low)) * STANDARD_GRAVITY, 0.0)

    def frequency_of(self, sharpness: npt.ArrayLike) -> F64:
        """Frequency, Hz, of sharpness clipped to 0..1."""
        low, high = self.frequency_hz
        share = np.minimum(np.maximum(np.asarray(sharpness, np.float64), 0.0), 1.0)
        return np.asarray(low + share * (high - low))


@dataclass(frozen=True)
class NoticeableSteps:
    """Just-noticeable differences of amplitude and frequency. Defaults: Liu and Gu (2025, section
    3.4.1), silence and six levels up to 1.2 g, five frequencies from 80 to 240 Hz. Raises
    InputError for steps of 0 or less."""

    amplitude_g: float = 0.2
    frequency_hz: float = 40.0

    def __post_init__(self) -> None:
        for name, value in (("amplitude_g", self.amplitude_g), ("frequency_hz", self.frequency_hz)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"Noticeable steps: {name} is {value:g}; expected more than 0.")


def _stepped(share: F32, limits: tuple[float, float], step: float) -> F32:
    """Shares 0..1 of the range ``limits``, rounded to whole steps from its lower limit. Steps
    beyond the range are not used; unchanged for a range without width."""
    low, high = limits
    if high == low:
        return share
    # The margin keeps the top step of a range that is a multiple of the step, despite rounding.
    count = np.floor((high - low) / step * (1.0 + 1e-9))
    steps = np.clip(np.rint(share * ((high - low) / step)), 0.0, count)
    return (steps * (step / (high - low))).astype(np.float32)


@dataclass(frozen=True, eq=False)
class HapticMap:
    """Two layers of Liu and Gu (2025, section 3.2), relative to a device's range. Row 0 is at the
    bottom, as in :class:`.HeightField`. Raises InputError for layers that differ in size or leave
    0..1, or a texel without size."""

    intensity: F32  # (H, W) 0 silent to 1 strongest
    sharpness: F32  # (H, W) 0 lowest frequency (rough) to 1 highest (smooth)
    texel_m: tuple[float, float]  # size of a texel along x and y
    tiles: bool = True  # repeat the map; else its edge continues outwards
    device: DeviceRange = field(default_factory=DeviceRange)  # meaning of 0 and 1 in g and Hz
    steps: NoticeableSteps | None = None  # steps to which both layers are rounded; None: none

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
            # Negated below, so that NaN is refused, too.
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

    def in_steps(self, steps: NoticeableSteps | None = None) -> "HapticMap":
        """Copy with both layers rounded to noticeable steps; None: the default steps."""
        steps = steps or NoticeableSteps()
        return replace(
            self,
            intensity=_stepped(self.intensity, self.device.amplitude_g, steps.amplitude_g),
            sharpness=_stepped(self.sharpness, self.device.frequency_hz, steps.frequency_hz),
            steps=steps,
        )


class SurfaceRenderer(Enum):
    """Method of rendering a surface as vibration."""

    MCHA = "mcha"  # micro-collisions: strongest texel of the haptic map on the path
    TEXTILE = "textile"  # weighted spectrum of heights in a window, single frequency
    DIRECT = "direct"  # heights as a waveform, for wide-band actuators


@dataclass(frozen=True, eq=False)
class SurfaceTexture:
    """Haptic material of a surface.

    ``drive_per_m`` is c_v of equation 3: drive (0..1) per metre of height. ``is_calibrated``: this
    is the user's common setting, replaced by a device's own c_v (:mod:`..surface.surface_drive`).
    Raises InputError without the renderer's heights or map, or for an unusable ``drive_per_m``.
    """

    height: HeightField | None = None  # required by TEXTILE and DIRECT
    map: HapticMap | None = None  # required by MCHA; texels may differ in size from the heights
    renderer: SurfaceRenderer = SurfaceRenderer.MCHA
    drive_per_m: float = DRIVE_PER_M
    device: DeviceRange = field(default_factory=DeviceRange)  # of drive 0..1, also for a map
    is_calibrated: bool = False

    def __post_init__(self) -> None:
        if self.renderer is SurfaceRenderer.MCHA and self.map is None:
            raise InputError("Haptic surface: micro-collisions need a haptic map.")
        if self.renderer is not SurfaceRenderer.MCHA and self.height is None:
            raise InputError(f"Haptic surface: renderer '{self.renderer.value}' needs heights.")
        if not (np.isfinite(self.drive_per_m) and self.drive_per_m >= 0.0):
            raise InputError(
                f"Haptic surface: drive per metre is {self.drive_per_m:g}; expected 0 or more."
            )
