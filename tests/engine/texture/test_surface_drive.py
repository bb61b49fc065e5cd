# SPDX-License-Identifier: GPL-3.0-or-later
"""A calibrated device plays surfaces with the device's c_v; other devices use the common c_v."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from gratings import grating

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations import surface_calibration
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.rendering.moment import MomentRenderer, moment_header
from hfx_blender.engine.rendering.renderer import Renderer as DeviceRenderer
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import (
    BodyDescription,
    EffectDescription,
    HapticSurface,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.surface.surface_drive import SETTING, SurfaceDrive, SurfaceDrives
from hfx_blender.engine.texture.haptic_map import SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.mcha import make_map
from hfx_blender.engine.track import TrackHeader
from hfx_blender.engine.track.layout import from_json, to_json
from hfx_blender.errors import InputError

DEVICE = "phone_wide_band"
FULL = 1.3 * 9.80665


@pytest.fixture(scope="module")
def model() -> PerceptualModel:
    return load_model("hfx-vibration-1")


def _texture(
    renderer: SurfaceRenderer = SurfaceRenderer.TEXTILE, is_calibrated: bool = True
) -> SurfaceTexture:
    field = grating(1e-3)
    return SurfaceTexture(
        field, make_map(field), renderer, drive_per_m=10_000.0, is_calibrated=is_calibrated
    )


def _scene(model: PerceptualModel, texture: SurfaceTexture) -> SceneDescription:
    area = HapticSurface(np.array([[0, 1, 2]], np.int32), np.zeros((1, 3, 2)), texture)
    return SceneDescription(
        TimeBase(Fraction(1), Fraction(1), 0, 0, 0),
        (BodyDescription("body", "Body", SkinBinding(model.bone_names)),),
        (EffectDescription("table", "Table", "vibration", model.id, area),),
    )


def _run(model: PerceptualModel, amplitude: float) -> SampleRun:
    everywhere = np.arange(len(model), dtype=np.int32)
    return SampleRun(
        Stream("table", "body", "vibration", model.id),
        np.array([0]),
        np.array([0.0]),
        np.array([1.0]),
        np.array([[amplitude, 160.0]]),
        np.array([0, len(everywhere)]),
        everywhere,
        np.ones(len(everywhere), np.float32),
    )


@pytest.fixture
def calibrated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """c_v is 10 per mm on any device, and 5 on the device of these tests."""
    monkeypatch.setattr(
        "hfx_blender.files.resources.surface_calibration", lambda: tmp_path / "c_v.json"
    )
    surface_calibration.store(10_000.0)
    surface_calibration.store(5_000.0, DEVICE)


def _strongest(header: TrackHeader, run: SampleRun) -> tuple[float, float]:
    """Return the strength of the device's first actuator in an export, and live."""
    device = load_device(DEVICE)
    exported = DeviceRenderer(header, device)
    exported.add([run])
    live = MomentRenderer(header, device).values([run])
    values = exported.raster().values
    return float(values[0, 0]), float(live[0])  # strength of the first actuator


@pytest.mark.usefixtures("calibrated")
def test_a_calibrated_device_plays_with_its_own_c_v_live_and_exported(
    model: PerceptualModel,
) -> None:
    run = _run(model, 2.0)
    for texture, expected in (
        (_texture(SurfaceRenderer.TEXTILE), 0.5),
        (_texture(SurfaceRenderer.DIRECT), 0.5),
        (_texture(SurfaceRenderer.MCHA), 1.0),  # has no c_v
        (_texture(SurfaceRenderer.TEXTILE, is_calibrated=False), 1.0),  # stated for the object
    ):
        scene = _scene(model, texture)
        plain = replace(moment_header(scene), settings={})
        before = _strongest(plain, run)
        after = _strongest(moment_header(scene), run)
        assert before[0] > 0.0 and before[0] == pytest.approx(before[1])
        assert after[0] == pytest.approx(expected * before[0])
        assert after[1] == pytest.approx(expected * before[1])


def test_only_the_device_that_was_calibrated_is_another(
    calibrated: None, model: PerceptualModel
) -> None:
    assert load_device(DEVICE).surface_drive_per_m == 5_000.0
    assert load_device("phone_lra").surface_drive_per_m is None
    assert surface_calibration.drive_per_m("phone_lra") == 10_000.0


def test_nothing_is_stronger_than_the_surfaces_strongest(model: PerceptualModel) -> None:
    drive = SurfaceDrive.of(_texture())
    assert drive is not None
    np.testing.assert_allclose(
        drive.amplitude([0.0, 1.0, 10.0, 20.0], 30_000.0), [0.0, 3.0, FULL, 20.0]
    )
    np.testing.assert_array_equal(drive.amplitude([1.0, 10.0], None), [1.0, 10.0])


def test_a_track_file_keeps_the_sampling_of_surfaces(model: PerceptualModel) -> None:
    header = moment_header(_scene(model, _texture()))
    again, _ = from_json(to_json(header, {"name": "none"}))
    run = _run(model, 2.0)
    for track_header in (header, again):
        assert SurfaceDrives(track_header.settings, 20_000.0).on_device(run).parameters[0, 0] == 4.0
    assert run.parameters[0, 0] == 2.0
    assert SETTING not in moment_header(_scene(model, _texture(SurfaceRenderer.MCHA))).settings


@pytest.mark.parametrize("wrong", [3, [], {"table": 1.0}, {"table": [1.0, -1.0]}, {"a": [1, "2"]}])
def test_a_track_that_states_nonsense_is_refused(wrong: object) -> None:
    with pytest.raises(InputError, match=SETTING):
        SurfaceDrives({SETTING: wrong}, None)
