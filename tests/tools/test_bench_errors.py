# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparison of two recordings in the benchmarks, against results by hand."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.volume.analytic import Cuboid, Sphere
from hfx_tools.bench.trade import trade_errors

STREAM = Stream("e", "b", "pressure", "m")


def run(indices, sets, weights=None, set_of=None) -> SampleRun:
    vertices = np.concatenate([np.array(indices, np.int32) for indices in sets])
    count = len(indices)
    return SampleRun(
        stream=STREAM,
        indices=np.array(indices),
        times_s=np.array(indices) / 100.0,
        levels=np.ones(count),
        parameters=np.ones((count, 1)),
        offsets=np.concatenate([[0], np.cumsum([len(indices) for indices in sets])]),
        vertices=vertices,
        weights=np.ones(len(vertices), np.float32) if weights is None else np.float32(weights),
        sets=None if set_of is None else np.array(set_of),
    )


def test_missed_and_extra_contacts_and_their_skin():
    areas = np.array([1.0, 2.0, 4.0, 8.0]) * 1e-4
    reference = trade_errors.contacts_of([run([3, 4], [[0, 1]], set_of=[0, 0]), run([5], [[2]])])
    contacts = trade_errors.contacts_of([run([3, 4], [[0, 1], [1, 3]], [1.0, 0.5, 1.0, 1.0])])
    error = trade_errors.contact_error(contacts[STREAM], reference[STREAM], areas)
    at = trade_errors.VERTICES
    assert error.missed.tolist() == [4 * at + 0, 5 * at + 2]
    assert error.extra.tolist() == [4 * at + 3]
    assert error.count == 5 and error.samples == 3
    assert error.missed_m2 == pytest.approx((1.0 + 1.0 + 4.0) * 1e-4)
    assert error.extra_m2 == pytest.approx(8e-4)
    assert error.felt_m2 == pytest.approx((3.0 + 3.0 + 4.0) * 1e-4)
    nothing = trade_errors.contact_error(trade_errors.NOTHING, reference[STREAM], areas)
    assert len(nothing.missed) == 5 and nothing.missed_m2 == nothing.felt_m2


@pytest.mark.parametrize("shape", [Cuboid(), Sphere()])
def test_the_distance_to_the_boundary_from_both_sides(shape):
    """Along an axis, both are 1 from the centre; the volume has half edges of 0.2 m."""
    to_shape = np.diag([5.0, 5.0, 5.0, 1.0])
    away = np.array([0.1, 0.15, 0.199, 0.201, 0.25, 0.3])
    points = np.stack([away, np.zeros(6), np.zeros(6)])
    distance_m = trade_errors.boundary_distance_m(shape, to_shape, points)
    assert distance_m == pytest.approx(np.abs(away - 0.2), rel=0.15)
    assert np.isinf(trade_errors.boundary_distance_m(shape, to_shape, points + 10.0)).all()


def test_events_are_joined_over_short_gaps():
    events = trade_errors.events(np.array([10, 11, 12, 14, 40, 41]), 100.0)
    assert events.tolist() == [[0.10, 0.15], [0.40, 0.42]]
    assert len(trade_errors.events(np.zeros(0, np.int64), 100.0)) == 0


def test_onsets_are_matched_within_a_window():
    reference = np.array([[1.0, 1.5], [2.0, 2.01], [3.0, 3.2]])
    second = np.array([[1.02, 1.5], [2.99, 3.0], [9.0, 9.1]])
    error = trade_errors.onset_error(second, reference)
    assert error.errors_s == pytest.approx([0.02, -0.01])
    assert (error.missed, error.extra) == (1, 1)
    assert trade_errors.onset_error(np.zeros((0, 2)), reference).missed == 3


def test_onsets_are_matched_with_the_nearest():
    """An event ending just before would make the onset early by the event's length."""
    reference = np.array([[0.332, 1.19], [1.215, 2.644]])
    second = np.array([[0.34, 1.20], [1.22, 2.65]])
    error = trade_errors.onset_error(second, reference)
    assert error.errors_s == pytest.approx([0.008, 0.005])
    assert (error.missed, error.extra) == (0, 0)


def raster(values) -> tuple[Raster, object]:
    values = np.array(values, float)[:, None]
    columns = (Column("a", "pressure_kpa", "kPa"),)
    control = SimpleNamespace(name="pressure_kpa", lowest=0.0, highest=20.0)
    device = SimpleNamespace(
        actuators=(SimpleNamespace(id="a", type=SimpleNamespace(strength=control)),)
    )
    times = np.arange(len(values)) / 100.0
    actual = Raster("d", "b", ("a",), columns, times, Fraction(100), values, np.zeros(1), (), ())
    return actual, device


def test_amplitudes_are_shares_of_full_scale():
    reference, device = raster([0, 0, 10, 10, 0, 0])
    late, _ = raster([0, 0, 0, 10, 10, 0])
    weak, _ = raster([0, 0, 8, 8, 0, 0])
    none, _ = raster([0, 0, 0, 0, 0, 0])
    same = trade_errors.amplitude_error(reference, reference, device, 0)
    assert (same.mean, same.largest, same.count) == (0.0, 0.0, 2)
    shifted = trade_errors.amplitude_error(late, reference, device, 0)
    assert shifted.mean == pytest.approx(1.0 / 3.0) and shifted.largest == 0.5
    assert trade_errors.amplitude_error(late, reference, device, 1).largest == 0.0
    assert trade_errors.amplitude_error(weak, reference, device, 1).largest == pytest.approx(0.1)
    assert trade_errors.amplitude_error(none, reference, device, 1).largest == 0.5
    assert trade_errors.amplitude_error(reference, none, device, 1).largest == 0.5
