# SPDX-License-Identifier: GPL-3.0-or-later
"""Device-specific drive of haptic surfaces: a calibrated c_v instead of the common c_v.

Samples are independent of devices, so surfaces rendered by heights are sampled with a common c_v
(:mod:`..texture.textile`, equation 3). On a calibrated device amplitudes scale by the ratio of both
c_v, up to the surface's largest amplitude.
"""

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
from ..texture.haptic_map import SurfaceRenderer, SurfaceTexture

SETTING: Final = "surface_drive"
"""Key in track settings: ``{effect id: [c_v in 1/m, largest amplitude in m/s^2]}``."""


@dataclass(frozen=True)
class SurfaceDrive:
    """Drive used to sample a surface."""

    drive_per_m: float
    full_m_s2: float  # amplitude at drive 1

    @classmethod
    def of(cls, texture: SurfaceTexture) -> "SurfaceDrive | None":
        """Drive of a texture by the common c_v (drive per metre of height), which the c_v
        calibrated for a device replaces. None if nothing may replace it: for micro-collisions
        (MCHA), and for a c_v set on the object."""
        by_heights = texture.renderer is not SurfaceRenderer.MCHA
        if not (by_heights and texture.is_calibrated and texture.drive_per_m > 0.0):
            return None
        return cls(texture.drive_per_m, float(texture.device.amplitude_m_s2(1.0)))

    def amplitude(self, amplitude_m_s2: npt.ArrayLike, own_per_m: float | None) -> F64:
        """Amplitudes (m/s^2) of a surface on a device with a calibrated drive per metre of height.
        ``own_per_m`` is that drive (c_v of the textile paper); amplitudes are multiplied by its
        ratio to ``drive_per_m``, but raised at most to ``full_m_s2``. None: unchanged."""
        amplitude = np.asarray(amplitude_m_s2, np.float64)
        if own_per_m is None:
            return amplitude
        # The limit does not cut amplitudes that are above it without the ratio.
        largest = np.maximum(amplitude, self.full_m_s2)
        return np.minimum(amplitude * (own_per_m / self.drive_per_m), largest)


class SurfaceDrives:
    """Drives of the surfaces of a track on one device. ``settings`` are those of the track;
    ``own_per_m`` is the c_v of the device, None without calibration. Raises InputError: the setting
    is invalid."""

    def __init__(self, settings: Mapping[str, Any], own_per_m: float | None) -> None:
        self._own_per_m = own_per_m
        stored = settings.get(SETTING, {})
        if not isinstance(stored, Mapping):
            raise InputError(f"Track: settings.{SETTING} is no list of effects.")
        self._drives: dict[str, SurfaceDrive] = {}
        for name, pair in stored.items():
            numbers = pair if isinstance(pair, list) and len(pair) == 2 else ()
            is_number = [isinstance(x, int | float) and not isinstance(x, bool) for x in numbers]
            if not (numbers and all(is_number) and all(0.0 < x < math.inf for x in numbers)):
                raise InputError(
                    f"Track: settings.{SETTING} of effect '{name}' is {pair!r:.60}; expected two "
                    "numbers above 0."
                )
            self._drives[name] = SurfaceDrive(float(numbers[0]), float(numbers[1]))

    def on_device(self, run: SampleRun) -> SampleRun:
        """Copy of a run with amplitudes for the device; the run itself without calibration or drive
        of the effect."""
        drive = self._drives.get(run.stream.effect_id)
        if self._own_per_m is None or drive is None:
            return run
        parameters = run.parameters.copy()
        parameters[:, 0] = drive.amplitude(parameters[:, 0], self._own_per_m)
        return replace(run, parameters=parameters)


def with_drives(settings: Mapping[str, Any], scene: SceneDescription) -> Mapping[str, Any]:
    """Copy of track settings with the drives of the calibrated surfaces of a scene; ``settings``
    itself without any."""
    drives = {
        effect.id: SurfaceDrive.of(effect.area.texture)
        for effect in scene.effects
        if isinstance(effect.area, HapticSurface)
    }
    known = {id: [drive.drive_per_m, drive.full_m_s2] for id, drive in drives.items() if drive}
    return {**settings, SETTING: known} if known else settings
