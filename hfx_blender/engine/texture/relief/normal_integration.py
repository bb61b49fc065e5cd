# SPDX-License-Identifier: GPL-3.0-or-later
"""Relief from a normal map: the heights with the best matching slopes.

Frankot and Chellappa (1988), "A method for enforcing integrability in shape from shading
algorithms": least squares in the Fourier domain.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...arrays import F64

_STEEPEST = 0.05  # smallest z of a unit normal: steeper is a fault of the map


def heights_of_normals(
    normals: npt.ArrayLike, texel_m: tuple[float, float], *, tiles: bool = False
) -> F64:
    """Heights (H, W) in metres, of mean 0.

    Parameters
    ----------
    normals : array_like
        (H, W, 3) unit normals in tangent space: x along columns, y along rows, z outwards.
        What is no number is flat.
    texel_m : (float, float)
        Size of a texel along columns and rows, metres.
    tiles : bool
        Whether the map goes on at its opposite edge; if not it is continued as in a mirror.
    """
    n = np.array(normals, np.float64)
    flat = ~np.isfinite(n).all(axis=2)
    n[flat] = (0.0, 0.0, 1.0)
    up = np.maximum(n[..., 2], _STEEPEST)
    # Slopes along each axis, in metres a texel.
    along_x, along_y = -n[..., 0] / up * texel_m[0], -n[..., 1] / up * texel_m[1]
    rows, columns = up.shape
    if not tiles:
        along_x = np.block([[along_x, -along_x[:, ::-1]], [along_x[::-1], -along_x[::-1, ::-1]]])
        along_y = np.block([[along_y, along_y[:, ::-1]], [-along_y[::-1], -along_y[::-1, ::-1]]])
    # A slope is that of a sampled sine wave: its frequency in radians a texel.
    fx = 2.0 * np.pi * np.fft.rfftfreq(along_x.shape[1])[None, :]
    fy = 2.0 * np.pi * np.fft.fftfreq(along_x.shape[0])[:, None]
    # Nyquist's slope has no sign.
    fx = np.where(np.isclose(np.abs(fx), np.pi), 0.0, fx)
    fy = np.where(np.isclose(np.abs(fy), np.pi), 0.0, fy)
    power = (fx / texel_m[0]) ** 2 + (fy / texel_m[1]) ** 2
    spectrum = -1j * (
        fx / texel_m[0] ** 2 * np.fft.rfft2(along_x) + fy / texel_m[1] ** 2 * np.fft.rfft2(along_y)
    )
    spectrum = np.divide(spectrum, power, out=np.zeros_like(spectrum), where=power > 0.0)
    heights = np.fft.irfft2(spectrum, s=along_x.shape)[:rows, :columns]
    return np.asarray(heights - heights.mean())
