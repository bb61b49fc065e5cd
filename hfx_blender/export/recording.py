# SPDX-License-Identifier: GPL-3.0-or-later
"""Records the track of a scene, and its animation for glb and clips, as a whole or in parts."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import chain
from math import ceil
from pathlib import Path
from typing import Any, Self

import bpy
import numpy as np
import numpy.typing as npt

from ..engine.areas.felt_times import FeltTimes
from ..engine.body.model import load_model
from ..engine.counters import Counters, ReadingCounters
from ..engine.evaluate import Engine
from ..engine.overlapping import overlapped, sequentially
from ..engine.rendering.conditioning.feel import Feel
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.render import renderers_of
from ..engine.rendering.renderer import Renderer
from ..engine.samples import SampleRun, joined_runs
from ..engine.scene import AnimationBlock, HapticSurface, SceneDescription
from ..engine.track import TrackHeader, TrackWriter
from ..engine.track.layout import SAMPLES_PER_CHUNK
from ..formats.clip.spatial_recorder import SpatialRecorder
from ..formats.glb.glb_scene import VolumeRecorder
from ..reading.description.missed_effects import flattened_warning
from ..reading.scene_reader import BLOCK_SIZE, SceneReader
from ..version import __version__

Watch = Callable[[AnimationBlock], None]
_SPATIAL = "clip."  # prefix of array names of the SpatialRecorder

BlockSamples = tuple[AnimationBlock, Iterable[SampleRun]]


@dataclass(frozen=True)
class Recorded:
    """Counters, faults, notes and felt times of a recording, as plain data for worker processes."""

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
            # Constant notes first: merged parts then have the order of a single recording.
            (*engine.notes, *reader.notes),
            reader.stepping_note,
            asdict(times),
        )

    def as_json(self) -> dict[str, Any]:
        """Plain data for :meth:`from_json`."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Facts from :meth:`as_json` data, also after JSON, in which the notes are a list."""
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
        # A part of an earlier version has no felt times, and times of the others would be partial.
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
        """Warnings of reading and evaluation, each with the number of samples."""
        counts = self.engine["warnings"] | {text: len(k) for text, k in self.faults.items()}
        texts = (f"{text.rstrip('.')} ({count} times)" for text, count in counts.items())
        return (*flattened_warning(self.flattened), *texts)

    @property
    def flattened(self) -> dict[str, int]:
        """Number of samples with a flattened volume, by effect name."""
        counts: dict[str, int] = self.engine.get("flattened", {})  # not of earlier versions
        return counts


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
) -> Generator[float, None, tuple[TrackWriter | None, list[tuple[DeviceConfig, Renderer]]]]:
    """Evaluate a scene block by block, write its track, and render it for devices.

    Yields the finished share after each block; a caller that stops early leaves no file. Returns
    the writer, and the renderers of all devices on all bodies, with all samples added. Blocks are
    read in the calling thread and, where threads can run, evaluated and written in a second one.
    Renderers get the samples as stored, so rendering the track later gives equal results.

    ``watch`` is called with each recorded block, and ``times`` collects the samples at which
    effects are on and felt. With ``part`` only samples (first, stop) are recorded, whole chunks of
    the track; :func:`lead_in` samples before are evaluated for ringing responses and discarded.
    Devices with state between samples need the whole track.
    """
    settings = {
        "record": sorted(record),
        "tolerance": reader.tolerance.name,
        **reader.play_space_setting(),
    }
    tools = {"hfx": __version__, "blender": bpy.app.version_string}
    first, stop = part or (0, reader.time.sample_count)
    sampled = reader.sample_indices
    count = max(int(((sampled >= first) & (sampled < stop)).sum()), 1)
    read = done = 0  # samples; reading counts for half of the progress
    # Whole blocks: a part then evaluates the same blocks as a recording in one go.
    start = (first - lead_in(engine)) // BLOCK_SIZE * BLOCK_SIZE
    blocks = reader.blocks((start, stop))
    finished: list[tuple[DeviceConfig, Renderer]] = []
    writer: TrackWriter | None = None
    effects = reader.description.effects
    touching = {effect.id for effect in effects if effect.is_contact}

    def counted() -> Iterator[AnimationBlock]:
        """Yield the blocks, and count their samples in ``read``, warm-up blocks excluded."""
        nonlocal read
        for block in blocks:
            if block.own_indices[-1] >= first:
                read += len(block.own_indices)
            yield block

    def own_blocks(evaluated: Iterator[BlockSamples]) -> Iterator[BlockSamples]:
        """Yield blocks from sample ``first`` on. Earlier blocks only warm up responses: the
        counters are reset after each, so that parts add up to the whole."""
        for block, runs in evaluated:
            if block.own_indices[-1] < first:
                deque(runs, 0)
                engine.counters.clear()
            else:
                yield block, runs

    def work(
        unread_blocks: Iterator[AnimationBlock],
    ) -> Generator[list[AnimationBlock], None, None]:
        """Evaluate and write blocks; yields the blocks of each written chunk, and empty lists."""
        nonlocal writer
        with closing(engine.evaluated(unread_blocks)) as evaluated:
            description = reader.description
            models = {e.model_id: load_model(e.model_id) for e in description.effects}
            header = TrackHeader.of(description, models, settings=settings, tools=tools)
            renderers = renderers_of(header, devices)
            is_equal = Feel.of_settings(header.settings).is_equal
            with TrackWriter(path, header, full_precision=full_precision) as writer:
                single = ([pair] for pair in own_blocks(evaluated))
                for chunk in _chunks(own_blocks(evaluated)) if renderers else single:
                    # Renderers get the runs as stored: quantised, and joined to whole chunks.
                    # Without renderers each run is stored and freed before the next is found.
                    runs = chain.from_iterable(own_runs for _, own_runs in chunk)
                    if renderers:
                        runs = joined_runs((own_runs for _, own_runs in chunk), header.streams)
                    stored: Iterable[SampleRun] = writer.stored(runs)
                    if renderers:
                        stored = [*stored]
                        for _, renderer in renderers:
                            renderer.add(stored)
                    if times is not None:
                        times.add_runs(stored, touching, is_equal=is_equal)
                        for block, _ in chunk:
                            times.add_levels(effects, block)
                        times.touched |= dict.fromkeys(engine.touched, True)
                    deque(stored, 0)
                    yield [block for block, _ in chunk]
                    # Freed before the next block is evaluated; generators hold these lists, too.
                    for samples in (runs, stored, *(own_runs for _, own_runs in chunk)):
                        if isinstance(samples, list):
                            samples.clear()
        finished.extend(renderers)

    # Blender releases Python's lock while it steps a scene, so a second thread helps even on one
    # processor.
    together = overlapped if engine.has_threads or reader.is_stepped else sequentially
    # closing() restores the scene even if the caller stops early.
    with closing(blocks), closing(together(counted(), work)) as worked:
        for chunks in worked:
            for block in (block for chunk in chunks for block in chunk):
                if watch is not None:
                    watch(block)
                done += len(block.own_indices)
            yield (read + done) / (2 * count)
    return writer, finished


def _chunks(blocks: Iterator[BlockSamples]) -> Iterator[list[BlockSamples]]:
    """Group blocks by chunk of the track; yields an empty list for each block within a chunk."""
    chunk: list[BlockSamples] = []
    number = -1  # of the chunk in the track
    for pair in blocks:
        # The last sample decides: the first ones may be read for motion only.
        next_number = int(pair[0].indices[-1]) // SAMPLES_PER_CHUNK
        # An empty list lets the caller report progress and stop within a chunk.
        yield chunk if chunk and number != next_number else []
        pair = pair[0], [*pair[1]]
        chunk = [*chunk, pair] if number == next_number else [pair]
        number = next_number
    if chunk:
        yield chunk


class SceneRecorders:
    """Recorders for formats: ``volumes`` for glb, ``spatial`` for clip, or None."""

    def __init__(self, scene: SceneDescription, formats: Sequence[str], detail: int) -> None:
        self.volumes = VolumeRecorder(scene) if "glb" in formats else None
        self.spatial = SpatialRecorder(scene, detail) if "clip" in formats else None

    @property
    def is_any(self) -> bool:
        """True if any format needs a recorder."""
        return self.volumes is not None or self.spatial is not None

    def add(self, block: AnimationBlock) -> None:
        """Record the next block, in order of time."""
        for recorder in (self.volumes, self.spatial):
            if recorder is not None:
                recorder.add(block)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Recorded arrays by name, to be stored for :meth:`join`; empty without recorders."""
        arrays = {} if self.volumes is None else self.volumes.arrays()
        if self.spatial is not None:
            arrays |= {_SPATIAL + name: array for name, array in self.spatial.arrays().items()}
        return arrays

    def join(
        self, files: Sequence[Path], block_at: Callable[[int], Iterable[AnimationBlock]]
    ) -> None:
        """Replace the recordings by the files of :meth:`arrays` of all parts, in order of time.
        ``block_at`` reads the block of a sample, for the shapes of volumes."""
        # Arrays of both recorders are in one file, told apart by the prefix of their names.
        parts: list[Mapping[str, npt.NDArray[Any]]] = []
        for file in files:
            with np.load(file, allow_pickle=False) as arrays:
                parts.append(dict(arrays))
        if self.volumes is not None:
            # Shapes cannot be stored as arrays: the block of each volume's first sample is read
            # again.
            for first in self.volumes.first_samples(parts):
                for block in block_at(first):
                    self.volumes.add(block)
            self.volumes.replace(parts)
        if self.spatial is not None:
            own = [
                {k.removeprefix(_SPATIAL): v for k, v in part.items() if k.startswith(_SPATIAL)}
                for part in parts
            ]
            self.spatial.replace(own)
