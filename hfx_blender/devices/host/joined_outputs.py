# SPDX-License-Identifier: GPL-3.0-or-later
"""Several outputs of a device as a single output, such as two boards of a belt."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import TypeVar

import numpy as np

from ...engine.arrays import F64
from ...engine.rendering.device_config import DeviceConfig
from .output import Output, OutputLostError

_T = TypeVar("_T")


class JoinedOutputs:
    """Outputs of a device, each with the values of its own actuators.

    A lost output raises OutputLostError, and the device then stops all outputs.

    ``open_part``: opens an output by its number from 0; called for one output after another. If
    a call raises, the outputs before are stopped and closed.
    """

    def __init__(self, device: DeviceConfig, open_part: Callable[[int], Output]) -> None:
        columns = [np.arange(part.start, part.stop) for part in device.actuator_columns]
        self._columns = [
            np.concatenate([columns[k] for k in config.actuators]) for config in device.outputs
        ]
        self._outputs: list[Output] = []
        try:
            for number in range(len(device.outputs)):
                self._outputs.append(_named(number, partial(open_part, number)))
        except BaseException:
            self.stop()
            with suppress(OutputLostError):
                self.close()
            raise

    @property
    def chosen_devices(self) -> Sequence[str]:
        """Label of the device at a server, or address of the board, for each output; "" without."""
        return [str(getattr(output, "chosen_device", "")) for output in self._outputs]

    def send(self, values: F64) -> None:
        """Send values (columns,) of the whole device; OutputLostError with the output's number."""
        # An exception ends the loop: the device thread then stops all outputs, also those that have
        # taken the new values.
        for number, (columns, output) in enumerate(zip(self._columns, self._outputs, strict=True)):
            _named(number, partial(output.send, values[columns]))

    def stop(self) -> None:
        """Stop each output, also after an exception of another; never raises."""
        for output in self._outputs:
            with suppress(Exception):
                output.stop()

    def close(self) -> None:
        """Close each output; then OutputLostError with the messages of all that raised one."""
        faults = []
        for number, output in enumerate(self._outputs):
            try:
                _named(number, output.close)
            except OutputLostError as error:
                faults.append(str(error))
        if faults:
            raise OutputLostError(" ".join(faults))


def _named(number: int, action: Callable[[], _T]) -> _T:
    """Result of an action for an output; the number, from 1, begins the message of a loss."""
    try:
        return action()
    except OutputLostError as error:
        raise OutputLostError(f"Output {number + 1}: {error}") from None
