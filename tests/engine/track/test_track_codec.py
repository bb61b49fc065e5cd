# SPDX-License-Identifier: GPL-3.0-or-later
"""Impossible sections are refused, each fault by a separate check."""

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from track_synthetic import header, run

from hfx_blender.engine.track import TrackReader, TrackWriter
from hfx_blender.engine.track.codec import Cursor, Section, decode, encode, read_head
from hfx_blender.errors import InputError

GOOD = Section(
    stream=0,
    steps=np.array([2, 5, 6]),
    levels=np.array([0.5, 0.5, 1.0]),
    parameters=np.array([[1.0], [2.0], [3.0]]),
    is_new=np.array([True, False, True]),
    sizes=np.array([2, 3]),
    vertices=np.array([1, 9, 0, 1, 4], np.int32),
    weights=np.array([0.5, 1.0, 0.25, 0.5, 1.0], np.float32),
)


def decoded(content):
    cursor = Cursor(content)
    head = read_head(cursor)
    section = decode(cursor, head, parameter_count=1, vertex_count=10, full_precision=True)
    assert cursor.at_end
    return section


def test_good_section():
    actual = decoded(encode(GOOD))
    for name, value in vars(GOOD).items():
        assert np.array_equal(getattr(actual, name), value), name


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": np.array([2, 2, 6])}, "time order"),
        ({"is_new": np.array([False, True, True])}, "no vertex set"),
        ({"levels": np.array([0.5, 0.0, 1.0])}, "level"),
        ({"levels": np.array([0.5, np.nan, 1.0])}, "level"),
        ({"levels": np.array([0.5, 1.5, 1.0])}, "level"),
        ({"parameters": np.array([[1.0], [np.inf], [3.0]])}, "parameter"),
        ({"vertices": np.array([1, 10, 0, 1, 4], np.int32)}, "not in its model"),
        ({"weights": np.array([0.5, 1.0, 0.0, 0.5, 1.0], np.float32)}, "weight"),
        ({"weights": np.array([0.5, 1.0, 1.5, 0.5, 1.0], np.float32)}, "weight"),
        ({"weights": np.array([0.5, 1.0, np.nan, 0.5, 1.0], np.float32)}, "weight"),
        ({"channels": {"depth_m": np.zeros((5, 1), np.float32)}}, "for every sample"),
        (
            {
                "channels": {"depth_m": np.full((5, 1), np.nan, np.float32)},
            },
            "depth_m",
        ),
    ],
)
def test_faulty_values(change, message):
    with pytest.raises(ValueError, match=message):
        decoded(encode(replace(GOOD, **change)))


def test_ids_that_do_not_ascend():
    """The second toggle of the second set is repeated: a gap of 0."""
    content = bytearray(encode(GOOD))
    # head; step, is_new, level, parameter of 3 samples; counts of 2 sets; then the gaps' lowest
    # bytes: 1 8 | 0 4 5 (0 and 4 enter, 9 leaves).
    gaps = 12 + 3 * (2 + 1 + 8 + 8) + 2 * 4
    assert content[gaps : gaps + 5] == bytes([1, 8, 0, 4, 5])
    content[gaps + 4] = 0
    with pytest.raises(ValueError, match="do not ascend"):
        decoded(bytes(content))
    content[gaps + 4] = 5
    content[8] = 1 << 3  # an unknown channel
    with pytest.raises(ValueError, match="channels"):
        decoded(bytes(content))


@pytest.mark.parametrize(
    ("order", "message"),
    [
        ((0, 0), "stream 0 is not expected"),
        ((1, 0), "stream 0 is not expected"),
        ((0, 9), "stream 9 is not expected"),
        ((0, 2), "where there is none"),
        ((0, 1, None), "within a column"),
    ],
)
def test_sections_in_a_chunk(tmp_path, order, message):
    """Sections of streams 0 and 1 in another order, of other streams, and with trailing bytes."""
    track_header = header(128, 10, ("pressure", "pressure"))
    path = tmp_path / "a.hfxtrack"
    runs = [run(track_header, k, [2, 6], [[1], [2]], [[1.0], [0.5]]) for k in (0, 1)]
    with TrackWriter(path, track_header, full_precision=True) as writer:
        writer.append(runs)
    sections = [
        b"\0" * 5 if stream is None else encode(replace(GOOD, stream=stream)) for stream in order
    ]
    _replace_chunk(path, b"".join(sections))
    with TrackReader(path) as reader, pytest.raises(InputError, match=message):
        list(reader.runs())


@pytest.mark.parametrize("steps", [[1, 5, 6], [2, 5, 7]])
def test_samples_outside_the_index(tmp_path, steps):
    track_header = header(128, 10, ("pressure",))
    path = tmp_path / "a.hfxtrack"
    with TrackWriter(path, track_header, full_precision=True) as writer:
        writer.append([run(track_header, 0, [2, 6], [[1], [2]], [[1.0], [0.5]])])
    _replace_chunk(path, encode(GOOD))
    with TrackReader(path) as reader:
        assert [item.indices.tolist() for item in reader.runs()] == [[2, 5, 6]]
    _replace_chunk(path, encode(replace(GOOD, steps=np.array(steps))))
    with TrackReader(path) as reader, pytest.raises(InputError, match="where there is none"):
        list(reader.runs())


def _replace_chunk(path, content):
    with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as old:
        entries = {name: old.read(name) for name in old.namelist()}
    entries["chunks/000000.bin"] = content
    with zipfile.ZipFile(path, "w") as new:
        for name, data in entries.items():
            new.writestr(name, data)
