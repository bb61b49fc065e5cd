# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster: the values of one device's actuators over time.

After the raster of Mango (Schneider et al., UIST 2015): actuators x time and a row of times.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from ..arrays import F64, I64, Bool
from ..samples import Stream
from .conditioning.frequency import Partial
from .device_config import DeviceConfig

Reason = Literal["modality", "place", "device", "frequency", "limit", "threshold"]
"""Reason why something is not rendered as it was felt. ``modality``: the device has no actuator for
it, nor a substitution; ``place``: none of its actuators is where it was felt; ``device``: it drives
single actuators of another device; ``frequency``: outside the actuators' range, the nearest
possible is played; ``limit``: stronger than an actuator may be, cut; ``threshold``: played, but
weaker at every actuator than is felt there by itself."""


@dataclass(frozen=True)
class Column:
    """Column of a raster: one parameter of one actuator."""

    actuator: str
    parameter: str
    unit: str


def columns_of(device: DeviceConfig) -> tuple[Column, ...]:
    """Columns of a device's raster: controls of all actuators, one after the other."""
    return tuple(
        Column(actuator.id, control.name, actuator.type.unit(control))
        for actuator in device.actuators
        for control in actuator.type.controls
    )


@dataclass(frozen=True)
class Shortfall:
    """Part of one effect that a device could not render."""

    effect_id: str
    body_id: str
    modality: str
    reason: Reason
    samples: int
    share: float  # of the effect's samples
    seconds: float


@dataclass(frozen=True, eq=False)
class FeltStream:
    """Samples of a stream on the wearer, and the part that the device rendered."""

    stream: Stream
    indices: I64  # (n,) sample indices
    strengths: F64  # (n,) level times strength parameter (temperature: deviation), >= 0
    is_rendered: Bool  # (n,)


@dataclass(frozen=True, eq=False)
class Raster:
    """Values for all actuators of a device on the sample clock of a track.

    Row ``i`` is sample ``i`` of the track's time base; a value holds until the next row.
    """

    device_id: str
    body_id: str
    actuators: tuple[str, ...]
    columns: tuple[Column, ...]  # actuator by actuator
    times_s: F64  # (T,)
    rate_hz: Fraction
    values: F64  # (T, columns) finite and within the device's limits
    neutral: F64  # (columns,) given while nothing is rendered
    shortfalls: tuple[Shortfall, ...]
    felt: tuple[FeltStream, ...]
    waveform_actuators: tuple[str, ...] = ()  # that play the sum of all partials
    partials: tuple[Partial, ...] = ()


@dataclass(frozen=True)
class Unrendered:
    """Part of an effect on a body that no device rendered."""

    effect_id: str
    body_id: str
    modality: str
    samples: int
    share: float  # of the effect's samples
    seconds: float


def unrendered(rasters: Iterable[Raster]) -> list[Unrendered]:
    """Effects that were felt but rendered by none of several devices.

    A sample counts as rendered when one actuator of any device fires for it, however small
    the part of the felt area that it covers.

    Parameters
    ----------
    rasters : iterable of Raster
        Of one track; each tells about the body that wears its device.

    Returns
    -------
    list of Unrendered
        Effects of which something is missing, in the order of the rasters' streams.
    """
    found: dict[tuple[str, str], FeltStream] = {}
    rates: dict[tuple[str, str], float] = {}
    for raster in rasters:
        for felt in raster.felt:
            key = (felt.stream.effect_id, felt.stream.body_id)
            before = found.get(key)
            if before is not None:
                is_rendered = before.is_rendered | felt.is_rendered
                felt = FeltStream(felt.stream, felt.indices, felt.strengths, is_rendered)
            found[key], rates[key] = felt, float(raster.rate_hz)
    missing = []
    for key, felt in found.items():
        lost = ~felt.is_rendered
        count = int(np.count_nonzero(lost))
        if not count:
            continue
        missing.append(
            Unrendered(
                *key,
                felt.stream.modality,
                samples=count,
                share=count / len(lost),
                seconds=count / rates[key],
            )
        )
    return missing
