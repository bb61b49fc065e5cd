# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoding of values as bytes: scaling by each control's range, rounding, framing, stop bytes.

A channel is a control with minimum < maximum, in the order of the device's columns.
Values from the guard are limited once more here: a NaN cast to a whole number could mean full
power.
"""

from functools import reduce
from operator import xor
from typing import Final

import numpy as np

from ...engine.arrays import F64, I64
from ...engine.rendering.conditioning.actuator_limits import limited
from ...engine.rendering.conditioning.waveform import drive_of
from ...engine.rendering.device_config import (
    ActuatorType,
    BytesEncoder,
    DeviceConfig,
    OscEncoder,
    TextEncoder,
)

_NUMPY_TYPES: Final = {"u8": "u1", "u16le": "<u2", "u16be": ">u2"}


class Channels:
    """Channels of a device: the columns that are sent, their limits and scales.

    ``strengths_only``: only the strength of each actuator, for outputs that take no frequency.
    """

    def __init__(self, device: DeviceConfig, *, strengths_only: bool = False) -> None:
        picked = []
        # Channel, type, and channel of the frequency of actuators with a measured drive.
        self._driven: list[tuple[int, ActuatorType, int | None]] = []
        self.names: list[tuple[str, str]] = []  # actuator and control of each channel
        column = 0
        for actuator in device.actuators:
            for control in actuator.type.controls:
                is_strength = control is actuator.type.strength
                if is_strength if strengths_only else control.minimum < control.maximum:
                    picked.append((column, control))
                    # Drive curves depend on the frequency: the sent one, or the fixed one of the
                    # type.
                    if is_strength and actuator.type.drive:
                        frequency = actuator.type.controls[1]
                        is_sent = not strengths_only and frequency.minimum < frequency.maximum
                        index = len(self.names)
                        self._driven.append((index, actuator.type, index + 1 if is_sent else None))
                    self.names.append((actuator.id, control.name))
                column += 1
        self._width = column
        self._columns = np.array([column for column, _ in picked], np.int64)
        controls = [control for _, control in picked]
        self._minimum = np.array([c.minimum for c in controls])
        self._span = np.array([max(c.maximum - c.minimum, 1e-9) for c in controls])
        self._lowest = np.array([c.lowest for c in controls])
        self._highest = np.array([c.highest for c in controls])
        self._neutral = np.array([c.neutral for c in controls])

    def __len__(self) -> int:
        return len(self.names)

    @property
    def neutral(self) -> F64:
        """Neutral values (channels,), in each control's unit; a copy."""
        return self._neutral.copy()

    def values(self, columns: F64) -> F64:
        """Convert values (columns,) to channels (channels,), in units, clipped to their limits.

        NaN becomes neutral.

        Raises ValueError: the number of values is not that of the columns.
        """
        if columns.shape != (self._width,):
            raise ValueError(f"values: expected ({self._width},), got {columns.shape}")
        # A NaN or a value beyond the limits must never reach the cast to whole numbers.
        row = limited(
            columns[self._columns, None],
            self._lowest[:, None],
            self._highest[:, None],
            self._neutral[:, None],
        )
        return row[:, 0]

    def fractions(self, values: F64) -> F64:
        """Scale channels (channels,) to 0..1 of the range of the hardware.

        A strength with measured drive curves becomes the drive, 0..1, that produces this output at
        the present frequency, or at the neutral one if no frequency is sent.
        """
        fractions = np.clip((values - self._minimum) / self._span, 0.0, 1.0)
        for channel, kind, frequency_channel in self._driven:
            if frequency_channel is None:
                hz = np.asarray(kind.controls[1].neutral)
            else:
                hz = np.asarray(values[frequency_channel])
            fractions[channel] = drive_of(kind.drive, values[channel], hz)
        return fractions

    def whole(self, values: F64, full_scale: int) -> I64:
        """Scale channels (channels,) to whole numbers 0..full_scale, rounded to the nearest."""
        return np.rint(self.fractions(values) * full_scale).astype(np.int64)


def osc_addresses(device: DeviceConfig, how: OscEncoder) -> list[str]:
    """OSC address of each channel; a single template is for all channels. Placeholders: {device},
    {actuator}, {control}, {number} (of the channel, from 1), {side}, {Side} (capitalized)."""
    names = Channels(device).names
    templates = how.addresses if len(how.addresses) == len(names) else how.addresses * len(names)
    side = device.side or ""
    addresses = []
    for i, (template, (actuator, control)) in enumerate(zip(templates, names, strict=True)):
        facts = {
            "device": device.id,
            "actuator": actuator,
            "control": control,
            "number": str(i + 1),
            "side": side,
            "Side": side.capitalize(),
        }
        # No str.format: an address could reach attributes of its arguments.
        for key, fact in facts.items():
            template = template.replace("{" + key + "}", fact)
        addresses.append(template)
    return addresses


class FrameEncoder:
    """Encoder of frames for a serial port, by the description in the device's configuration."""

    def __init__(self, device: DeviceConfig, how: BytesEncoder | TextEncoder) -> None:
        self._how = how
        self._channels = Channels(device)

    def frame(self, columns: F64) -> bytes:
        """Encode values (columns,): header, numbers, checksum and footer, or a line of text."""
        return self._framed(self._channels.values(columns))

    @property
    def stop(self) -> bytes:
        """Bytes that silence the device: as configured, by default a frame of neutral values."""
        how = self._how
        if how.stop is None:
            return self._framed(self._channels.neutral)
        return how.stop if isinstance(how.stop, bytes) else how.stop.encode("ascii") + b"\n"

    def _framed(self, values: F64) -> bytes:
        how = self._how
        numbers = self._channels.whole(values, how.full_scale)
        if isinstance(how, TextEncoder):
            line = how.start + how.separator.join(str(int(number)) for number in numbers)
            return line.encode("ascii") + b"\n"
        # Numbers are at most ``full_scale``, which fits the configured type.
        body = numbers.astype(_NUMPY_TYPES[how.number]).tobytes()
        # The checksum covers the numbers, without header and footer.
        check = {
            "none": b"",
            "xor": bytes([reduce(xor, body, 0)]),
            "sum": bytes([sum(body) & 0xFF]),
        }[how.checksum]
        return how.header + body + check + how.footer
