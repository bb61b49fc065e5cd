# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences between two recordings of a scene: contacts, onsets, values at actuators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hfx_blender.engine.arrays import F64, I64
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.volume.shape import Shape

GAP_S = 0.05
"""Contacts of one effect with a shorter gap are one event: a graze may flicker."""

WINDOW_S = 0.1
"""Largest distance in time of two matched onsets, seconds."""

_DIRECTIONS = 64
_NEAREST_M, _FARTHEST_M, _FACTOR = 2e-5, 0.5, 1.1


@dataclass(frozen=True, eq=False)
class StreamContacts:
    """Contacts of one stream, in columns sorted by sample and vertex."""

    keys: I64  # (n,) sample index times VERTICES plus vertex
    weights: F64  # (n,)


VERTICES = 1 << 24


def contacts_of(runs: Sequence[SampleRun]) -> dict[Stream, StreamContacts]:
    """Collect all contacts of a recording, by stream, sorted by sample and vertex."""
    parts_of_streams: dict[Stream, list[tuple[I64, F64]]] = {}
    for run in runs:
        sets = run.set_of
        sizes = run.sizes
        owners = np.repeat(np.arange(len(run)), sizes)
        steps = np.arange(len(owners)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        entries = np.repeat(run.offsets[sets], sizes) + steps
        keys = run.indices[owners] * VERTICES + run.vertices[entries]
        parts_of_streams.setdefault(run.stream, []).append(
            (keys, run.weights[entries].astype(np.float64))
        )
    columns = {
        stream: tuple(np.concatenate(column) for column in zip(*parts, strict=True))
        for stream, parts in parts_of_streams.items()
    }
    return {
        stream: StreamContacts(keys[order], weights[order])
        for stream, (keys, weights) in columns.items()
        for order in [np.argsort(keys, kind="stable")]
    }


@dataclass(frozen=True, eq=False)
class ContactError:
    """Differences of one stream's contacts from the reference's."""

    missed: I64  # keys in the reference only
    extra: I64  # keys in the compared recording only
    count: int  # contacts of the reference
    missed_m2: float  # area of skin times missing weight, summed over samples
    extra_m2: float  # area of skin times excess weight
    felt_m2: float  # area of skin times weight of the reference
    samples: int  # samples with a contact in either recording


def contact_error(
    contacts: StreamContacts, reference: StreamContacts, areas_m2: F64
) -> ContactError:
    """Compare the contacts of one stream; ``areas_m2`` are the vertices' cells, (V,)."""
    keys = np.union1d(contacts.keys, reference.keys)
    difference = _on(keys, contacts) - _on(keys, reference)
    areas = areas_m2[keys % VERTICES]
    return ContactError(
        missed=np.setdiff1d(reference.keys, contacts.keys, assume_unique=True),
        extra=np.setdiff1d(contacts.keys, reference.keys, assume_unique=True),
        count=len(reference.keys),
        missed_m2=float(np.sum(np.maximum(-difference, 0.0) * areas)),
        extra_m2=float(np.sum(np.maximum(difference, 0.0) * areas)),
        felt_m2=float(np.sum(_on(keys, reference) * areas)),
        samples=len(np.unique(keys // VERTICES)),
    )


NOTHING = StreamContacts(np.zeros(0, np.int64), np.zeros(0))


def _on(keys: I64, contacts: StreamContacts) -> F64:
    values = np.zeros(len(keys))
    values[np.searchsorted(keys, contacts.keys)] = contacts.weights
    return values


def boundary_distance_m(shape: Shape, to_shape: F64, points: F64) -> F64:
    """World distance of points (3, N) to the boundary of a placed shape, unsigned, (N,).

    Probes in 64 directions at growing distance search the first point on the opposite side: right
    for every shape to a tenth. Infinite if the boundary is farther than 0.5 m.
    """
    # Even directions on a sphere, by a Fibonacci spiral.
    k = np.arange(_DIRECTIONS) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / _DIRECTIONS), np.pi * (1.0 + 5.0**0.5) * k
    around = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])
    linear, offset = to_shape[:3, :3], to_shape[:3, 3:]
    inside = shape.contains(linear @ points + offset)
    distances = np.full(points.shape[1], np.inf)
    open_ = np.arange(points.shape[1])
    reach = _NEAREST_M
    while reach < _FARTHEST_M and len(open_):
        probes = points[:, open_, None] + reach * around[:, None]
        is_inside = shape.contains(linear @ probes.reshape(3, -1) + offset).reshape(-1, _DIRECTIONS)
        crossed = (is_inside != inside[open_, None]).any(axis=1)
        distances[open_[crossed]] = reach
        open_ = open_[~crossed]
        reach *= _FACTOR
    return distances


# Time


def events(indices: I64, rate_hz: float) -> F64:
    """Begin and end of each contact event of one stream, (n, 2) seconds since the first sample."""
    indices = np.unique(indices)
    if not len(indices):
        return np.zeros((0, 2))
    cuts = np.flatnonzero(np.diff(indices) > 1.0 + GAP_S * rate_hz) + 1
    parts = np.split(indices, cuts)
    return np.array([[part[0] / rate_hz, (part[-1] + 1) / rate_hz] for part in parts])


@dataclass(frozen=True, eq=False)
class OnsetError:
    """Timing errors of the beginnings of one stream's events."""

    errors_s: F64  # (n,) signed, of matched events; above 0: late
    missed: int  # events of the reference without a near event
    extra: int  # events without a near event of the reference


def onset_error(events_: F64, reference: F64) -> OnsetError:
    """Match the events (n, 2) of a recording to the reference's events (m, 2), seconds.

    Of several near events the one with the nearest begin counts.
    """
    errors, missed = [], 0
    used = np.zeros(len(events_), np.bool_)
    for begin, end in reference:
        near = (events_[:, 0] < end + WINDOW_S) & (events_[:, 1] > begin - WINDOW_S)
        if not near.any():
            missed += 1
            continue
        used |= near  # all near events count as matched, the nearest begin gives the error
        late = events_[near, 0] - begin
        errors.append(float(late[np.abs(late).argmin()]))
    return OnsetError(np.array(errors), missed, int(np.count_nonzero(~used)))


# Actuators


@dataclass(frozen=True)
class AmplitudeError:
    """Errors of a device's actuators, as shares of their full scale."""

    mean: float  # over actuators and times driven in either raster
    largest: float  # beyond all values of the reference within the accepted time
    count: int  # driven values


def amplitude_error(
    raster: Raster, reference: Raster, device: DeviceConfig, window: int
) -> AmplitudeError:
    """Compare two rasters of a device; shifts up to ``window`` samples are no error.

    All zero for a device without strengths, or with nothing driven.
    """
    columns, scales = _strengths(reference, device)
    if not len(columns):
        return AmplitudeError(0.0, 0.0, 0)
    count = min(len(raster.values), len(reference.values))
    neutral = reference.neutral[columns]
    a = (raster.values[:count, columns] - neutral) / scales
    b = (reference.values[:count, columns] - neutral) / scales
    driven = (a != 0.0) | (b != 0.0)
    if not driven.any():
        return AmplitudeError(0.0, 0.0, 0)
    low, high = _least(b, window), -_least(-b, window)
    beyond = np.maximum(np.maximum(low - a, a - high), 0.0)
    # Brief values of the reference must be reached within the window, too.
    lacking = np.maximum(np.maximum(_least(a, window) - b, b + _least(-a, window)), 0.0)
    return AmplitudeError(
        float(np.abs(a - b)[driven].mean()),
        float(max(beyond.max(), lacking.max())),
        int(np.count_nonzero(driven)),
    )


def _strengths(raster: Raster, device: DeviceConfig) -> tuple[I64, F64]:
    """Columns of strengths (not of frequencies), and the full scale of each, (C,)."""
    types = {actuator.id: actuator.type for actuator in device.actuators}
    chosen, scales = [], []
    for k, column in enumerate(raster.columns):
        strength = types[column.actuator].strength
        if column.parameter == strength.name and strength.highest > strength.lowest:
            chosen.append(k)
            scales.append(strength.highest - strength.lowest)
    return np.array(chosen, np.int64), np.array(scales)


def _least(values: F64, window: int) -> F64:
    """Minimum of each value and its neighbours up to ``window`` rows away, (T, C)."""
    least = values.copy()
    for step in range(1, min(window, len(values) - 1) + 1):
        np.minimum(least[step:], values[:-step], out=least[step:])
        np.minimum(least[:-step], values[step:], out=least[:-step])
    return least
