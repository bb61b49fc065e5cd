# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks derived from tracks: named clips, excerpts, merged parts."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, count, groupby
from math import ceil, floor
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..scene import Clip, TimeBase
from ..stepwise import tell
from .header import TrackHeader
from .track_reader import TrackReader
from .writer import TrackWriter


@dataclass(frozen=True)
class NamedClip:
    """Clip of an effect with a unique name."""

    name: str  # unique in the track, also without regard to case
    clip: Clip
    effect_ids: tuple[str, ...]  # the effect's id


def named_clips(header: TrackHeader) -> list[NamedClip]:
    """Clips of a track in the order of time, each with a single effect. Of clips with equal names,
    case apart, the later ones get the effect's name appended, then a number from 2."""
    clips = [(clip, effect) for effect in header.effects for clip in effect.clips]
    named: list[NamedClip] = []
    used_names: set[str] = set()
    for clip, effect in sorted(clips, key=lambda pair: (pair[0].frame_start, pair[0].frame_end)):
        # File systems may ignore case, and clips become files of these names.
        longer = f"{clip.name} {effect.name}"
        names = chain([clip.name, longer], (f"{longer} {number}" for number in count(2)))
        name = next(n for n in names if n.casefold() not in used_names)
        used_names.add(name.casefold())
        named.append(NamedClip(name, clip, (effect.id,)))
    return named


def write_excerpt(
    track: TrackReader, effect_ids: Collection[str], clip: Clip, path: Path
) -> TimeBase:
    """Write the samples of some effects during a clip as a new track; return its time base.

    ``clip``, in frames of the track, is the only clip of the new track's effects. The first sample
    at or after the clip's start becomes sample 0 at time 0, so a clip that starts between two
    samples begins up to one sample late. The clip's end is included; the last frame lasts a whole
    frame, as in every track. Raises ValueError for a clip without a sample of the track, InputError
    for a damaged track, and OutputError.
    """
    time = track.header.time
    rows = sample_range(clip, time)
    if rows is None:
        raise ValueError(f"clip '{clip.name}' has no sample in the track")
    first, last = rows
    step = time.fps / time.rate_hz  # frames per sample
    # Whole frame at or before the first sample, so that the new time base starts on a frame.
    start = floor(time.frame(first))
    frames = max(ceil((last - first + 1) * step), 1)
    moved = TimeBase(time.fps, time.rate_hz, start, start, start + frames - 1)
    header = _header_of(track.header, effect_ids, replace(clip, frame_start=float(start)), moved)
    streams = set(header.streams)
    begin, end = time.times_s(np.array([first, last + 1])).tolist()
    with TrackWriter(path, header, full_precision=track.full_precision) as writer:
        runs = (run for run in track.runs(begin, end) if run.stream in streams)
        # Chunk by chunk, as the writer takes the runs of a block of time together.
        for _, chunk in groupby(runs, lambda run: int(run.indices[0]) // track.samples_per_chunk):
            block = []
            for run in chunk:
                indices = run.indices - first
                block.append(replace(run, indices=indices, times_s=moved.times_s(indices)))
            writer.append(block)
    return moved


def sample_range(clip: Clip, time: TimeBase) -> tuple[int, int] | None:
    """First and last sample index within a clip's frames, both ends included, and within the time
    base; None without any."""
    # Exact fractions: a clip that starts on a sample includes this sample.
    step = time.fps / time.rate_hz
    first = max(ceil((Fraction(clip.frame_start) - time.frame_first) / step), 0)
    last = min(floor((Fraction(clip.frame_end) - time.frame_first) / step), time.sample_count - 1)
    return (first, last) if first <= last else None


def _header_of(
    header: TrackHeader, effect_ids: Collection[str], clip: Clip, time: TimeBase
) -> TrackHeader:
    """Header with the effects of these ids, each with the only clip ``clip``, and their models,
    bodies and streams."""
    effects = tuple(
        replace(effect, clips=(clip,)) for effect in header.effects if effect.id in effect_ids
    )
    used = {effect.model_id for effect in effects}
    streams = tuple(stream for stream in header.streams if stream.effect_id in effect_ids)
    bodies = {stream.body_id for stream in streams}
    return replace(
        header,
        time=time,
        models=tuple(model for model in header.models if model.id in used),
        bodies=tuple(body for body in header.bodies if body.id in bodies),
        effects=effects,
        streams=streams,
    )


def merge(parts: Iterable[Path], path: Path) -> None:
    """Merge tracks with the parts of one recording into a single track.

    The parts have equal headers, and disjoint whole chunks (``layout.SAMPLES_PER_CHUNK``) in the
    order of time. Raises InputError without parts, and for a part that is damaged, out of order, or
    of another recording; OutputError.
    """
    files = list(parts)
    if not files:
        raise InputError(f"{path}: there are no parts of it.")
    with TrackReader(files[0]) as first:
        header, precise = first.header, first.full_precision
    with TrackWriter(path, header, full_precision=precise) as writer:
        for k, file in enumerate(files):
            tell(k / len(files))
            with TrackReader(file) as part:
                writer.copy(part)
