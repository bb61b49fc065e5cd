# SPDX-License-Identifier: GPL-3.0-or-later
"""The three example scripts of the documentation play as described."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.workers.haptics import Effect, Haptics, as_values
from hfx_blender.engine.rendering.device_config import DeviceConfig

PAGE = Path(__file__).resolve().parents[3] / "docs" / "device-scripts.md"


def examples() -> list[str]:
    matches = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(matches) == 4
    return matches[1:]


def run(source: str, haptics: Haptics) -> np.ndarray:
    names: dict[str, Any] = {}
    exec(source, names)
    return as_values(names["render"](haptics), haptics)


def haptics_of(device: DeviceConfig, *felt: Effect, time_s: float = 0.0) -> Haptics:
    neutral = [c.neutral for a in device.actuators for c in a.type.controls]
    return Haptics(time_s, felt, np.array(neutral), device)


def effect(modality: str, gains: list[float], **parameters: float) -> Effect:
    vertices, weights = np.zeros(1, np.int32), np.ones(1, np.float32)
    return Effect("x", modality, "m", 1.0, parameters, vertices, weights, np.array(gains))


def of_modality(modality: str, ids: tuple[str, ...]) -> DeviceConfig:
    heater = load_device("fan_heater")
    kind = next(a.type for a in heater.actuators if a.type.modality == modality)
    one = next(a for a in heater.actuators if a.type is kind)
    return replace(heater, actuators=tuple(replace(one, id=number) for number in ids))


def test_warmer_skin_pulses_faster() -> None:
    band = load_device("forearm_band_left")
    gains = [1.0] + [0.0] * 7

    def beats(temperature: float) -> int:
        warm = effect("temperature", gains, temperature_c=temperature)
        times = np.arange(0.0, 10.0, 0.01)
        actual = [run(examples()[0], haptics_of(band, warm, time_s=t))[0] for t in times]
        return int(np.count_nonzero((np.array(actual[1:]) > 0) & (np.array(actual[:-1]) == 0)))

    assert beats(29.0) == 10  # 1 Hz
    assert beats(39.0) == 20  # 2 Hz
    silent = haptics_of(band)
    assert run(examples()[0], silent).tolist() == silent.values.tolist()


def test_the_grill_has_warm_and_cool_bars_in_turn() -> None:
    bars = of_modality("temperature", ("a", "b", "c", "d"))
    hot = effect("temperature", [1.0, 1.0, 0.0, 0.5], temperature_c=55.0)
    assert run(examples()[1], haptics_of(bars, hot)).tolist() == [40.0, 20.0, 33.0, 26.5]


def test_wind_plays_on_the_fan_in_its_direction() -> None:
    fans = of_modality("wind", ("left", "right"))
    count = len(fans.actuators[0].type.controls)
    east = effect(
        "wind", [1.0, 1.0], speed_m_s=3.0, direction_x=1.0, direction_y=0.0, direction_z=0.0
    )
    completed = run(examples()[2], haptics_of(fans, east))
    assert completed[0] == pytest.approx(3.0)
    assert completed[count] == 0.0
    assert run(examples()[2], haptics_of(fans)).tolist() == haptics_of(fans).neutral.tolist()
