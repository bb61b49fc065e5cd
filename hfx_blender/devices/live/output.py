# SPDX-License-Identifier: GPL-3.0-or-later
"""An open device: what the output process needs of it, whatever it is connected by."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


class OutputLostError(Exception):
    """The device cannot be reached any more: unplugged, refused, gone."""


class Output(Protocol):
    """Encoder and transport of one device together. No method ever waits for the hardware."""

    def send(self, values: F64) -> None:
        """Hand over values (columns,) that have passed the guard; only the newest ones count.

        Raises
        ------
        OutputLostError
        """

    def stop(self) -> None:
        """Send the stop bytes, before anything that still waits; never raises."""

    def close(self) -> None:
        """Give the port back; never raises. The device has been stopped before."""
