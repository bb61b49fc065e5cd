# SPDX-License-Identifier: GPL-3.0-or-later
"""The last guard before a value leaves the engine: finite, then in range."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def limited(
    values: npt.ArrayLike, lowest: npt.ArrayLike, highest: npt.ArrayLike, silent: npt.ArrayLike
) -> F64:
    """Values that an actuator may be given.

    One parameter that is NaN or infinite silences the actuator in all its parameters: a
    minimum or maximum alone would turn NaN into full power.

    Parameters
    ----------
    values : (..., P)
        Parameters of one actuator in the last axis.
    lowest, highest : (P,) or broadcastable
        Allowed range, both included.
    silent : (P,) or broadcastable
        What is given instead, itself in the range.

    Returns
    -------
    (..., P) float64
    """
    values = np.asarray(values, np.float64)
    is_number = np.isfinite(values).all(axis=-1, keepdims=True)
    return np.clip(np.where(is_number, values, silent), lowest, highest)
