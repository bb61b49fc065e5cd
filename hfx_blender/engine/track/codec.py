# SPDX-License-Identifier: GPL-3.0-or-later
"""Codec of the columns of a HapticTrack: one stream's samples within one chunk.

What changes little from sample to sample is stored as its change: a vertex set as the ids that
enter or leave, a weight as the difference to the same vertex's weight before. The bytes of
wider numbers are grouped by significance. The zeros that this leaves are what deflate removes.
``docs/track-format.md`` describes the layout.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...files import limits
from ..arrays import F32, F64, I32, I64, Bool
from ..native import track as native

Unsigned = npt.NDArray[np.unsignedinteger[Any]]

_ENTRY_BYTES: Final = 64  # upper bound of memory for a (set, vertex) pair while it is unpacked

MAX_ENTRIES: Final = 2**25
"""Largest number of (sample, vertex) pairs of one stream in one chunk."""

MAX_SET_ENTRIES: Final = int(limits.MEMORY.default) // _ENTRY_BYTES
"""Largest number of (set, vertex) pairs of all streams in one chunk, which a reader has to hold."""

CHANNELS: Final = {"positions": 3, "velocities": 3, "depth_m": 1}
"""Optional values at each vertex, and how many numbers each has; bit ``k`` of the flags."""

FOCUS_COLUMNS: Final = 4
_FOCUS: Final = 1 << len(CHANNELS)  # flag of a column set with a row for each sample
_DRIVE: Final = _FOCUS << 1

_HEAD = struct.Struct("<III")  # stream, samples, channel flags
_WEIGHT_OF_BYTE: Final = (np.arange(256) / 255.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Section:
    """Samples of one stream within one chunk; equal successive sets are stored once.

    With channels, every sample has a set of its own.
    """

    stream: int
    steps: I64  # (n,) sample index minus the chunk's first, ascending
    levels: F64  # (n,)
    parameters: F64  # (n, P)
    is_new: Bool  # (n,) whether the sample's set differs from the one before
    sizes: I64  # (m,) vertices of each set, m = count of is_new
    vertices: I32  # (s,) set after set, ascending within each
    weights: npt.NDArray[Any]  # (s,) uint8 (times 255) or float32
    channels: Mapping[str, F32] = field(default_factory=dict)  # (s, CHANNELS[name])
    focus: F32 | None = None  # (n, FOCUS_COLUMNS)
    drive: F32 | None = None  # (n, A)

    def parts(self, size: int) -> Iterator[tuple[int, Section]]:
        """Yield (number, section) for each ``size`` successive steps that hold a sample, ascending.

        Steps count from the first step of a part; its first sample always brings its set.
        """
        set_of = np.cumsum(self.is_new) - 1
        offsets = np.concatenate(([0], np.cumsum(self.sizes)))
        numbers = self.steps // size
        edges = np.flatnonzero(np.diff(numbers, prepend=-1, append=-1))
        for first, last in pairwise(edges.tolist()):
            rows = slice(first, last)
            sets = slice(int(set_of[first]), int(set_of[last - 1]) + 1)
            entries = slice(int(offsets[sets.start]), int(offsets[sets.stop]))
            is_new = self.is_new[rows].copy()
            is_new[0] = True
            number = int(numbers[first])
            yield (
                number,
                Section(
                    stream=self.stream,
                    steps=self.steps[rows] - number * size,
                    levels=self.levels[rows],
                    parameters=self.parameters[rows],
                    is_new=is_new,
                    sizes=self.sizes[sets],
                    vertices=self.vertices[entries],
                    weights=self.weights[entries],
                    channels={name: values[entries] for name, values in self.channels.items()},
                    focus=None if self.focus is None else self.focus[rows],
                    drive=None if self.drive is None else self.drive[rows],
                ),
            )

    @property
    def entry_count(self) -> int:
        """Number of (sample, vertex) pairs."""
        return int(self.sizes[np.cumsum(self.is_new) - 1].sum())


def encode_weights(weights: F32) -> npt.NDArray[np.uint8]:
    """Encode weights in (0, 1] as 1..255: no contact becomes 0."""
    steps: F64 = np.multiply(weights, 255.0, dtype=np.float64)
    np.maximum(np.rint(steps, out=steps), 1.0, out=steps)
    return steps.astype(np.uint8)


def decode_weights(stored: npt.NDArray[np.uint8]) -> F32:
    """Decode weights to (0, 1], exactly as :func:`encode_weights` rounded them."""
    weights: F32 = _WEIGHT_OF_BYTE[stored]
    return weights


def encode(section: Section) -> bytes:
    """Encode a section into the bytes that :func:`decode` reads."""
    flags = sum(1 << k for k, name in enumerate(CHANNELS) if name in section.channels)
    flags |= _FOCUS * (section.focus is not None) | _DRIVE * (section.drive is not None)
    counts, gaps, weights, channels = _set_columns(section)
    parts = [
        _HEAD.pack(section.stream, len(section.steps), flags),
        _planes(_changes(section.steps.astype(np.uint16))),
        section.is_new.astype(np.uint8).tobytes(),
        _planes(_changes(_bits(section.levels))),
        *(_planes(_changes(_bits(column))) for column in section.parameters.T),
        _planes(counts),
        _planes(gaps),
        _planes(weights),
        *map(_planes, channels),
    ]
    for rows in (section.focus, section.drive):
        if rows is not None:
            parts += [_planes(_changes(_bits(column))) for column in rows.T]
    return b"".join(parts)


def _set_columns(section: Section) -> tuple[Unsigned, Unsigned, Unsigned, list[Unsigned]]:
    """Toggles at each set and their ids (see :func:`_toggles`), weights and channels as changes."""
    if section.weights.dtype == np.uint8 and not section.channels:
        found = native.changes(section.sizes, section.vertices, section.weights)
        if found is not None:
            return (*found, [])
    owners = np.repeat(np.arange(len(section.sizes)), section.sizes)
    order = np.argsort(section.vertices, kind="stable")
    counts, gaps = _toggles(section.vertices[order], owners[order], len(section.sizes))
    starts = _group_starts(section.vertices[order])
    columns = [section.channels[n] for n in CHANNELS if n in section.channels]
    weights, *channels = (
        _changes_per_vertex(_bits(column), order, starts)
        for column in (section.weights, *(column for each in columns for column in each.T))
    )
    return counts, gaps, weights, channels


class Cursor:
    """Read position in a chunk's bytes that never leaves them."""

    def __init__(self, content: bytes, name: str = "a track") -> None:
        self._content = content
        self._at = 0
        self._name = name
        self._entries = 0

    def count(self, entries: int) -> None:
        """Count (set, vertex) pairs of a section that is about to be unpacked.

        Raises
        ------
        TooLargeError
            With those of the chunk's sections before they are more than a file may ask for.
        """
        self._entries += entries
        most_bytes = float(_ENTRY_BYTES * self._entries)
        limits.MEMORY.check(most_bytes, self._name, "contacts of one chunk would take")

    @property
    def at_end(self) -> bool:
        """End of the bytes: everything has been read."""
        return self._at == len(self._content)

    def take(self, size: int) -> bytes:
        """The next ``size`` bytes. Raises ValueError if there are fewer."""
        if size > len(self._content) - self._at:
            raise ValueError("a chunk ends within a column")
        self._at += size
        return self._content[self._at - size : self._at]

    def column(self, count: int, dtype: str) -> Unsigned:
        """The next ``count`` numbers, their bytes grouped by significance."""
        width = np.dtype(dtype).itemsize
        planes = np.frombuffer(self.take(count * width), np.uint8).reshape(width, count)
        return np.ascontiguousarray(planes.T).view(dtype).reshape(count)


def read_head(cursor: Cursor) -> tuple[int, int, int]:
    """Stream index, sample count and channel flags of the section that follows."""
    stream, samples, flags = _HEAD.unpack(cursor.take(_HEAD.size))
    return stream, samples, flags


def decode(
    cursor: Cursor,
    head: tuple[int, int, int],
    *,
    parameter_count: int,
    vertex_count: int,
    full_precision: bool,
    is_spot: bool = False,
    actuator_count: int = 0,
) -> Section:
    """The section at the cursor, checked.

    Raises
    ------
    ValueError
        The bytes are not such a section; the message says why.
    """
    stream, samples, flags = head
    _require(samples > 0, "a section has no samples")
    _require(flags < _DRIVE << 1, "a section has unknown channels")
    fits = bool(flags & _FOCUS) == is_spot and bool(flags & _DRIVE) == (actuator_count > 0)
    _require(fits, "a section has not the channels of its effect's kind")
    steps = np.cumsum(cursor.column(samples, "<u2"), dtype=np.int64)
    _require(bool(np.all(np.diff(steps) > 0)), "samples are not in time order")
    new = np.frombuffer(cursor.take(samples), np.uint8)
    _require(bool(np.all(new <= 1) and new[0] == 1), "a sample has no vertex set")
    levels = _sums(cursor.column(samples, "<u8")).view(np.float64)
    _require(bool(np.all((levels > 0.0) & (levels <= 1.0))), "a level is not in 0..1")
    parameters = np.zeros((samples, parameter_count))
    for column in range(parameter_count):
        parameters[:, column] = _sums(cursor.column(samples, "<u8")).view(np.float64)
    _require(bool(np.isfinite(parameters).all()), "a parameter is not a finite number")

    is_new = new.astype(np.bool_)
    sizes, vertices, order = _read_sets(cursor, is_new, vertex_count)
    starts = _group_starts(vertices[order])
    width = "<u4" if full_precision else "<u1"
    weights: npt.NDArray[Any] = _sums_per_vertex(cursor.column(len(vertices), width), order, starts)
    if full_precision:
        weights = weights.view(np.float32)
    heaviest = 1.0 if full_precision else 255
    _require(bool(np.all((weights > 0) & (weights <= heaviest))), "a weight is not in 0..1")
    channels = {}
    for k, (name, columns) in enumerate(CHANNELS.items()):
        if flags & 1 << k:
            values = np.zeros((len(vertices), columns), np.float32)
            for column in range(columns):
                bits = _sums_per_vertex(cursor.column(len(vertices), "<u4"), order, starts)
                values[:, column] = bits.view(np.float32)
            _require(bool(np.isfinite(values).all()), f"{name} holds something not finite")
            channels[name] = values
    _require(not channels or bool(is_new.all()), "channels without a set for every sample")
    focus = _rows(cursor, samples, FOCUS_COLUMNS) if flags & _FOCUS else None
    _require(focus is None or bool((focus[:, 3] >= 0.0).all()), "a spot has a negative radius")
    drive = _rows(cursor, samples, actuator_count) if flags & _DRIVE else None
    if drive is not None:
        _require(bool(((drive >= 0.0) & (drive <= 1.0)).all()), "an actuator is not in 0..1")
    return Section(
        stream, steps, levels, parameters, is_new, sizes, vertices, weights, channels, focus, drive
    )


def _rows(cursor: Cursor, samples: int, columns: int) -> F32:
    """Finite values (samples, columns)."""
    values = np.zeros((samples, columns), np.float32)
    for column in range(columns):
        values[:, column] = _sums(cursor.column(samples, "<u4")).view(np.float32)
    _require(bool(np.isfinite(values).all()), "a place or an actuator is not a finite number")
    return values


def _require(condition: bool, complaint: str) -> None:
    if not condition:
        raise ValueError(complaint)


def _toggles(vertices: I32, owners: I64, set_count: int) -> tuple[Unsigned, Unsigned]:
    """Ids that enter or leave at each set, starting from none.

    ``vertices`` and the sets that hold them, ``owners``, are sorted by vertex, then by set.
    Returns how many toggle at each set, and their ids as differences, ascending in each set.
    """
    follows = (np.diff(vertices) == 0) & (np.diff(owners) == 1)
    enters = np.ones(len(vertices), np.bool_)
    enters[1:] = ~follows
    leaves = owners + 1 < set_count
    leaves[:-1] &= ~follows
    ids = np.concatenate((vertices[enters], vertices[leaves]))
    sets = np.concatenate((owners[enters], owners[leaves] + 1))
    order = np.lexsort((ids, sets))
    ids, sets = ids[order], sets[order]
    gaps = np.diff(ids, prepend=np.int32(0))
    starts = _group_starts(sets)
    gaps[starts] = ids[starts]
    return np.bincount(sets, minlength=set_count).astype(np.uint32), gaps.astype(np.uint32)


def _read_sets(cursor: Cursor, is_new: Bool, vertex_count: int) -> tuple[I64, I32, I64]:
    """Read the sizes of the sets, their vertices, and their order by vertex, then by set."""
    set_count = int(is_new.sum())
    counts = cursor.column(set_count, "<u4").astype(np.int64)
    gaps = cursor.column(int(counts.sum()), "<u4").astype(np.int64)
    ids = np.cumsum(gaps)
    starts = np.cumsum(counts) - counts
    starts, filled = starts[counts > 0], counts[counts > 0]
    ids -= np.repeat(ids[starts] - gaps[starts], filled)
    ascending = np.diff(ids) > 0
    ascending[starts[1:] - 1] = True
    _require(bool(np.all(ascending)), "vertex ids do not ascend")
    _require(bool(np.all(ids < vertex_count)), "a vertex id is not in its model")

    # By vertex, then by set: it enters, leaves, enters...; what does not leave stays to the end.
    sets = np.repeat(np.arange(set_count), counts)
    order = np.argsort(ids, kind="stable")
    ids, sets = ids[order], sets[order]
    groups = _group_starts(ids)
    rank = np.arange(len(ids)) - np.repeat(groups, np.diff(groups, append=len(ids)))
    until = np.full(len(ids), set_count)
    until[:-1][np.diff(ids) == 0] = sets[1:][np.diff(ids) == 0]
    enters = rank % 2 == 0
    first, lasts = sets[enters], (until - sets)[enters]

    # Both sums are exact and bounded by toggles * sets, before anything of that size is made.
    uses = np.diff(np.flatnonzero(is_new), append=len(is_new))  # samples that share each set
    uses_before = np.concatenate(([0], np.cumsum(uses)))
    entries = int((uses_before[first + lasts] - uses_before[first]).sum())
    _require(entries <= MAX_ENTRIES, f"a section has more than {MAX_ENTRIES} contacts")
    total = int(lasts.sum())
    cursor.count(total)

    before = np.cumsum(lasts) - lasts
    owners = np.repeat(first - before, lasts) + np.arange(total)
    by_set = np.argsort(owners.astype(np.uint16), kind="stable")
    vertices = np.repeat(ids[enters], lasts)[by_set].astype(np.int32)
    by_vertex = np.zeros(total, np.int64)
    by_vertex[by_set] = np.arange(total)
    return np.bincount(owners, minlength=set_count), vertices, by_vertex


def _group_starts(sorted_values: npt.NDArray[Any]) -> I64:
    """Start of each group of equal values, (groups,)."""
    is_start = np.ones(len(sorted_values), np.bool_)
    is_start[1:] = sorted_values[1:] != sorted_values[:-1]
    return np.flatnonzero(is_start)


def _bits(values: npt.NDArray[Any]) -> Unsigned:
    """Numbers as unsigned integers with the same bits."""
    contiguous = np.ascontiguousarray(values)
    return contiguous.view(f"u{contiguous.dtype.itemsize}")


def _changes(values: Unsigned) -> Unsigned:
    """Differences to the value before, modulo the range; the first to 0."""
    return np.diff(values, prepend=values.dtype.type(0))


def _sums(changes: Unsigned) -> Unsigned:
    return np.cumsum(changes, dtype=changes.dtype)


def _changes_per_vertex(values: Unsigned, order: I64, starts: I64) -> Unsigned:
    """Differences to the last value of the same vertex in this section, 0 for the first."""
    ordered = values[order]
    changes = _changes(ordered)
    changes[starts] = ordered[starts]
    result = np.zeros_like(changes)
    result[order] = changes
    return result


def _sums_per_vertex(changes: Unsigned, order: I64, starts: I64) -> Unsigned:
    ordered = changes[order]
    sums = _sums(ordered)
    sums -= np.repeat(sums[starts] - ordered[starts], np.diff(starts, append=len(sums)))
    result = np.zeros_like(sums)
    result[order] = sums
    return result


def _planes(values: Unsigned) -> bytes:
    """Byte planes: all lowest bytes, then all second lowest, and so on."""
    width = values.dtype.itemsize
    little = values.astype(values.dtype.newbyteorder("<"), copy=False)
    return np.ascontiguousarray(little.view(np.uint8).reshape(-1, width).T).tobytes()
