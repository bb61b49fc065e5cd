# SPDX-License-Identifier: GPL-3.0-or-later
"""Material of a haptic surface: heights, haptic map and renderer."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from ...errors import InputError
from .haptic_map import DeviceRange, HapticMap
from .height_field import HeightField
from .surface_names import DRIVE_PER_M


class SurfaceRenderer(Enum):
    """Method of rendering a surface as vibration."""

    MCHA = "mcha"  # micro-collisions: strongest texel of the haptic map on the path
    TEXTILE = "textile"  # weighted spectrum of heights in a window, single frequency
    DIRECT = "direct"  # heights as a waveform, for wide-band actuators


@dataclass(frozen=True, eq=False)
class SurfaceTexture:
    """Haptic material of a surface.

    Raises InputError without the renderer's heights or map, or for an unusable ``drive_per_m``.

    Parameters
    ----------
    height : HeightField, optional
        Required by ``TEXTILE`` and ``DIRECT``.
    map : HapticMap, optional
        Required by ``MCHA``; may have texels of another size than the heights.
    drive_per_m : float
        c_v of equation 3: drive (0..1) per metre of height; calibrated per user and device.
    device : DeviceRange
        Meaning of drive 0..1; also for a map, in place of the map's range.
    is_calibrated : bool
        ``drive_per_m`` is the user's common setting; a device's own c_v replaces it
        (:mod:`..surface.surface_drive`).
    """

    height: HeightField | None = None
    map: HapticMap | None = None
    renderer: SurfaceRenderer = SurfaceRenderer.MCHA
    drive_per_m: float = DRIVE_PER_M
    device: DeviceRange = field(default_factory=DeviceRange)
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
