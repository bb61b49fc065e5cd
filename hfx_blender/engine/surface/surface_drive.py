# SPDX-License-Identifier: GPL-3.0-or-later
"""Device-specific drive of surfaces: a device's own c_v in place of the common one.

Samples hold for all devices, so a surface that is felt by its heights is sampled with one c_v
(:mod:`..texture.textile`, equation 3). A device that was calibrated has its own; its amplitudes
are as many times stronger, up to the surface's strongest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64
from ..samples import SampleRun
from ..scene import HapticSurface, SceneDescription
from ..texture.surface_texture import SurfaceRenderer, SurfaceTexture

SETTING: Final = "surface_drive"
"""Key of a track's settings: ``{effect id: [c_v in 1/m, strongest amplitude in m/s^2]}``."""


@dataclass(frozen=True)
class SurfaceDrive:
    """Sampled drive of a surface, where a device's own c_v may take its place."""

    drive_per_m: float
    full_m_s2: float  # amplitude of a drive of 1

    @classmethod
    def of(cls, texture: SurfaceTexture) -> SurfaceDrive | None:
        """Drive of a texture; None where c_v is not the device's: micro-collisions, or set for the
        object.
        """
        by_heights = texture.renderer is not SurfaceRenderer.MCHA
        if not (by_heights and texture.is_calibrated and texture.drive_per_m > 0.0):
            return None
        return cls(texture.drive_per_m, float(texture.device.amplitude_m_s2(1.0)))

    def amplitude(self, amplitude_m_s2: npt.ArrayLike, own_per_m: float | None) -> F64:
        """Amplitudes on a device with its own c_v (None: it has none)."""
        amplitude = np.asarray(amplitude_m_s2, np.float64)
        if own_per_m is None:
            return amplitude
        most = np.maximum(amplitude, self.full_m_s2)
        return np.minimum(amplitude * (own_per_m / self.drive_per_m), most)


class SurfaceDrives:
    """Drives of the surfaces of a track on one device.

    Parameters
    ----------
    settings : mapping
        A track's.
    own_per_m : float, optional
        c_v of the device; None: it has none of its own.

    Raises
    ------
    InputError
        The settings hold something else.
    """

    def __init__(self, settings: Mapping[str, Any], own_per_m: float | None) -> None:
        self._own_per_m = own_per_m
        found = settings.get(SETTING, {})
        if not isinstance(found, Mapping):
            raise InputError(f"Track: settings.{SETTING} is no list of effects.")
        self._drives = {name: _read(name, pair) for name, pair in found.items()}

    def on_device(self, run: SampleRun) -> SampleRun:
        """A run as the device is to play it."""
        drive = self._drives.get(run.stream.effect_id)
        if self._own_per_m is None or drive is None:
            return run
        parameters = run.parameters.copy()
        parameters[:, 0] = drive.amplitude(parameters[:, 0], self._own_per_m)
        return replace(run, parameters=parameters)


def with_drives(settings: Mapping[str, Any], scene: SceneDescription) -> Mapping[str, Any]:
    """Settings of a track, extended by the drives of its surfaces."""
    drives = {
        effect.id: SurfaceDrive.of(effect.area.texture)
        for effect in scene.effects
        if isinstance(effect.area, HapticSurface)
    }
    known = {id: [each.drive_per_m, each.full_m_s2] for id, each in drives.items() if each}
    return {**settings, SETTING: known} if known else settings


def _read(name: str, pair: object) -> SurfaceDrive:
    if isinstance(pair, list) and len(pair) == 2:
        is_number = [isinstance(x, int | float) and not isinstance(x, bool) for x in pair]
        if all(is_number) and all(math.isfinite(x) and x > 0.0 for x in pair):
            return SurfaceDrive(float(pair[0]), float(pair[1]))
    raise InputError(
        f"Track: settings.{SETTING} of effect '{name}' is {pair!r:.60}; expected two numbers "
        "above 0."
    )
