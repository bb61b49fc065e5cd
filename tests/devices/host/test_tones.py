# SPDX-License-Identifier: GPL-3.0-or-later
"""An actuator driven as sound plays vibrations of 80 and 250 Hz together in live mode."""

from __future__ import annotations

import math
import sys
import types
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.host.clock import SYSTEM
from hfx_blender.devices.host.device_thread import DeviceThread
from hfx_blender.devices.host.output import SoundingOutput
from hfx_blender.devices.host.tones import LONE, MAX_TONES, Sounding, Tones, frame_of, of_partials
from hfx_blender.devices.transports.sound_card import RATE_HZ, SoundCard, SumOfTones
from hfx_blender.engine.rendering.conditioning.frequency import Partial
from hfx_blender.engine.rendering.raster import Column, Raster
from hfx_blender.formats.sound import wav

PAD = load_device("mango_pad")  # ten actuators with waveforms
WIDTH = len(PAD.actuators)
MOST = PAD.actuators[0].type.strength.highest
LOW, HIGH = 80.0, 250.0


def values(amplitude: float, hz: float = LOW) -> np.ndarray:
    return np.tile([amplitude, hz], WIDTH)


def tones(*pairs: tuple[float, float]) -> Tones:
    """Return tones 0, 1, ... with (amplitude, frequency) at every actuator."""
    actual = np.array(pairs, np.float64).reshape(-1, 2)
    ones = np.ones(WIDTH)
    return Tones(
        np.arange(len(pairs)),
        actual[:, :1] * ones[None],
        np.clip(actual[:, 1:], 0, 1e9) * ones[None],
    )


def both(low: float = 3.0, high: float = 2.0) -> np.ndarray:
    return frame_of(values(np.hypot(low, high)), tones((low, LOW), (high, HIGH)))


def played(sounding: Sounding, frame: np.ndarray) -> Tones:
    """Return the tones of a frame, scaled by a guard gain of 1."""
    columns = sounding.split(frame)
    return sounding.at(1.0, columns, columns)


def strength_of(some_tones: Tones, hz: float) -> float:
    return float(some_tones.amplitudes[np.isclose(some_tones.frequencies_hz[:, 0], hz), 0].sum())


def test_a_frame_with_tones_is_played_as_their_sum():
    actual = played(Sounding(PAD), both())
    assert strength_of(actual, LOW) == pytest.approx(3.0)
    assert strength_of(actual, HIGH) == pytest.approx(2.0)


def test_values_without_tones_are_one_tone():
    actual = played(Sounding(PAD), values(4.0, 120.0))
    assert actual.numbers.tolist() == [LONE]
    assert actual.amplitudes[0].tolist() == [4.0] * WIDTH
    assert actual.frequencies_hz[0].tolist() == [120.0] * WIDTH


def test_strengths_ramp_linearly_and_removed_tones_fade():
    sounding = Sounding(PAD)
    played(sounding, both(3.0, 2.0))
    columns = sounding.split(frame_of(values(6.0), tones((6.0, LOW))))
    actual = sounding.at(0.5, columns, columns)
    assert strength_of(actual, LOW) == pytest.approx(4.5)
    assert strength_of(actual, HIGH) == pytest.approx(1.0)


def test_tones_are_turned_down_as_the_guard_turns_down_their_strength():
    sounding = Sounding(PAD)
    columns = sounding.split(both(3.0, 2.0))
    actual = sounding.at(1.0, columns, 0.5 * columns)
    assert strength_of(actual, LOW) == pytest.approx(1.5)
    silent = sounding.at(1.0, columns, values(0.0))
    assert not silent.amplitudes.any()


def test_a_test_pulse_is_heard_where_no_tone_sounds():
    sounding = Sounding(PAD)
    silent = sounding.split(values(0.0))
    pulse = silent.copy()
    pulse[4] = 2.0
    actual = sounding.at(1.0, silent, pulse)
    assert actual.amplitudes.sum(axis=0).tolist() == [0.0, 0.0, 2.0] + [0.0] * (WIDTH - 3)


numbers = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(st.tuples(numbers, numbers), max_size=MAX_TONES), numbers, st.floats(0.0, 1.0))
@example([(1.7e308, 0.0)], 6.0, 1.0)  # too large to be turned down
@example([(np.inf, 80.0), (-1.0, np.nan)], np.inf, 0.5)
@settings(deadline=None)
def test_any_sum_of_tones_keeps_the_limits(pairs, strength, share):
    sounding = Sounding(PAD)
    frame = frame_of(values(5.0), tones(*pairs))
    with np.errstate(all="ignore"):
        columns = sounding.split(frame)
        passed = values(min(max(np.nan_to_num(strength), 0.0), MOST))
        actual = sounding.at(share, columns, passed)
    frequency = PAD.actuators[0].type.controls[1]
    assert np.isfinite(actual.amplitudes).all() and (actual.amplitudes >= 0.0).all()
    assert (actual.amplitudes.sum(axis=0) <= MOST * (1.0 + 1e-12)).all()
    assert (actual.frequencies_hz >= frequency.lowest).all()
    assert (actual.frequencies_hz <= frequency.highest).all()


@pytest.mark.parametrize("wrong", [np.zeros(3), np.zeros((2, 20)), np.zeros(2 * WIDTH + 5)])
def test_an_invalid_frame_is_refused(wrong: np.ndarray) -> None:
    with pytest.raises(ValueError, match=f"values and takes {2 * WIDTH}"):
        Sounding(PAD).split(wrong)


def test_a_frame_of_too_many_tones_is_refused():
    sounding = Sounding(PAD)
    with pytest.raises(ValueError, match="and takes"):
        sounding.split(frame_of(values(5.0), tones(*[(0.1, LOW)] * (MAX_TONES + 1))))
    assert len(sounding.split(frame_of(values(5.0), tones(*[(0.1, LOW)] * MAX_TONES)))) == 2 * WIDTH


def partial(name: str, amplitude: float, hz: float) -> Partial:
    return Partial(name, 0, np.full((1, 2), amplitude), np.full((1, 2), hz))


def test_effects_of_one_frequency_are_one_tone_and_of_too_many_the_strongest_stay():
    numbers = {f"e{k}": k for k in range(100)}
    actual = of_partials(
        [partial("e3", 1.0, LOW), partial("e5", 2.0, HIGH), partial("e7", 4.0, LOW)], numbers, 2
    )
    assert actual.numbers.tolist() == [3, 5]
    assert actual.amplitudes[:, 0].tolist() == [5.0, 2.0]
    many = [partial(f"e{k}", 1.0 + k, 50.0 + 2 * k) for k in range(100)]
    assert sorted(of_partials(many, numbers, 2).numbers) == list(range(100 - MAX_TONES, 100))


def spectrum(samples: np.ndarray, rate: int) -> dict[float, float]:
    """Return amplitudes over whole periods of both frequencies."""
    time = np.arange(len(samples)) / rate
    return {
        hz: abs(np.exp(-2j * np.pi * hz * time) @ samples) * 2.0 / len(samples)
        for hz in (LOW, HIGH)
    }


class Stream:
    """Stand-in for PortAudio's stream."""

    made: list[Stream] = []

    def __init__(self, **settings: Any) -> None:
        self.settings = settings
        Stream.made.append(self)

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None: ...

    def ask(self, count: int) -> np.ndarray:
        block = np.zeros((count, self.settings["channels"]), np.float32)
        self.settings["callback"](block, count, None, None)
        return block


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Iterator[SoundCard]:
    fake = types.ModuleType("sounddevice")
    fake.OutputStream = Stream
    monkeypatch.setitem(sys.modules, "sounddevice", fake)
    Stream.made.clear()
    opened = SoundCard(PAD)
    yield opened
    opened.close()


def through(card: Any, frame: np.ndarray) -> None:
    """Send a frame as the output process does."""
    sounding = Sounding(PAD)
    columns = sounding.split(frame)
    card.send_tones(columns, sounding.at(1.0, columns, columns))


def test_a_card_plays_the_samples_of_an_exported_wav(card: Any) -> None:
    assert isinstance(card, SoundingOutput)
    through(card, both(3.0, 2.0))
    (stream,) = Stream.made
    stream.ask(4800)
    live = spectrum(stream.ask(RATE_HZ // 2)[:, 0], RATE_HZ)
    rows = 200
    raster = Raster(
        device_id=PAD.id,
        body_id="body",
        actuators=tuple(a.id for a in PAD.actuators),
        columns=tuple(
            Column(a.id, c.name, a.type.unit(c)) for a in PAD.actuators for c in a.type.controls
        ),
        times_s=np.arange(rows) / 100.0,
        rate_hz=Fraction(100),
        values=np.tile(values(np.hypot(3.0, 2.0)), (rows, 1)),
        neutral=values(0.0),
        shortfalls=(),
        felt=(),
        waveform_actuators=tuple(a.id for a in PAD.actuators),
        partials=tuple(
            Partial(n, 0, np.full((rows, WIDTH), a), np.full((rows, WIDTH), hz))
            for n, a, hz in (("low", 3.0, LOW), ("high", 2.0, HIGH))
        ),
    )
    rate, samples = (
        wav.RATE_HZ,
        np.concatenate([*wav.waveforms(raster, wav.drives_of(raster, PAD), wav.RATE_HZ)]),
    )
    exported = spectrum(samples[rate // 2 : rate, 0], rate)
    for hz, strength in ((LOW, 3.0), (HIGH, 2.0)):
        assert live[hz] == pytest.approx(strength / MOST, rel=1e-3)
        assert live[hz] == pytest.approx(exported[hz], rel=1e-3)


def test_a_second_frequency_comes_and_goes_without_a_click(card: Any) -> None:
    (stream,) = Stream.made
    heard = []
    for frame in (both(3.0, 0.0), both(3.0, 2.0), both(0.0, 2.0), values(0.0)):
        through(card, frame)
        heard.append(stream.ask(2400)[:, 0])
    steps = np.abs(np.diff(np.concatenate(heard)))
    steepest = sum(2 * np.pi * hz * a / MOST for a, hz in ((3.0, LOW), (2.0, HIGH))) / RATE_HZ
    assert steps.max() <= steepest + 5.0 / MOST / (0.005 * RATE_HZ)
    assert not heard[-1][300:].any()


@given(st.lists(st.integers(1, 700), min_size=1, max_size=12))
@settings(deadline=None, max_examples=30)
def test_sums_are_equal_for_any_block_size(sizes):
    total = sum(sizes)

    def sound(blocks: list[int]) -> np.ndarray:
        created = SumOfTones(["sine"] * WIDTH, RATE_HZ)
        created.aim(tones((0.4, LOW), (0.3, HIGH)))
        first = np.concatenate([created.block(count) for count in blocks])
        created.aim(tones((0.1, 90.0)))
        return np.concatenate([first, *(created.block(count) for count in blocks)])

    np.testing.assert_allclose(sound(sizes), sound([total]), atol=1e-9)


def test_tones_of_one_frequency_are_in_phase_however_they_begin():
    created = SumOfTones(["sine"], RATE_HZ)
    one = np.array([[0.4]]), np.array([[LOW]])
    created.aim(Tones(np.array([0]), *one))
    created.block(1234)
    created.aim(Tones(np.array([0, 1]), *(np.vstack([item, item]) for item in one)))
    created.block(4800)
    assert np.abs(created.block(RATE_HZ // 10)).max() == pytest.approx(0.8, abs=1e-3)


class ToneRecorder:
    """Output recording sums of tones."""

    def __init__(self) -> None:
        self.heard: list[Tones] = []

    def send(self, values: np.ndarray) -> None:
        raise AssertionError("values without tones")

    def send_tones(self, values: np.ndarray, tones: Tones) -> None:
        self.heard.append(tones)

    def stop(self) -> None: ...

    def close(self) -> None: ...


def test_a_lane_plays_both_frequencies_within_its_guard() -> None:
    kind = replace(PAD.actuators[0].type, slew_per_s=100.0)
    slow = replace(PAD, actuators=tuple(replace(a, type=kind) for a in PAD.actuators))
    recorder = ToneRecorder()
    thread = DeviceThread(0, slow, lambda: recorder, lambda *_, **__: None)
    thread.output, thread.is_open = recorder, True  # the test thread stands for the output thread
    thread.arm()
    thread.feed(both(3.0, 4.0))
    # 100 m/s^2 per second: the sum of 5 m/s^2 reaches 1 after 10 ms and 5 after 50 ms.
    newest = thread.waiting.taken(math.inf, 0.0)
    now = SYSTEM.now()
    for k in range(8):
        thread.step(now + 0.01 * k, 0.01, newest if k == 0 else None, thread.generation)
    sums = [
        np.hypot(strength_of(message, LOW), strength_of(message, HIGH))
        for message in recorder.heard
    ]
    assert sums == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0, 5.0])
    assert strength_of(recorder.heard[-1], LOW) == pytest.approx(3.0)


def test_a_frame_weaker_than_its_tones_exceeds_no_limit() -> None:
    kind = replace(PAD.actuators[0].type, slew_per_s=100.0)
    slow = replace(PAD, actuators=tuple(replace(a, type=kind) for a in PAD.actuators))
    recorder = ToneRecorder()
    thread = DeviceThread(0, slow, lambda: recorder, lambda *_, **__: None)
    thread.output, thread.is_open = recorder, True  # the test thread stands for the output thread
    thread.arm()
    frame = both(3.0, 4.0)
    frame[0] = 1e-6
    now = SYSTEM.now()
    for k in range(3):
        thread.step(now + 0.01 * k, 0.01, frame if k == 0 else None, thread.generation)
    sums = [
        np.hypot(strength_of(message, LOW), strength_of(message, HIGH))
        for message in recorder.heard
    ]
    assert sums == pytest.approx([1.0, 2.0, 3.0])
