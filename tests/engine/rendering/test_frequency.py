# SPDX-License-Identifier: GPL-3.0-or-later
"""Overlapping 80 and 250 Hz: a single frequency with hysteresis, or the sum of both waveforms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendering_synthetic import MODELS, at, make_device, make_header, make_run

from hfx_blender.engine.rendering.conditioning.frequency import (
    MARGIN,
    StrongestContributor,
    tone_pair_shares,
)
from hfx_blender.engine.rendering.device_config import DeviceConfig, Substitution
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.formats.sound import wav

LOW, HIGH = 80.0, 250.0


def chosen(*strengths: tuple[float, float]) -> list[float]:
    """Return the frequencies of an actuator for strengths of an 80 and a 250 Hz effect."""
    amplitudes = np.array(strengths).T[..., None]
    hz = np.repeat([[LOW], [HIGH]], len(strengths), axis=1)
    return StrongestContributor(1).frequencies(["a", "b"], amplitudes, hz)[:, 0].tolist()


def test_the_strongest_contributors_frequency_is_played():
    assert chosen((2.0, 1.0)) == [LOW]
    assert chosen((1.0, 2.0)) == [HIGH]
    assert chosen((0.0, 0.0)) == [0.0]


def test_the_frequency_changes_only_for_a_clearly_stronger_effect():
    a_little, clearly = 1.0 * MARGIN - 0.01, 1.0 * MARGIN + 0.01
    assert chosen((1.0, 0.5), (1.0, a_little), (1.0, clearly), (a_little, 1.0)) == [
        LOW,
        LOW,
        HIGH,
        HIGH,
    ]


def test_the_frequency_changes_at_once_after_silence():
    assert chosen((1.0, 0.1), (0.0, 0.1), (0.1, 0.1), (0.13, 0.1)) == [LOW, HIGH, HIGH, LOW]


def test_nearly_equal_effects_do_not_alternate():
    rng = np.random.default_rng(1)
    noise = 1.0 + 0.1 * rng.uniform(-1.0, 1.0, (500, 2))
    assert len(set(chosen(*map(tuple, noise.tolist())))) == 1


def test_contributors_of_one_frequency_support_each_other():
    amplitudes = np.array([1.0, 1.0, 1.5])[:, None, None]
    hz = np.array([[LOW], [LOW + 0.5], [HIGH]])
    assert StrongestContributor(1).frequencies(["a", "b", "c"], amplitudes, hz)[0, 0] < HIGH


def test_actuators_choose_for_themselves_and_remember_from_block_to_block():
    contributor = StrongestContributor(2)
    hz = np.array([[LOW], [HIGH]])
    first = np.array([[[2.0, 1.0]], [[1.0, 2.0]]])
    equal = np.ones((2, 1, 2))
    assert contributor.frequencies(["a", "b"], first, hz).tolist() == [[LOW, HIGH]]
    # The same effects in another order, with a silent effect in between.
    again = contributor.frequencies(
        ["b", "x", "a"], np.insert(equal, 1, 0.0, axis=0), hz[[1, 1, 0]]
    )
    assert again.tolist() == [[LOW, HIGH]]


@given(st.integers(0, 2**32 - 1))
def test_frequencies_do_not_depend_on_blocks(seed: int):
    """Blocks without changes of source take a vectorised path."""
    random = np.random.default_rng(seed)
    rows, width = 6, 5
    amplitudes = random.integers(0, 4, (2, rows, width)) * random.choice([1.0, 0.3], (2, 1, width))
    amplitudes[:, :, random.random(width) < 0.5] *= random.random((2, 1, 1))
    steady = random.random(width) < 0.4
    amplitudes[:, :, steady] = amplitudes[:, :1, steady]
    hz = np.repeat([[LOW], [HIGH]], rows, axis=1)
    whole, bit_by_bit = StrongestContributor(width), StrongestContributor(width)
    for _ in range(2):  # the second time somebody is held
        frequencies = whole.frequencies(["a", "b"], amplitudes, hz)
        for k in range(rows):
            part = slice(k, k + 1)
            one = bit_by_bit.frequencies(["a", "b"], amplitudes[:, part], hz[:, part])
            assert frequencies[k].tolist() == one[0].tolist()


def test_a_frequency_that_is_none_is_handed_on_for_the_guard_to_silence():
    hz = np.array([[np.nan], [HIGH]])
    frequencies = StrongestContributor(2).frequencies(
        ["a", "b"], np.array([[[1.0, 0.0]], [[2.0, 2.0]]]), hz
    )
    assert np.isnan(frequencies[0, 0]) and frequencies[0, 1] == HIGH


@given(st.lists(st.tuples(st.floats(0, 10), st.floats(0, 10)), min_size=1, max_size=30))
def test_the_played_effect_is_never_much_weaker_than_the_strongest(strengths):
    for (low, high), hz in zip(strengths, chosen(*strengths), strict=True):
        mine = {LOW: low, HIGH: high, 0.0: 0.0}[hz]
        assert max(low, high) <= mine * MARGIN * (1 + 1e-9)


def rendered(
    low: float, high: float, *, wave: bool, count: int = 100, latency_ms: float = 0.0, **device
) -> tuple[DeviceConfig, Raster]:
    header = make_header({"low": "vibration", "high": "vibration"}, count)
    actual = make_device({"m": ("vibration", at(3))}, **device)
    kind = replace(
        actual.actuators[0].type,
        takes_waveform=wave,
        latency_ms=latency_ms,
    )
    actual = replace(
        actual,
        actuator_types={"vibration": kind},
        actuators=(replace(actual.actuators[0], type=kind),),
    )
    samples = {i: {3: 1.0} for i in range(count)}
    late = {i: {3: 1.0} for i in range(count // 4, count)}
    renderer = Renderer(header, actual, lambda name: MODELS[name])
    renderer.add(
        [
            make_run(header, "low", samples, [low, LOW]),
            make_run(header, "high", late, [high, HIGH]),
        ]
    )
    return actual, renderer.raster()


def test_an_actuator_with_a_frequency_keeps_the_first_of_two_equal_effects():
    _, raster = rendered(6.0, 6.0, wave=False)
    assert set(raster.values[:, 1].tolist()) == {LOW}
    assert raster.values[50, 0] == pytest.approx(np.hypot(6.0, 6.0))
    assert raster.partials == ()
    _, raster = rendered(4.0, 6.0, wave=False)
    assert raster.values[:, 1].tolist() == [LOW] * 25 + [HIGH] * 75


def waveform(device: DeviceConfig, raster: Raster) -> np.ndarray:
    return np.concatenate([*wav.waveforms(raster, wav.drives_of(raster, device), wav.RATE_HZ)])[
        :, 0
    ]


def spectrum(device: DeviceConfig, raster: Raster) -> dict[float, float]:
    """Return amplitudes of 80 and 250 Hz in the second half of a WAV, m/s^2."""
    samples = waveform(device, raster)
    half = samples[len(samples) // 2 :]  # half a second: whole periods of both
    time = np.arange(len(half)) / wav.RATE_HZ
    scale = device.actuators[0].type.strength.highest * 2.0 / len(half)
    return {hz: scale * abs(np.exp(-2j * np.pi * hz * time) @ half) for hz in (LOW, HIGH)}


def test_an_actuator_that_takes_a_waveform_plays_both():
    device, raster = rendered(6.0, 4.0, wave=True)
    actual = spectrum(device, raster)
    # The last row fades to silence: a fiftieth of the half second plays at half strength.
    assert actual[LOW] == pytest.approx(6.0 * 0.99, rel=2e-3)
    assert actual[HIGH] == pytest.approx(4.0 * 0.99, rel=2e-3)


def test_one_with_a_frequency_plays_one():
    device, raster = rendered(6.0, 4.0, wave=False)
    actual = spectrum(device, raster)
    assert actual[LOW] == pytest.approx(np.hypot(6.0, 4.0) * 0.99, rel=2e-3)
    assert actual[HIGH] < 0.01


def test_the_sum_keeps_the_limit_for_any_phases():
    device, raster = rendered(15.0, 15.0, wave=True, gain=2.0)
    total = sum(np.pad(p.amplitudes[:, 0], (p.first_row, 0)) for p in raster.partials)
    assert total.max() == pytest.approx(20.0)
    assert np.abs(waveform(device, raster)).max() <= 1.0


def test_effects_of_one_frequency_are_in_phase_however_they_begin():
    header = make_header({"one": "vibration", "two": "vibration"}, 100)
    device, _ = rendered(1.0, 1.0, wave=True)
    for begin in (13, 27):
        renderer = Renderer(header, device, lambda name: MODELS[name])
        runs = [
            make_run(header, name, {i: {3: 1.0} for i in range(first, 100)}, [5.0, LOW])
            for name, first in (("one", 0), ("two", begin))
        ]
        renderer.add(runs)
        actual = spectrum(device, renderer.raster())
        assert actual[LOW] == pytest.approx(10.0 * 0.99, rel=2e-3)


def test_partials_are_early_by_the_latency_as_values_are():
    _, raster = rendered(6.0, 4.0, wave=True, latency_ms=30.0)
    high = next(partial_ for partial_ in raster.partials if partial_.effect_id == "high")
    assert high.first_row == 22
    assert np.flatnonzero(np.diff(raster.values[:, 0]))[0] == 21
    low = next(partial_ for partial_ in raster.partials if partial_.effect_id == "low")
    assert low.first_row == 0 and len(low.amplitudes) == 97


def test_nan_is_silent_in_a_waveform():
    header = make_header({"bad": "vibration"}, 4)
    device, _ = rendered(1.0, 1.0, wave=True)
    for bad in ([np.nan, LOW], [5.0, np.nan], [np.inf, LOW], [5.0, -1.0]):
        renderer = Renderer(header, device, lambda name: MODELS[name])
        renderer.add([make_run(header, "bad", {i: {3: 1.0} for i in range(4)}, bad)])
        for partial in renderer.raster().partials:
            assert not partial.amplitudes.any()


def test_a_substitute_is_a_partial_of_its_own():
    header = make_header({"push": "pressure", "low": "vibration"}, 4)
    device, _ = rendered(1.0, 1.0, wave=True)
    shown = Substitution("pressure", "vibration", 2.0, HIGH)
    device = replace(device, substitutions={"pressure": shown})
    renderer = Renderer(header, device, lambda name: MODELS[name])
    samples = {i: {3: 1.0} for i in range(4)}
    renderer.add(
        [make_run(header, "push", samples, [3.0]), make_run(header, "low", samples, [1.0, LOW])]
    )
    actual = {p.frequencies_hz[0, 0]: p.amplitudes[0, 0] for p in renderer.raster().partials}
    assert actual == {LOW: 1.0, HIGH: 6.0}


def test_shares_of_a_tone_pair() -> None:
    """Octaves from 40 Hz: 1.5 of 3 is half way, an eighth of a turn; the power is constant."""
    hz = np.array([20.0, 40.0, 40.0 * 8**0.5, 80.0, 320.0, 500.0])
    shares = tone_pair_shares(hz)
    half = 0.5**0.5
    np.testing.assert_allclose(shares[0], [1, 1, half, 0.75**0.5, 0, 0], atol=1e-12)
    np.testing.assert_allclose(shares[1], [0, 0, half, 0.5, 1, 1], atol=1e-12)


def test_actuators_with_a_tone_pair_play_two_tones() -> None:
    """80 Hz at 10 m/s^2 is 8.66 at 40 Hz and 5 at 320 Hz; a second effect at 320 Hz adds 2."""
    device = make_device({"coil": ("vibration", at(4))})
    kind = device.actuators[0].type
    wide = tuple(replace(c, minimum=0, lowest=0, maximum=500, highest=500) for c in kind.controls)
    kind = replace(kind, controls=wide, takes_waveform=True, is_tone_pair=True)
    device = replace(device, actuators=(replace(device.actuators[0], type=kind),))
    header = make_header({"a": "vibration", "b": "vibration"}, 2)
    runs = [
        make_run(header, name, {0: {4: 1.0}, 1: {4: 1.0}}, parameters)
        for name, parameters in (("a", [10.0, 80.0]), ("b", [2.0, 320.0]))
    ]
    renderer = Renderer(header, device, lambda name: MODELS[name])
    renderer.add(runs)
    tones = {p.effect_id: (p.amplitudes[0, 0], p.frequencies_hz[0, 0]) for p in renderer.partials()}
    assert tones == {
        "40 Hz": (pytest.approx(8.6603, abs=1e-4), 40.0),
        "320 Hz": (pytest.approx(7.0, abs=1e-4), 320.0),
    }


def test_marks_of_a_person_scale_strengths_and_tones():
    """10 of 20 m/s^2, between first felt 1 and strong enough 3, is 2; two tones share the 2."""
    device = make_device({"coil": ("vibration", at(4))})
    kind = replace(device.actuators[0].type, takes_waveform=True, marks=(1.0, 3.0, 20.0))
    device = replace(device, actuators=(replace(device.actuators[0], type=kind),))
    header = make_header({"a": "vibration", "b": "vibration"}, 1)
    runs = [make_run(header, "a", {0: {4: 1.0}}, [8.0, LOW])]
    runs.append(make_run(header, "b", {0: {4: 1.0}}, [6.0, HIGH]))
    renderer = Renderer(header, device, lambda name: MODELS[name])
    renderer.add(runs)
    tones = [partial.amplitudes[0, 0] for partial in renderer.partials()]
    assert renderer.first_row()[0] == pytest.approx(2.0)  # sqrt(8^2 + 6^2) is 10
    assert tones == pytest.approx([1.6, 1.2])
