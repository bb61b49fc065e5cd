# SPDX-License-Identifier: GPL-3.0-or-later
"""Remarks on a device: unused or overridden settings, with the actuators' names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rendering_synthetic import EVERYWHERE, MODELS, at, make_device, make_header, make_run

from hfx_blender.engine.rendering import render as rendering
from hfx_blender.engine.rendering.device_config import BodyPlace, Scheme, VertexPlace
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import Drive
from hfx_blender.engine.scene import (
    BodyDescription,
    EffectDescription,
    HapticVolume,
    SceneDescription,
    SkinBinding,
)
from hfx_blender.engine.volume.shape import Falloff

HEADER = make_header({"tap": "vibration"}, 40)
NOWHERE = VertexPlace((replace(at(3).sets[0], model_id="of another body"),))


def notes(device, *runs, header=HEADER):
    renderer = Renderer(header, device, lambda name: MODELS[name])
    renderer.add(runs)
    return renderer.notes()


def tap(*samples):
    return make_run(HEADER, "tap", {i: {3: 1.0} for i in samples}, [5.0, 80.0])


def test_actuators_without_vertices_are_reported():
    device = make_device(
        {"a": ("vibration", at(3)), "b": ("vibration", NOWHERE), "c": ("pressure", NOWHERE)}
    )
    (note,) = notes(device, tap(5), tap(6))
    assert "vibration actuators" in note and "dots-vibration" in note and note.endswith("1 (b)")
    assert notes(make_device({"a": ("vibration", at(3))}), tap(5)) == ()


def test_an_overridden_scheme_is_reported():
    of_skin = make_device({"a": ("vibration", at(3)), "b": ("vibration", at(5))})
    assert notes(replace(of_skin, scheme=Scheme("nearest")), tap(5)) == ()
    of_room = make_device(
        {"a": ("vibration", at(3)), "b": ("vibration", EVERYWHERE)}, scheme=Scheme("nearest")
    )
    (note,) = notes(of_room, tap(5))
    assert "'nearest'" in note and "coverage" in note and "stand in the room" in note


def test_missing_actuators_of_an_effect_are_reported():
    device = make_device({"a": ("vibration", at(3)), "p": ("pressure", at(3))})
    names = ("a", "p", "gone", "never")
    effects = (replace(HEADER.effects[0], kind="actuators", device_id="device", actuators=names),)
    header = replace(HEADER, effects=effects)
    values = np.array([[1.0, 1.0, 0.5, 0.0]] * 2, np.float32)
    run = replace(tap(5, 6), drive=Drive("device", names, values))
    (note,) = notes(device, run, header=header)
    assert "effect 'tap'" in note and note.endswith("2 (p, gone)")
    second = replace(run, drive=replace(run.drive, device_id="another"))
    assert notes(device, second, header=header) == ()


def test_values_too_early_for_an_actuator_are_reported():
    device = make_device({"a": ("vibration", at(3)), "late": ("vibration", at(3))})
    slow = replace(device.actuators[1].type, latency_ms=40.0)
    device = replace(
        device, actuators=(device.actuators[0], replace(device.actuators[1], type=slow))
    )
    assert notes(device, tap(4, 5)) == ()
    (note,) = notes(device, tap(3, 4))
    assert "beginning" in note and note.endswith("1 (late)")


def test_a_device_that_does_not_fit_is_named_and_costs_no_other(monkeypatch):
    far = BodyPlace(("torso",), (9.0, 0.0, 0.0), 0.1)
    good = replace(make_device({"a": ("vibration", at(3))}), id="good")
    area = HapticVolume(Falloff())
    scene = SceneDescription(
        HEADER.time,
        (BodyDescription("body", "Body", SkinBinding(("root",))),),
        (EffectDescription("tap", "tap", "vibration", "dots-vibration", area),),
    )
    bad = make_device({"a": ("vibration", far)})
    monkeypatch.setattr(rendering, "load_model", MODELS.__getitem__)
    actual = rendering.misfits(scene, [good, bad])
    assert list(actual) == ["device"]
    assert "plays nothing" in actual["device"] and "9.0, 0.0, 0.0" in actual["device"]
    of_others = make_device({"a": ("pressure", far)})
    assert rendering.misfits(scene, [of_others]) == {}
