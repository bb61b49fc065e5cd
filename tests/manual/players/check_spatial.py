# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare the spatial core with the engine at tolerance ``paper``, on walking avatars.

``python tests/manual/players/check_spatial.py --walkers 5 --seconds 10`` prints, for volumes alone
and with responses, the share of samples (an effect, a vertex of the level, a moment with contact in
either) with weight times level within 1/255 of the engine's. ``--standard`` prints the distance of
actuator values from the values at ``standard``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "players"))
from coarse_models import at_level
from core_library import Body, Clip
from walkers import RATE_HZ, Walk, walk

from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body.levels_and_cells import level_count
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.tolerance import PAPER, STANDARD
from hfx_blender.engine.track import TrackHeader
from hfx_blender.formats.clip import COARSEST
from hfx_blender.formats.clip.clip_writer import write
from hfx_blender.formats.clip.spatial_recorder import SpatialRecorder
from hfx_tools.formats import clip_rules
from hfx_tools.formats.clip_reader import texts_at

DEVICES = ("oculus_touch", "pressure_vest", "fan_heater")


@dataclass
class Shares:
    """Compared samples."""

    samples: int = 0
    within: int = 0
    values: int = 0
    values_within: int = 0


@dataclass(frozen=True, eq=False)
class Moment:
    """Input of a player at a row of a walk, and the engine's contacts at the row."""

    bones: np.ndarray  # (B, 3, 4) rest space to world, of the clip's bones
    volumes: np.ndarray  # (E, 3, 4)
    factors: np.ndarray  # (E,): level over the level in the clip
    # Weight times level of each effect, (V,) of the effect's model in the clip.
    felt: list[np.ndarray]
    values: np.ndarray  # (C,) at level 0: values of actuators


def moments(made: Walk, folder: Path, level: int) -> tuple[Path, Iterator[Moment]]:
    """Clip of a walk, and the walk's moments in the engine at tolerance ``paper``."""
    whole = _models(made)
    coarse = {
        id: replace(at_level(model, _least(model, level))[0], id=id) for id, model in whole.items()
    }
    # A player knows no later frame, so the comparison is with the engine's live values.
    live = replace(made.block, live_s=made.scene.time.times_s(made.block.indices))
    runs = Engine(made.scene, models=coarse.__getitem__, tolerance=PAPER).evaluate(live)
    path, bones, given = _written(made, folder, level, runs if level == 0 else [])
    sections = clip_rules.read(path.read_bytes(), str(path))
    runs_by_id = {run.stream.effect_id: run for run in runs}
    ranks = {
        text: _ranks(sections["VERT"]["id"][int(at["first_vertex"]) :][: int(at["vertices"])])
        for text, at in zip(
            texts_at(sections, sections["MODL"]["id"]), sections["MODL"], strict=True
        )
    }
    return path, (
        Moment(
            made.matrices[row, bones],
            np.array([animated.matrices[row, :3] for animated in made.block.effects]),
            _factors(made, sections, row),
            [
                _expected(runs_by_id.get(effect.id), row, len(coarse[effect.model_id]))[
                    ranks[effect.model_id]
                ]
                for effect in made.scene.effects
            ],
            given[row],
        )
        for row in range(len(made.matrices))
    )


def against_standard(made: Walk, folder: Path, level: int) -> np.ndarray:
    """Distance of a level's values from those at ``standard``, of full scale, where either acts."""
    whole = _models(made)
    runs = Engine(made.scene, models=whole.__getitem__, tolerance=STANDARD).evaluate(made.block)
    path, bones, given = _written(made, folder, level, runs)
    sections = clip_rules.read(path.read_bytes(), str(path))
    columns = sections["COLM"]
    strengths = np.flatnonzero((columns["highest"] > columns["lowest"]) & _are_first(columns))
    body = Body(Clip(path.read_bytes()))
    actual = []
    for row in range(len(made.matrices)):
        body.set_bones(made.matrices[row, bones])
        factors = _factors(made, sections, row)
        for k, animated in enumerate(made.block.effects):
            body.set_volume(k, animated.matrices[row, :3])
            body.trigger(k, float(factors[k]))
        actual.append(body.evaluate(1.0 / RATE_HZ if row else 0.0))
    values, neutral = np.array(actual)[:, strengths], columns["neutral"][strengths]
    expected = given[:, strengths]
    full = (columns["highest"] - columns["lowest"])[strengths]
    acts = (np.abs(values - neutral) > 1e-3 * full) | (np.abs(expected - neutral) > 1e-3 * full)
    return np.asarray((np.abs(values - expected) / full)[acts])


def _factors(made: Walk, sections: dict[str, np.ndarray], row: int) -> np.ndarray:
    """Level of each effect at a row, over its level in the clip, (E,)."""
    levels = np.array([animated.levels[row] for animated in made.block.effects])
    return levels / sections["EFCT"]["level"]


def _are_first(columns: np.ndarray) -> np.ndarray:
    """Columns with the strength of an actuator: the actuator's first column."""
    return np.diff(columns["actuator"].astype(np.int64), prepend=-1) > 0


def compare(made: Walk, folder: Path, level: int, shares: Shares) -> None:
    """Evaluate a walk with engine and core; at level 0 compare the values of each actuator, too."""
    path, messages = moments(made, folder, level)
    sections = clip_rules.read(path.read_bytes(), str(path))
    body = Body(Clip(path.read_bytes()))
    assert body.error == 0
    full = sections["COLM"]["highest"] - sections["COLM"]["lowest"]
    for row, moment in enumerate(messages):
        body.set_bones(moment.bones)
        for k, matrix in enumerate(moment.volumes):
            body.set_volume(k, matrix)
            body.trigger(k, float(moment.factors[k]))
        out = body.evaluate(1.0 / RATE_HZ if row else 0.0)
        if level == 0:
            differs = np.abs(out - moment.values) > full / 255.0
            is_given = (moment.values != sections["COLM"]["neutral"]) | differs
            shares.values += int(np.count_nonzero(is_given))
            shares.values_within += int(np.count_nonzero(is_given & ~differs))
        for k, expected in enumerate(moment.felt):
            actual = body.weights(k) * body.level(k)
            is_felt = (actual > 0.0) | (expected > 0.0)
            shares.samples += int(np.count_nonzero(is_felt))
            is_right = np.abs(actual - expected) <= 1.0 / 255.0
            shares.within += int(np.count_nonzero(is_felt & is_right))


def clip_of(made: Walk, folder: Path, level: int) -> tuple[Path, list[int]]:
    """Clip of a walk, and the walk's bones in the clip."""
    return _written(made, folder, level, [])[:2]


def _models(made: Walk) -> dict[str, PerceptualModel]:
    return {effect.model_id: load_model(effect.model_id) for effect in made.scene.effects}


def _written(
    made: Walk, folder: Path, level: int, runs: list[SampleRun]
) -> tuple[Path, list[int], np.ndarray]:
    """Clip of a walk, the clip's bones, and the devices' values of some runs, (T, C)."""
    header = TrackHeader.of(made.scene, _models(made), settings={}, tools={})
    played = []
    for device in (_unheld(load_device(item)) for item in DEVICES):
        renderer = Renderer(header, device, compensates_latency=False)
        renderer.add(runs)
        played.append((device, renderer.raster()))
    recorder = SpatialRecorder(made.scene, level)
    recorder.add(made.block)
    (path,) = write(header, played, folder / "walk", recorder).files
    sections = clip_rules.read(path.read_bytes(), str(path))
    number = {name: k for k, name in enumerate(made.scene.bodies[0].binding.bone_names)}
    bones = [number[item] for item in texts_at(sections, sections["BONE"]["name"])]
    return path, bones, np.concatenate([raster.values for _, raster in played], axis=1)


def _unheld(device: DeviceConfig) -> DeviceConfig:
    """A device with changes allowed at any row: the core leaves holding to the output."""
    free = tuple(
        replace(actuator, type=replace(actuator.type, update_interval_ms=0.0))
        for actuator in device.actuators
    )
    return replace(device, actuators=free)


def _ranks(ids: np.ndarray) -> np.ndarray:
    """Index of each vertex in the ascending vertices of the level."""
    return np.asarray(np.argsort(np.argsort(ids)))


def _least(model: PerceptualModel, level: int) -> int:
    return min(level, level_count(model))


def _expected(run: SampleRun | None, row: int, count: int) -> np.ndarray:
    """Weight times level of each vertex of a model at a row, by the engine."""
    dense = np.zeros(count)
    if run is None:
        return dense
    at = np.flatnonzero(run.indices == row)
    if len(at):
        j = int(run.set_of[at[0]])
        part = slice(int(run.offsets[j]), int(run.offsets[j + 1]))
        dense[run.vertices[part]] = run.weights[part] * run.levels[at[0]]
    return dense


def print_table(walkers: int, seconds: float) -> int:
    """Print a table row per level of detail: differences of the players' actuator values from an
    export at tolerance ``standard``, as shares of full scale. Returns an exit code."""
    sys.stdout.write("| level | values | mean | within 5 % | within 20 % |\n")
    sys.stdout.write("|---|---|---|---|---|\n")
    for level in range(COARSEST + 1):
        with tempfile.TemporaryDirectory() as name:
            walks = [walk(seed, seconds) for seed in range(walkers)]
            away = np.concatenate([against_standard(item, Path(name), level) for item in walks])
        shares = " | ".join(f"{np.mean(away <= most):.1%}" for most in (0.05, 0.2))
        sys.stdout.write(f"| {level} | {len(away)} | {away.mean():.1%} | {shares} |\n")
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--walkers", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--level", type=int, default=1)
    parser.add_argument("--standard", action="store_true", help="the table against 'standard'")
    options = parser.parse_args()
    if options.standard:
        return print_table(options.walkers, options.seconds)
    for responds in (False, True):
        shares = Shares()
        with tempfile.TemporaryDirectory() as name:
            for seed in range(options.walkers):
                created = walk(seed, options.seconds, responds=responds)
                compare(created, Path(name), options.level, shares)
        what = "with responses" if responds else "volumes alone"
        share = shares.within / max(shares.samples, 1)
        sys.stdout.write(f"{what}: {shares.samples} samples, {share:.5%} within 1/255\n")
        if shares.values:
            share = shares.values_within / shares.values
            sys.stdout.write(f"  {shares.values} values of actuators, {share:.3%} within 1/255\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
