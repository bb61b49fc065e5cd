# SPDX-License-Identifier: GPL-3.0-or-later
"""Vector sensations: curves for single actuators, from the blocks to the device and the track."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from skin_plane import plane

from hfx_blender.engine.body.model import PerceptualModel
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.device_config import (
    Actuator,
    ActuatorControl,
    ActuatorType,
    BodyPlace,
    DeviceConfig,
    Scheme,
)
from hfx_blender.engine.rendering.raster import Raster, unrendered
from hfx_blender.engine.rendering.render import render
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    ActuatorArea,
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    SpotArea,
    TimeBase,
)
from hfx_blender.engine.track import TrackHeader, TrackReader, TrackWriter
from hfx_blender.errors import InputError

MODEL = plane()
TIMES = 6
CURVES = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.25], [0.0, 0.0], [2.0, -1.0], [0.0, 0.75]])


def _load(_: str) -> PerceptualModel:
    return MODEL


def _device(name: str = "belt", highest: float = 8.0) -> DeviceConfig:
    controls = (
        ActuatorControl("amplitude_m_s2", 0.0, 20.0, 0.0, highest, 0.0),
        ActuatorControl("frequency_hz", 50.0, 300.0, 50.0, 300.0, 100.0),
    )
    kind = ActuatorType("motor", "vibration", controls, 0.0, 10.0)
    places = [BodyPlace(("torso",), (0.05 * k, 0.0, 0.0), 0.02) for k in range(3)]
    return DeviceConfig(
        id=name,
        name=name,
        description="",
        actuator_types={"motor": kind},
        actuators=tuple(Actuator(f"m{k}", kind, position) for k, position in enumerate(places)),
        scheme=Scheme(),
        substitutions={},
        gain=1.0,
    )


def _scene(effects: Sequence[EffectDescription]) -> SceneDescription:
    body = BodyDescription("anna", "Anna", SkinBinding(("root",)))
    time = TimeBase(Fraction(100), Fraction(100), 0, 0, TIMES - 1)
    return SceneDescription(time, (body,), tuple(effects))


VECTOR = EffectDescription(
    "v", "Vector", "vibration", MODEL.id, ActuatorArea("anna", "belt", ("m2", "m0"))
)
PAINT = EffectDescription(
    "p",
    "Paint",
    "vibration",
    MODEL.id,
    PaintedArea("anna", np.array([len(MODEL) // 2], np.int32), np.ones(1, np.float32)),
)
SPOT = EffectDescription(
    "s", "Spot", "vibration", MODEL.id, SpotArea("anna", np.array([[0.0, 0, 0], [0.05, 0, 0]]))
)


def _animated(effect: EffectDescription, curves: np.ndarray = CURVES) -> EffectBlock:
    fixed = np.full(TIMES, 0.5), np.tile([4.0, 100.0], (TIMES, 1))
    if effect.kind == "spot":
        path = np.stack([np.linspace(0, 1, TIMES), np.full(TIMES, 0.03)], axis=1)
        return EffectBlock(*fixed, place=path)
    return EffectBlock(*fixed, drive=curves) if effect.kind == "actuators" else EffectBlock(*fixed)


def _runs(effects: Sequence[EffectDescription], **options: object) -> list[SampleRun]:
    world = np.tile(np.eye(4), (TIMES, 1, 1))
    pose = PoseBlock(np.ones(TIMES, bool), world, world[:, None, :3])
    engine = Engine(_scene(effects), models=_load, **options)  # type: ignore[arg-type]
    block = AnimationBlock(np.arange(TIMES), tuple(_animated(e) for e in effects), (pose,))
    return engine.evaluate(block)


def _header(effects: Sequence[EffectDescription]) -> TrackHeader:
    return TrackHeader.of(_scene(effects), {MODEL.id: MODEL}, settings={}, tools={})


def _rendered(effects: Sequence[EffectDescription], device: DeviceConfig) -> Raster:
    renderer = Renderer(_header(effects), device, _load)
    renderer.add(_runs(effects))
    return renderer.raster()


def test_actuators_get_the_curves() -> None:
    """Value (clipped to 0..1) times level 0.5 times 4 m/s^2; m1 has no curve."""
    raster = _rendered([VECTOR], _device())
    assert raster.values[:, 0] == pytest.approx([0.0, 0.0, 0.5, 0.0, 0.0, 1.5])
    assert (raster.values[:, 2] == 0.0).all()
    assert raster.values[:, 4] == pytest.approx([0.0, 1.0, 2.0, 0.0, 2.0, 0.0])
    assert raster.values[2, 5] == 100.0 and not raster.shortfalls


def test_other_effects_add_to_them_and_the_limits_come_last() -> None:
    """The painted effect adds 2 m/s^2 of the same frequency at m0, inside the painted area."""
    raster = _rendered([VECTOR, PAINT], _device())
    assert raster.values[:, 0] == pytest.approx([2.0, 2.0, 2.5, 2.0, 2.0, 3.5])
    limited = _rendered([VECTOR, PAINT], _device(highest=3.0))
    assert limited.values[:, 0] == pytest.approx([2.0, 2.0, 2.5, 2.0, 2.0, 3.0])


def test_any_other_device_plays_nothing_and_says_so_once() -> None:
    raster = _rendered([VECTOR], _device("vest"))
    assert (raster.values[:, ::2] == 0.0).all()
    assert [(shortfall.reason, shortfall.samples) for shortfall in raster.shortfalls] == [
        ("device", 4)
    ]
    assert [item.samples for item in unrendered([raster])] == [4]
    assert not unrendered([raster, _rendered([VECTOR], _device())])


@pytest.mark.parametrize("record", [(), ("positions", "depth")])
def test_a_track_keeps_spots_and_curves(tmp_path: Path, record: tuple[str, ...]) -> None:
    effects = [VECTOR, SPOT, PAINT]
    path = tmp_path / "a.hfxtrack"
    with TrackWriter(path, _header(effects)) as writer:
        runs = writer.append(_runs(effects, record=record))
    with TrackReader(path) as track:
        again = list(track.runs())
        assert [effect.kind for effect in track.header.effects] == ["actuators", "spot", "painted"]
        assert track.header.effects[0].actuators == ("m2", "m0")
        part = list(track.runs(0.02, 0.05))
        assert [len(item) for item in part] == [2, 3, 3]
        assert part[1].focus is not None and runs[1].focus is not None
        assert (part[1].focus == runs[1].focus[2:5]).all()
    for first, second in zip(runs, again, strict=True):
        assert (first.indices == second.indices).all() and (first.vertices == second.vertices).all()
        assert first.weights.tobytes() == second.weights.tobytes()
        assert (first.focus is None) == (second.focus is None)
        if first.focus is not None and second.focus is not None:
            assert first.focus.tobytes() == second.focus.tobytes()
        assert (first.drive is None) == (second.drive is None)
        if first.drive is not None and second.drive is not None:
            assert first.drive.values.tobytes() == second.drive.values.tobytes()
            assert first.drive.actuators == second.drive.actuators
    direct = render(_header(effects), runs, _device(), _load)
    later = render(_header(effects), again, _device(), _load)
    assert direct.values.tobytes() == later.values.tobytes()


def test_the_new_version_is_used_only_when_needed(tmp_path: Path) -> None:
    import zipfile

    for effects, version in (([PAINT], 1), ([SPOT], 2), ([VECTOR, PAINT], 2)):
        path = tmp_path / "v.hfxtrack"
        with TrackWriter(path, _header(effects)) as writer:
            writer.append(_runs(effects))
        with zipfile.ZipFile(path) as archive:
            text = archive.read("header.json").decode()
        assert f'"version": {version}' in text
        assert ("device_id" in text) == (VECTOR in effects)


def test_a_track_of_the_first_version_knows_no_spots(tmp_path: Path) -> None:
    import zipfile

    path, old = tmp_path / "new.hfxtrack", tmp_path / "old.hfxtrack"
    with TrackWriter(path, _header([SPOT])) as writer:
        writer.append(_runs([SPOT]))
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(old, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "header.json":
                content = content.replace(b'"version": 2', b'"version": 1')
            target.writestr(name, content)
    with pytest.raises(InputError, match='kind is "spot"'):
        TrackReader(old)


def test_a_run_that_is_not_of_its_kind_is_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    run = _runs([SPOT])[0]
    for bad in (
        replace(run, focus=None),
        replace(run, focus=np.full((len(run), 4), np.nan, np.float32)),
        replace(run, drive=_runs([VECTOR])[0].drive),
    ):
        with pytest.raises(ValueError), TrackWriter(tmp_path / "x", _header([SPOT])) as writer:
            writer.append([bad])
