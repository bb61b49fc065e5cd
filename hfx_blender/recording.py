# SPDX-License-Identifier: GPL-3.0-or-later
"""Recording a scene's track, whole or in parts that others record at the same time."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path
from typing import Any, Self

import bpy

from . import __version__
from .engine.body.model import load_model
from .engine.counters import Counters
from .engine.evaluate import Engine
from .engine.parallel.evaluating import evaluated
from .engine.rendering.device import DeviceConfig
from .engine.rendering.devices import Played, renderers_of
from .engine.scene import AnimationBlock, HapticSurface
from .engine.track import TrackHeader, TrackWriter, as_kept
from .reading.scene_reader import BLOCK_SIZE, SceneReader

Watch = Callable[[AnimationBlock], None]


@dataclass(frozen=True)
class Recorded:
    """What recording told besides the samples; plain data, so that processes can hand it on."""

    engine: dict[str, Any]  # the engine's counters
    faults: dict[str, list[int]]  # message: samples at which the scene could not be read well
    notes: tuple[str, ...]
    stepping: str

    @classmethod
    def of(cls, reader: SceneReader, engine: Engine) -> Self:
        """That of a recording that has just ended."""
        return cls(
            engine.counters.as_dict(),
            {text: sorted(samples) for text, samples in reader.faults.items()},
            reader.notes,
            reader.stepping_note,
        )

    def as_json(self) -> dict[str, Any]:
        """Plain data for :meth:`from_json`."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        return cls(**{**data, "notes": tuple(data["notes"])})

    @classmethod
    def merged(cls, parts: Sequence[Self]) -> Self:
        """What one recording of all parts, given in the order of time, would have told."""
        counted = Counters()
        faults: dict[str, set[int]] = {}
        for part in parts:
            for text, samples in part.faults.items():
                faults.setdefault(text, set()).update(samples)
        for part in parts:
            counted.add(Counters(**part.engine))
        notes = dict.fromkeys(note for part in parts for note in part.notes)
        return cls(
            counted.as_dict(),
            {text: sorted(samples) for text, samples in faults.items()},
            tuple(notes),
            parts[0].stepping,
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What went wrong while samples were read and evaluated, and how often."""
        counts = self.engine["warnings"] | {text: len(k) for text, k in self.faults.items()}
        return tuple(f"{text} ({count} times)" for text, count in counts.items())


def why_in_one_go(reader: SceneReader) -> str | None:
    """Why a scene cannot be recorded in parts; None: it can, and that gives the same."""
    for effect in reader.description.effects:
        if isinstance(effect.area, HapticSurface):
            return f"what is felt of the surface '{effect.name}' goes on from sample to sample"
    return reader.why_in_one_go()


def lead_in(engine: Engine) -> int:
    """Samples before a part that must be evaluated for what still rings in it."""
    memory_s = engine.responses.memory_s
    return ceil(memory_s * engine.scene.time.rate_hz) + 1 if memory_s else 0


def record_track(
    reader: SceneReader,
    engine: Engine,
    path: Path,
    *,
    devices: Sequence[DeviceConfig] = (),
    record: Sequence[str] = (),
    full_precision: bool = False,
    watch: Watch | None = None,
    part: tuple[int, int] | None = None,
    processes: int = 1,
) -> Generator[float, None, list[Played]]:
    """Evaluate a scene block by block, record it, and render it for the devices on the way.

    After each block the share that is done is yielded: whoever stops there leaves no file.
    The devices get exactly what the track keeps: rendering the track later gives the same.
    Several ``processes`` evaluate it where that pays, with the same result. With ``part``, only
    samples ``first <= index < stop`` are recorded, whole chunks of the track. What rings on from
    before is evaluated first, and forgotten; what devices carry on from one sample to the next
    is for the whole track.
    """
    scene = reader.description
    models = {effect.model_id: load_model(effect.model_id) for effect in scene.effects}
    header = TrackHeader.of(
        scene,
        models,
        settings={
            "record": sorted(record),
            "tolerance": reader.tolerance.name,
            **reader.play_space_setting(),
        },
        tools={"hfx": __version__, "blender": bpy.app.version_string},
    )
    renderers = renderers_of(header, devices)
    first, stop = part or (0, reader.time.sample_count)
    wanted = reader.sample_indices
    count = max(int(((wanted >= first) & (wanted < stop)).sum()), 1)
    done = 0
    start = max(first - lead_in(engine), 0) // BLOCK_SIZE * BLOCK_SIZE
    blocks = reader.blocks(part and (start, stop))
    felt_blocks = evaluated(engine, blocks, samples=count, processes=processes)
    with (
        closing(blocks),  # scenes are as they were even if nobody goes on after a step
        closing(felt_blocks),
        TrackWriter(path, header, full_precision=full_precision) as writer,
    ):
        for block, felt in felt_blocks:
            if block.indices[-1] < first:
                engine.counters.clear()
                continue
            runs = [as_kept(run, full_precision=full_precision) for run in felt]
            writer.append(runs)
            for _, renderer in renderers:
                renderer.add(runs)
            if watch is not None:
                watch(block)
            done += len(block.indices) - block.history
            yield done / count
    return [(device, renderer.raster()) for device, renderer in renderers]
