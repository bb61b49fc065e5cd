# SPDX-License-Identifier: GPL-3.0-or-later
"""The stroke pad without a window: the rendered strength at each moment equals the stroke's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import make_map
from hfx_blender.engine.texture.stroke_rendering import render_stroke
from hfx_blender.operators.surfaces.stroke_pad_view import PadPlace
from hfx_blender.playback import stroke_pad
from hfx_blender.playback.stroke_pad import TARGET_PX_S, TARGETS_M_S, StrokePad, StrokeSound
from hfx_tools.demo import board


@pytest.fixture
def texture() -> SurfaceTexture:
    x = (np.arange(256) + 0.5) / 256
    heights = 50e-6 * np.sin(2.0 * np.pi * 16 * x)[None].repeat(8, axis=0)
    field = HeightField(heights, (0.02 / 256, 0.02 / 256))
    return SurfaceTexture(field, make_map(field), SurfaceRenderer.TEXTILE)


def stroked(pad: StrokePad, speed: float, seconds: float = 0.5) -> list[Any]:
    """Stroke along x with 120 moves a second; return the steps computed in between."""
    pad.press(10.0, (0.0, 0.001))
    steps = []
    for k in range(1, round(seconds * 120) + 1):
        pad.move(10.0 + k / 120, (speed * k / 120, 0.001))
        step = pad.next_step()
        steps += [] if step is None else [step]
    return steps


def test_steps_on_the_way_are_those_of_the_whole_stroke(texture: SurfaceTexture) -> None:
    pad = StrokePad("Grating", texture)
    steps = stroked(pad, 0.05)
    take = pad.release(10.5)
    assert take is not None and take.stroke.length_m == pytest.approx(0.025)
    whole = render_stroke(texture, take.stroke)
    amplitudes = np.concatenate([step.amplitude_m_s2 for step in steps])
    assert len(amplitudes) >= 9 and (amplitudes > 0.0).all()
    assert np.allclose(amplitudes, whole.amplitude_m_s2[: len(amplitudes)], rtol=1e-6)


def test_the_pad_shows_the_speed_and_the_height_under_the_finger(texture: SurfaceTexture) -> None:
    pad = StrokePad("Grating", texture)
    stroked(pad, 0.05)
    assert pad.now.speed_m_s == pytest.approx(0.05, rel=1e-6)
    expected = float(texture.height.sample(np.array([[0.025, 0.001]]))[0])
    assert pad.now.height_m == pytest.approx(expected)
    assert pad.now.amplitude_m_s2 > 0.0 and pad.history[-1][1] is pad.now


@pytest.mark.parametrize("renderer", list(SurfaceRenderer))
def test_it_is_felt_at_each_moment_however_long_the_clock_has_run(
    texture: SurfaceTexture, renderer: SurfaceRenderer
) -> None:
    pad = StrokePad("Grating", replace(texture, renderer=renderer))
    start = 8.64e6 + 1.0 / 3.0  # 100 days
    pad.press(start, (0.0, 0.001))
    for k in range(1, 61):
        pad.move(start + k / 120, (0.05 * k / 120, 0.001))
    later = [samples for time_s, samples in pad.history if time_s > 0.1]
    assert len(later) > 40 and min(samples.amplitude_m_s2 for samples in later) > 0.0
    assert min(samples.frequency_hz for samples in later) > 0.0


def test_places_that_are_told_at_once_are_spread_over_the_time_since_the_last_one(
    texture: SurfaceTexture,
) -> None:
    one, bunch = (StrokePad("Grating", texture) for _ in range(2))
    way = [(0.05 * k / 100, 0.001) for k in range(1, 101)]
    for pad in (one, bunch):
        pad.press(7.0, (0.0, 0.001))
    for k, point in enumerate(way):
        one.move(7.0 + (k + 1) / 100, point)
    bunch.move_through(way[:80], 7.8)  # the window drew for so long
    bunch.move_through(way[80:], 8.0)
    assert len(bunch.history) == len(one.history) == 100
    for (at, samples), (expected_at, expected) in zip(bunch.history, one.history, strict=True):
        assert at == pytest.approx(expected_at)
        assert samples.height_m == pytest.approx(expected.height_m)
        assert samples.speed_m_s == pytest.approx(expected.speed_m_s, rel=1e-6)
    assert bunch.recent(0.25) == bunch.history[-26:] or bunch.recent(0.25) == bunch.history[-25:]
    assert bunch.trail_m[0] == (0.0, 0.001) and bunch.trail_m[-1] == pytest.approx(way[-1])


def test_a_finger_that_rests_feels_nothing(texture: SurfaceTexture) -> None:
    pad = StrokePad("Grating", texture)
    stroked(pad, 0.05)
    for k in range(1, 40):
        pad.rest(10.5 + k / 100)
    assert pad.now.speed_m_s == 0.0 and pad.now.amplitude_m_s2 == 0.0


def test_a_click_is_no_stroke_and_is_told(texture: SurfaceTexture) -> None:
    pad = StrokePad("Grating", texture)
    pad.press(1.0, (0.0, 0.0))
    assert pad.release(1.0) is None and pad.fault and not pad.is_stroking
    pad.move(2.0, (1.0, 1.0))
    assert not pad.is_stroking and not len(pad.path_m)


def test_at_the_target_speed_the_pointer_goes_200_pixels_a_second(texture: SurfaceTexture) -> None:
    pad_place = PadPlace(1200, 800)
    for target in TARGETS_M_S:
        pad = StrokePad("Grating", texture)
        pad.target_m_s = target
        one = np.array(pad_place.surface_point(pad, 100, 300))
        two = np.array(pad_place.surface_point(pad, 100 + TARGET_PX_S, 300))
        assert (two - one)[0] == pytest.approx(target)
        assert pad_place.pixels(pad, [tuple(one)])[0] == pytest.approx([100, 300])
    assert pad_place.holds(pad_place.left, pad_place.bottom) and not pad_place.holds(
        pad_place.left - 1, pad_place.bottom
    )


def test_stronger_fabrics_are_stronger_and_c_v_scales_them() -> None:
    actual = {
        name: stroke_pad.reference_signal(name, speed, 2000.0).amplitude_m_s2.mean()
        for speed in TARGETS_M_S
        for name in ("shirting", "denim", "costume")
    }
    assert actual["shirting"] < actual["denim"] < actual["costume"]
    twice = stroke_pad.reference_signal("denim", TARGETS_M_S[1], 4000.0).amplitude_m_s2.mean()
    assert twice == pytest.approx(2.0 * actual["denim"], rel=1e-6)


def test_the_calibration_slider_is_kept(
    scene: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    from hfx_blender.devices.configurations import surface_calibration

    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    chosen = bpy.context.window_manager.hfx_surface_calibration
    chosen.drive = 42.0
    chosen.device = "phone"
    assert chosen.drive == pytest.approx(42.0)  # the general drive
    chosen.drive = 7.0
    chosen.device = ""
    assert chosen.drive == pytest.approx(42.0)
    assert surface_calibration.drive_per_m("phone") == pytest.approx(7000.0)
    assert bpy.ops.hfx.feel_fabric() == {"FINISHED"}
    stroke = stroke_pad.reference_stroke
    assert stroke.signal is not None and stroke.step == 0
    stroke.stop()
    assert stroke.signal is None


def test_no_sound_is_no_fault() -> None:
    sound = StrokeSound(10.0)
    sound.play(np.zeros(100), 8000.0)
    sound.set_friction(0.5)
    sound.close()
    sound.play(np.zeros(100), 8000.0)


def test_the_board_has_four_materials_once_in_each_row_and_column(scene: Any) -> None:
    assert all(sorted(row) == [0, 1, 2, 3] for row in board.ORDER)
    assert all(sorted(column) == [0, 1, 2, 3] for column in zip(*board.ORDER, strict=True))
    squares = board.build(bpy.context)
    assert len(squares) == 16 and all(square.hfx.kind == "SURFACE" for square in squares)
    assert len({square.hfx.uid for square in squares}) == 16
    assert len({square.hfx.surface.relief_image.name for square in squares}) == 4
    metal = next(square for square in squares if square.name.startswith("Metal"))
    assert metal.hfx.surface.sound is not None and metal.hfx.surface.sound.packed_file
    assert bpy.data.objects["Cover"].hide_get()


def test_connected_devices_play_along_within_their_neutral_rest(
    registered: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.playback.live.live import Connected, Live

    sent: dict[str, Any] = {}

    class Client:
        devices = {"a": type("State", (), {"is_armed": True, "number": 1})}

        def send(self, name: str, values: Any) -> None:
            sent[name] = list(values)

    live = Live()
    live.send_vibration(5.0, 200.0)  # nothing is connected: nothing happens
    device = load_device("back_pad")
    monkeypatch.setattr(live, "client", Client())
    live.connected["a"] = Connected(device, False, 0.0)
    live.send_vibration(5.0, 200.0)
    values = np.array(sent["a"]).reshape(len(device.actuators), -1)
    assert all(a.type.modality == "vibration" for a in device.actuators)
    assert np.array_equal(values, np.tile([5.0, 200.0], (len(device.actuators), 1)))
    item = bpy.context.scene.hfx.devices.add()
    item.name, item.gain = "a", 0.5
    live.send_vibration(5.0, 200.0)
    assert sent["a"][:2] == [2.5, 200.0]
    item.is_muted = True
    live.send_vibration(5.0, 200.0)
    assert sent["a"][:2] == [0.0, 200.0]
    live.connected["a"] = Connected(device, True, 0.0)
    sent.clear()
    live.send_vibration(5.0, 200.0)
    assert not sent  # a script decides by itself
