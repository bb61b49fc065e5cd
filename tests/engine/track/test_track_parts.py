# SPDX-License-Identifier: GPL-3.0-or-later
"""A track from parts equals a single recording; a part of a track is a track from time 0."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from track_synthetic import cut, header, rows, run

from hfx_blender.engine.scene import Clip, TimeBase
from hfx_blender.engine.track import TrackReader, TrackWriter, layout
from hfx_blender.engine.track import writer as track_writer
from hfx_blender.engine.track.excerpt import merge, named_clips, write_excerpt
from hfx_blender.errors import InputError
from hfx_blender.files import limits

CHUNK = 128


def _recording(track_header, seed: int):
    """Return a run of each stream, at some samples, with sets repeated at times."""
    chance = np.random.default_rng(seed)
    runs = []
    for stream in range(len(track_header.streams)):
        count = track_header.time.sample_count
        indices = np.flatnonzero(chance.random(count) < chance.choice([0.0, 0.05, 0.9]))
        sets, weights = [], []
        for _ in indices:
            if not sets or chance.random() < 0.5:
                chosen = np.flatnonzero(chance.random(50) < 0.3)
                values = chance.uniform(0.1, 1.0, len(chosen)).astype(np.float32)
            sets.append(chosen)
            weights.append(values)
        levels = chance.uniform(0.01, 1.0, len(indices))
        runs.append(run(track_header, stream, indices, sets, weights, levels))
    return runs


def _write(path: Path, track_header, runs, precise: bool, low: int = 0, high: int = 10**9) -> Path:
    with TrackWriter(path, track_header, full_precision=precise) as writer:
        parts = []
        for item in runs:
            first, last = np.searchsorted(item.indices, (low, high))
            if last > first:
                parts.append(cut(item, first, last))
        writer.append(parts)
    return path


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    count=st.integers(1, 900),
    cuts=st.sets(st.integers(1, 7), max_size=4),
    precise=st.booleans(),
)
def test_parts_become_the_bytes_of_one_recording(
    tmp_path_factory: pytest.TempPathFactory, seed: int, count: int, cuts: set[int], precise: bool
) -> None:
    folder = tmp_path_factory.mktemp("parts")
    track_header = header(sample_count=count)
    runs = _recording(track_header, seed)
    whole = _write(folder / "whole", track_header, runs, precise)
    edges = [0, *(CHUNK * k for k in sorted(cuts)), 10**9]
    parts = [
        _write(folder / f"{k}", track_header, runs, precise, edges[k], edges[k + 1])
        for k in range(len(edges) - 1)
    ]
    merge(parts, folder / "merged")
    assert (folder / "merged").read_bytes() == whole.read_bytes()


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    count=st.integers(1, 700),
    limit=st.integers(200, 6000),
    cuts=st.sets(st.integers(1, 5), max_size=3),
    precise=st.booleans(),
)
def test_chunks_hold_no_more_than_a_reader_holds(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    count: int,
    limit: int,
    cuts: set[int],
    precise: bool,
) -> None:
    """Up to 4 streams of 15 vertices a sample on average, below any limit on a single sample."""
    folder = tmp_path_factory.mktemp("limited")
    track_header = header(sample_count=count)
    runs = _recording(track_header, seed)
    whole = _write(folder / "whole", track_header, runs, precise)
    edges = [0, *(CHUNK * k for k in sorted(cuts)), 10**9]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(track_writer.codec, "MAX_SET_ENTRIES", limit)
        limited = _write(folder / "limited", track_header, runs, precise)
        parts = [
            _write(folder / f"{k}", track_header, runs, precise, edges[k], edges[k + 1])
            for k in range(len(edges) - 1)
        ]
        merge(parts, folder / "merged")
    assert (folder / "merged").read_bytes() == limited.read_bytes()
    times = 64 * limit / 2**30  # 64 bytes for each vertex of a set, of 1 GiB
    with TrackReader(whole) as track, TrackReader(limited) as second:
        assert second.samples_per_chunk in (1, 2, 4, 8, 16, 32, 64, 128)
        with limits.raised(times):
            actual = rows(second.runs())
        assert actual == rows(track.runs())
        assert second.summary() == track.summary()
        if second.samples_per_chunk < CHUNK:  # only as small as necessary
            with limits.raised(times), pytest.raises(limits.TooLargeError):
                rows(track.runs())


def test_chunks_are_cut_by_their_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    track_header = header(sample_count=300)
    runs = _recording(track_header, 7)
    whole = _write(tmp_path / "whole", track_header, runs, True)
    monkeypatch.setattr(layout, "MAX_CHUNK_BYTES", 6000)
    path = _write(tmp_path / "limited", track_header, runs, True)
    with TrackReader(path) as track:
        assert track.samples_per_chunk < CHUNK
        actual = rows(track.runs())
    monkeypatch.undo()
    with TrackReader(whole) as track:
        assert rows(track.runs()) == actual


def test_parts_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    track_header = header(sample_count=600)
    runs = _recording(track_header, 5)
    early = _write(tmp_path / "early", track_header, runs, False, 0, CHUNK)
    late = _write(tmp_path / "late", track_header, runs, False, CHUNK)
    second = _write(tmp_path / "other", header(sample_count=601), runs, False, CHUNK)
    precise = _write(tmp_path / "precise", track_header, runs, True, CHUNK)
    for parts in ([late, early], [early, early], [early, second], [early, precise], []):
        with pytest.raises(InputError):
            merge(parts, tmp_path / "merged")
        assert not (tmp_path / "merged").exists()
    damaged = bytearray(late.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    late.write_bytes(damaged)
    with pytest.raises(InputError, match="late"):
        merge([early, late], tmp_path / "merged")


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32), start=st.floats(0.0, 320.0), length=st.floats(0.0, 400.0))
def test_an_excerpt_holds_the_samples_of_its_clip_from_time_0(
    tmp_path_factory: pytest.TempPathFactory, seed: int, start: float, length: float
) -> None:
    folder = tmp_path_factory.mktemp("excerpt")
    track_header = header(sample_count=500)  # frames 11 to 510, a sample each
    runs = _recording(track_header, seed)
    whole = _write(folder / "whole", track_header, runs, True)
    with TrackReader(whole) as track:
        inside = [k for k in range(500) if start <= 11 + k <= start + length]
        clip = Clip("hit", start, start + length)
        if not inside:
            with pytest.raises(ValueError, match="hit"):
                write_excerpt(track, {"e0"}, clip, folder / "part")
            return
        write_excerpt(track, {"e0"}, clip, folder / "part")
        expected = {
            (*key[:2], key[2] - inside[0]): value[1:]
            for key, value in rows(track.runs()).items()
            if key[0] == "e0" and key[2] in inside
        }
    with TrackReader(folder / "part") as part:
        assert {key: value[1:] for key, value in rows(part.runs()).items()} == expected
        assert [effect.id for effect in part.header.effects] == ["e0"]
        times = part.header.time.times_s(np.arange(len(inside)))
        assert times[0] == 0.0
        assert np.allclose(np.diff(times), 1001 / 60000)
        assert part.header.time.sample_count == len(inside)


def test_an_excerpt_between_frames_begins_with_the_next_sample(tmp_path: Path) -> None:
    # 25 frames and 100 samples a second: samples at frames 0, 0.25, 0.5 ...
    base = header(sample_count=100)
    time = TimeBase(Fraction(25), Fraction(100), 0, 0, 24)
    track_header = type(base)(time, base.models, base.bodies, base.effects, base.streams)
    runs = [run(track_header, 0, np.arange(100), [[1]] * 100, [[1.0]] * 100)]
    path = _write(tmp_path / "whole", track_header, runs, True)
    with TrackReader(path) as track:
        excerpt = write_excerpt(track, {"e0"}, Clip("c", 10.3, 12.0), tmp_path / "part")
        # Samples at frames 10.5 to 12: 7 samples, which take two frames.
        assert excerpt.sample_count == 8
    with TrackReader(tmp_path / "part") as part:
        assert part.summary()[0].sample_count == 7
        assert part.summary()[0].first_s == 0.0


def test_clips_are_distinguished_by_name_or_effect() -> None:
    base = header(modalities=("vibration", "temperature", "pressure"))
    hit, second = Clip("hit", 1.0, 5.0), Clip("Hit", 7.0, 9.0)
    clips = ((hit, second), (hit,), (Clip("hit", 20.0, 30.0), Clip("hum", 0.0, 1.0)))
    effects = tuple(
        type(effect)(effect.id, effect.name, effect.modality, "volume", "m", clips=own)
        for effect, own in zip(base.effects, clips, strict=True)
    )
    actual = named_clips(type(base)(base.time, base.models, base.bodies, effects, base.streams))
    assert [(entry.name, entry.effect_ids) for entry in actual] == [
        ("hum", ("e2",)),
        ("hit", ("e0",)),
        ("hit effect 1", ("e1",)),  # at the same time: separate files all the same
        ("Hit effect 0", ("e0",)),  # file names equal on some systems
        ("hit effect 2", ("e2",)),
    ]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("limit", [150, 600, 2000])
def test_calls_have_no_influence_on_the_size_of_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, limit: int
) -> None:
    """Chunks are halved while their samples are collected, in blocks of 64 or at once."""
    track_header = header(sample_count=500)
    runs = _recording(track_header, seed)
    monkeypatch.setattr(track_writer.codec, "MAX_SET_ENTRIES", limit)
    whole = _write(tmp_path / "whole", track_header, runs, False)
    with TrackWriter(tmp_path / "blocks", track_header) as writer:
        for low in range(0, 500, 64):
            spans = [(item, *np.searchsorted(item.indices, (low, low + 64))) for item in runs]
            parts = [cut(item, first, last) for item, first, last in spans if last > first]
            for one in writer.stored(iter(parts)):
                assert len(one)
    assert (tmp_path / "blocks").read_bytes() == whole.read_bytes()
    if limit == 150 and sum(map(len, runs)) > 300:  # chunks of over 500 vertices
        with TrackReader(whole) as track:
            assert track.samples_per_chunk < CHUNK
