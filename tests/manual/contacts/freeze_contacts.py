# SPDX-License-Identifier: GPL-3.0-or-later
"""Write contacts of many scenes at one commit into a folder, and compare two such folders.

``python tests/manual/contacts/freeze_contacts.py write DIR`` evaluates scenes made from seeds and
of the benches, all data of each sample, in full precision: one file for each. At another commit do
the same into another folder; ``... compare DIR OTHER`` then names each scene with weights or
details differing by more than 1e-6. ``write --only random,bodies,moving`` leaves out scenes needing
Blender. Not part of the test suite: for changes meant to change no result.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "engine"))
from distorted_scenes import DistortedScene, load
from moving_scenes import moving_scene
from random_contacts import RandomContact

from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.samples import Sample, SampleRun
from hfx_blender.engine.scene import SceneDescription
from hfx_blender.engine.tolerance import EXACT, PAPER, PRESETS, PREVIEW, STANDARD, Tolerance

NEAR = 1e-6
"""Accepted difference: of a weight, and of details as a share of their size."""

DETAILS = ("positions", "velocities", "depth_m", "surface", "surface_normals")
_FAST = ("preview", "standard", "paper")

Scenes = Iterator[tuple[str, Callable[[], list[SampleRun]]]]
"""Names of scenes, and what evaluates them."""


def of_seeds() -> Scenes:
    """Small scenes: every shape, falloff, binding, record and preset."""
    for seed in range(48):
        tolerance = (PREVIEW, STANDARD, EXACT, PAPER)[seed % 4]
        yield (
            f"random-{seed}-{tolerance.name}",
            lambda seed=seed, it=tolerance: RandomContact(seed, it).runs(),
        )


def of_bodies() -> Scenes:
    """The shipped models in distorted poses, five volumes each."""
    for modality in ("vibration", "pressure", "temperature"):
        for seed, tolerance in enumerate((PREVIEW, STANDARD, PAPER, EXACT)):

            def evaluated(
                modality: str = modality, seed: int = seed, it: Tolerance = tolerance
            ) -> list[SampleRun]:
                make = DistortedScene.drawn if seed % 2 else DistortedScene.turned
                return make(load(f"hfx-{modality}-1"), seed, 0.4).runs(it)

            yield f"body-{modality}-{tolerance.name}", evaluated


def of_moving() -> Scenes:
    """The shipped models with turning, flying and deforming volumes; and turning bodies."""
    for modality in ("temperature", "pressure"):
        for seed, (strength, speed) in enumerate(((0.0, 1.0), (0.3, 0.1), (0.1, 0.4))):
            for tolerance in (STANDARD, EXACT):

                def evaluated(
                    modality: str = modality, drawn: tuple = (seed, strength, speed),
                    it: Tolerance = tolerance,
                ) -> list[SampleRun]:  # fmt: skip
                    scene, block = moving_scene(load(f"hfx-{modality}-1"), *drawn)
                    return Engine(scene, models=load, tolerance=it).evaluate(block)

                yield f"moving-{modality}-{seed}-{tolerance.name}", evaluated


def of_blender() -> Scenes:
    """The demo, and the scenes of ``hfx bench trade`` and of ``hfx bench export``."""
    from hfx_blender.processes import blender_session

    blender_session.start()
    import bpy

    from hfx_tools.bench import export_cost, scenes
    from hfx_tools.demo import garage

    def changed(change: Callable[[object], None]) -> Callable[[], None]:
        def build() -> None:
            garage.build()
            change(next(item for item in bpy.data.objects if item.type == "ARMATURE"))

        return build

    kinds = {kind.name.replace(" ", "-"): changed(kind.change) for kind in export_cost.KINDS}
    builders = {name: scenes.builder(name) for name in scenes.names()} | kinds
    for name, build in builders.items():
        for preset in _FAST:
            for record in ((), ("positions", "velocities", "depth")):
                if not record or preset == "standard":
                    yield (
                        f"{name}-{preset}{'-details' * bool(record)}",
                        lambda build=build, it=PRESETS[preset], record=record: _of_scene(
                            build, it, record
                        ),
                    )


def _of_scene(
    build: Callable[[], None], tolerance: Tolerance, record: tuple[str, ...]
) -> list[SampleRun]:
    import bpy

    from hfx_blender.reading.scene_reader import SceneReader

    build()
    scene = bpy.context.scene
    frames = scene.frame_start, scene.frame_end
    if record:  # slow
        frames = frames[0], min(frames[1], frames[0] + 40)
    reader = SceneReader(
        scene,
        frames=frames,
        with_positions="positions" in record,
        with_velocities="velocities" in record,
        tolerance=tolerance,
    )
    engine = Engine(reader.description, record=record, tolerance=tolerance)
    volumes = {effect.id for effect in reader.description.effects if effect.kind == "volume"}
    runs = (run for block in reader.blocks() for run in engine.evaluate(block))
    return [_named(run, reader.description) for run in runs if run.stream.effect_id in volumes]


def _named(run: SampleRun, scene: SceneDescription) -> SampleRun:
    """A run with names in place of the stream's ids: ids differ for each build of a scene."""
    names = {item.id: item.name for item in (*scene.bodies, *scene.effects)}
    own = run.stream
    named = replace(own, effect_id=names[own.effect_id], body_id=names[own.body_id])
    return replace(run, stream=named)


GROUPS = {"random": of_seeds, "bodies": of_bodies, "moving": of_moving, "blender": of_blender}


def write(folder: Path, groups: list[str]) -> int:
    """Write a file for each scene; existing files stay."""
    folder.mkdir(parents=True, exist_ok=True)
    for group in groups:
        for name, evaluated in GROUPS[group]():
            path = folder / f"{name}.npz"
            if not path.exists():
                arrays = _packed(evaluated())
                partial = path.with_suffix(".part")
                with partial.open("wb") as file:
                    np.savez_compressed(file, **arrays)
                partial.replace(path)
                sys.stdout.write(f"{name}: {len(arrays['weights'])} contacts\n")
                sys.stdout.flush()
    return 0


def _packed(runs: list[SampleRun]) -> dict[str, np.ndarray]:
    """All runs: a row for each sample, a weight for each contact, and further recorded arrays.

    A key gives the stream, time and vertex of a row or contact.
    """
    streams = sorted({str(run.stream) for run in runs})
    rows: list[tuple[int, np.ndarray]] = []
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for run in runs:
        stream = streams.index(str(run.stream)) << 56
        for index, sample in zip(run.indices.tolist(), run, strict=True):
            key = stream | index << 24
            rows.append((key, np.array([sample.time_s, sample.level, *sample.parameters])))
            parts.append((key | sample.vertices.astype(np.int64), sample.weights, _told(sample)))
    columns = max((len(row) for _, row in rows), default=0)
    values = np.zeros((len(rows), columns))
    for k, (_, row) in enumerate(rows):
        values[k, : len(row)] = row
    actual = {"rows": np.array([key for key, _ in rows], np.int64), "values": values}
    names = "keys", "weights", "details"
    for k, name in enumerate(names):
        actual[name] = np.concatenate([part[k] for part in parts]) if parts else np.zeros(0)
    order = np.argsort(actual["keys"], kind="stable")
    actual |= {name: actual[name][order] for name in names}
    return actual | {"streams": np.array(streams)}


def _told(sample: Sample) -> np.ndarray:
    """Recorded details of each contact, (n, D); NaN for a contact without beginning."""
    impact = sample.impact
    messages = [getattr(sample, name) for name in DETAILS]
    messages += [impact.times_s, impact.speeds_m_s, impact.normals] if impact else []
    count = len(sample.vertices)
    columns = [
        np.asarray(item, np.float64).reshape(count, -1) for item in messages if item is not None
    ]
    return np.concatenate([np.zeros((count, 0)), *columns], axis=1)


def compare(one: Path, other: Path) -> int:
    """Print each differing scene with the kind and size of the difference; 1 for any difference."""
    names = sorted({path.name for folder in (one, other) for path in folder.glob("*.npz")})
    off = 0
    for name in names:
        if not ((one / name).exists() and (other / name).exists()):
            difference = "is in one of the folders only"
        else:
            with np.load(one / name) as first, np.load(other / name) as second:
                difference = _difference(dict(first), dict(second))
        if difference:
            off += 1
            sys.stdout.write(f"{name}: {difference}\n")
    sys.stdout.write(f"{len(names)} scenes, {off} differ\n")
    return int(off > 0 or not names)


def _difference(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> str:
    """Description of the largest differences; empty if all is the same."""
    if one["streams"].tolist() != other["streams"].tolist():
        return "other effects or bodies are felt"
    messages = []
    _, mine, theirs = np.intersect1d(one["keys"], other["keys"], True, return_indices=True)
    # A contact missing in one folder has weight 0 there.
    lonely = [np.delete(one["weights"], mine), np.delete(other["weights"], theirs)]
    apart = np.abs(one["weights"][mine].astype(float) - other["weights"][theirs])
    most = np.concatenate([apart, *lonely]).max(initial=0.0)
    if most > NEAR:
        alone = sum(map(len, lonely))
        messages.append(f"weights by {most:.2g} ({alone} of {len(apart) + alone} on one side only)")
    messages.append(_apart("details", one["details"][mine], other["details"][theirs]))
    _, mine, theirs = np.intersect1d(one["rows"], other["rows"], True, return_indices=True)
    messages.append(_apart("levels, parameters", one["values"][mine], other["values"][theirs]))
    return ", ".join(filter(None, messages))


def _apart(name: str, one: np.ndarray, other: np.ndarray) -> str:
    if one.shape != other.shape or (np.isnan(one) != np.isnan(other)).any():
        return f"{name}: others are there"
    apart = np.nan_to_num(np.abs(one - other) / np.maximum(np.abs(one), 1.0))
    most = apart.max(initial=0.0)
    return f"{name} by {most:.2g}" if most > NEAR else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write", help="evaluate all scenes at this commit")
    writing.add_argument("folder", type=Path)
    writing.add_argument("--only", default=",".join(GROUPS), metavar="GROUP,...")
    comparing = commands.add_parser("compare", help="compare two folders")
    comparing.add_argument("folder", type=Path)
    comparing.add_argument("other", type=Path)
    options = parser.parse_args()
    if options.command == "compare":
        return compare(options.folder, options.other)
    groups = options.only.split(",")
    if not set(groups) <= set(GROUPS):
        parser.error(f"--only: expected some of {', '.join(GROUPS)}")
    return write(options.folder, groups)


if __name__ == "__main__":
    sys.exit(main())
