# SPDX-License-Identifier: GPL-3.0-or-later
"""Material of a haptic surface: its heights, its haptic map, and the renderer to use."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from ...errors import InputError
from .haptic_map import DeviceRange, HapticMap
from .height_field import HeightField
from .surface_names import DRIVE_PER_M


class SurfaceRenderer(Enum):
    """Method by which a surface is turned into vibration."""

    MCHA = "mcha"  # micro-collisions: the haptic map's strongest texel on the way
    TEXTILE = "textile"  # the weighted spectrum of the height over a window, one frequency
    DIRECT = "direct"  # the height itself, at audio rate, for wide-band actuators


@dataclass(frozen=True, eq=False)
class SurfaceTexture:
    """Haptic material of a surface.

    Parameters
    ----------
    height : HeightField, optional
        Needed by ``TEXTILE`` and ``DIRECT``.
    map : HapticMap, optional
        Needed by ``MCHA``. Its texels need not be those of the heights.
    drive_per_m : float
        c_v of equation 3: drive (0..1) per metre of height; calibrated per user and device.
    device : DeviceRange
        What a drive of 0..1 means. A map is rendered with this device, not with its own.
    is_calibrated : bool
        ``drive_per_m`` is what the user set for any device: one with a c_v of its own takes that
        (:mod:`..surface.surface_drive`).

    Raises
    ------
    InputError
        What the renderer needs is not there.
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
