# SPDX-License-Identifier: GPL-3.0-or-later
"""Interface of an open device for the output process, for any kind of connection."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from ...engine.arrays import F64
from .tones import Tones


class OutputLostError(Exception):
    """Raised when the device cannot be reached any more: unplugged, refused, gone."""


class Output(Protocol):
    """Encoder and transport of one device together. Only :meth:`close` waits."""

    def send(self, values: F64) -> None:
        """Hand over values (columns,) from the guard; only the newest ones count.

        Raises
        ------
        OutputLostError
        """

    def stop(self) -> None:
        """Send the stop bytes, before anything that waits; never raises."""

    def close(self) -> None:
        """Give the port back. The device has been stopped before; where the other side confirms
        that, this waits for it, a few seconds at most.

        Raises
        ------
        OutputLostError
            The stop did not arrive. The port is given back all the same.
        """


@runtime_checkable
class SoundingOutput(Output, Protocol):
    """Output that plays sums of sines at the actuators that take a waveform."""

    def send_tones(self, values: F64, tones: Tones) -> None:
        """Hand over values, and the tones that replace them at these actuators.

        Raises
        ------
        OutputLostError
        """
