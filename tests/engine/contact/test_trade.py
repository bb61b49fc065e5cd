# SPDX-License-Identifier: GPL-3.0-or-later
"""The stated tolerance holds: edges in mm, onsets in ms, strengths in shares of full scale.

A setting may misplace the edge of a contact by a distance: the result must lie between exact
results for a smaller and a larger volume, up to the setting's share of strength.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import EXACT, PREVIEW, STANDARD, Tolerance, parse
from hfx_blender.engine.track import TrackHeader
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Sphere
from hfx_blender.engine.volume.shape import Falloff, Shape

Placed = tuple[Shape, np.ndarray]

RATE_HZ = 100
MODEL = load_model("hfx-pressure-1")
SETTINGS = {"preview": PREVIEW, "standard": STANDARD, "3 mm": parse("3mm,10ms,5%")}
DEVICES = ("pressure_vest", "insoles")
SPACING_M = np.sqrt(2.0 / np.sqrt(3.0) * MODEL.areas_m2.astype(float))


EFFECTS = 6


def scene() -> SceneDescription:
    effects = tuple(
        EffectDescription(f"v{k}", f"v{k}", "pressure", MODEL.id, HapticVolume(Falloff()))
        for k in range(EFFECTS)
    )
    body = BodyDescription("anna", "Anna", SkinBinding(MODEL.bone_names))
    return SceneDescription(
        TimeBase(Fraction(RATE_HZ), Fraction(RATE_HZ), 0, 0, 199), (body,), effects
    )


@lru_cache(maxsize=8)
def engine_of(tolerance: Tolerance) -> Engine:
    """Return the shared engine of a setting; prepared skin is equal for all examples."""
    return Engine(scene(), models=lambda _: MODEL, tolerance=tolerance)


def runs_of(tolerance: Tolerance, volumes: list[list[Placed]], first: int = 0) -> list[SampleRun]:
    """Return samples for volumes with matrices over time, on a standing body."""
    times = len(volumes[0])
    bones = np.tile(np.eye(4)[:3], (times, len(MODEL.bone_names), 1, 1))
    pose = PoseBlock(np.ones(times, bool), np.tile(np.eye(4), (times, 1, 1)), bones)
    blocks = [
        EffectBlock(
            np.ones(times),
            np.full((times, 1), 20.0),
            np.stack([matrix for _, matrix in places]),
            (places[0][0],),
        )
        for places in volumes
    ]
    silent = EffectBlock(
        np.zeros(times), np.zeros((times, 1)), np.zeros((times, 4, 4)), (Sphere(),)
    )
    blocks += [silent] * (EFFECTS - len(blocks))
    indices = first + np.arange(times)
    return engine_of(tolerance).evaluate(AnimationBlock(indices, tuple(blocks), (pose,)))


def weights_of(runs: list[SampleRun]) -> np.ndarray:
    """Return weights at the first time, by volume and vertex."""
    weights = np.zeros((EFFECTS, len(MODEL)))
    for run in runs:
        for sample in run:
            weights[int(run.stream.effect_id[1:]), sample.vertices] = sample.weights
    return weights


def placed(kind: str, size_m: float, grown_m: float, centre: np.ndarray) -> Placed:
    """Return a shape of a size, with the surface offset outwards by ``grown_m``; tiny if shrunk
    away.
    """
    radius = max(size_m + grown_m, 1e-9)
    matrix = np.diag([radius, radius, radius, 1.0])
    shape: Shape = Sphere()
    if kind == "cuboid":
        edges = np.maximum(size_m * np.array([1.0, 0.5, 2.0]) + grown_m, 1e-9)
        shape, matrix = Cuboid(), np.diag([*edges, 1.0])
    elif kind == "capsule":
        shape = Capsule(2.0 * size_m / radius)
    matrix[:3, 3] = centre
    return shape, matrix


SCENES = st.fixed_dictionaries(
    {
        "kind": st.sampled_from(["sphere", "cuboid", "capsule"]),
        "size_m": st.floats(0.01, 0.08),
        "vertex": st.integers(0, len(MODEL) - 1),
        "shift": st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    }
)


def place_of(drawn: dict) -> np.ndarray:
    """Return a position within the size from the skin, so most volumes touch."""
    vertex = MODEL.vertices[drawn["vertex"]].astype(float)
    return vertex + drawn["size_m"] * np.array(drawn["shift"])


def here(drawn: dict, grown_m: float = 0.0) -> list[Placed]:
    """Return a volume at one time, with the surface offset outwards."""
    return [placed(drawn["kind"], drawn["size_m"], grown_m, place_of(drawn))]


@pytest.mark.parametrize("name", SETTINGS)
@settings(max_examples=4, deadline=None)
@given(scenes=st.lists(SCENES, min_size=3, max_size=3))
def test_edges_are_within_the_stated_distance(name, scenes):
    tolerance = SETTINGS[name]
    actual = weights_of(runs_of(tolerance, [here(item) for item in scenes]))[:3]
    # The distance is a share of the local spacing, so vertices are judged by their own.
    edges = np.array([tolerance.edge_m(spacing) for spacing in SPACING_M])
    for edge_m in np.unique(np.quantile(edges, [0.3, 1.0])):
        mine = edges <= edge_m * (1.0 + 1e-9)
        exact = [here(item, grown) for grown in (-edge_m, edge_m) for item in scenes]
        smaller, larger = np.split(weights_of(runs_of(EXACT, exact)), 2)
        slack = tolerance.amplitude + 0.02  # the exact setting samples skin, too
        assert (actual[:, mine] >= smaller[:, mine] - slack).all()
        assert (actual[:, mine] <= larger[:, mine] + slack).all()


@pytest.mark.parametrize("name", SETTINGS)
@settings(max_examples=3, deadline=None)
@given(drawn=SCENES)
def test_actuators_are_within_the_stated_share_of_full_scale(name, drawn):
    """Measured at shipped devices, with the devices' rendering."""
    tolerance = SETTINGS[name]
    edge_m = max(tolerance.edge_m(float(spacing)) for spacing in SPACING_M)
    lower, upper = (played(runs_of(EXACT, [here(drawn, grown)])) for grown in (-edge_m, edge_m))
    for actual, low, high in zip(
        played(runs_of(tolerance, [here(drawn)])), lower, upper, strict=True
    ):
        assert (actual >= low - tolerance.amplitude - 0.02).all()
        assert (actual <= high + tolerance.amplitude + 0.02).all()


def played(runs: list[SampleRun]) -> list[np.ndarray]:
    """Return shares of full scale at the first time, (actuators,), by device."""
    header = TrackHeader.of(scene(), {MODEL.id: MODEL}, settings={}, tools={})
    shares = []
    for name in DEVICES:
        device = load_device(name)
        renderer = Renderer(header, device, load_model)
        renderer.add(runs)
        raster = renderer.raster()
        highest = {actuator.id: actuator.type.strength.highest for actuator in device.actuators}
        columns = [k for k, c in enumerate(raster.columns) if c.parameter == "pressure_kpa"]
        scales = np.array([highest[raster.columns[k].actuator] for k in columns])
        shares.append(raster.values[0, columns] / scales)
    return shares


@pytest.mark.parametrize("name", SETTINGS)
@settings(max_examples=3, deadline=None)
@given(
    speed=st.floats(0.1, 3.0),
    angle=st.floats(0.0, 2 * np.pi),
    height=st.floats(0.9, 1.4),
    radius=st.floats(0.02, 0.05),
)
def test_contacts_begin_within_the_stated_time(name, speed, angle, height, radius):
    """A ball moves from 0.35 m away towards the skin; samples are 10 ms apart."""
    tolerance = SETTINGS[name]
    way = np.array([np.cos(angle), np.sin(angle), 0.0])

    def ball(time_s: float) -> tuple:
        centre = way * (0.6 - speed * time_s) + np.array([0.0, 0.0, height])
        return placed("sphere", radius, 0.0, centre)

    def is_touched(time_s: float) -> bool:
        return any(len(run) for run in runs_of(EXACT, [[ball(time_s)]]))

    apart, inside = 0.0, 0.6 / speed  # in the middle of the body
    way_there = np.linspace(apart, inside, 25)
    first = next(k for k, time_s in enumerate(way_there) if is_touched(time_s))
    apart, inside = float(way_there[first - 1]), float(way_there[first])
    while inside - apart > 5e-4:
        middle = 0.5 * (apart + inside)
        apart, inside = (apart, middle) if is_touched(middle) else (middle, inside)
    start = max(int(inside * RATE_HZ) - 12, 0)
    runs = runs_of(tolerance, [[ball(k / RATE_HZ) for k in range(start, start + 25)]], start)
    (run,) = runs
    begin_s = int(run.indices[0]) / RATE_HZ
    late = max(tolerance.time_s, 1.0 / RATE_HZ) + tolerance.edge_m(float(SPACING_M.max())) / speed
    # A sample is valid until the next sample.
    assert -1.0 / RATE_HZ - 1e-3 <= begin_s - inside <= late + 1e-3
