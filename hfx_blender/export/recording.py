# SPDX-License-Identifier: GPL-3.0-or-later
"""Records the track of a scene, as a whole or as one of several parts."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from math import ceil
from pathlib import Path
from typing import Any, Self

import bpy

from ..engine.areas.felt_times import FeltTimes
from ..engine.body.model import load_model
from ..engine.counters import Counters, ReadingCounters
from ..engine.evaluate import Engine
from ..engine.overlapping import overlapped, sequentially
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.render import renderers_of
from ..engine.rendering.renderer import Renderer
from ..engine.samples import SampleRun, joined_runs
from ..engine.scene import AnimationBlock, HapticSurface, SceneDescription
from ..engine.track import TrackHeader, TrackWriter
from ..engine.track.layout import SAMPLES_PER_CHUNK
from ..reading.scene_reader import BLOCK_SIZE, SceneReader
from ..version import __version__

Watch = Callable[[AnimationBlock], None]
BlockSamples = tuple[AnimationBlock, list[SampleRun]]


@dataclass(frozen=True)
class Recorded:
    """Counters, faults, notes and felt times of a recording, as plain data for other processes."""

    engine: dict[str, Any]  # fields of Counters
    reading: dict[str, Any]  # fields of ReadingCounters
    faults: dict[str, list[int]]  # reading faults, with their samples
    notes: tuple[str, ...]
    stepping: str
    felt_times: dict[str, Any] | None = None  # fields of FeltTimes; None: by an earlier version

    @classmethod
    def of(cls, reader: SceneReader, engine: Engine, times: FeltTimes) -> Self:
        """Collect the facts after the last block of a recording."""
        return cls(
            engine.counters.as_dict(),
            reader.counters.as_dict(),
            {text: sorted(samples) for text, samples in reader.faults.items()},
            (*reader.notes, *engine.notes),
            reader.stepping_note,
            asdict(times),
        )

    def as_json(self) -> dict[str, Any]:
        """Plain data for :meth:`from_json`."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        return cls(**{**data, "notes": tuple(data["notes"])})

    @classmethod
    def merged(cls, parts: Sequence[Self]) -> Self:
        """Merge parts, given in the order of time, into the facts of a single recording."""
        counted, read, times = Counters(), ReadingCounters(), FeltTimes()
        faults: dict[str, set[int]] = {}
        for part in parts:
            counted.add(Counters(**part.engine))
            read.add(ReadingCounters(**part.reading))
            times.add(part.times or FeltTimes())
            for text, samples in part.faults.items():
                faults.setdefault(text, set()).update(samples)
        notes = dict.fromkeys(note for part in parts for note in part.notes)
        is_complete = all(part.felt_times is not None for part in parts)
        return cls(
            counted.as_dict(),
            read.as_dict(),
            {text: sorted(samples) for text, samples in faults.items()},
            tuple(notes),
            parts[0].stepping,
            asdict(times) if is_complete else None,
        )

    @property
    def times(self) -> FeltTimes | None:
        """Samples at which effects are on and felt; None in recordings of earlier versions."""
        return None if self.felt_times is None else FeltTimes(**self.felt_times)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of reading and evaluation, each with its number of samples."""
        counts = self.engine["warnings"] | {text: len(k) for text, k in self.faults.items()}
        return tuple(f"{text.rstrip('.')} ({count} times)" for text, count in counts.items())


def why_in_one_go(reader: SceneReader) -> str | None:
    """Reason why a scene cannot be recorded in parts with equal results; None if it can."""
    for effect in reader.description.effects:
        if isinstance(effect.area, HapticSurface):
            return f"what is felt of the surface '{effect.name}' goes on from sample to sample"
    return reader.why_in_one_go()


def lead_in(engine: Engine) -> int:
    """Number of samples before a part that must be evaluated for ringing responses."""
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
    times: FeltTimes | None = None,
) -> Generator[float, None, list[tuple[DeviceConfig, Renderer]]]:
    """Evaluate a scene block by block, record it, and pass the samples to renderers.

    Renderers are returned that have been given all of it, for each device on each body.

    After each block the share that is done is yielded: whoever stops there leaves no file.
    Blocks are read here; they are worked on in another thread meanwhile, if that can run.
    The devices get exactly what the track keeps, a chunk of it at a time: rendering the track
    later gives the same.
    With ``part``, only samples ``first <= index < stop`` are recorded, whole chunks of the track.
    What rings on from before, also before the first frame, is evaluated first, and forgotten; what
    devices carry on from one sample to the next is for the whole track.
    ``times`` counts the samples at which effects are on and felt.
    """
    settings = {
        "record": sorted(record),
        "tolerance": reader.tolerance.name,
        **reader.play_space_setting(),
    }
    tools = {"hfx": __version__, "blender": bpy.app.version_string}
    first, stop = part or (0, reader.time.sample_count)
    wanted = reader.sample_indices
    count = max(int(((wanted >= first) & (wanted < stop)).sum()), 1)
    read = done = 0  # samples, each of which counts half after reading
    start = (first - lead_in(engine)) // BLOCK_SIZE * BLOCK_SIZE
    blocks = reader.blocks((start, stop))
    finished: list[tuple[DeviceConfig, Renderer]] = []
    effects = reader.description.effects
    touching = {effect.id for effect in effects if effect.is_contact}

    def counted() -> Iterator[AnimationBlock]:
        nonlocal read
        for block in blocks:
            if block.own_indices[-1] >= first:
                read += len(block.own_indices)
            yield block

    def work(given: Iterator[AnimationBlock]) -> Generator[list[AnimationBlock], None, None]:
        with closing(engine.evaluated(given)) as found:
            header = _header(reader.description, settings, tools)
            renderers = renderers_of(header, devices)
            with TrackWriter(path, header, full_precision=full_precision) as writer:
                for some in _chunks(_without_warm_up(found, first, engine.counters)):
                    felt = joined_runs((felt for _, felt in some), header.streams)
                    runs = writer.append(felt)
                    for _, renderer in renderers:
                        renderer.add(runs)
                    if times is not None:
                        times.add_runs(runs, touching)
                        for block, _ in some:
                            times.add_levels(effects, block)
                        times.touched |= dict.fromkeys(engine.touched, True)
                    yield [block for block, _ in some]
        finished.extend(renderers)

    # Blender lets other threads run while it steps a scene, even on one processor.
    together = overlapped if engine.has_threads or reader.is_stepped else sequentially
    # Scenes are restored even if the caller stops after a step.
    with closing(blocks), closing(together(counted(), work)) as worked:
        for done_now in worked:
            for block in (block for some in done_now for block in some):
                if watch is not None:
                    watch(block)
                done += len(block.own_indices)
            yield (read + done) / (2 * count)
    return finished


def _header(
    scene: SceneDescription, settings: Mapping[str, Any], tools: Mapping[str, str]
) -> TrackHeader:
    models = {effect.model_id: load_model(effect.model_id) for effect in scene.effects}
    return TrackHeader.of(scene, models, settings=settings, tools=tools)


def _without_warm_up(
    found: Iterator[BlockSamples], first: int, counters: Counters
) -> Iterator[BlockSamples]:
    """Yields blocks from sample ``first`` on; discards the counters of warm-up blocks."""
    for block, felt in found:
        if block.own_indices[-1] < first:
            counters.clear()
        else:
            yield block, felt


def _chunks(found: Iterator[BlockSamples]) -> Iterator[list[BlockSamples]]:
    """Group blocks by chunk of the track; an empty list while a chunk goes on."""
    some: list[BlockSamples] = []
    for pair in found:
        if some and _chunk(some[-1]) != _chunk(pair):
            yield some
            some = [pair]
        else:
            some.append(pair)
            yield []
    if some:
        yield some


def _chunk(pair: BlockSamples) -> int:
    return int(pair[0].indices[-1]) // SAMPLES_PER_CHUNK
