# SPDX-License-Identifier: GPL-3.0-or-later
"""Sound cards with a stand-in module for PortAudio, and the waveforms sent to the cards."""

from __future__ import annotations

import sys
import types
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bench_devices import device, heat, vibration

from hfx_blender.devices.host import opening
from hfx_blender.devices.host.output import OutputLostError
from hfx_blender.devices.transports import sound_card
from hfx_blender.devices.transports.sound_card import RATE_HZ, Oscillators, SoundCard


class Stream:
    """Stand-in for PortAudio's stream: requests blocks on demand."""

    made: list[Stream] = []

    def __init__(self, **settings: Any) -> None:
        if settings["device"] == "gone":
            raise ValueError("No output device matching 'gone'")
        self.settings = settings
        self.calls: list[str] = []
        Stream.made.append(self)

    def start(self) -> None:
        self.calls.append("start")

    def stop(self) -> None:
        self.calls.append("stop")
        self.settings["finished_callback"]()

    def close(self) -> None:
        self.calls.append("close")

    def ask(self, count: int) -> np.ndarray:
        block = np.full((count, self.settings["channels"]), np.nan, np.float32)
        self.settings["callback"](block, count, None, None)
        return block


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Any:
    fake = types.ModuleType("sounddevice")
    fake.OutputStream = Stream
    fake.query_devices = lambda: [
        {"name": "Card", "max_output_channels": 8},
        {"name": "Microphone", "max_output_channels": 0},
    ]
    monkeypatch.setitem(sys.modules, "sounddevice", fake)
    Stream.made.clear()
    return lambda **options: SoundCard(device(vibration(), heat(), vibration()), **options)


LOUD = np.array([5.0, 100.0, 29.0, 10.0, 200.0])  # motor, element, motor
SILENT = np.array([0.0, 100.0, 29.0, 0.0, 100.0])


def test_a_channel_of_a_card_is_one_devices(card: Any) -> None:
    actual = card(interface="Card", first_channel=1)
    with pytest.raises(OutputLostError, match="channel from 2 on of Card is open already"):
        card(interface="Card", first_channel=2)
    assert Stream.made[-1].calls == ["close"], "never started"
    card(interface="Card", first_channel=3).close()
    actual.close()
    card(interface="Card", first_channel=1).close()


def test_each_motor_has_a_channel_of_its_own_amplitude_and_frequency(card: Any) -> None:
    actual = card(interface="Card", first_channel=2)
    (stream,) = Stream.made
    assert stream.settings["channels"] == 3 and stream.calls == ["start"]
    actual.send(LOUD)
    stream.ask(4800)  # the ramp
    block = stream.ask(RATE_HZ // 2)
    assert not block[:, 0].any(), "channels before the first are silent"
    for channel, (amplitude, hz) in ((1, (0.5, 100.0)), (2, (1.0, 200.0))):
        assert np.abs(block[:, channel]).max() == pytest.approx(amplitude, abs=1e-3)
        spectrum = np.abs(np.fft.rfft(block[:, channel]))
        assert np.argmax(spectrum) * 2 == hz


def test_no_frequency_above_1000_hz_is_played(card: Any) -> None:
    actual = card()
    (stream,) = Stream.made
    actual.send(np.array([5.0, 9000.0, 29.0, 0.0, 100.0]))
    stream.ask(4800)
    assert np.argmax(np.abs(np.fft.rfft(stream.ask(RATE_HZ // 2)[:, 0]))) * 2 == 1000


def test_a_stop_is_silence_within_5_ms_and_without_a_click(card: Any) -> None:
    actual = card()
    (stream,) = Stream.made
    actual.send(LOUD)
    before = stream.ask(4800)
    actual.stop()
    after = stream.ask(480)
    assert not after[241:].any()
    steepest = 2.0 * np.pi * 200.0 / RATE_HZ + 1.0 / 240
    assert np.abs(np.diff(np.vstack([before[-1:], after]), axis=0)).max() < 1.1 * steepest


def test_a_card_falls_silent_by_itself_without_values(
    card: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    actual = card()
    (stream,) = Stream.made
    now = [100.0]
    monkeypatch.setattr(sound_card.time, "monotonic", lambda: now[0])
    actual.send(LOUD)
    now[0] += 0.2
    stream.ask(480)
    assert stream.ask(480).any()
    now[0] += 0.1
    stream.ask(480)
    assert not stream.ask(480).any()
    actual.send(LOUD)
    stream.ask(480)
    assert stream.ask(480).any()


def test_a_lost_card_is_reported_and_a_closed_card_is_not(card: Any) -> None:
    actual = card()
    Stream.made[0].settings["finished_callback"]()
    with pytest.raises(OutputLostError, match="unplugged"):
        actual.send(LOUD)
    second = card()
    second.close()
    assert Stream.made[1].calls == ["start", "stop", "close"]
    second.send(SILENT)


def test_a_failure_to_open_names_the_reason(card: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OutputLostError, match="gone cannot be opened"):
        card(interface="gone")
    with pytest.raises(OutputLostError, match="nothing that vibrates"):
        SoundCard(device(heat()))
    monkeypatch.setitem(sys.modules, "sounddevice", None)  # as if not installed
    with pytest.raises(OutputLostError, match=r"hfx-blender\[audio\]"):
        card()


def test_any_device_that_vibrates_can_be_opened_on_a_card(card: Any) -> None:
    output = opening.open_output(device(vibration()), {"kind": "audio", "interface": "3"})
    assert isinstance(output, SoundCard)
    assert Stream.made[0].settings["device"] == 3
    for wrong in ({"interface": 3}, {"first_channel": 0}, {"first_channel": True}):
        with pytest.raises(OutputLostError):
            opening.open_output(device(vibration()), {"kind": "audio", **wrong})


def test_a_card_plays_the_waveforms_of_its_actuators(card: Any) -> None:
    plain = vibration()
    kinds = [
        replace(plain, name=w, takes_waveform=True, waveform=w) for w in ("square", "sine", "noise")
    ]
    actual = SoundCard(device(*kinds))
    (stream,) = Stream.made
    actual.send(np.tile([5.0, 100.0], 3))  # half of the maximum
    stream.ask(4800)
    block = stream.ask(RATE_HZ)
    assert (np.abs(block) <= 0.5 + 1e-6).all()
    # Power at the same peak: of a square 1, of a sine 1/2, of noise 13/35.
    power = (block.astype(np.float64) ** 2).mean(axis=0) / 0.25
    assert power == pytest.approx([1.0, 0.5, 13 / 35], abs=0.04)
    actual.stop()
    stream.ask(240)
    assert not stream.ask(480).any()


def test_phase_goes_on_through_changes_of_frequency() -> None:
    oscillators = Oscillators(["sine"], RATE_HZ)
    parts = []
    for hz in (80.0, 250.0, 31.0, 400.0):
        oscillators.aim(np.ones(1), np.array([hz]))
        parts.append(oscillators.block(1000))
    wave = np.concatenate(parts)[240:, 0]
    assert np.abs(np.diff(wave)).max() <= 2.0 * np.pi * 400.0 / RATE_HZ * 1.01


@pytest.mark.parametrize("bad", [(np.nan, 100.0), (np.inf, 100.0), (1.0, np.nan), (-1.0, 100.0)])
def test_nan_is_silence(bad: tuple[float, float]) -> None:
    oscillators = Oscillators(["sine"], RATE_HZ)
    oscillators.aim(np.ones(1), np.array([100.0]))
    oscillators.block(480)
    oscillators.aim(np.array(bad[:1]), np.array(bad[1:]))
    oscillators.block(240)
    assert not oscillators.block(480).any()
