# SPDX-License-Identifier: GPL-3.0-or-later
"""Micro-collision haptic maps from heights and roughness (Liu and Gu 2025, section 3.2).

Intensity: Gaussian blur, Sobel gradient magnitude, full strength at a slope common to all
materials. Sharpness: 1 minus roughness.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...files import limits
from ..arrays import F32
from .haptic_map import DeviceRange, HapticMap, NoticeableSteps
from .height_field import HeightField, wrapped

TRUNCATE: Final = 4.0  # cut-off of the Gaussian kernel in standard deviations
_MOST_SIZES: Final = 3
_KERNEL_BYTES: Final = 24.0  # memory per texel of the Gaussian: offset, weight, sum
_TEXEL_BYTES: Final = 12.0  # memory per padded texel: height, spectrum, slope
_WORKERS: Final = 2


@dataclass(frozen=True)
class MapSettings:
    """Settings of haptic maps; equal for all materials, so that maps are comparable."""

    blur_m: float = 0.1e-3  # standard deviation of the Gaussian blur
    full_slope: float = 1.0  # slope of intensity 1, metres per metre
    default_roughness: float = 0.5  # 0..1, of a surface without a roughness picture
    device: DeviceRange = field(default_factory=DeviceRange)
    steps: NoticeableSteps | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.blur_m) and self.blur_m >= 0.0):
            raise InputError(f"Haptic map: a blur of {1e3 * self.blur_m:g} mm; expected 0 or more.")
        if not (np.isfinite(self.full_slope) and self.full_slope > 0.0):
            raise InputError(f"Haptic map: full slope {self.full_slope:g}; expected more than 0.")


def make_map(
    field: HeightField,
    roughness: npt.ArrayLike | None = None,
    settings: MapSettings | None = None,
    slope: F32 | None = None,
) -> HapticMap:
    """Make the haptic map of a surface: intensity from slope, sharpness from roughness.

    ``roughness`` (h, w) is 0 smooth to 1 rough, linear, bottom row first, over the same rectangle,
    of any resolution; None for ``settings.default_roughness``. ``slope`` (H, W) is a separately
    estimated slope after a blur of one texel; None for the slope of the heights. Raises InputError
    for a roughness that is no picture of finite numbers.
    """
    settings = settings or MapSettings()
    if slope is None:
        slope = blurred_slope(field, settings.blur_m)
    else:
        from scipy import ndimage

        # Variances add: the blur that is missing besides one texel, in texels along each axis.
        more = [np.sqrt(max((settings.blur_m / t) ** 2 - 1.0, 0.0)) for t in field.texel_m[::-1]]
        mode = "grid-wrap" if field.tiles else "nearest"
        slope = np.asarray(ndimage.gaussian_filter(slope, more, mode=mode, truncate=TRUNCATE))
    slope *= np.float32(1.0 / settings.full_slope)
    intensity = np.minimum(slope, np.float32(1.0), out=slope)
    sharpness = _sharpness(field, roughness, settings.default_roughness)
    haptic_map = HapticMap(
        intensity, sharpness, field.texel_m, tiles=field.tiles, device=settings.device
    )
    return haptic_map if settings.steps is None else haptic_map.in_steps(settings.steps)


def blurred_slope(field: HeightField, blur_m: float) -> F32:
    """Sobel gradient magnitude of the blurred heights, metres per metre, (H, W). Spatial kernels,
    applied by Fourier transform, whose cost does not grow with the blur. A surface without tiling
    continues flat beyond its edges. Raises TooLargeError for a huge blur."""
    from scipy import fft

    heights = field.heights_m
    rows, columns = heights.shape
    # Large arrays are reused in place, as allocation costs as much as the arithmetic.
    centred = np.zeros(heights.shape, np.float32)
    heights = np.subtract(heights, heights.mean(), out=centred, casting="same_kind")
    # Padding beyond some sizes of the surface changes nothing: a much larger blur flattens it.
    most = _MOST_SIZES * max(rows, columns)
    shown = " x ".join(f"{1e3 * t:g}" for t in field.texel_m)
    asks = f"a blur of {1e3 * blur_m:g} mm over texels of {shown} mm would take"
    kernel = _KERNEL_BYTES * TRUNCATE * blur_m / min(field.texel_m)
    limits.MEMORY.check(kernel, "Haptic map", asks)
    # Cut-off of the kernel, and one texel for the derivative.
    reach = [min(int(TRUNCATE * blur_m / t + 0.5) + 1, most) for t in field.texel_m]
    top = left = 0
    if not field.tiles:
        top, left = reach[1], reach[0]
        texels = float(rows + 2 * top) * float(columns + 2 * left)
        limits.MEMORY.check(_TEXEL_BYTES * texels, "Haptic map", asks)
        below = fft.next_fast_len(rows + 2 * top, real=True) - rows - top
        right = fft.next_fast_len(columns + 2 * left, real=True) - columns - left
        heights = np.pad(heights, ((top, below), (left, right)), "edge")
    spectrum = fft.rfft2(heights, workers=_WORKERS)
    squared: F32 | None = None
    along = [
        _transfers(np.arange(n), heights.shape[k], field.texel_m[1 - k], blur_m)
        for k, n in enumerate(spectrum.shape)
    ]
    # Sobel is separable: smoothing along one axis times the derivative along the second.
    for axis in (0, 1):
        factors = [along[k][int(k == axis)].astype(np.complex64) for k in (0, 1)]
        # The second axis overwrites the spectrum, used for the last time.
        waves = np.multiply(spectrum, factors[0][:, None], out=spectrum if axis else None)
        waves *= factors[1]
        slope = fft.irfft2(waves, heights.shape, workers=_WORKERS, overwrite_x=True)
        slope = slope[top : top + rows, left : left + columns]
        slope *= slope
        squared = slope if squared is None else np.add(squared, slope, out=squared)
    assert squared is not None
    return np.ascontiguousarray(np.sqrt(squared, out=squared))


def _transfers(
    waves: npt.NDArray[np.int64], count: int, texel_m: float, blur_m: float
) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Transfer functions (n,) along one axis: Gaussian times Sobel smoothing, or derivative.
    ``waves`` (n,) are numbers of periods over ``count`` texels."""
    from scipy import fft

    angle = 2.0 * np.pi * waves / count
    blur = np.ones(len(waves))
    if blur_m > 0.0:
        offsets = np.arange(1, int(TRUNCATE * blur_m / texel_m + 0.5) + 1)
        weights = np.exp(-0.5 * (offsets * texel_m / blur_m) ** 2)
        # Offsets beyond one period alias onto the period, for the discrete transform.
        folded = np.bincount(offsets % count, weights, minlength=count)
        blur = (1.0 + 2.0 * fft.fft(folded).real[waves]) / (1.0 + 2.0 * weights.sum())
    # Transfer functions of the kernels [1/4, 1/2, 1/4] and [-1/2, 0, 1/2].
    return blur * (0.5 + 0.5 * np.cos(angle)) + 0j, 1j * blur * np.sin(angle) / texel_m


def _sharpness(field: HeightField, roughness: npt.ArrayLike | None, default: float) -> F32:
    """Sharpness (H, W): 1 minus a roughness picture of any size, or ``default``, clipped to 0..1.
    Raises InputError for a picture that is empty or not finite."""
    shape = field.heights_m.shape
    if roughness is None:
        return np.full(shape, 1.0 - np.clip(default, 0.0, 1.0), np.float32)
    values = np.asarray(roughness, np.float32)
    if values.ndim != 2 or values.size == 0 or not np.isfinite(values).all():
        raise InputError(f"Roughness picture: expected finite rows and columns, {values.shape}.")
    values = _stretched(_stretched(values, shape[1], field.tiles).T, shape[0], field.tiles).T
    sharpness = np.subtract(np.float32(1.0), values)
    return np.ascontiguousarray(sharpness.clip(0.0, 1.0, out=sharpness))


def _stretched(values: F32, count: int, tiles: bool) -> F32:
    """Values (h, w) resampled linearly to (h, ``count``) over the same width; ``values`` itself for
    an equal count. ``tiles``: wrapped at the edges, else clamped."""
    known = values.shape[1]
    if known == count:
        return values
    # Centres of the new texels, counted in old texels.
    position = (np.arange(count) + 0.5) * (known / count) - 0.5
    first = np.floor(position)
    share = (position - first).astype(np.float32)
    i = first.astype(np.int64)
    left = values[:, wrapped(i, known, tiles)]
    return left + share * (values[:, wrapped(i + 1, known, tiles)] - left)
