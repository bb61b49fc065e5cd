# SPDX-License-Identifier: GPL-3.0-or-later
"""Size of a track on disk and in memory."""

import tracemalloc
import zipfile
from itertools import pairwise

import numpy as np
import pytest
from track_synthetic import body_points, header, run, walking_contact

from hfx_blender.engine.track import TrackReader, TrackWriter


@pytest.mark.parametrize(
    ("with_falloff", "most_bytes"), [(False, 0.25), (True, 0.45)], ids=["hard", "falloff"]
)
def test_moving_contact_costs_under_a_byte_an_entry(tmp_path, with_falloff, most_bytes):
    """The promise is 1 byte per (sample, vertex) entry; the bounds here are today's sizes."""
    points = body_points()
    track_header = header(240, len(points), ("vibration",), header().bodies[:1])
    contacts = [walking_contact(points, k, with_falloff) for k in range(240)]
    entries = sum(len(vertices) for vertices, _ in contacts)
    assert entries > 240 * 1000, "about a thousand contacts a sample are meant"
    changes = [len(np.setxor1d(a[0], b[0])) for a, b in pairwise(contacts)]
    assert np.mean(changes) > 20, "the sets have to change"

    path = tmp_path / "a.hfxtrack"
    with TrackWriter(path, track_header) as writer:
        writer.append([run(track_header, 0, range(240), *zip(*contacts, strict=True))])
    assert path.stat().st_size / entries < most_bytes


def test_a_painted_effect_costs_one_set_a_chunk(tmp_path):
    """1000 painted vertices over 1280 samples: ten chunks, so ten sets, and columns."""
    track_header = header(1280, 20_000, ("pressure",), header().bodies[:1])
    rng = np.random.default_rng(1)
    vertices = np.sort(rng.choice(20_000, 1000, replace=False))
    weights = rng.uniform(0.01, 1.0, 1000)
    path = tmp_path / "a.hfxtrack"
    with TrackWriter(path, track_header) as writer:
        writer.append([run(track_header, 0, range(1280), [vertices] * 1280, [weights] * 1280)])
    sizes = [e.file_size for e in zipfile.ZipFile(path).infolist() if e.filename[0] == "c"]
    # Plain bytes: head, one set (count, ids, weights), per sample step, flag, level, parameter.
    assert sizes == [12 + (4 + 4 * 1000 + 1000) + 128 * (2 + 1 + 8 + 8)] * 10


def test_long_tracks_need_little_memory(tmp_path):
    """10,000 samples of 1000 changing contacts: 10 million entries, 80 MB as plain arrays."""
    track_header = header(10_000, 5000, ("vibration",), header().bodies[:1])
    path = tmp_path / "a.hfxtrack"
    tracemalloc.start()
    try:
        with TrackWriter(path, track_header) as writer:
            for start in range(0, 10_000, 50):
                indices = range(start, start + 50)
                sets = [np.arange(k % 4000, k % 4000 + 1000) for k in indices]
                weights = [np.full(1000, (k % 7 + 1) / 7) for k in indices]
                writer.append([run(track_header, 0, indices, sets, weights)])
        written_peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.reset_peak()
        entries = 0
        with TrackReader(path) as reader:
            for item in reader.runs():
                entries += len(item.vertices)
        read_peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert entries == 10_000_000
    assert written_peak < 25e6
    assert read_peak < 25e6
