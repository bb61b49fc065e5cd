# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading of HapticTracks from any time, with checks of all content."""

import math
import textwrap
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NoReturn, Self

import numpy as np

from ...errors import InputError, refuse_no_file
from ..arrays import NPZ_DAMAGE
from ..modality import MODALITIES
from ..samples import Drive, Sample, SampleRun, Stream
from ..stepwise import tell
from . import layout
from .codec import Cursor, Section, decode, decode_weights, read_head
from .header import TrackHeader
from .layout import from_json, parse_json, value_in

_ENCRYPTED: Final = 0x1  # flag of an encrypted ZIP entry

Content = tuple[TrackHeader, Mapping[str, Any], list[int], list[layout.StreamIndex]]
"""Header, encoding, numbers of the chunks with samples, and entry of each stream, of a track."""

_TIME_TOLERANCE: Final = 1e-6
"""Fraction of a sample by which a requested time may miss a sample's own float64 time."""


@dataclass(frozen=True)
class StreamSummary:
    """Summary of a stream of a track."""

    stream: Stream
    sample_count: int
    first_s: float | None  # None without samples
    last_s: float | None
    entry_count: int  # (sample, vertex) pairs
    peak_level: float
    channels: tuple[str, ...]


class TrackReader:
    """Reader of a track, and a context manager; no body model is needed.

    Attributes: ``header``; ``full_precision``, True for float32 weights as recorded, else multiples
    of 1/255; ``samples_per_chunk``; ``chunks``, ascending numbers of the chunks with samples;
    ``index``, the entry of each stream. Raises InputError for a file that is missing, no track, of
    a newer version or damaged; for damaged samples when read. With ``written``, the content
    of header and index of a track that was just written, neither is parsed.
    """

    def __init__(self, path: Path, written: Content | None = None) -> None:
        self.path = path
        refuse_no_file(path)
        try:
            self._archive = zipfile.ZipFile(path)
        except (PermissionError, IsADirectoryError) as error:
            raise InputError(f"{path}: cannot be read ({error.strerror}).") from error
        except NPZ_DAMAGE as error:
            raise InputError(f"{path}: not a HapticTrack, or cut short ({error}).") from error
        try:
            self.header, encoding, self.chunks, self.index = written or self._content()
            self.samples_per_chunk: int = encoding["samples_per_chunk"]
            self.full_precision: bool = encoding["weights"] == layout.WEIGHTS_FULL
            self._check_index()
        except ValueError as error:
            self._archive.close()
            self._fail(str(error))
        except BaseException:
            self._archive.close()
            raise
        self._cached: tuple[int, list[Section]] = (-1, [])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; later calls do nothing."""
        self._archive.close()

    def runs(self, start_s: float | None = None, end_s: float | None = None) -> Iterator[SampleRun]:
        """Yield samples with ``start_s <= time < end_s`` (None: no bound), chunk by chunk. Runs of
        a chunk are in the order of ``header.streams``, never empty. One chunk is held in memory,
        and only chunks in the range are read. Raises InputError for a damaged file."""
        # Times become sample indices once; a sample's own float time is never compared.
        count = self.header.time.sample_count
        first = 0 if start_s is None else self._first_at_or_after(start_s)
        stop = count if end_s is None else self._first_at_or_after(end_s)
        for chunk in self.chunks:
            low = chunk * self.samples_per_chunk
            if low < stop and first < low + self.samples_per_chunk:
                tell((max(low, first) - first) / max(stop - first, 1))
                for section in self.sections(chunk):
                    run = self._run(section, low, first, stop)
                    if len(run):
                        yield run

    def samples_at(self, time_s: float) -> list[Sample]:
        """Samples in effect at a time, in the order of ``header.streams``; a sample lasts until the
        next sample time. Raises InputError for a damaged file, ValueError for NaN."""
        return [sample for run in self.runs_at(time_s) for sample in run]

    def index_at(self, time_s: float) -> int:
        """Index of the sample in effect at a time; -1 before the first sample, the sample count
        after the last; raises ValueError for NaN."""
        return math.floor(self._position(time_s) + _TIME_TOLERANCE)

    def runs_at(self, time_s: float) -> list[SampleRun]:
        """Samples in effect at a time, as runs of one sample; empty without any. Raises InputError
        for a damaged file, ValueError for NaN."""
        index = self.index_at(time_s)
        chunk = index // self.samples_per_chunk
        if chunk not in self._chunk_set:
            return []
        # Reading forward needs the same chunk for many times in succession.
        if self._cached[0] != chunk:
            self._cached = (chunk, self.sections(chunk))
        low = chunk * self.samples_per_chunk
        runs = (self._run(section, low, index, index + 1) for section in self._cached[1])
        return [run for run in runs if len(run)]

    def summary(self) -> list[StreamSummary]:
        """Summaries of all streams in the order of ``header.streams``, from the index alone."""
        return [
            StreamSummary(
                stream=stream,
                sample_count=entry.samples,
                first_s=self._time_s(entry.first) if entry.samples else None,
                last_s=self._time_s(entry.last) if entry.samples else None,
                entry_count=entry.entries,
                peak_level=entry.peak_level,
                channels=entry.channels,
            )
            for stream, entry in zip(self.header.streams, self.index, strict=True)
        ]

    def _time_s(self, index: int) -> float:
        """Time of sample ``index``, seconds since the scene's start."""
        return float(self.header.time.times_s(np.array([index]))[0])

    def _position(self, time_s: float) -> float:
        """Fractional sample index of a time, clamped to -1..sample count; ValueError for NaN."""
        if math.isnan(time_s):
            raise ValueError("the time is not a number")
        time = self.header.time
        position = (time_s - self._time_s(0)) * float(time.rate_hz)
        return min(max(position, -1.0), float(time.sample_count))

    def _first_at_or_after(self, time_s: float) -> int:
        """Index of the first sample at or after a time (a millionth of a sample earlier counts); 0
        to the sample count."""
        return math.ceil(self._position(time_s) - _TIME_TOLERANCE)

    def _run(self, section: Section, low: int, first: int, stop: int) -> SampleRun:
        """Samples of a section with ``first <= index < stop``, as a possibly empty run; ``low`` is
        the index of the chunk's first sample."""
        indices = low + section.steps
        rows = slice(*np.searchsorted(indices, (first, stop)))
        sets = np.cumsum(section.is_new)[rows] - 1
        # Sets of the selected samples only: entries from the first used set to the last.
        used = slice(int(sets[0]), int(sets[-1]) + 1) if len(sets) else slice(0, 0)
        set_starts = np.cumsum(section.sizes) - section.sizes
        start = int(set_starts[used][0]) if len(sets) else 0
        offsets = np.concatenate(([0], np.cumsum(section.sizes[used])))
        picked = slice(start, start + int(offsets[-1]))
        # Weights stay bytes up to here: most samples of a chunk are not in a short range.
        weights = section.weights[picked]
        channels = {name: values[picked] for name, values in section.channels.items()}
        stream, drive = self.header.streams[section.stream], None
        if section.drive is not None:
            effect = self.header.effect(stream)
            assert effect.device_id is not None
            drive = Drive(effect.device_id, effect.actuators, section.drive[rows])
        return SampleRun(
            stream=stream,
            indices=indices[rows],
            times_s=self.header.time.times_s(indices[rows]),
            levels=section.levels[rows],
            parameters=section.parameters[rows],
            offsets=offsets,
            vertices=section.vertices[picked],
            weights=weights if self.full_precision else decode_weights(weights),
            sets=None if channels else sets - used.start,
            positions=channels.get("positions"),
            velocities=channels.get("velocities"),
            depth_m=channels["depth_m"][:, 0] if "depth_m" in channels else None,
            forces_n=channels.get("forces_n"),
            focus=None if section.focus is None else section.focus[rows],
            drive=drive,
        )

    def chunk_bytes(self, chunk: int) -> bytes:
        """Uncompressed bytes of a chunk after a full check; InputError for a damaged file."""
        self.sections(chunk)
        return self._entry(layout.chunk_name(chunk), layout.MAX_CHUNK_BYTES)

    def sections(self, chunk: int) -> list[Section]:
        """Decoded sections of the streams with samples in chunk number ``chunk``, in the order of
        ``header.streams``; raises
        InputError for a damaged file, and for samples outside the stream's index entry."""
        name = layout.chunk_name(chunk)
        cursor = Cursor(self._entry(name, layout.MAX_CHUNK_BYTES), str(self.path))
        low = chunk * self.samples_per_chunk
        try:
            sections = list(
                read_sections(cursor, self.header, self.samples_per_chunk, self.full_precision)
            )
            # The index of a whole track is trusted by summaries, so it must agree.
            for section in sections:
                index = self.index[section.stream]
                if low + section.steps[0] < index.first or low + section.steps[-1] > index.last:
                    raise ValueError(
                        f"a sample of stream {section.stream} lies where there is none"
                    )
        except ValueError as error:
            self._fail(f"{name}: {error}")
        return sections

    def _content(self) -> Content:
        """Content of header and index; raises InputError without header, ValueError for damage."""
        if layout.HEADER not in self._archive.namelist():
            self._fail(f"it has no {layout.HEADER}")
        header, encoding = from_json(self._entry(layout.HEADER, layout.MAX_JSON_BYTES))
        storage = value_in(encoding, layout.STORAGE, "encoding")
        document = parse_json(self._entry(layout.INDEX, layout.MAX_JSON_BYTES), "index")
        index = value_in(document, layout.INDEX_SHAPE, "index")
        return header, storage, list(index["chunks"]), list(index["streams"])

    def _check_index(self) -> None:
        """Raise InputError unless the index has exactly the file's chunks, the header's streams,
        and sample numbers within the time base. Sets the known chunks."""
        # A chunk missing from the index would be skipped without a word.
        names = [name for name in self._archive.namelist() if name.startswith("chunks/")]
        if sorted(names) != sorted(map(layout.chunk_name, self.chunks)):
            self._fail("the index and the chunks differ")
        if len(self.index) != len(self.header.streams):
            self._fail("the index and the header have different streams")
        count = self.header.time.sample_count
        if any(
            entry.samples and not 0 <= entry.first <= entry.last < count for entry in self.index
        ) or any(chunk < 0 or chunk * self.samples_per_chunk >= count for chunk in self.chunks):
            self._fail("the index names samples outside the time base")
        self._chunk_set = frozenset(self.chunks)

    def _entry(self, name: str, limit: int) -> bytes:
        """Content of the ZIP entry ``name``; raises InputError if missing, encrypted, damaged,
        unknown compression, or above ``limit`` bytes unpacked."""
        try:
            info = self._archive.getinfo(name)
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError("it is compressed in an unknown way")
            if info.flag_bits & _ENCRYPTED:
                raise ValueError("it is encrypted")
            # Checked before unpacking, as a small file may claim to hold any number of bytes.
            if info.file_size > limit:
                raise ValueError(f"it claims {info.file_size} bytes, at most {limit} are allowed")
            content = self._archive.read(info)
            if len(content) != info.file_size:
                raise ValueError("it is cut short")
            return content
        except NPZ_DAMAGE as error:
            self._fail(f"{name}: {error}")

    def _fail(self, reason: str) -> NoReturn:
        """Raise InputError with the path and a reason, shortened to 200 characters."""
        reason = textwrap.shorten(reason, 200)  # zipfile quotes file names of any length
        raise InputError(f"{self.path}: not a readable HapticTrack ({reason}).")


def read_sections(
    cursor: Cursor, header: TrackHeader, samples_per_chunk: int, full_precision: bool
) -> Iterator[Section]:
    """Yield the decoded sections of a chunk up to the end of the bytes, streams ascending. Raises
    ValueError if the bytes are no such chunk, and TooLargeError if the contacts would take more
    memory than :data:`.limits.MEMORY`."""
    last = -1
    while not cursor.at_end:
        head = read_head(cursor)
        stream, samples, _ = head
        # Checked before decoding, as both decide how many bytes and numbers are read.
        if not last < stream < len(header.streams):
            raise ValueError(f"stream {stream} is not expected here")
        if samples > samples_per_chunk:
            raise ValueError(f"{samples} samples do not fit into a chunk")
        effect = header.effect(header.streams[stream])
        section = decode(
            cursor,
            head,
            parameter_count=len(MODALITIES[effect.modality].parameters),
            vertex_count=header.vertex_count(header.streams[stream]),
            full_precision=full_precision,
            is_spot=effect.kind == "spot",
            actuator_count=len(effect.actuators),
        )
        if section.steps[-1] >= samples_per_chunk:
            raise ValueError(f"a sample of stream {stream} lies where there is none")
        yield section
        last = stream
