# SPDX-License-Identifier: GPL-3.0-or-later
"""Equal strength at all places, adaptation and persistence, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from rendering_synthetic import MODELS, at, make_device, make_header, make_run

from hfx_blender.engine.rendering.conditioning.feel import Feel, SkinMemory
from hfx_blender.engine.rendering.moment import MomentRenderer, of_one_moment
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.errors import InputError

TORSO, FOREARM = 3, 4  # vertices of the dots: odd ones are torso, even ones forearm


def models(name):
    return MODELS[name]


def header_of(feel, count=40, modality="vibration"):
    return replace(make_header({"hum": modality}, count), settings=feel.as_setting())


def device_of(**options):
    actuators = {"t": ("vibration", at(TORSO)), "f": ("vibration", at(FOREARM))}
    return make_device(actuators, **options)


def strengths(feel, samples, parameters=(10.0, 100.0), count=40, **options):
    header = header_of(feel, count)
    run = make_run(header, "hum", samples, parameters)
    return render(header, [run], device_of(**options), models).values[:, [0, 2]]


def everywhere(rows):
    return {row: {TORSO: 1.0, FOREARM: 1.0} for row in rows}


def test_equal_feel_lowers_the_more_sensitive_place():
    plain = strengths(Feel(), everywhere(range(5)))
    equal = strengths(Feel(is_equal=True), everywhere(range(5)))
    assert plain[0].tolist() == [10.0, 10.0]
    # detection.csv at 100 Hz: the torso needs 33.8 dB more than a finger, the forearm 26.9 dB.
    assert equal[0] == pytest.approx([10.0, 10.0 * 10.0 ** ((26.9 - 33.8) / 20.0)])


def test_equal_feel_evens_frequencies():
    # At 250 Hz the torso needs 34.3 dB more than a finger, and the palm's curve is at -20 dB re
    # 1 um; at 100 Hz at 10 - 12 log2(2.5) = -5.86 dB (-5.87 with the value -17.9 of 200 Hz).
    per_hz = [(2 * np.pi * hz) ** 2 * 10 ** (db / 20) for hz, db in ((250, 14.3), (100, 27.93))]
    felt = strengths(Feel(is_equal=True), everywhere(range(5)), (10.0, 250.0))[0, 0]
    assert felt == pytest.approx(10.0 * per_hz[0] / per_hz[1], rel=2e-3)


def vibrating(low_hz, high_hz, values=(), **fields):
    """Device with actuators of a range of frequencies."""
    device = device_of()
    kind = device.actuators[0].type
    strength, frequency = kind.controls
    frequency = replace(frequency, lowest=low_hz, highest=high_hz, values=values)
    kind = replace(kind, controls=(strength, frequency), **fields)
    return replace(device, actuators=tuple(replace(a, type=kind) for a in device.actuators))


@pytest.mark.parametrize(
    ("device", "hz", "torso_db", "palm_db", "played_hz"),
    # The torso's dB above a finger, and the palm's curve by logarithm of the frequency: 10 dB at
    # 40 Hz, -17.9 at 200 Hz, -20 at 250 Hz.
    [
        (vibrating(150.0, 150.0), 500.0, 32.0, -12.91, 150.0),
        (vibrating(50.0, 250.0), 500.0, 34.3, -20.0, 250.0),
        (vibrating(75.0, 250.0), 30.0, 28.1, -0.90, 75.0),
        (vibrating(75.0, 250.0, (75.0, 150.0)), 200.0, 32.0, -12.91, 150.0),
    ],
)
def test_equal_feel_takes_the_frequency_that_is_played(device, hz, torso_db, palm_db, played_hz):
    header = header_of(Feel(is_equal=True))
    run = make_run(header, "hum", everywhere([0]), (1.0, hz))
    at_100 = 33.8 - 5.88
    expected = (played_hz / 100.0) ** 2 * 10.0 ** ((torso_db + palm_db - at_100) / 20.0)
    values = render(header, [run], device, models).values[0, :2]
    assert values == pytest.approx([expected, played_hz], rel=2e-3)
    live = MomentRenderer(of_one_moment(header), device, models).values([run], 0.0)
    assert live[0] == pytest.approx(expected, rel=2e-3)


def test_equal_feel_raises_by_12_db_at_most():
    # At 500 Hz a torso needs 69 um (36.9 dB re 1 um) or 690 m/s^2, at 100 Hz 9.82: 70 times less.
    header = header_of(Feel(is_equal=True))
    run = make_run(header, "hum", everywhere([0]), (1.0, 500.0))
    values = render(header, [run], vibrating(50.0, 500.0), models).values
    assert values[0, :2].tolist() == [4.0, 500.0]


def test_equal_feel_of_a_pair_of_tones_takes_the_tone_felt_first():
    device = vibrating(20.0, 500.0, takes_waveform=True, is_tone_pair=True)
    header = header_of(Feel(is_equal=True))
    # Midway of 40 and 320 Hz both tones have the same share.
    run = make_run(header, "hum", everywhere([0]), (10.0, np.sqrt(40.0 * 320.0)))
    low, high = (p.amplitudes[0, 0] for p in render(header, [run], device, models).partials)
    # The torso at 40 Hz: 18.23 + 10 dB re 1 um or 1.630 m/s^2; at 320 Hz 55 m/s^2.
    assert low == pytest.approx(10.0 * 1.630 / 9.818, rel=2e-3)
    assert high == pytest.approx(low)


def test_thresholds_of_an_actuator_count_at_the_frequency_that_is_played():
    # 2 m/s^2 is above the actuator's threshold at 100 Hz, but below that at 250 Hz.
    device = vibrating(100.0, 100.0, thresholds=((100.0, 1.0), (250.0, 5.0)))
    header = header_of(Feel())
    run = make_run(header, "hum", everywhere([0]), (2.0, 250.0))
    shortfalls = render(header, [run], device, models).shortfalls
    assert [short.reason for short in shortfalls] == ["frequency"]


def test_limits_come_after_equal_feel():
    # Factor 1.303 at 250 Hz: 18 m/s^2 would be 23.5; the device has 20 at most.
    felt = strengths(Feel(is_equal=True), everywhere(range(5)), (18.0, 250.0))
    assert felt[0, 0] == 20.0


def test_adaptation_follows_its_first_order_equation():
    tau_s = 0.1
    values = strengths(Feel(adaptation_s=tau_s), everywhere([*range(20), *range(30, 40)]))[:, 0]
    times_s = np.arange(20) / 100.0
    adapted = 1.0 - np.exp(-times_s / tau_s)
    assert values[:20] == pytest.approx(10.0 / (1.0 + 0.6 * adapted))
    # 10 samples of silence recover, with the same constant, up to and including the last of them.
    recovered = adapted[-1] * np.exp(-0.1 / tau_s)
    first_back = 1.0 - (1.0 - recovered) * np.exp(-0.01 / tau_s)
    assert values[20:30].tolist() == [0.0] * 10
    assert values[30] == pytest.approx(10.0 / (1.0 + 0.6 * first_back))


def test_complete_adaptation_raises_the_threshold_by_60_percent():
    values = strengths(Feel(adaptation_s=0.01), everywhere(range(40)))
    assert values[39, 0] == pytest.approx(10.0 / 1.6)


def test_a_sensation_persists_exponentially_to_one_percent():
    tau_s = 0.04
    values = strengths(Feel(persistence_s=tau_s), everywhere(range(5)))[:, 0]
    tail_s = np.arange(1, 36) / 100.0
    expected = 10.0 * np.exp(-tail_s / tau_s)
    expected[expected < 0.1] = 0.0
    assert values[:5].tolist() == [10.0] * 5
    assert values[5:] == pytest.approx(expected)


def test_adaptation_recovers_while_a_sensation_persists():
    feel = Feel(adaptation_s=0.1, persistence_s=0.04)
    values = strengths(feel, everywhere(range(5)))[:, 0]
    tail_s = np.arange(36) / 100.0
    adapted = (1.0 - np.exp(-0.04 / 0.1)) * np.exp(-tail_s / 0.1)
    fading = np.exp(-tail_s / 0.04)
    fading[fading < 0.01] = 0.0  # 1 % of the level without adaptation
    assert values[4:] == pytest.approx(10.0 * fading / (1.0 + 0.6 * adapted))


def test_samples_of_level_0_are_silence():
    feel = Feel(adaptation_s=0.1, persistence_s=0.04)
    header = header_of(feel)
    run = make_run(header, "hum", everywhere(range(40)), (10.0, 100.0))
    run = replace(run, levels=np.where(np.arange(40) < 5, 1.0, 0.0))
    values = render(header, [run], device_of(), models).values[:, [0, 2]]
    assert values == pytest.approx(strengths(feel, everywhere(range(5))))


def test_persistence_crosses_blocks_and_gaps():
    feel = Feel(persistence_s=0.04)
    header = header_of(feel)
    samples = everywhere([2, 3, 4, 9, 10, 25])
    whole = render(header, [make_run(header, "hum", samples, (10.0, 100.0))], device_of(), models)
    renderer = Renderer(header, device_of(), models)
    for rows in ((2, 3), (4,), (9, 10), (25,)):
        renderer.add([make_run(header, "hum", everywhere(rows), (10.0, 100.0))])
    assert renderer.raster().values == pytest.approx(whole.values)
    assert whole.values[6, 0] == pytest.approx(10.0 * np.exp(-0.02 / 0.04))


def test_live_moments_equal_the_export():
    feel = Feel(adaptation_s=0.1, persistence_s=0.04)
    header = header_of(feel)
    samples = everywhere(range(3, 12))
    run = make_run(header, "hum", samples, (10.0, 100.0))
    raster = render(header, [run], device_of(), models)
    live = MomentRenderer(of_one_moment(header), device_of(), models)
    for row in range(3, 40):
        moment = make_run(header, "hum", everywhere([0]), (10.0, 100.0))
        values = live.values([moment] if row in samples else [], row / 100.0)
        assert values == pytest.approx(raster.values[row])


def test_nothing_persists_while_time_stands_still():
    header = header_of(Feel(persistence_s=10.0))
    live = MomentRenderer(of_one_moment(header), device_of(), models)
    live.values([make_run(header, "hum", everywhere([0]), (10.0, 100.0))], 1.0)
    assert live.values([], 1.1)[0] > 9.0
    assert live.values([], 1.1)[0] == 0.0  # paused


def test_time_that_jumps_back_forgets():
    header = header_of(Feel(persistence_s=10.0))
    live = MomentRenderer(of_one_moment(header), device_of(), models)
    live.values([make_run(header, "hum", everywhere([0]), (10.0, 100.0))], 1.0)
    assert live.values([], 0.5)[0] == 0.0


def test_defaults_change_nothing():
    assert Feel().as_setting() == {}
    header = header_of(Feel())
    run = make_run(header, "hum", everywhere([1]), (10.0, 100.0))
    memory = SkinMemory(Feel())
    same = memory.felt([run], run.indices, run.times_s)[0]
    assert (same.levels.tolist(), same.weights.tolist()) == ([1.0], run.weights.tolist())


@pytest.mark.parametrize(
    "stored",
    [
        *(3, None, [], {"is_equal": 1}, {"adaptation_s": -1.0}, {"adaptation_s": "1"}),
        *({"persistence_s": float("nan")}, {"persistence_s": 1e9}, {"x": 1.0}),
    ],
)
def test_a_malformed_setting_is_one_error(stored):
    header = replace(make_header({"hum": "vibration"}), settings={"feel": stored})
    with pytest.raises(InputError, match=r"settings\.feel"):
        Renderer(header, device_of(), models)
