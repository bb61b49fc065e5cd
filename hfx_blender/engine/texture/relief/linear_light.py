# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversion of pictures between sRGB and linear light."""

import numpy as np
import numpy.typing as npt

from ...arrays import F64


def srgb_to_linear(codes: npt.ArrayLike) -> F64:
    """Linear light 0..1 of sRGB values 0..1 (IEC 61966-2-1)."""
    values = np.asarray(codes, np.float64)
    toe = values / 12.92
    return np.where(values <= 0.04045, toe, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: npt.ArrayLike) -> F64:
    """sRGB values 0..1 of linear light 0..1 (IEC 61966-2-1)."""
    values = np.asarray(light, np.float64)
    curve = 1.055 * np.maximum(values, 0.0) ** (1.0 / 2.4) - 0.055
    return np.where(values <= 0.0031308, 12.92 * values, curve)


def luminance(linear_rgb: npt.ArrayLike) -> F64:
    """Luminance (...) of linear RGB (..., 3 or more), the weights of ITU-R BT.709."""
    values = np.asarray(linear_rgb, np.float64)
    return np.asarray(values[..., :3] @ np.array([0.2126, 0.7152, 0.0722]))


def height_from_colour(srgb: npt.ArrayLike) -> F64:
    """Heights 0..1 of an albedo picture (..., 3 or 4), sRGB: the luminance, so bright is high."""
    values = np.asarray(srgb, np.float64)
    return luminance(srgb_to_linear(values[..., :3]))
