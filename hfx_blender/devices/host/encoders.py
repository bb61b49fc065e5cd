# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes values into bytes: scaling by each control's range, rounding, framing; and stop bytes.

A channel is a control that can be set (its range is more than one value), in the order of the
device's columns. Values have passed the guard before; they are limited here once more, because
a NaN that became a number could be full power.
"""

from __future__ import annotations

from functools import reduce
from operator import xor
from typing import Final

import numpy as np

from ...engine.arrays import F64, I64
from ...engine.rendering.conditioning.drive import drive_of
from ...engine.rendering.conditioning.limits import limited
from ...engine.rendering.device import ActuatorType, DeviceConfig
from ...engine.rendering.device_output import BytesEncoder, OscEncoder, TextEncoder

_NUMPY_TYPES: Final = {"u8": "u1", "u16le": "<u2", "u16be": ">u2"}


class Channels:
    """Columns of a device that are sent, as channels.

    Parameters
    ----------
    strengths_only : bool
        One channel for each actuator: for devices that take no frequency.
    """

    def __init__(self, device: DeviceConfig, *, strengths_only: bool = False) -> None:
        picked = []
        self._driven: list[tuple[int, ActuatorType, int | None]] = []  # channel, that of its Hz
        self.names: list[tuple[str, str]] = []  # actuator, control
        column = 0
        for actuator in device.actuators:
            for control in actuator.type.controls:
                is_strength = control is actuator.type.strength
                if is_strength if strengths_only else control.minimum < control.maximum:
                    picked.append((column, control))
                    if is_strength and actuator.type.drive:
                        frequency = actuator.type.controls[1]
                        is_sent = not strengths_only and frequency.minimum < frequency.maximum
                        here = len(self.names)
                        self._driven.append((here, actuator.type, here + 1 if is_sent else None))
                    self.names.append((actuator.id, control.name))
                column += 1
        self._width = column
        self._columns = np.array([each for each, _ in picked], np.int64)
        controls = [each for _, each in picked]
        self._minimum = np.array([c.minimum for c in controls])
        self._span = np.array([max(c.maximum - c.minimum, 1e-9) for c in controls])
        self._lowest = np.array([c.lowest for c in controls])
        self._highest = np.array([c.highest for c in controls])
        self._neutral = np.array([c.neutral for c in controls])

    def __len__(self) -> int:
        return len(self.names)

    @property
    def neutral(self) -> F64:
        """Silence, (channels,) in each control's unit."""
        return self._neutral.copy()

    def values(self, columns: F64) -> F64:
        """A device's columns as channels (channels,), each in its own unit and limits.

        Raises
        ------
        ValueError
            There are not as many values as columns.
        """
        if columns.shape != (self._width,):
            raise ValueError(f"values: expected ({self._width},), got {columns.shape}")
        each = limited(
            columns[self._columns, None],
            self._lowest[:, None],
            self._highest[:, None],
            self._neutral[:, None],
        )
        return each[:, 0]

    def fractions(self, values: F64) -> F64:
        """Channels (channels,) as 0..1 of the range that the hardware takes.

        A strength whose output over drive was measured is the drive that it needs.
        """
        found = np.clip((values - self._minimum) / self._span, 0.0, 1.0)
        for channel, kind, at in self._driven:
            hz = np.asarray(kind.controls[1].neutral if at is None else values[at])
            found[channel] = drive_of(kind.drive, values[channel], hz)
        return found

    def whole(self, values: F64, full_scale: int) -> I64:
        """Channels (channels,) as whole numbers 0..full_scale, rounded to the nearest."""
        return np.rint(self.fractions(values) * full_scale).astype(np.int64)


def osc_addresses(device: DeviceConfig, how: OscEncoder) -> list[str]:
    """The address of each channel; ``{number}`` counts channels from 1, as VRChat's do."""
    names = Channels(device).names
    templates = how.addresses if len(how.addresses) == len(names) else how.addresses * len(names)
    side = device.side or ""
    found = []
    for i, (template, (actuator, control)) in enumerate(zip(templates, names, strict=True)):
        facts = {
            "device": device.id,
            "actuator": actuator,
            "control": control,
            "number": str(i + 1),
            "side": side,
            "Side": side.capitalize(),
        }
        for key, fact in facts.items():
            template = template.replace("{" + key + "}", fact)
        found.append(template)
    return found


class FrameEncoder:
    """Frames for a serial port, by a description in the device's configuration.

    Parameters
    ----------
    how : BytesEncoder or TextEncoder
    """

    def __init__(self, device: DeviceConfig, how: BytesEncoder | TextEncoder) -> None:
        self._how = how
        self._channels = Channels(device)

    def frame(self, columns: F64) -> bytes:
        """Encode one frame of a device's values (columns,)."""
        return self._framed(self._channels.values(columns))

    @property
    def stop(self) -> bytes:
        """Bytes that silence the device: the configured ones, else the frame of neutral values."""
        how = self._how
        if how.stop is None:
            return self._framed(self._channels.neutral)
        return how.stop if isinstance(how.stop, bytes) else how.stop.encode("ascii") + b"\n"

    def _framed(self, values: F64) -> bytes:
        how = self._how
        numbers = self._channels.whole(values, how.full_scale)
        if isinstance(how, TextEncoder):
            line = how.start + how.separator.join(str(int(each)) for each in numbers)
            return line.encode("ascii") + b"\n"
        body = numbers.astype(_NUMPY_TYPES[how.number]).tobytes()
        check = {
            "none": b"",
            "xor": bytes([reduce(xor, body, 0)]),
            "sum": bytes([sum(body) & 0xFF]),
        }[how.checksum]
        return how.header + body + check + how.footer
