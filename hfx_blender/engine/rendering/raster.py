# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster: values of a device's actuators over time.

After the raster of Mango (Schneider et al., UIST 2015): actuators x time, and a row of times.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

import numpy as np

from ..arrays import F64, I64, Bool
from ..samples import Stream
from .conditioning.frequency import Partial
from .device_config import DeviceConfig

Reason = Literal["modality", "place", "device", "frequency", "limit", "threshold", "step"]
"""Reason of a shortfall. ``modality``: neither an actuator for the modality, nor a substitution;
``place``: no actuator at the place; ``device``: the effect drives actuators of another device;
``frequency``: outside the actuators' range, the nearest frequency is played; ``limit``: cut to the
actuator's limit; ``threshold``: below the detection threshold at every actuator;
``step``: below the first allowed value at every actuator, which is then silent."""


@dataclass(frozen=True)
class Column:
    """Column of a raster: a parameter of an actuator."""

    actuator: str
    parameter: str
    unit: str


def columns_of(device: DeviceConfig) -> tuple[Column, ...]:
    """Columns of a device's raster: controls of all actuators, actuator by actuator."""
    return tuple(
        Column(actuator.id, control.name, actuator.type.unit(control))
        for actuator in device.actuators
        for control in actuator.type.controls
    )


@dataclass(frozen=True)
class Shortfall:
    """Part of an effect that a device did not render as sampled."""

    effect_id: str
    body_id: str
    modality: str
    reason: Reason
    samples: int  # with strength
    share: float  # of the effect's samples with strength
    seconds: float


@dataclass(frozen=True, eq=False)
class FeltStream:
    """Samples of a stream on the wearer, and the rendered part."""

    stream: Stream
    indices: I64  # (n,) sample indices
    # (n,) Level times strength parameter (temperature: deviation); 0 for samples without strength,
    # see areas.felt_times.has_strength.
    strengths: F64
    is_rendered: Bool  # (n,)


@dataclass(frozen=True, eq=False)
class Raster:
    """Values of all actuators of a device on the sample clock of a track. Row ``i`` is sample ``i``
    of the track's time base; a value holds until the next row."""

    device_id: str
    body_id: str
    actuators: tuple[str, ...]
    columns: tuple[Column, ...]  # actuator by actuator
    times_s: F64  # (T,)
    rate_hz: Fraction
    values: F64  # (T, columns) finite and within the device's limits
    neutral: F64  # (columns,) silence
    shortfalls: tuple[Shortfall, ...]
    felt: tuple[FeltStream, ...]
    waveform_actuators: tuple[str, ...] = ()  # actuators that play the sum of all partials
    partials: tuple[Partial, ...] = ()


@dataclass(frozen=True)
class Unrendered:
    """Part of an effect on a body that no device rendered."""

    effect_id: str
    body_id: str
    modality: str
    samples: int  # with strength
    share: float  # of the effect's samples with strength
    seconds: float


def unrendered(rasters: Iterable[Raster]) -> list[Unrendered]:
    """Parts of effects that none of several devices rendered, in the order of the rasters' streams.

    Rasters are of the same track, each for the wearer of its device. A sample counts as rendered if
    one actuator of any device responds, however little of its area that actuator covers. Only
    samples with strength count. Effects without missing samples are left out.
    """
    streams: dict[tuple[str, str], FeltStream] = {}
    rates: dict[tuple[str, str], float] = {}
    for raster in rasters:
        for stream in raster.felt:
            key = (stream.stream.effect_id, stream.stream.body_id)
            if key in streams:
                # The same samples on a further device: rendered if either device plays there.
                is_rendered = streams[key].is_rendered | stream.is_rendered
                stream = replace(stream, is_rendered=is_rendered)
            streams[key], rates[key] = stream, float(raster.rate_hz)
    missing = []
    for key, stream in streams.items():
        is_strong = stream.strengths > 0.0
        count = int(np.count_nonzero(~stream.is_rendered & is_strong))
        if count:
            share, seconds = count / int(np.count_nonzero(is_strong)), count / rates[key]
            missing.append(Unrendered(*key, stream.stream.modality, count, share, seconds))
    return missing
