# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing of HapticTracks during evaluation, in bounded memory."""

import math
import shutil
import tempfile
import zipfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt

from ...errors import InputError, OutputError
from ...files.atomic import atomic_file
from ..modality import MODALITIES
from ..samples import SampleRun
from . import codec, layout
from .header import TrackEffect, TrackHeader
from .layout import to_json
from .track_reader import Content, TrackReader, read_sections

_ZIP_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
_TIME_TOLERANCE_S: Final = 1e-9


class TrackWriter:
    """Writer of a track, and a context manager.

    The file appears at the end of a ``with`` block without exception; otherwise no file is left.
    The bytes depend on header and samples only, not on the calls of :meth:`append`. The samples of
    one call and of a chunk, :data:`layout.SAMPLES_PER_CHUNK` at first, are held in memory. If a
    chunk is too large for a reader, all chunks are halved, repeatedly. ``full_precision`` keeps
    float32 weights; otherwise weights are rounded to 1/255, but not to 0. Raises OutputError if the
    file cannot be written, or one sample has too many contacts for a reader; ValueError for a
    header with a value that is no JSON value.
    """

    def __init__(self, path: Path, header: TrackHeader, *, full_precision: bool = False) -> None:
        self.path = path
        self.header = header
        self.full_precision = full_precision
        self._streams = {
            (stream.effect_id, stream.body_id): k for k, stream in enumerate(header.streams)
        }
        self._vertex_counts = [header.vertex_count(stream) for stream in header.streams]
        self._index = [layout.StreamIndex() for _ in header.streams]
        self._samples_per_chunk = layout.SAMPLES_PER_CHUNK
        self._chunks: list[int] = []
        self._end = 0  # sample index after the last written chunk
        # By chunk number, then by stream index: parts of a section, in order of time.
        self._open: defaultdict[int, dict[int, list[codec.Section]]] = defaultdict(dict)
        self._entries: Counter[int] = Counter()  # collected (set, vertex) pairs by chunk number

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._file = stack.enter_context(atomic_file(self.path))
            self._archive = zipfile.ZipFile(self._file, "w")
            # The archive at that time: halving replaces the present one.
            stack.callback(lambda: self._archive.close())
            self._put_header()
            self._finishing = stack.pop_all()
        return self

    @property
    def written(self) -> Content:
        """Content of header and index so far, for a :class:`TrackReader` of the finished file."""
        encoding = {
            "samples_per_chunk": self._samples_per_chunk,
            "weights": layout.WEIGHTS_FULL if self.full_precision else layout.WEIGHTS_BYTE,
        }
        return self.header, encoding, self._chunks, self._index

    def _put_header(self) -> None:
        """Write the file's header entry, with chunk size and precision of weights so far."""
        header = to_json(*self.written[:2])
        self._put(layout.HEADER, header, layout.MAX_JSON_BYTES)

    def __exit__(self, *failure: Any) -> None:
        if failure[0] is not None:  # the stack closes the archive and removes the file
            self._finishing.__exit__(*failure)
            return
        with self._finishing:
            self._write_collected(math.inf)
            index = layout.encode_index(self._chunks, self._index)
            self._put(layout.INDEX, index, layout.MAX_JSON_BYTES)

    def append(self, runs: Iterable[SampleRun]) -> list[SampleRun]:
        """Record runs of the header's streams over the next block of time; see :meth:`stored`."""
        return [*self.stored(runs)]

    def stored(self, runs: Iterable[SampleRun]) -> Iterator[SampleRun]:
        """Record runs of any of the header's streams over the next block of time, one by one.

        Yields the runs with samples, with weights as a reader will decode them. Blocks, and runs
        of a stream within a block, must be in the order of time. A block may start within the chunk
        of the last block's end. Raises ValueError for a run that breaks the contract of
        :class:`SampleRun` or is out of order, and OutputError.
        """
        yield from (self._add(run) for run in runs if len(run))
        # The next call may still add samples to the newest chunk; all earlier ones are complete.
        self._write_collected(max(self._open, default=0) * self._samples_per_chunk)

    def _add(self, run: SampleRun) -> SampleRun:
        """Check a run, collect its samples by chunk, count them in the index, and return it with
        the weights a reader will see. Raises ValueError for an unknown stream, an invalid run, or a
        sample out of order."""
        stream = self._streams.get((run.stream.effect_id, run.stream.body_id))
        if stream is None:
            raise ValueError(
                f"effect '{run.stream.effect_id}' on body '{run.stream.body_id}' is not a stream "
                "of the header"
            )
        _check_run(run, self.header, self._vertex_counts[stream])
        # Chunks are written as soon as they are complete, so nothing can be added to earlier ones.
        index = self._index[stream]
        if run.indices[0] <= index.last or run.indices[0] < self._end:
            raise ValueError(f"sample {run.indices[0]} comes after later ones were recorded")

        weights: npt.NDArray[Any] = run.weights.astype(np.float32)
        if not self.full_precision:
            weights = codec.encode_weights(weights)
        chunks = run.indices // self._samples_per_chunk
        # Split the run at chunk borders; each part extends the builder of a chunk.
        edges = np.flatnonzero(np.diff(chunks, prepend=-1, append=-1))
        for first, last in pairwise(edges.tolist()):
            chunk = int(chunks[first])
            before = self._open[chunk].get(stream, ())
            part = _section_of(run, weights, slice(first, last), before)
            start = chunk * self._samples_per_chunk
            self._keep(chunk, replace(part, stream=stream, steps=part.steps - start))
        # A chunk too large already will not fit when complete: its later samples need no memory.
        while max(self._entries.values()) > codec.MAX_SET_ENTRIES:
            self._halve_chunks()

        index.add(
            layout.StreamIndex(
                samples=len(run),
                first=int(run.indices[0]),
                last=int(run.indices[-1]),
                entries=int(run.sizes.sum()),
                peak_level=float(run.levels.max()),
                channels=tuple(name for name in codec.CHANNELS if getattr(run, name) is not None),
            )
        )
        return run if self.full_precision else replace(run, weights=codec.decode_weights(weights))

    def copy(self, part: TrackReader) -> None:
        """Append a track with a later part of the same recording, as if its samples were recorded
        here. Raises InputError if the part is damaged, of another recording, or out of order, and
        OutputError if the file cannot be written."""
        size = part.samples_per_chunk
        if (
            to_json(part.header, {}) != to_json(self.header, {})
            or part.full_precision != self.full_precision
            or layout.SAMPLES_PER_CHUNK % size
            or self._open
            or (part.chunks and part.chunks[0] * size < self._end)
        ):
            raise InputError(f"{part.path}: not the next part of {self.path.name}.")
        # Both files get the smaller chunk size, as a recording in one piece would have it.
        while self._samples_per_chunk > size:
            self._halve_chunks()
        for chunk in part.chunks:
            if size == self._samples_per_chunk:
                self._put_chunk(chunk, part.chunk_bytes(chunk))
            else:
                self._collect(part.sections(chunk), chunk * size)
                self._write_collected((chunk + 1) * size)
        for index, entry in zip(self._index, part.index, strict=True):
            index.add(entry)

    def _keep(self, chunk: int, part: codec.Section) -> None:
        """Collect a part of a section, with vertex ids as short as the model allows."""
        if self._vertex_counts[part.stream] <= 1 << 16:
            part = replace(part, vertices=part.vertices.astype(np.uint16))
        self._open[chunk].setdefault(part.stream, []).append(part)
        self._entries[chunk] += len(part.vertices)

    def _collect(self, sections: Iterable[codec.Section], start: int) -> None:
        """Collect sections of a chunk that started at sample ``start``, split at present chunks."""
        for section in sections:
            for number, part in section.parts(self._samples_per_chunk):
                self._keep(start // self._samples_per_chunk + number, part)

    def _write_collected(self, before: float) -> None:
        """Write the collected chunks that start before a sample, and remove their samples; halves
        all chunks until each fits a reader."""
        while self._open and (start := min(self._open) * self._samples_per_chunk) < before:
            chunk, sections = self._taken(min(self._open))
            content = _encoded(sections)
            if content is None:
                self._collect(sections, start)
                self._halve_chunks()
            else:
                self._put_chunk(chunk, content)

    def _taken(self, chunk: int) -> tuple[int, list[codec.Section]]:
        """Number of a collected chunk, and its sections; these are collected no longer."""
        del self._entries[chunk]
        parts = self._open.pop(chunk)
        # Removed one by one, so that no two copies of a chunk are in memory.
        return chunk, [_joined(parts.pop(stream)) for stream in sorted(parts)]

    def _halve_chunks(self) -> None:
        """Rewrite the file with half as many samples per chunk; raises OutputError if a chunk has
        one sample already. A chunk of 2n samples splits into two of n, so the bytes equal a
        recording that started with n."""
        if self._samples_per_chunk == 1:
            raise OutputError(
                f"{self.path}: more is felt in one sample than a track holds "
                f"({codec.MAX_SET_ENTRIES:,} contacts of all effects and bodies together). "
                "Fewer effects or bodies fit."
            )
        chunks, self._chunks = self._chunks, []
        size = self._samples_per_chunk
        self._archive.close()
        # The file itself stays the target of the atomic write, so the old content is moved away.
        with tempfile.TemporaryFile(dir=self.path.parent) as earlier:
            self._file.seek(0)
            shutil.copyfileobj(self._file, earlier)
            self._file.seek(0)
            self._file.truncate()
            collected, self._open = self._open, defaultdict(dict)
            self._entries.clear()
            self._samples_per_chunk //= 2
            for chunk, parts in collected.items():
                for stream in [*parts]:  # one by one: a second copy of all would not fit
                    self._collect([_joined(parts.pop(stream))], chunk * size)
            self._archive = zipfile.ZipFile(self._file, "w")
            self._put_header()
            with zipfile.ZipFile(earlier) as archive:
                for chunk in chunks:
                    cursor = codec.Cursor(archive.read(layout.chunk_name(chunk)), str(self.path))
                    sections = read_sections(cursor, self.header, size, self.full_precision)
                    self._collect(sections, chunk * size)
                    self._write_collected((chunk + 1) * size)

    def _put_chunk(self, chunk: int, content: bytes) -> None:
        """Write the encoded content of chunk number ``chunk``; the number goes to the index."""
        self._put(layout.chunk_name(chunk), content, layout.MAX_CHUNK_BYTES)
        self._chunks.append(chunk)
        self._end = (chunk + 1) * self._samples_per_chunk

    def _put(self, name: str, content: bytes, limit: int) -> None:
        """Write a deflated ZIP entry with a fixed date and mode; raises OutputError above ``limit``
        bytes."""
        if len(content) > limit:
            raise OutputError(
                f"{self.path}: {name} would be {len(content)} bytes, a track allows {limit}."
            )
        # No date, so that equal recordings are equal files.
        entry = zipfile.ZipInfo(name, _ZIP_EPOCH)
        entry.create_system = 3  # equal bytes on every system
        entry.external_attr = 0o644 << 16
        entry.compress_type = zipfile.ZIP_DEFLATED
        self._archive.writestr(entry, content)


def _encoded(sections: Sequence[codec.Section]) -> bytes | None:
    """Encoded chunk; None if it has too many contacts or bytes for a reader."""
    # Counts first: encoding a chunk that no reader accepts takes long.
    entries = sum(len(section.vertices) for section in sections)
    if entries > codec.MAX_SET_ENTRIES or any(
        part.entry_count > codec.MAX_ENTRIES for part in sections
    ):
        return None
    content = b"".join(map(codec.encode, sections))
    return content if len(content) <= layout.MAX_CHUNK_BYTES else None


def _section_of(
    run: SampleRun, weights: npt.NDArray[Any], rows: slice, before: Sequence[codec.Section]
) -> codec.Section:
    """Copies of some ``rows`` of a checked run as a part of a section with the parts ``before``;
    sets equal to the set before are left out. ``weights`` are the stored weights of the whole run.
    Stream 0, and steps from sample 0. Raises ValueError if the channels differ from those
    before."""
    present = {name for name in codec.CHANNELS if getattr(run, name) is not None}
    if before and present != before[-1].channels.keys():
        raise ValueError(f"effect '{run.stream.effect_id}': channels change within a chunk")
    # Only the sets of these samples, cut out of the run's shared entries.
    sets = run.set_of[rows]
    offsets = run.offsets[sets[0] : sets[-1] + 2]
    entries = slice(int(offsets[0]), int(offsets[-1]))
    sizes, weights = np.diff(offsets), weights[entries]
    vertices = run.vertices[entries].astype(np.int32)
    is_new = np.diff(sets, prepend=-1) != 0
    if not present:  # with channels every sample has its own set
        stays = codec.repeated_sets(offsets - offsets[0], vertices, weights)
        # The first set is compared with the last one before.
        last = next((part for part in reversed(before) if len(part.sizes)), None)
        if last is not None and last.sizes[-1] == sizes[0]:
            old, new = slice(len(last.vertices) - int(sizes[0]), None), slice(int(sizes[0]))
            pairs = (last.vertices, vertices), (last.weights, weights)
            stays[0] = all(np.array_equal(one[old], two[new]) for one, two in pairs)
        is_new &= ~stays[sets - sets[0]]
        entering = np.repeat(~stays, sizes)
        sizes, vertices, weights = sizes[~stays], vertices[entering], weights[entering]
    # Copies, made by astype(): the caller may reuse its arrays.
    return codec.Section(
        stream=0,
        steps=run.indices[rows].astype(np.int64),
        levels=run.levels[rows].astype(np.float64),
        parameters=run.parameters[rows].astype(np.float64),
        is_new=is_new,
        sizes=sizes,
        vertices=vertices,
        weights=weights.copy(),
        channels={
            name: getattr(run, name)[entries].astype(np.float32).reshape(-1, codec.CHANNELS[name])
            for name in present
        },
        focus=None if run.focus is None else run.focus[rows].astype(np.float32),
        drive=None if run.drive is None else run.drive.values[rows].astype(np.float32),
    )


def _joined(parts: Sequence[codec.Section]) -> codec.Section:
    """Join parts of a section, in order of time."""
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name, column in vars(parts[0]).items()
        if isinstance(column, np.ndarray)
    }
    columns["vertices"] = columns["vertices"].astype(np.int32)
    channels = {n: np.concatenate([part.channels[n] for part in parts]) for n in parts[0].channels}
    return replace(parts[0], channels=channels, **columns)


def _check_rows(run: SampleRun, effect: TrackEffect) -> None:
    """Raise ValueError unless a run has a focus exactly for spots and a drive exactly for actuator
    effects: finite (n, 4) with radius >= 0; 0..1 (n, A) for the effect's device and actuators."""
    if (run.focus is not None) != (effect.kind == "spot"):
        raise ValueError(f"effect '{effect.id}': a spot, and nothing else, has a focus")
    if run.focus is not None:
        good = run.focus.shape == (len(run), codec.FOCUS_COLUMNS) and np.isfinite(run.focus).all()
        if not good or (run.focus[:, 3] < 0.0).any():
            raise ValueError("focus: expected a finite place and a radius for each sample")
    if (run.drive is not None) != (effect.kind == "actuators"):
        raise ValueError(f"effect '{effect.id}': only one of kind 'actuators' drives any")
    if run.drive is not None:
        values = run.drive.values
        if (run.drive.device_id, run.drive.actuators) != (effect.device_id, effect.actuators):
            raise ValueError(f"effect '{effect.id}': drives other actuators than it says")
        if values.shape != (len(run), len(effect.actuators)) or not (
            ((values >= 0.0) & (values <= 1.0)).all()
        ):
            raise ValueError("drive: expected a value in 0..1 for each sample and actuator")


def _check_run(run: SampleRun, header: TrackHeader, vertex_count: int) -> None:
    """Raise ValueError if a run breaks the contract of :class:`SampleRun`, in sets, times,
    vertices, focus or drive, and for channels of wrong shape or not finite. Returns nothing."""
    _check_sets(run)
    _check_times(run, header)
    _check_vertices(run, vertex_count)
    _check_rows(run, header.effect(run.stream))
    total = len(run.vertices)
    for name, columns in codec.CHANNELS.items():
        values = getattr(run, name)
        if values is not None:
            shape = (total,) if columns == 1 else (total, columns)
            if values.shape != shape or not np.isfinite(values).all():
                raise ValueError(f"{name}: expected finite values of shape {shape}")


def _check_sets(run: SampleRun) -> None:
    """Raise ValueError for columns of unequal length, set numbers that do not start at 0 and rise
    by 0 or 1, shared sets with channels, and offsets that do not divide the vertices."""
    count = len(run)
    parameters = len(MODALITIES[run.stream.modality].parameters)
    if not (
        run.levels.shape == run.times_s.shape == run.indices.shape == (count,)
        and run.parameters.shape == (count, parameters)
        and run.set_of.shape == (count,)
        and run.offsets.shape == (int(run.set_of[-1]) + 2,)
    ):
        raise ValueError(f"effect '{run.stream.effect_id}': columns of unequal length")
    steps = np.diff(run.set_of)
    if run.set_of[0] != 0 or not ((steps == 0) | (steps == 1)).all():
        raise ValueError("sets: expected a number from 0 for each sample, rising by 0 or 1")
    if run.sets is not None and any(getattr(run, name) is not None for name in codec.CHANNELS):
        raise ValueError("positions, velocities, depth and forces need a set for each sample")
    sizes = np.diff(run.offsets)
    if run.offsets[0] != 0 or run.offsets[-1] != len(run.vertices) or (sizes < 0).any():
        raise ValueError("offsets do not cut the vertices into samples")


def _check_times(run: SampleRun, header: TrackHeader) -> None:
    """Raise ValueError unless sample indices ascend within the time base, times agree within 1 ns,
    levels are in (0, 1] and parameters finite."""
    if (np.diff(run.indices) <= 0).any() or not 0 <= run.indices[0]:
        raise ValueError("sample indices do not ascend from 0")
    if run.indices[-1] >= header.time.sample_count:
        raise ValueError(f"sample {run.indices[-1]} is outside the time base")
    # Negated, so that NaN fails, too; as in the comparisons below.
    away_s = np.abs(run.times_s - header.time.times_s(run.indices))
    if not (away_s <= _TIME_TOLERANCE_S).all():
        raise ValueError("times differ from those of the time base")
    if not ((run.levels > 0.0) & (run.levels <= 1.0)).all():
        raise ValueError("a level is not in (0, 1]")
    if not np.isfinite(run.parameters).all():
        raise ValueError("a parameter is not finite")


def _check_vertices(run: SampleRun, vertex_count: int) -> None:
    """Raise ValueError unless each vertex has a weight in (0, 1], and vertex ids are 0 to
    ``vertex_count - 1`` and strictly ascending within each set. Returns nothing."""
    total = len(run.vertices)
    if run.weights.shape != (total,) or not ((run.weights > 0.0) & (run.weights <= 1.0)).all():
        raise ValueError("weights: expected one in (0, 1] for each vertex")
    # Ids ascend within each set, but may fall from set to set.
    ascending = np.diff(run.vertices) > 0
    edges = run.offsets[1:-1]
    ascending[edges[(edges > 0) & (edges < total)] - 1] = True
    if not ascending.all():
        raise ValueError("vertices do not ascend within a sample")
    if total and not (run.vertices.min() >= 0 and run.vertices.max() < vertex_count):
        raise ValueError(f"a vertex is not in the model's {vertex_count}")
