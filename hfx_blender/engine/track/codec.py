# SPDX-License-Identifier: GPL-3.0-or-later
"""Codec of a HapticTrack's columns: a stream's samples within a chunk.

Slowly varying values are stored as changes: a vertex set as entering and leaving ids, a weight as
the difference from the same vertex's last weight. Bytes of wider numbers are grouped by
significance. Deflate removes the resulting zeros. The layout is described in
``docs/track-format.md``.
"""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...files import limits
from ..arrays import F32, F64, I32, I64, Bool
from ..native.library import library

Unsigned = npt.NDArray[np.unsignedinteger[Any]]

_ENTRY_BYTES: Final = 64  # memory bound of an unpacked (set, vertex) pair

MAX_ENTRIES: Final = 2**25  # largest number of (sample, vertex) pairs of a stream in a chunk
MAX_SET_ENTRIES: Final = int(limits.MEMORY.default) // _ENTRY_BYTES
"""Largest number of (set, vertex) pairs of all streams in a chunk; a reader's memory bound."""

CHANNELS: Final = {"positions": 3, "velocities": 3, "depth_m": 1, "forces_n": 3}
"""Optional channels of vertices and their widths, in the order of the file."""

FOCUS_COLUMNS: Final = 4
_FOCUS, _DRIVE = 1 << 3, 1 << 4  # flags of the columns of a spot, and of actuators
_FLAGS: Final = {"positions": 1, "velocities": 1 << 1, "depth_m": 1 << 2, "forces_n": 1 << 5}

_HEAD = struct.Struct("<III")  # stream, samples, channel flags
_WEIGHT_OF_BYTE: Final = (np.arange(256) / 255.0).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Section:
    """Samples of a stream within a chunk; equal successive sets are stored once. With channels,
    every sample has its own set."""

    stream: int
    steps: I64  # (n,) sample index minus the chunk's first index, ascending
    levels: F64  # (n,)
    parameters: F64  # (n, P)
    is_new: Bool  # (n,) True for samples with another set than the sample before
    sizes: I64  # (m,) vertices of each set, m = number of True in is_new
    vertices: I32  # (s,) sets in order, ids ascending within each
    weights: npt.NDArray[Any]  # (s,) uint8 (times 255) or float32
    channels: Mapping[str, F32] = field(default_factory=dict)  # (s, CHANNELS[name])
    focus: F32 | None = None  # (n, FOCUS_COLUMNS); None unless a spot
    drive: F32 | None = None  # (n, A); None unless actuators

    def parts(self, size: int) -> "Iterator[tuple[int, Section]]":
        """Yield (number, section) for each group of ``size`` steps with samples, ascending. Steps
        are relative to the group's first step. The first sample of a part always has a new set."""
        # Rows, then sets, then (set, vertex) entries of each part.
        set_of = np.cumsum(self.is_new) - 1
        offsets = np.concatenate(([0], np.cumsum(self.sizes)))
        numbers = self.steps // size
        # -1 is no number of a part: both ends become edges, too.
        edges = np.flatnonzero(np.diff(numbers, prepend=-1, append=-1))
        for first, last in pairwise(edges.tolist()):
            rows = slice(first, last)
            sets = slice(int(set_of[first]), int(set_of[last - 1]) + 1)
            entries = slice(int(offsets[sets.start]), int(offsets[sets.stop]))
            is_new = self.is_new[rows].copy()
            is_new[0] = True
            number = int(numbers[first])
            part = replace(
                self,
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
            )
            yield number, part

    @property
    def entry_count(self) -> int:
        """Number of (sample, vertex) pairs."""
        return int(self.sizes[np.cumsum(self.is_new) - 1].sum())


def encode_weights(weights: F32) -> npt.NDArray[np.uint8]:
    """Weights in (0, 1] as uint8: the nearest multiple of 1/255, at least 1."""
    # At least 1, so that a weak contact stays a contact. float64: 255 times a float32 is rounded.
    steps: F64 = np.multiply(weights, 255.0, dtype=np.float64)
    np.maximum(np.rint(steps, out=steps), 1.0, out=steps)
    return steps.astype(np.uint8)


def decode_weights(stored: npt.NDArray[np.uint8]) -> F32:
    """Weights in (0, 1] from 1..255: k / 255 as float32."""
    return np.asarray(_WEIGHT_OF_BYTE[stored])


def encode(section: Section) -> bytes:
    """Bytes of a section for :func:`decode`: head, then byte planes of all columns."""
    # Column after column: equal bytes of similar numbers are adjacent, which Deflate needs.
    flags = sum(flag for name, flag in _FLAGS.items() if name in section.channels)
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
    """Counts and gaps of vertex ids that enter or leave each of m sets, as of :func:`_toggles`, and
    columns (s,) of weights and channels, one value per (set, vertex) entry, as differences of bit
    patterns from the same vertex's last entry."""
    compiled = _compiled_columns(section)
    if compiled is not None:
        return compiled
    # Sorted by vertex, the entry before is the same vertex in an earlier set, or another vertex.
    owners = np.repeat(np.arange(len(section.sizes)), section.sizes)
    order = np.argsort(section.vertices, kind="stable")
    counts, gaps = _toggles(section.vertices[order], owners[order], len(section.sizes))
    starts = _group_starts(section.vertices[order])
    columns = [section.channels[n] for n in CHANNELS if n in section.channels]
    weights, *channels = (
        _changes_per_vertex(_bits(column), order, starts)
        for column in (section.weights, *(column for channel in columns for column in channel.T))
    )
    return counts, gaps, weights, channels


def _compiled_columns(
    section: Section,
) -> tuple[Unsigned, Unsigned, Unsigned, list[Unsigned]] | None:
    """Columns of :func:`_set_columns` by ``track.c``, the common case; None without the library,
    with channels, with weights other than bytes, or for a negative vertex id."""
    sizes, vertices, weights, native = section.sizes, section.vertices, section.weights, library()
    if native is None or section.channels or weights.dtype != np.uint8:
        return None
    if len(vertices) and int(vertices.min()) < 0:
        return None
    last = np.zeros(int(vertices.max(initial=0)) + 1, np.uint8)  # weight of each vertex; 0 at first
    counts, gaps = np.zeros(len(sizes), np.uint32), np.zeros(2 * len(vertices), np.uint32)
    differences = np.zeros(len(vertices), np.uint8)
    arrays = sizes, vertices, weights, last, counts, gaps, differences
    total = native.hfx_track_changes(len(sizes), *arrays)
    return counts, gaps[:total], differences, []


def repeated_sets(offsets: I64, vertices: I32, weights: npt.NDArray[Any]) -> Bool:
    """Mask (m,) of sets equal to the set before, False for the first. Set j has the entries
    ``slice(offsets[j], offsets[j + 1])`` of ``vertices`` and ``weights`` (total,); weights of any
    type are compared."""
    same, native = np.zeros(len(offsets) - 1, np.bool_), library()
    if native is None:
        parts = [slice(a, b) for a, b in pairwise(offsets.tolist())]
        for k, (a, b) in enumerate(pairwise(parts), start=1):
            columns = vertices, weights
            same[k] = all(np.array_equal(column[a], column[b]) for column in columns)
    else:
        width = weights.dtype.itemsize
        native.hfx_track_repeats(len(same), offsets, vertices, weights, width, same)
    return same


class Cursor:
    """Bounds-checked read position in the bytes of a chunk."""

    def __init__(self, content: bytes, name: str = "a track") -> None:
        self._content = content
        self._at = 0
        self._name = name
        self._entries = 0

    def count(self, entries: int) -> None:
        """Add the (set, vertex) pairs of the next section to the chunk's total. Raises
        TooLargeError if the total would take more memory than :data:`.limits.MEMORY`."""
        self._entries += entries
        most_bytes = float(_ENTRY_BYTES * self._entries)
        limits.MEMORY.check(most_bytes, self._name, "contacts of one chunk would take")

    @property
    def at_end(self) -> bool:
        """True if all bytes have been read."""
        return self._at == len(self._content)

    def take(self, size: int) -> bytes:
        """Read ``size`` bytes and advance; raises ValueError if fewer are left."""
        if size > len(self._content) - self._at:
            raise ValueError("a chunk ends within a column")
        self._at += size
        return self._content[self._at - size : self._at]

    def column(self, count: int, dtype: str) -> Unsigned:
        """Read ``count`` unsigned numbers with bytes grouped by significance; ``dtype`` is "<u1" to
        "<u8". Raises ValueError if fewer are left."""
        width = np.dtype(dtype).itemsize
        planes = np.frombuffer(self.take(count * width), np.uint8).reshape(width, count)
        return np.ascontiguousarray(planes.T).view(dtype).reshape(count)


def read_head(cursor: Cursor) -> tuple[int, int, int]:
    """Read (stream index, sample count, channel flags) of the next section, unchecked; raises
    ValueError for too few bytes."""
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
    """Read and check the section after ``head``, which the cursor has passed. Raises ValueError if
    the bytes are no such section, with the fault, and TooLargeError for too many contacts."""
    stream, samples, flags = head
    _require(samples > 0, "a section has no samples")
    _require(flags < 1 << 6, "a section has unknown channels")
    # Before the columns are read: a wrong flag would shift all later columns.
    fits = bool(flags & _FOCUS) == is_spot and bool(flags & _DRIVE) == (actuator_count > 0)
    _require(fits, "a section has not the channels of its effect's kind")
    steps = np.cumsum(cursor.column(samples, "<u2"), dtype=np.int64)  # no wrap-around: int64
    _require(bool(np.all(np.diff(steps) > 0)), "samples are not in time order")
    new = np.frombuffer(cursor.take(samples), np.uint8)
    _require(bool(np.all(new <= 1) and new[0] == 1), "a sample has no vertex set")
    # Running sums of bit patterns, modulo 2^64, restore every bit of a number.
    levels = _sums(cursor.column(samples, "<u8")).view(np.float64)
    _require(bool(np.all((levels > 0.0) & (levels <= 1.0))), "a level is not in 0..1")
    parameters = np.zeros((samples, parameter_count))
    for column in range(parameter_count):
        parameters[:, column] = _sums(cursor.column(samples, "<u8")).view(np.float64)
    _require(bool(np.isfinite(parameters).all()), "a parameter is not a finite number")

    # Weights and channels are coded in the order of ``order``: by vertex, then set.
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
    for name, columns in CHANNELS.items():
        if flags & _FLAGS[name]:
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
    """Read float32 values (samples, columns) by column; raises ValueError for NaN and infinity."""
    values = np.zeros((samples, columns), np.float32)
    for column in range(columns):
        values[:, column] = _sums(cursor.column(samples, "<u4")).view(np.float32)
    _require(bool(np.isfinite(values).all()), "a place or an actuator is not a finite number")
    return values


def _require(condition: bool, complaint: str) -> None:
    """Raise ValueError with the text ``complaint`` unless a condition holds."""
    if not condition:
        raise ValueError(complaint)


def _toggles(vertices: I32, owners: I64, set_count: int) -> tuple[Unsigned, Unsigned]:
    """Number (set_count,) of toggled ids, which enter or leave at each set, and their gaps, one per
    toggled id, set by set.

    ``vertices`` and the set numbers ``owners`` are sorted by vertex, then by set. Gaps are
    differences of ascending ids within a set; the first gap of a set is the id itself.
    """
    # An entry (vertex, set) starts an interval of sets unless the set before has the vertex too,
    # and ends one unless the next set has it; both ends are toggles.
    # Equal neighbours with successive set numbers continue an interval.
    follows = (np.diff(vertices) == 0) & (np.diff(owners) == 1)
    enters = np.ones(len(vertices), np.bool_)
    enters[1:] = ~follows
    leaves = owners + 1 < set_count
    leaves[:-1] &= ~follows
    # An interval that lasts to the end of the section needs no toggle for leaving.
    ids = np.concatenate((vertices[enters], vertices[leaves]))
    sets = np.concatenate((owners[enters], owners[leaves] + 1))
    order = np.lexsort((ids, sets))
    ids, sets = ids[order], sets[order]
    gaps = np.diff(ids, prepend=np.int32(0))
    starts = _group_starts(sets)
    gaps[starts] = ids[starts]
    return np.bincount(sets, minlength=set_count).astype(np.uint32), gaps.astype(np.uint32)


def _read_sets(cursor: Cursor, is_new: Bool, vertex_count: int) -> tuple[I64, I32, I64]:
    """Read m vertex sets: sizes (m,), vertices (s,) set by set, and the permutation (s,) that sorts
    these by vertex, then set. Raises ValueError for unsorted or unknown ids, TooLargeError for too
    many."""
    set_count = int(is_new.sum())
    counts = cursor.column(set_count, "<u4").astype(np.int64)
    gaps = cursor.column(int(counts.sum()), "<u4").astype(np.int64)
    # Running sums over all sets, less the sum before each set, restart at each set.
    ids = np.cumsum(gaps)
    starts = np.cumsum(counts) - counts
    starts, filled = starts[counts > 0], counts[counts > 0]
    ids -= np.repeat(ids[starts] - gaps[starts], filled)
    ascending = np.diff(ids) > 0
    # From a set to the next, ids may fall.
    ascending[starts[1:] - 1] = True
    _require(bool(np.all(ascending)), "vertex ids do not ascend")
    _require(bool(np.all(ids < vertex_count)), "a vertex id is not in its model")

    # By vertex, toggles alternate between entering and leaving; a last entry lasts to the end.
    sets = np.repeat(np.arange(set_count), counts)
    order = np.argsort(ids, kind="stable")
    ids, sets = ids[order], sets[order]
    groups = _group_starts(ids)
    # Number of each toggle among those of its vertex: even ones enter, odd ones leave.
    rank = np.arange(len(ids)) - np.repeat(groups, np.diff(groups, append=len(ids)))
    # An interval lasts until the next toggle of the same vertex.
    until = np.full(len(ids), set_count)
    until[:-1][np.diff(ids) == 0] = sets[1:][np.diff(ids) == 0]
    enters = rank % 2 == 0
    first, lasts = sets[enters], (until - sets)[enters]

    # Check both totals, exact and small to compute, before allocating arrays of the size.
    # A set with m samples counts m times.
    uses = np.diff(np.flatnonzero(is_new), append=len(is_new))  # samples that share each set
    uses_before = np.concatenate(([0], np.cumsum(uses)))
    entries = int((uses_before[first + lasts] - uses_before[first]).sum())
    _require(entries <= MAX_ENTRIES, f"a section has more than {MAX_ENTRIES} contacts")
    total = int(lasts.sum())
    cursor.count(total)

    # Expand each interval of sets into entries: entry i of an interval that begins at set b has set
    # b + i. A stable sort by set keeps vertices ascending within each set.
    before = np.cumsum(lasts) - lasts
    owners = np.repeat(first - before, lasts) + np.arange(total)
    # Set numbers fit 16 bits, which numpy sorts by radix in linear time.
    by_set = np.argsort(owners.astype(np.uint16), kind="stable")
    vertices = np.repeat(ids[enters], lasts)[by_set].astype(np.int32)
    by_vertex = np.zeros(total, np.int64)
    # The inverse permutation: the place among the sets of each entry, in the order by vertex.
    by_vertex[by_set] = np.arange(total)
    return np.bincount(owners, minlength=set_count), vertices, by_vertex


def _group_starts(sorted_values: npt.NDArray[Any]) -> I64:
    """Index of the first element of each run of equal values, (runs,); empty for empty input."""
    is_start = np.ones(len(sorted_values), np.bool_)
    is_start[1:] = sorted_values[1:] != sorted_values[:-1]
    return np.flatnonzero(is_start)


def _bits(values: npt.NDArray[Any]) -> Unsigned:
    """Numbers as unsigned integers of equal bits and width, shape unchanged."""
    contiguous = np.ascontiguousarray(values)
    return contiguous.view(f"u{contiguous.dtype.itemsize}")


def _changes(values: Unsigned) -> Unsigned:
    """Differences (n,) from the value before, modulo 2^bits; the first value is unchanged."""
    return np.diff(values, prepend=values.dtype.type(0))


def _sums(changes: Unsigned) -> Unsigned:
    """Running sums modulo 2^bits: the inverse of :func:`_changes`."""
    return np.cumsum(changes, dtype=changes.dtype)


def _changes_per_vertex(values: Unsigned, order: I64, starts: I64) -> Unsigned:
    """Differences from the last value of the same vertex in this section; a vertex's first value is
    unchanged. ``order`` sorts by vertex, then set; ``starts`` are the vertices' first places in
    that order."""
    ordered = values[order]
    changes = _changes(ordered)
    # The first value of a vertex has no predecessor: the one before is another vertex's last.
    changes[starts] = ordered[starts]
    result = np.zeros_like(changes)
    result[order] = changes
    return result


def _sums_per_vertex(changes: Unsigned, order: I64, starts: I64) -> Unsigned:
    """Inverse of :func:`_changes_per_vertex`."""
    ordered = changes[order]
    sums = _sums(ordered)
    # Running sums over all vertices, minus the sum before each vertex, restart at each vertex.
    sums -= np.repeat(sums[starts] - ordered[starts], np.diff(starts, append=len(sums)))
    result = np.zeros_like(sums)
    result[order] = sums
    return result


def _planes(values: Unsigned) -> bytes:
    """Byte planes: all lowest bytes, then all second lowest bytes, and so on."""
    width = values.dtype.itemsize
    little = values.astype(values.dtype.newbyteorder("<"), copy=False)
    return np.ascontiguousarray(little.view(np.uint8).reshape(-1, width).T).tobytes()
