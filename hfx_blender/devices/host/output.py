# SPDX-License-Identifier: GPL-3.0-or-later
"""Interface of a device's open output, for any kind of connection."""

from collections.abc import Sequence
from typing import Final, Protocol, runtime_checkable

from ...engine.arrays import F64
from ...text import printable
from .tones import Tones

PATIENCE_S: Final = 0.1
"""Time limit of an output for handing over values, seconds; a slower output counts as stuck. Also
the time limit of a device's script for an answer."""

_SHOWN: Final = 60


class OutputLostError(Exception):
    """Raised for a device that cannot be reached: unplugged, refused, program ended."""


class Output(Protocol):
    """Encoder and transport of a device. Only :meth:`close` waits for the device."""

    def send(self, values: F64) -> None:
        """Send values (columns,) from the guard; unsent older values are dropped.

        Raises OutputLostError.
        """

    def stop(self) -> None:
        """Send the stop bytes ahead of unsent values; never raises. Called from any thread."""

    def close(self) -> None:
        """Close the port after a stop; waits some seconds at most for a confirmation of the stop,
        with protocols that have confirmations.

        Raises OutputLostError: the stop did not arrive. The port is closed nevertheless.
        """


@runtime_checkable
class SoundingOutput(Output, Protocol):
    """Output that plays sums of sines at the actuators that take a waveform."""

    def send_tones(self, values: F64, tones: Tones) -> None:
        """Send values (columns,), and tones in place of the values of actuators with a waveform.

        Raises OutputLostError.
        """


def chosen_devices(output: Output) -> Sequence[str]:
    """Label of the device that a server chose, for each output of a device; "" without a server."""
    single = [str(getattr(output, "chosen_device", ""))]
    return getattr(output, "chosen_devices", single)


def shown(received: str) -> str:
    """Quote the start of a received text for a message, without line breaks."""
    cut = received if len(received) <= _SHOWN else received[:_SHOWN] + "..."
    return f"'{printable(cut)}'"
