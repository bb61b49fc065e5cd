# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters with a list of allowed values: rounded last, in exports and live."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendering_synthetic import MODELS, at, make_device, make_header, make_run

from hfx_blender.devices.host.guard import Guard
from hfx_blender.engine.rendering.conditioning.actuator_limits import rounded
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.rendering.renderer import Renderer

AMPLITUDES = (0.0, 4.0, 10.0)
FREQUENCIES = (60.0, 150.0)


def stepped(modality: str, *values: tuple[float, ...], **others: object) -> DeviceConfig:
    """Return a device of one actuator, whose parameters have lists of allowed values."""
    device = make_device({"a": (modality, at(0))}, **others)
    (actuator,) = device.actuators
    controls = tuple(
        replace(control, values=allowed, neutral=allowed[0] if k else control.neutral)
        for k, (control, allowed) in enumerate(zip(actuator.type.controls, values, strict=True))
    )
    kind = replace(actuator.type, controls=controls)
    return replace(
        device, actuator_types={modality: kind}, actuators=(replace(actuator, type=kind),)
    )


@pytest.mark.parametrize(
    ("wanted", "sent"),
    [
        ([0, 60], [0, 60]),
        ([3.99, 149], [0, 60]),
        ([4, 150], [4, 150]),
        ([9.99, 250], [4, 150]),
        ([20, 50], [10, 60]),  # no frequency at or below
        ([np.float32(0.1) * 40, 60], [4, 60]),
        ([10 - 1e-6, 60], [10, 60]),  # an error of single precision
    ],
)
def test_vibration_is_rounded_down(wanted, sent):
    kind = stepped("vibration", AMPLITUDES, FREQUENCIES).actuators[0].type
    assert rounded(np.array(wanted, np.float64), kind).tolist() == sent


@pytest.mark.parametrize(
    ("wanted", "sent"), [(25, 25), (29.9, 25), (30, 30), (40, 38), (24, 25), (20, 20), (12, 20)]
)
def test_temperatures_are_rounded_towards_neutral(wanted, sent):
    kind = stepped("temperature", (20.0, 25.0, 30.0, 38.0)).actuators[0].type
    assert rounded(np.array([[float(wanted)]]), kind).tolist() == [[sent]]


def test_an_export_has_allowed_values_only_and_reports_what_is_too_weak():
    header = make_header({"weak": "vibration", "strong": "vibration"}, 6)
    device = stepped("vibration", AMPLITUDES, FREQUENCIES)
    weak = make_run(header, "weak", {0: {0: 1.0}, 1: {0: 1.0}}, [3.0, 200.0])
    strong = make_run(header, "strong", {3: {0: 1.0}, 4: {0: 0.5}}, [12.0, 100.0])
    raster = render(header, [weak, strong], device, MODELS.__getitem__)
    assert raster.values[:, 0].tolist() == [0, 0, 0, 10, 4, 0]
    assert raster.values[3:5, 1].tolist() == [60, 60]
    assert [(s.effect_id, s.reason, s.samples) for s in raster.shortfalls] == [("weak", "step", 2)]


def test_values_of_a_script_are_rounded_in_an_export():
    header = make_header({"e": "pressure"}, 3)
    renderer = Renderer(header, stepped("pressure", (0.0, 2.0, 5.0)), MODELS.__getitem__)
    assert renderer.raster(np.array([[1.9], [4.9], [9.0]])).values[:, 0].tolist() == [0, 2, 5]


def test_a_slow_rise_goes_on_between_allowed_values():
    device = stepped("pressure", (0.0, 2.0, 5.0))
    kind = replace(device.actuators[0].type, slew_per_s=100.0)  # 1 kPa in 10 ms
    guard = Guard(replace(device, actuators=(replace(device.actuators[0], type=kind),)))
    sent = [guard.limited([5.0], 0.01)[0] for _ in range(6)]
    assert sent == [0, 2, 2, 2, 5, 5]
    assert guard.limited([2.5], 0.01)[0] == 2  # a fall is not slowed
    assert guard.limited([5.0], 0.01)[0] == 2  # 3.5


def test_only_strengths_that_are_sent_count_as_time_on():
    device = stepped("pressure", (0.0, 2.0, 5.0))
    kind = replace(device.actuators[0].type, maximum_on_s=0.05, rest_s=10.0)
    guard = Guard(replace(device, actuators=(replace(device.actuators[0], type=kind),)))
    for _ in range(100):
        assert guard.limited([1.9], 0.01)[0] == 0
    assert guard.limited([2.0], 0.01)[0] == 2
    sent = [guard.limited([2.0], 0.01)[0] for _ in range(10)]
    assert sent[-1] == 0


@given(
    st.lists(st.floats(0, 20), min_size=1, max_size=8, unique=True).map(sorted),
    st.lists(st.floats(-50, 50), min_size=1, max_size=20),
    st.floats(0.1, 2000),
)
@settings(deadline=None, max_examples=100)
def test_the_guard_sends_an_allowed_value_that_is_no_stronger(steps, wanted, slew_per_s):
    allowed = tuple(sorted({0.0, *(round(step, 3) for step in steps)}))
    device = stepped("vibration", allowed, FREQUENCIES)
    kind = replace(device.actuators[0].type, slew_per_s=slew_per_s)
    device = replace(device, actuators=(replace(device.actuators[0], type=kind),))
    smooth_kind = replace(
        kind, controls=tuple(replace(control, values=()) for control in kind.controls)
    )
    smooth_device = replace(device, actuators=(replace(device.actuators[0], type=smooth_kind),))
    guard, smooth = Guard(device), Guard(smooth_device)
    for value in wanted:
        sent = guard.limited([value, 100.0], 0.01)[0]
        limited = smooth.limited([value, 100.0], 0.01)[0]
        assert sent in allowed
        # The largest allowed value at or below, up to an error of single precision.
        assert sent == max(step for step in allowed if step <= limited * (1 + 1.01e-6))
