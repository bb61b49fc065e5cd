# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals and rasters for tests of formats, simple and random."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import strategies as st

from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.formats.signals.curves import Curve
from hfx_blender.formats.signals.signals import FrequencyRange, Signal, Transient

RANGE = FrequencyRange(50.0, 250.0)
NAMES = ("r1c1", "Zoë 手", "a/b\\c", "", "..", "x" * 60)
LEVELS = st.one_of(st.just(0.0), st.just(1.0), st.floats(0.0, 1.0, width=32))


def signal(levels, hertz=None, *, name="r1c1", rate_hz=100.0, transients=()):
    """Return a signal with a keyframe per row."""
    times = np.arange(len(levels)) / rate_hz
    pitch = np.full(len(levels), 120.0) if hertz is None else np.asarray(hertz, np.float64)
    return Signal(name, Curve.of(times, levels), Curve(times, pitch), tuple(transients))


@st.composite
def signals(draw, most=50, ticks=False):
    """Return a random signal: silence, steps, single rows, ticks."""
    levels = draw(st.lists(LEVELS, min_size=2, max_size=most))
    hertz = draw(st.lists(st.floats(50.0, 250.0), min_size=1, max_size=4))
    rows = np.linspace(0, len(hertz) - 1, len(levels))
    rate_hz = draw(st.sampled_from([24.0, 60.0, 100.0, 0.5]))
    times = st.integers(0, len(levels) - 1).map(lambda k: k / rate_hz)
    builds = st.builds(Transient, times, st.floats(0.1, 1.0), st.floats(50.0, 250.0))
    return signal(
        levels,
        np.interp(rows, np.arange(len(hertz)), hertz),
        name=draw(st.sampled_from(NAMES)),
        rate_hz=rate_hz,
        transients=draw(st.lists(builds, max_size=3, unique_by=lambda t: t.time_s))
        if ticks
        else (),
    )


def raster_for(device, values=None, rows=200, rate_hz=Fraction(100)):
    """Return a raster for a device; by default every vibration actuator differs."""
    columns = tuple(
        Column(actuator.id, control.name, actuator.type.unit(control))
        for actuator in device.actuators
        for control in actuator.type.controls
    )
    neutral = np.array([c.neutral for a in device.actuators for c in a.type.controls])
    times = np.arange(rows) / float(rate_hz)
    if values is None:
        values = np.tile(neutral, (rows, 1))
        for k, column in enumerate(columns):
            if column.parameter == "amplitude_m_s2":
                values[:, k] = 10.0 * np.maximum(np.sin(times * (3 + k)), 0.0)
            if column.parameter == "frequency_hz":
                values[:, k] = 90.0 + 40.0 * np.sin(times + k)
    return Raster(
        device_id=device.id,
        body_id="body",
        actuators=tuple(item.id for item in device.actuators),
        columns=columns,
        times_s=times,
        rate_hz=rate_hz,
        values=np.asarray(values, np.float64),
        neutral=neutral,
        shortfalls=(),
        felt=(),
    )
