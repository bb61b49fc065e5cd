# SPDX-License-Identifier: GPL-3.0-or-later
"""A track returns the recorded samples, whole or from any time, for any division of the input."""

from itertools import pairwise
from pathlib import Path

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from track_synthetic import cut, header, quantised, rows, run

from hfx_blender.engine.track import TrackReader, TrackWriter
from hfx_blender.engine.track.layout import from_json, to_json

HUGE = 2**31 - 1
HEADER = header(sample_count=700, vertex_count=HUGE)


def write(path, track_header, blocks, **options):
    with TrackWriter(path, track_header, **options) as writer:
        for block in blocks:
            writer.append(block)
    return path


@st.composite
def stream_runs(draw, stream):
    """Draw a run of one stream: empty or not, with constant, slightly or entirely changed sets."""
    indices = sorted(
        draw(st.sets(st.integers(0, 699), max_size=8)) | draw(st.sets(st.integers(120, 135)))
    )
    pool = draw(
        st.lists(
            st.one_of(st.integers(0, 40), st.integers(HUGE - 20, HUGE - 1)),
            unique=True,
            max_size=12,
        )
    )
    weight = st.floats(0, 1, width=32, exclude_min=True)
    sets, weights = [], []
    for _ in indices:
        if not sets or draw(st.booleans()):
            sets.append(np.array(sorted(draw(st.sets(st.sampled_from(pool)))) if pool else []))
            weights.append(draw(hnp.arrays(np.float32, len(sets[-1]), elements=weight)))
        else:
            sets.append(sets[-1])
            weights.append(weights[-1])
    total = sum(map(len, sets))
    count = len(indices)
    finite = st.floats(allow_nan=False, allow_infinity=False)
    single = st.floats(allow_nan=False, allow_infinity=False, width=32)
    columns = 2 if HEADER.streams[stream].modality == "vibration" else 1
    channels = {
        name: draw(hnp.arrays(np.float32, shape, elements=single))
        for name, shape in (
            ("positions", (total, 3)),
            ("velocities", (total, 3)),
            ("depth_m", (total,)),
        )
        if draw(st.booleans())
    }
    return run(
        HEADER,
        stream,
        indices,
        sets,
        weights,
        levels=draw(hnp.arrays(np.float64, count, elements=st.floats(0, 1, exclude_min=True))),
        parameters=draw(hnp.arrays(np.float64, (count, columns), elements=finite)),
        **channels,
    )


@st.composite
def recordings(draw):
    return [draw(stream_runs(k)) for k in range(len(HEADER.streams)) if draw(st.booleans())]


relaxed = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@relaxed
@given(runs=recordings(), full=st.booleans())
def test_everything_recorded_comes_back(tmp_path, runs, full):
    path = write(tmp_path / "a.hfxtrack", HEADER, [runs], full_precision=full)
    expected = runs
    if not full:
        expected = [
            type(item)(**{**vars(item), "weights": quantised(item.weights)}) for item in runs
        ]
    with TrackReader(path) as reader:
        assert rows(reader.runs()) == rows(expected)
        assert reader.full_precision is full
        indices = [int(i) for item in reader.runs() for i in item.indices[:1]]
        assert [i // 128 for i in indices] == sorted(i // 128 for i in indices)


@relaxed
@given(runs=recordings(), data=st.data())
def test_bytes_do_not_depend_on_how_the_samples_were_fed(tmp_path, runs, data):
    whole = write(tmp_path / "whole.hfxtrack", HEADER, [runs]).read_bytes()
    bounds = [0, *sorted(data.draw(st.sets(st.integers(1, 699), max_size=6))), 700]
    blocks = []
    for low, high in pairwise(bounds):
        parts = [cut(item, *np.searchsorted(item.indices, (low, high))) for item in runs]
        blocks.append(data.draw(st.permutations(parts)))
    assert write(tmp_path / "split.hfxtrack", HEADER, blocks).read_bytes() == whole

    # Runs from a reader make the same file again.
    with TrackReader(tmp_path / "whole.hfxtrack") as reader:
        again = write(
            tmp_path / "again.hfxtrack", reader.header, ([item] for item in reader.runs())
        )
    assert again.read_bytes() == whole


@relaxed
@given(runs=recordings(), data=st.data())
def test_any_time_equals_the_sequence(tmp_path, runs, data):
    path = write(tmp_path / "a.hfxtrack", HEADER, [runs])
    times = HEADER.time.times_s(np.arange(700))
    with TrackReader(path) as reader:
        everything = rows(reader.runs())
        first = data.draw(st.integers(0, 699))
        last = data.draw(st.integers(first, 699))
        actual = rows(reader.runs(times[first], times[last]))
        assert actual == {k: v for k, v in everything.items() if first <= k[2] < last}
        for index in data.draw(st.lists(st.sampled_from([0, 5, 127, 128, *range(120, 136), 699]))):
            keys = sorted((k[0], k[1]) for k in everything if k[2] == index)
            for time_s in (times[index], times[index] + 0.9 / 59.94):
                samples = reader.samples_at(time_s)
                streams = [(s.stream.effect_id, s.stream.body_id) for s in samples]
                assert streams == keys
                for sample in samples:
                    key = (sample.stream.effect_id, sample.stream.body_id, index)
                    assert sample.vertices.tobytes() == everything[key][3]


def test_every_sample_time_finds_its_own_sample(tmp_path):
    """Times rounded to float64 must not fall into the sample before."""
    track_header = header(sample_count=20_000)
    indices = np.arange(20_000)
    sets = [np.array([k % 2000]) for k in indices]
    weights = [np.ones(1)] * 20_000
    path = write(
        tmp_path / "a.hfxtrack", track_header, [[run(track_header, 0, indices, sets, weights)]]
    )
    with TrackReader(path) as reader:
        for index, time_s in enumerate(track_header.time.times_s(indices)):
            (sample,) = reader.samples_at(float(time_s))
            assert sample.vertices.tolist() == [index % 2000]
        times = track_header.time.times_s(np.arange(20_001))
        for index in range(0, 20_000, 61):
            (actual,) = reader.runs(float(times[index]), float(times[index + 1]))
            assert actual.indices.tolist() == [index]


def test_outside_the_track_there_are_no_contacts(tmp_path):
    track_header = header(sample_count=10)
    path = write(
        tmp_path / "a.hfxtrack",
        track_header,
        [[run(track_header, 0, [0, 9], [[1], [2]], [[1.0], [1.0]])]],
    )
    with TrackReader(path) as reader:
        start, end = track_header.time.times_s(np.array([0, 10]))
        assert len(reader.samples_at(start)) == len(reader.samples_at(end - 1e-3)) == 1
        for time_s in (start - 1e-3, end, -np.inf, np.inf, start + 0.1):
            assert reader.samples_at(time_s) == []
        assert list(reader.runs(end)) == list(reader.runs(None, start)) == []
        with pytest.raises(ValueError, match="not a number"):
            reader.samples_at(float("nan"))


def test_empty_track(tmp_path):
    path = write(tmp_path / "a.hfxtrack", HEADER, [])
    with TrackReader(path) as reader:
        assert list(reader.runs()) == []
        assert [
            (s.sample_count, s.first_s, s.last_s, s.entry_count, s.peak_level)
            for s in reader.summary()
        ] == [(0, None, None, 0, 0.0)] * 4


def test_summary(tmp_path):
    track_header = header(sample_count=1000)
    runs = [
        run(
            track_header,
            1,
            [3, 500],
            [[1, 2], [1, 2, 5]],
            [[1.0, 0.5], [0.1, 0.2, 0.3]],
            levels=[0.25, 0.75],
            depth_m=np.zeros(5, np.float32),
        )
    ]
    path = write(
        tmp_path / "a.hfxtrack", track_header, [[cut(runs[0], 0, 1)], [cut(runs[0], 1, 2)]]
    )
    with TrackReader(path) as reader:
        actual = reader.summary()[1]
    assert (actual.sample_count, actual.entry_count, actual.peak_level) == (2, 5, 0.75)
    # Frame 11 is 10 frames after the start; 60000/1001 frames a second.
    assert actual.first_s == pytest.approx(13 * 1001 / 60000, abs=1e-12)
    assert actual.last_s == pytest.approx(510 * 1001 / 60000, abs=1e-12)
    assert actual.channels == ("depth_m",)
    assert (actual.stream.effect_id, actual.stream.body_id) == ("e0", "b2")


def test_header_comes_back(tmp_path):
    path = write(tmp_path / "a.hfxtrack", HEADER, [])
    encoding = {"any": "thing"}
    with TrackReader(path) as reader:
        actual = reader.header
    assert to_json(actual, encoding) == to_json(HEADER, encoding)
    for name in ("time", "models", "bodies", "effects", "source", "settings", "tools", "warnings"):
        assert getattr(actual, name) == getattr(HEADER, name)
    assert [vars(s) for s in actual.streams] == [vars(s) for s in HEADER.streams]
    assert actual.bodies[1].name == "Bär\udc80"
    again, rest = from_json(to_json(HEADER, encoding))
    assert rest == encoding and again.time == HEADER.time


@pytest.mark.parametrize("weight", [1e-45, 1e-9, 0.5 / 255, 1.5 / 255, 0.3, 254.6 / 255, 1.0])
def test_eight_bits_keep_a_weight_within_half_a_step(tmp_path, weight):
    track_header = header(sample_count=1)
    path = write(
        tmp_path / "a.hfxtrack", track_header, [[run(track_header, 0, [0], [[7]], [[weight]])]]
    )
    with TrackReader(path) as reader:
        (actual,) = reader.runs()
    stored = float(actual.weights[0]) * 255
    assert stored == pytest.approx(round(stored), abs=1e-4) and stored > 0.99
    assert abs(stored - weight * 255) <= (0.5001 if weight > 0.5 / 255 else 1.0001)


def test_the_file_is_the_same_on_every_run(tmp_path):
    first = write(tmp_path / "a.hfxtrack", HEADER, []).read_bytes()
    assert write(tmp_path / "b.hfxtrack", HEADER, []).read_bytes() == first


def test_reading_needs_no_body_model_file(tmp_path, monkeypatch):
    monkeypatch.setattr("hfx_blender.files.resources.body_models", lambda: Path("/nonexistent"))
    path = write(tmp_path / "a.hfxtrack", HEADER, [[run(HEADER, 0, [0], [[HUGE - 1]], [[1.0]])]])
    with TrackReader(path) as reader:
        assert [r.vertices.tolist() for r in reader.runs()] == [[HUGE - 1]]


@pytest.mark.parametrize("full_precision", [False, True])
def test_what_was_just_written_equals_what_the_file_says(tmp_path, full_precision):
    runs = [run(HEADER, 0, [3, 7], [[1, 2], [5]], [[0.5, 1.0], [0.25]])]
    with TrackWriter(tmp_path / "a", HEADER, full_precision=full_precision) as writer:
        writer.append(runs)
    with TrackReader(tmp_path / "a", writer.written) as known, TrackReader(tmp_path / "a") as read:
        assert known.header is HEADER and to_json(read.header, {}) == to_json(HEADER, {})
        assert known.full_precision == read.full_precision == full_precision
        assert known.samples_per_chunk == read.samples_per_chunk
        assert known.chunks == read.chunks == [0] and known.index == read.index
