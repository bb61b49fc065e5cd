# SPDX-License-Identifier: GPL-3.0-or-later
"""From samples to a raster: every rule once, with values by hand."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from rendering_synthetic import (
    EVERYWHERE,
    MODELS,
    at,
    make_device,
    make_header,
    make_run,
)

from hfx_blender.engine.rendering.device_config import Substitution
from hfx_blender.engine.rendering.raster import unrendered
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.track import TrackReader, TrackWriter
from hfx_blender.errors import InputError

load = MODELS.__getitem__
DOWN = (0.0, 0.0, -1.0)


def play(header, runs, device, **options):
    return render(header, runs, device, load, **options)


def test_columns_times_and_neutral():
    header = make_header({}, 4, rate_hz=Fraction(50))
    device = make_device({"v": ("vibration", at(0)), "t": ("temperature", EVERYWHERE)})
    raster = play(header, [], device)
    assert [(c.actuator, c.parameter, c.unit) for c in raster.columns] == [
        ("v", "amplitude_m_s2", "m/s^2"),
        ("v", "frequency_hz", "Hz"),
        ("t", "temperature_c", "degC"),
    ]
    assert (raster.device_id, raster.body_id, raster.actuators) == ("device", "body", ("v", "t"))
    assert raster.rate_hz == 50
    np.testing.assert_allclose(raster.times_s, [0.0, 0.02, 0.04, 0.06])
    assert raster.neutral.tolist() == [0, 100, 25]
    assert (raster.values == raster.neutral).all()
    assert raster.shortfalls == () and raster.felt == ()


def test_weight_times_level_times_parameter():
    header = make_header({"buzz": "vibration"}, 6)
    device = make_device({"a": ("vibration", at(0, 1)), "b": ("vibration", at(5))})
    run = make_run(header, "buzz", {1: {0: 0.5, 1: 0.25}, 4: {5: 1.0}}, [8.0, 120.0], level=0.5)
    values = play(header, [run], device).values
    expected = np.tile([0.0, 100.0, 0.0, 100.0], (6, 1))
    expected[1, :2] = [0.5 * 0.5 * 8.0, 120.0]
    expected[4, 2:] = [0.5 * 8.0, 120.0]
    np.testing.assert_allclose(values, expected)


def test_gain_of_the_device_comes_before_its_limits():
    header = make_header({"push": "pressure"}, 2)
    run = make_run(header, "push", {0: {0: 1.0}, 1: {0: 0.25}}, [8.0])
    device = make_device({"p": ("pressure", at(0))}, gain=2.0)
    raster = play(header, [run], device)
    assert raster.values.tolist() == [[10.0], [4.0]]
    (shortfall,) = raster.shortfalls
    assert (shortfall.reason, shortfall.samples, shortfall.share) == ("limit", 1, 0.5)


def test_unequal_vibrations_add_as_powers_equal_ones_as_amplitudes():
    header = make_header({"x": "vibration", "y": "vibration", "z": "vibration"}, 3)
    device = make_device({"v": ("vibration", at(0))})
    runs = [
        make_run(header, "x", {0: {0: 1.0}, 1: {0: 1.0}, 2: {0: 1.0}}, [3.0, 80.0]),
        make_run(header, "y", {1: {0: 1.0}}, [4.0, 200.0]),
        make_run(header, "z", {2: {0: 1.0}}, [4.0, 80.0]),
    ]
    assert play(header, runs, device).values.tolist() == [[3, 80], [5, 200], [7, 80]]


def test_temperature_adds_its_deviation_to_the_devices_neutral():
    header = make_header({"fire": "temperature", "stone": "temperature"}, 3, contact=["stone"])
    device = make_device({"t": ("temperature", EVERYWHERE)})
    runs = [
        make_run(header, "fire", {0: {3: 1.0}, 2: {3: 1.0}}, [30.0]),
        make_run(header, "stone", {1: {3: 0.5}, 2: {3: 0.5}}, [30.0]),
    ]
    # Air of 30 is 6 above 24; a stone of 30 is 3 below 33, felt at half; neutral is 25.
    assert play(header, runs, device).values[:, 0].tolist() == [31.0, 23.5, 29.5]


def test_winds_that_blow_against_each_other_cancel():
    header = make_header({"a": "wind", "b": "wind"}, 2)
    device = make_device({"fan": ("wind", EVERYWHERE)})
    up = (0.0, 0.0, 1.0)
    runs = [
        make_run(header, "a", {0: {0: 1.0}, 1: {0: 1.0}}, [5.0, *up]),
        make_run(header, "b", {1: {0: 1.0}}, [3.0, *DOWN]),
    ]
    np.testing.assert_allclose(play(header, runs, device).values[:, 0], [5.0, 2.0])


SUBSTITUTIONS = [
    (Substitution("pressure", "vibration", 2.0, 150.0), "push", [3.0], [6.0, 150.0]),
    (Substitution("wind", "vibration", 0.5, 60.0), "blow", [4.0, *DOWN], [2.0, 60.0]),
    (Substitution("temperature", "vibration", 0.5, 90.0), "cold", [14.0], [5.0, 90.0]),
    (Substitution("wind", "pressure", 0.25), "blow", [4.0, *DOWN], [1.0]),
    (Substitution("vibration", "pressure", 0.1), "buzz", [20.0, 80.0], [2.0]),
    (Substitution("pressure", "wind", 2.0), "push", [3.0], [6.0]),
    (Substitution("wind", "temperature", -0.5), "blow", [4.0, *DOWN], [23.0]),
    (Substitution("pressure", "temperature", 1.0), "push", [3.0], [28.0]),
]
ALL = {"push": "pressure", "blow": "wind", "cold": "temperature", "buzz": "vibration"}


@pytest.mark.parametrize(("substitution", "effect", "parameters", "expected"), SUBSTITUTIONS)
def test_substitution(substitution, effect, parameters, expected):
    header = make_header(ALL, 1)
    run = make_run(header, effect, {0: {0: 1.0}}, parameters)
    places = {"x": (substitution.target, at(0))}
    with_it = play(header, [run], make_device(places, substitutions=[substitution]))
    assert with_it.values.tolist() == [expected]
    assert with_it.shortfalls == () and with_it.felt[list(ALL).index(effect)].is_rendered.all()
    without = play(header, [run], make_device(places))
    assert (without.values == without.neutral).all()
    assert [shortfall.reason for shortfall in without.shortfalls] == ["modality"]


def test_a_substitute_combines_with_the_own_modality():
    header = make_header(ALL, 3)
    runs = [
        make_run(header, "push", {0: {0: 1.0}, 1: {0: 1.0}}, [4.0]),
        make_run(header, "buzz", {1: {0: 1.0}, 2: {0: 1.0}}, [3.0, 200.0]),
    ]
    device = make_device(
        {"v": ("vibration", at(0))},
        substitutions=[Substitution("pressure", "vibration", 1.0, 80.0)],
    )
    assert play(header, runs, device).values.tolist() == [[4, 80], [5, 80], [3, 200]]


def test_frequencies_out_of_range_are_clamped_and_reported():
    header = make_header({"buzz": "vibration", "low": "vibration"}, 4)
    device = make_device({"v": ("vibration", at(0))})
    runs = [
        make_run(header, "buzz", {0: {0: 1.0}, 1: {5: 1.0}}, [2.0, 400.0]),
        make_run(header, "low", {3: {0: 1.0}}, [2.0, 20.0]),
    ]
    raster = play(header, runs, device)
    assert raster.values.tolist() == [[2, 250], [0, 100], [0, 100], [2, 50]]
    actual = {(s.effect_id, s.reason): (s.samples, s.share, s.seconds) for s in raster.shortfalls}
    assert actual == {
        ("buzz", "place"): (1, 0.5, 0.01),
        ("buzz", "frequency"): (1, 0.5, 0.01),
        ("low", "frequency"): (1, 1.0, 0.01),
    }


def test_values_that_are_no_numbers_are_silent():
    header = make_header({"a": "pressure", "b": "vibration"}, 1)
    runs = [
        make_run(header, "a", {0: {0: 1.0}}, [float("nan")]),
        make_run(header, "b", {0: {0: 1.0}}, [5.0, float("inf")]),
    ]
    device = make_device({"p": ("pressure", at(0)), "v": ("vibration", at(0))})
    raster = play(header, runs, device)
    assert (raster.values == raster.neutral).all()


def test_slow_actuators_hold_their_peak():
    header = make_header({"push": "pressure"}, 10)
    device = make_device({"p": ("pressure", at(0))}, interval_ms=50.0)
    run = make_run(header, "push", {2: {0: 0.5}, 3: {0: 1.0}, 8: {0: 0.25}}, [4.0])
    assert play(header, [run], device).values[:, 0].tolist() == [4.0] * 5 + [1.0] * 5


def random_runs(header, random, low, high):
    """Return random runs, one per effect, over some samples of a range."""
    runs = []
    for effect, parameters in [
        ("push", [4.0]),
        ("buzz", [3.0, 120.0]),
        ("cold", [12.0]),
        ("blow", [6.0, 1.0, 0.0, 0.0]),
    ]:
        times = random.choice(np.arange(low, high), random.integers(0, high - low + 1), False)
        samples = {
            int(t): {
                int(v): float(random.uniform(0.01, 1))
                for v in random.choice(10, random.integers(1, 10), False)
            }
            for t in times
        }
        if samples:
            runs.append(make_run(header, effect, samples, parameters))
    return runs


def pieces(runs, cuts):
    """Yield samples in blocks with the ends ``cuts``."""
    for low, high in zip([0, *cuts], cuts, strict=False):
        for run in runs:
            samples = {
                int(i): dict(zip(sample.vertices.tolist(), sample.weights.tolist(), strict=True))
                for i, sample in zip(run.indices, run, strict=True)
                if low <= i < high
            }
            if samples:
                yield make_run(HEADER, run.stream.effect_id, samples, run.parameters[0])


HEADER = make_header(ALL, 40)
DEVICE = make_device(
    {
        "v": ("vibration", at(0, 1, 2)),
        "w": ("vibration", EVERYWHERE),
        "p": ("pressure", at(3, 4)),
        "t": ("temperature", at(7)),
    },
    substitutions=[
        Substitution("pressure", "vibration", 1.0, 80.0),
        Substitution("wind", "vibration", 1.0, 60.0),
    ],
    interval_ms=30.0,
)


@pytest.mark.parametrize("cuts", [[1, 2, 3, 20, 40], [7, 40], list(range(1, 41))])
@pytest.mark.parametrize("seed", range(4))
def test_blocks_may_be_cut_anywhere(seed, cuts):
    order = {stream.effect_id: i for i, stream in enumerate(HEADER.streams)}
    runs = random_runs(HEADER, np.random.default_rng(seed), 0, 40)
    runs.sort(key=lambda run: order[run.stream.effect_id])
    whole = play(HEADER, runs, DEVICE)
    cut = play(HEADER, pieces(runs, cuts), DEVICE)
    assert whole.values.tobytes() == cut.values.tobytes()
    assert whole.shortfalls == cut.shortfalls
    for a, b in zip(whole.felt, cut.felt, strict=True):
        assert (a.indices == b.indices).all() and (a.is_rendered == b.is_rendered).all()
        np.testing.assert_array_equal(a.strengths, b.strengths)


def test_blocks_must_follow_each_other():
    renderer = Renderer(HEADER, DEVICE, load)
    run = make_run(HEADER, "push", {5: {3: 1.0}}, [1.0])
    renderer.add([run])
    with pytest.raises(ValueError, match="out of order"):
        renderer.add([run])


def test_only_models_of_rendered_streams_are_loaded():
    loaded = []

    def loader(model_id):
        loaded.append(model_id)
        return MODELS[model_id]

    header = make_header(ALL, 2)
    device = make_device({"v": ("vibration", at(0))})
    run = make_run(header, "push", {0: {0: 1.0}}, [4.0])
    render(header, [run], device, loader)
    assert loaded == []
    render(header, [make_run(header, "buzz", {0: {0: 1.0}}, [4.0, 90.0])], device, loader)
    assert loaded == ["dots-vibration"]


def test_the_wearer():
    header = make_header({"push": "pressure"}, 1, bodies=["ann", "ben"])
    device = make_device({"p": ("pressure", at(0))})
    runs = [
        make_run(header, "push", {0: {0: 1.0}}, [1.0], body_id="ann"),
        make_run(header, "push", {0: {0: 1.0}}, [2.0], body_id="ben"),
    ]
    assert play(header, runs, device, body_id="ben").values.tolist() == [[2.0]]
    assert [f.stream.body_id for f in play(header, runs, device, body_id="ann").felt] == ["ann"]
    for body_id, actual in ((None, "no body is chosen"), ("eve", "there is no body 'eve'")):
        with pytest.raises(InputError, match=actual + r" to wear it.*'Ann' \(ann\), 'Ben' \(ben\)"):
            play(header, runs, device, body_id=body_id)


def test_a_track_of_another_model_is_refused():
    header = make_header({"push": "pressure"}, 1)
    run = make_run(header, "push", {0: {0: 1.0}}, [1.0])
    device = make_device({"p": ("pressure", EVERYWHERE)})
    with pytest.raises(InputError, match="recorded on body model 'dots-pressure'"):
        render(header, [run], device, lambda model_id: MODELS["dots-vibration"])


def test_modalities_without_a_device():
    header = make_header({"push": "pressure", "blow": "wind", "buzz": "vibration"}, 10)
    runs = [
        make_run(header, "push", {0: {0: 1.0}, 1: {5: 1.0}, 2: {9: 1.0}, 3: {9: 1.0}}, [2.0]),
        make_run(header, "blow", {4: {0: 1.0}}, [3.0, *DOWN]),
        make_run(header, "buzz", {4: {0: 1.0}}, [3.0, 80.0]),
    ]
    first = make_device({"p": ("pressure", at(0))})
    second = make_device({"p": ("pressure", at(5)), "v": ("vibration", at(0))})
    rasters = [play(header, runs, item) for item in (first, second)]
    push, blow = unrendered(rasters)
    assert (push.effect_id, push.modality, push.samples) == ("push", "pressure", 2)
    assert (push.share, push.seconds) == (0.5, 0.02)
    assert (blow.effect_id, blow.samples, blow.share) == ("blow", 1, 1.0)
    third = make_device({"p": ("pressure", EVERYWHERE), "f": ("wind", EVERYWHERE)})
    assert unrendered([*rasters, play(header, runs, third)]) == []
    assert unrendered([]) == []


def test_samples_without_strength_are_neither_lost_nor_cut():
    """Four samples at 100 Hz: pressure 0 and 9000 under an actuator of at most 10 kPa, then 0 and
    2 away from it. Only the second and the fourth are felt: half cut, half lost."""
    header = make_header({"push": "pressure", "idle": "pressure"}, 4)
    device = make_device({"p": ("pressure", at(0))})
    places = {0: {0: 1.0}, 1: {0: 1.0}, 2: {5: 1.0}, 3: {5: 1.0}}
    push = make_run(header, "push", places, [0.0])
    push.parameters[:, 0] = [0.0, 9000.0, 0.0, 2.0]
    idle = make_run(header, "idle", places, [0.0])  # shares the cut actuator, and gives nothing
    raster = play(header, [push, idle], device)
    assert [(s.effect_id, s.reason, s.samples, s.share, s.seconds) for s in raster.shortfalls] == [
        ("push", "place", 1, 0.5, 0.01),
        ("push", "limit", 1, 0.5, 0.01),
    ]
    (lost,) = unrendered([raster])
    assert (lost.effect_id, lost.samples, lost.share, lost.seconds) == ("push", 1, 0.5, 0.01)


@pytest.mark.parametrize(("is_contact", "neutral"), [(True, 33.0), (False, 24.0)])
def test_a_neutral_temperature_without_a_device_is_not_lost(is_contact, neutral):
    """33 degrees of an object and 24 of air are neutral, to within a thousandth of a degree."""
    header = make_header({"heat": "temperature"}, 3)
    effects = tuple(replace(effect, is_contact=is_contact) for effect in header.effects)
    header = replace(header, effects=effects)
    run = make_run(header, "heat", {k: {0: 1.0} for k in range(3)}, [0.0])
    run.parameters[:, 0] = [neutral, neutral + 0.0005, neutral - 4.0]
    raster = play(header, [run], make_device({"p": ("pressure", at(0))}))
    assert [(s.reason, s.samples, s.share) for s in raster.shortfalls] == [("modality", 1, 1.0)]
    assert [(lost.samples, lost.share) for lost in unrendered([raster])] == [(1, 1.0)]


def test_a_track_read_back_renders_equally(tmp_path):
    order = {stream.effect_id: i for i, stream in enumerate(HEADER.streams)}
    header = make_header(ALL, 4000)
    random = np.random.default_rng(8)
    blocks = []
    for low in range(0, 4000, 500):  # some streams pause for whole chunks
        runs = random_runs(header, random, low, low + 40)
        subset = [run for run in runs if random.random() < 0.6]
        blocks.append(sorted(subset, key=lambda run: order[run.stream.effect_id]))
    with TrackWriter(tmp_path / "t.hfxtrack", header, full_precision=True) as writer:
        renderer = Renderer(header, DEVICE, load)
        for block in blocks:
            writer.append(block)
            renderer.add(block)
    with TrackReader(tmp_path / "t.hfxtrack") as reader:
        read = render(reader.header, reader.runs(), DEVICE, load)
    assert read.values.tobytes() == renderer.raster().values.tobytes()
    assert (read.values != read.neutral).any()
