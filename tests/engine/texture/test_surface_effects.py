# SPDX-License-Identifier: GPL-3.0-or-later
"""Haptic surfaces in the engine: moving fingers feel an object's material."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from gratings import grating

from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.response_filters.controls import ContactLaw
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticSurface,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.texture.contact_path import ContactFollower, SurfaceMesh
from hfx_blender.engine.texture.contact_rendering import ContactRenderer
from hfx_blender.engine.texture.haptic_map import STANDARD_GRAVITY, SurfaceRenderer, SurfaceTexture
from hfx_blender.engine.texture.height_field import HeightField
from hfx_blender.engine.texture.mcha import make_map
from hfx_blender.engine.texture.textile import weighted_rms
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.engine.track import TrackHeader

RATE = 100
FINGERS = PARTS.index("fingers")
FULL = 1.3 * STANDARD_GRAVITY


@pytest.fixture(scope="module")
def hand() -> PerceptualModel:
    return load_model("hfx-vibration-1")


def _scene(texture: SurfaceTexture, times: int, model: PerceptualModel) -> SceneDescription:
    vertices, triangles = SHEET
    area = HapticSurface(triangles, vertices[triangles][..., :2], texture, reach_m=0.003)
    return SceneDescription(
        TimeBase(Fraction(RATE), Fraction(RATE), 0, 0, times - 1),
        (BodyDescription("body", "Body", SkinBinding(model.bone_names)),),
        (EffectDescription("table", "Table", "vibration", model.id, area),),
    )


SHEET = (
    np.array([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0]]),
    np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)


def _block(
    model: PerceptualModel,
    offsets: np.ndarray,
    indices: np.ndarray,
    history: int = 0,
    levels: np.ndarray | None = None,
) -> AnimationBlock:
    """Return a block with a still body; the sheet, below a fingertip, moves by the offsets."""
    times = len(offsets)
    fingers = np.flatnonzero(model.part == FINGERS)
    lowest = model.vertices[fingers][np.argmin(model.vertices[fingers, 2])]
    matrices = np.tile(np.eye(4), (times, 1, 1))
    matrices[:, :3, 3] = lowest + offsets
    body = PoseBlock(
        np.ones(times, bool),
        np.tile(np.eye(4), (times, 1, 1)),
        np.tile(np.eye(3, 4), (times, len(model.bone_names), 1, 1)),
    )
    surface = EffectBlock(
        np.ones(times) if levels is None else levels,
        np.tile([FULL, 160.0], (times, 1)),
        matrices,
        vertices=SHEET[0][None],
    )
    return AnimationBlock(indices, (surface,), (body,), history)


def _texture(renderer: SurfaceRenderer) -> SurfaceTexture:
    field = grating(1e-3)
    return SurfaceTexture(field, make_map(field), renderer)


def _run(model: PerceptualModel, renderer: SurfaceRenderer, offsets: np.ndarray) -> list[SampleRun]:
    engine = Engine(
        _scene(_texture(renderer), len(offsets), model), models=lambda _: model, tolerance=PAPER
    )
    return engine.evaluate(_block(model, offsets, np.arange(len(offsets))))


def _slide(times: int, speed: float = 0.1) -> np.ndarray:
    offsets = np.zeros((times, 3))
    offsets[:, 0] = -speed / RATE * np.arange(times)
    return offsets


@pytest.mark.parametrize("renderer", list(SurfaceRenderer))
def test_a_sliding_finger_feels_the_surface(
    hand: PerceptualModel, renderer: SurfaceRenderer
) -> None:
    (run,) = _run(hand, renderer, _slide(30))
    assert run.stream.modality == "vibration"
    np.testing.assert_array_equal(run.indices, np.arange(1, 30))
    assert (hand.part[run.vertices] == FINGERS).all()
    assert (run.weights > 0.0).all() and (run.weights <= 1.0).all()
    for k, sample in enumerate(run):
        assert sample.weights.max() == pytest.approx(1.0)
        assert (np.diff(sample.vertices) > 0).all()
        if k >= 5:  # the window is full
            if renderer is SurfaceRenderer.TEXTILE:  # 100 Hz, 20 um, five whole periods a window
                drive = 1e4 * 20e-6 / np.sqrt(2.0)
                assert sample.parameters[0] == pytest.approx(drive * FULL, rel=0.01)
                assert sample.parameters[1] == 160.0
            elif renderer is SurfaceRenderer.DIRECT:
                assert sample.parameters[0] == pytest.approx(1e4 * 20e-6 * FULL, rel=0.02)
                assert sample.parameters[1] == pytest.approx(100.0, rel=0.02)
            else:
                assert sample.parameters[1] == pytest.approx(170.0)
                slope = 20e-6 * 2.0 * np.pi / 1e-3
                assert 0.5 * slope * FULL < sample.parameters[0] <= slope * FULL


@pytest.mark.parametrize("renderer", list(SurfaceRenderer))
def test_a_resting_finger_feels_nothing(hand: PerceptualModel, renderer: SurfaceRenderer) -> None:
    assert _run(hand, renderer, np.zeros((20, 3))) == []


def test_a_finger_that_stops_is_silent_at_once(hand: PerceptualModel) -> None:
    offsets = np.concatenate([_slide(10), np.repeat(_slide(10)[-1:], 10, axis=0)])
    for renderer in SurfaceRenderer:
        (run,) = _run(hand, renderer, offsets)
        np.testing.assert_array_equal(run.indices, np.arange(1, 10))


@pytest.mark.parametrize("renderer", list(SurfaceRenderer))
@pytest.mark.parametrize("split", [1, 7])
def test_splitting_time_changes_nothing(
    hand: PerceptualModel, renderer: SurfaceRenderer, split: int
) -> None:
    offsets = _slide(24)
    offsets[:, 1] = 2e-3 * np.sin(np.arange(24))
    (whole,) = _run(hand, renderer, offsets)
    engine = Engine(_scene(_texture(renderer), 24, hand), models=lambda _: hand, tolerance=PAPER)
    parts = []
    for first in range(0, 24, split):
        history = int(first > 0)
        indices = np.arange(first - history, min(first + split, 24))
        parts += engine.evaluate(_block(hand, offsets[indices], indices, history))
    np.testing.assert_array_equal(np.concatenate([p.indices for p in parts]), whole.indices)
    np.testing.assert_array_equal(np.concatenate([p.vertices for p in parts]), whole.vertices)
    np.testing.assert_allclose(
        np.concatenate([p.parameters for p in parts]), whole.parameters, rtol=1e-9
    )
    np.testing.assert_allclose(np.concatenate([p.weights for p in parts]), whole.weights, rtol=1e-5)


def test_the_window_of_the_engine_is_that_of_the_textile_renderer(hand: PerceptualModel) -> None:
    rng = np.random.default_rng(0)
    field = HeightField(rng.normal(size=(16, 16)) * 1e-5, (1e-3, 1e-3))
    texture = SurfaceTexture(field, None, SurfaceRenderer.TEXTILE)
    engine = Engine(
        _scene(texture, 12, hand), models=lambda _: hand, record=("positions",), tolerance=PAPER
    )
    (run,) = engine.evaluate(_block(hand, _slide(12), np.arange(12)))
    sample = list(run)[-1]
    strongest = int(np.argmax(sample.weights))
    assert sample.positions is not None
    block = _block(hand, _slide(12), np.arange(12))
    assert block.effects[0].matrices is not None
    end = sample.positions[strongest] - block.effects[0].matrices[-1, :3, 3]
    times = (np.arange(100) + 0.5) / 2000.0 - 0.05
    points = end[:2] + times[:, None] * np.array([0.1, 0.0])
    expected = 1e4 * float(weighted_rms(field.sample(points), 2000.0)) * FULL
    assert sample.parameters[0] == pytest.approx(expected, rel=1e-3)


def paths_over_sheet(x_m):
    """Return paths of a single contact at these positions of the sheet, one per sample."""
    vertices, triangles = SHEET
    points = np.zeros((len(x_m), 3))
    points[:, 0] = x_m
    return ContactFollower(SurfaceMesh(triangles, vertices[triangles][..., :2]), 0.003).follow(
        np.tile(np.eye(4), (len(points), 1, 1)),
        vertices[None],
        np.arange(len(points)),
        np.zeros(len(points), np.int64),
        points,
        np.arange(len(points)) > 0,
    )


def test_heights_are_constant_before_the_first_sample() -> None:
    field = grating(1e-3, texels=16)  # no step passes a texel
    texture = SurfaceTexture(field, None, SurfaceRenderer.TEXTILE)
    paths = paths_over_sheet([0.2e-3, 1.2e-3])  # 10 cm/s for 1/100 s
    drive, _ = ContactRenderer(texture, 0.01).render(paths)
    x = np.concatenate([np.full(80, 0.2e-3), 0.2e-3 + 1e-3 * (np.arange(20) + 0.5) / 20])
    heights = field.sample(np.stack([x, 0.0 * x], axis=1))
    np.testing.assert_allclose(drive, [0.0, 1e4 * weighted_rms(heights, 2000.0)], rtol=1e-9)


def test_a_fine_wave_is_played_whole_at_any_strength() -> None:
    """0.5 mm in texels of 0.25 mm and 0.1 mm at 6 cm/s: 120 Hz, 30 um times the drive."""
    for texel, drive_per_m, expected in ((2.5e-4, 1.6e4, 0.48), (1e-4, 1e6, 1.0)):
        wave = 30e-6 * np.sin(2.0 * np.pi * (np.arange(round(0.1 / texel)) + 0.5) * texel / 5e-4)
        field = HeightField(np.tile(wave, (8, 1)), (texel, texel), True)
        texture = SurfaceTexture(field, None, SurfaceRenderer.DIRECT, drive_per_m)
        paths = paths_over_sheet(-0.03 + 6e-4 * np.arange(20))
        drive, frequency = ContactRenderer(texture, 0.01).render(paths)
        assert drive[10:].max() == pytest.approx(expected, rel=0.04)
        assert frequency[-1] == pytest.approx(120.0, rel=0.02)


def test_inactive_or_nan_surfaces_have_no_contacts(hand: PerceptualModel) -> None:
    scene = _scene(_texture(SurfaceRenderer.MCHA), 10, hand)
    engine = Engine(scene, models=lambda _: hand, tolerance=PAPER)
    off = _block(hand, _slide(10), np.arange(10), levels=np.zeros(10))
    assert engine.evaluate(off) == []
    broken = _block(hand, _slide(10), np.arange(10))
    assert broken.effects[0].matrices is not None
    broken.effects[0].matrices[4] = np.nan
    (run,) = Engine(scene, models=lambda _: hand, tolerance=PAPER).evaluate(broken)
    np.testing.assert_array_equal(run.indices, [1, 2, 3, 6, 7, 8, 9])
    far = _slide(10)
    far[:, 2] = -5.0
    assert (
        Engine(scene, models=lambda _: hand, tolerance=PAPER).evaluate(
            _block(hand, far, np.arange(10))
        )
        == []
    )


def test_a_surface_is_at_home_in_the_scene(hand: PerceptualModel) -> None:
    scene = _scene(_texture(SurfaceRenderer.MCHA), 10, hand)
    header = TrackHeader.of(scene, {hand.id: hand}, settings={}, tools={})
    assert header.effects[0].kind == "volume"


def test_ignored_contacts_and_positions_are_reported_by_name(hand: PerceptualModel) -> None:
    scene = _scene(_texture(SurfaceRenderer.MCHA), 6, hand)
    (table,) = scene.effects
    assert isinstance(table.area, HapticSurface)
    few = replace(scene, effects=(replace(table, area=replace(table.area, max_contacts=1)),))
    block = _block(hand, _slide(6), np.arange(6))
    surface = block.effects[0]
    assert surface.matrices is not None
    surface.matrices[4, 0, 3] = np.nan
    for description, crowded in ((scene, []), (few, [5])):
        engine = Engine(description, models=lambda _: hand, tolerance=PAPER)
        engine.evaluate(block)
        warnings = engine.counters.warnings
        assert [
            n for text, n in warnings.items() if "more than 1 vertices at once" in text
        ] == crowded
        assert [n for text, n in warnings.items() if "not a finite number" in text] == [1]
        assert all("surface 'Table'" in text for text in warnings)


LAW = ContactLaw(800.0, 4.0, 0.5)
DEPTH_M = 1e-3  # of the sheet above the lowest vertex, at the first sample


def _pushed(
    model: PerceptualModel,
    offsets: np.ndarray,
    cuts: tuple[int, ...] = (),
    mirrored: bool = False,
    levels: np.ndarray | None = None,
) -> list[SampleRun]:
    """Runs of a sheet with a contact law, in blocks that end at ``cuts``."""
    scene = _scene(_texture(SurfaceRenderer.MCHA), len(offsets), model)
    (table,) = scene.effects
    assert isinstance(table.area, HapticSurface)
    lawful = replace(scene, effects=(replace(table, area=replace(table.area, law=LAW)),))
    engine = Engine(lawful, models=lambda _: model, tolerance=PAPER)
    runs = []
    for first, stop in pairwise((0, *cuts, len(offsets))):
        indices = np.arange(max(first - 1, 0), stop)
        chosen = None if levels is None else levels[indices]
        block = _block(model, offsets[indices], indices, int(first > 0), chosen)
        if mirrored:
            assert block.effects[0].matrices is not None
            block.effects[0].matrices[:, 0, 0] = -1.0
        runs += engine.evaluate(block)
    return runs


def _expected(model: PerceptualModel, vertices: np.ndarray, top_m: float, velocity: np.ndarray):
    """Spring, damper and friction of a level sheet at height ``top_m`` above the lowest fingertip
    vertex, written out for each vertex; ``velocity`` of the skin relative to the sheet."""
    fingers = np.flatnonzero(model.part == FINGERS)
    lowest = model.vertices[fingers, 2].min().astype(float)
    forces = []
    for height in model.vertices[vertices, 2].astype(float):
        depth = lowest + top_m - height
        normal = max(0.0, 800.0 * depth - 4.0 * velocity[2]) if depth > 0.0 else 0.0
        speed = np.hypot(velocity[0], velocity[1])
        share = 0.5 * normal / max(speed, 1e-3)
        forces.append([-share * velocity[0], -share * velocity[1], normal])
    return np.array(forces)


def test_a_sheet_pushes_by_depth_speed_and_friction(hand: PerceptualModel) -> None:
    steps = np.array([-1e-3, 0.5e-3, 1e-4])  # of the sheet, for each sample: 100 Hz
    offsets = [0.0, 0.0, DEPTH_M] + np.arange(6)[:, None] * steps
    (run,) = _pushed(hand, offsets)
    np.testing.assert_array_equal(run.indices, np.arange(6))  # also before it slides
    for k, sample in enumerate(run):
        velocity = -100.0 * steps if k else np.zeros(3)
        expected = _expected(hand, sample.vertices, offsets[k, 2], velocity)
        assert sample.forces_n is not None
        np.testing.assert_allclose(sample.forces_n, expected, atol=2e-5)
        assert expected[:, 2].max() > 0.5  # 800 N/m times 1 mm, and 4 N s/m times 1 cm/s


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_resting_finger_is_pushed_and_feels_no_vibration(
    hand: PerceptualModel, mirrored: bool
) -> None:
    offsets = np.tile([0.0, 0.0, DEPTH_M], (4, 1))
    (run,) = _pushed(hand, offsets, mirrored=mirrored, levels=np.array([1.0, 1.0, 0.25, 1.0]))
    assert run.parameters[:, 0].tolist() == [0.0] * 4
    for sample, level in zip(run, (1.0, 1.0, 0.25, 1.0), strict=True):
        expected = level * _expected(hand, sample.vertices, DEPTH_M, np.zeros(3))
        assert sample.forces_n is not None
        np.testing.assert_allclose(sample.forces_n, expected, atol=2e-5)


def test_all_touched_vertices_are_pushed_beyond_the_contacts_of_a_texture(
    hand: PerceptualModel,
) -> None:
    """A resting sheet 1 m wide under both feet, 2.9 mm above the lowest vertex: each vertex up to
    2.9 mm deep has 800 N/m times its depth, more than the 3 contacts of a texture."""
    heights = hand.vertices[:, 2].astype(float)
    top = heights.min() + 2.9e-3
    behind = np.flatnonzero(heights < top)
    scene = _scene(_texture(SurfaceRenderer.MCHA), 2, hand)
    (table,) = scene.effects
    assert isinstance(table.area, HapticSurface)
    area = replace(table.area, law=LAW, max_contacts=3)
    engine = Engine(
        replace(scene, effects=(replace(table, area=area),)), models=lambda _: hand, tolerance=PAPER
    )
    block = _block(hand, np.zeros((2, 3)), np.arange(2))
    matrices = block.effects[0].matrices
    assert matrices is not None
    matrices[:, :3, :3] *= 10.0
    matrices[:, :3, 3] = [0.0, 0.0, top]
    (run,) = engine.evaluate(block)
    sample = run.one(1)
    assert len(behind) > 3 and sample.forces_n is not None
    np.testing.assert_array_equal(sample.vertices, behind)
    np.testing.assert_allclose(sample.forces_n[:, 2], 800.0 * (top - heights[behind]), atol=2e-5)


def test_skin_in_front_of_a_surface_is_not_pushed(hand: PerceptualModel) -> None:
    offsets = _slide(4) - [0.0, 0.0, 1e-3]
    (run,) = _pushed(hand, offsets)
    assert run.forces_n is not None and not run.forces_n.any()
    assert _pushed(hand, np.tile([0.0, 0.0, -1e-3], (4, 1))) == []


def test_forces_of_a_surface_do_not_depend_on_the_cut_into_blocks(hand: PerceptualModel) -> None:
    offsets = _slide(8) + [0.0, 0.0, DEPTH_M] + np.arange(8)[:, None] * [0.0, 0.0, 1e-4]
    (whole,) = _pushed(hand, offsets)
    parts = _pushed(hand, offsets, cuts=(3, 4))
    assert len(parts) == 3
    joined = np.concatenate([run.forces_n for run in parts])
    np.testing.assert_array_equal(np.concatenate([run.vertices for run in parts]), whole.vertices)
    np.testing.assert_allclose(joined, whole.forces_n, atol=1e-6)


def test_a_blade_does_not_push_skin_beside_its_edge(hand: PerceptualModel) -> None:
    """A wedge of 20 degrees with its edge below a fingertip: the normals of both sides are 160
    degrees apart, so the plane of one side has the fingertip behind it."""
    half = np.tan(np.radians(10.0)) * 0.05
    points = np.array([[x, y, z] for x in (-0.05, 0.05) for y, z in ((0, 0), (half, -0.05))])
    points = np.concatenate([points, points[[1, 3]] * [1.0, -1.0, 1.0]])
    faces = np.array([[0, 2, 3], [0, 3, 1], [0, 5, 2], [0, 4, 5]], np.int32)
    scene = _scene(_texture(SurfaceRenderer.MCHA), 4, hand)
    (table,) = scene.effects
    area = HapticSurface(
        faces, points[faces][..., :2], _texture(SurfaceRenderer.MCHA), 0.003, law=LAW
    )
    engine = Engine(
        replace(scene, effects=(replace(table, area=area),)), models=lambda _: hand, tolerance=PAPER
    )
    for below_m, pushes in ((1e-3, False), (-1e-3, True)):
        block = _block(hand, _slide(4) - [0.0, 0.0, below_m], np.arange(4))
        surface = replace(block.effects[0], vertices=points[None])
        runs = engine.evaluate(replace(block, effects=(surface,)))
        forces = [run.forces_n for run in runs if run.forces_n is not None]
        assert any(part.any() for part in forces) is pushes
