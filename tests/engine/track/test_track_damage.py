# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading any damaged file gives valid samples or one clear InputError."""

import io
import json
import struct
import warnings
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from track_synthetic import header, run

from hfx_blender.engine.track import TrackReader, TrackWriter
from hfx_blender.engine.track import layout as track_layout
from hfx_blender.engine.track.codec import MAX_ENTRIES
from hfx_blender.errors import InputError

HEADER = header(sample_count=300, vertex_count=500)


@pytest.fixture(scope="module", params=[False, True], ids=["byte", "full"])
def intact(request, tmp_path_factory):
    rng = np.random.default_rng(5)
    path = tmp_path_factory.mktemp("track") / "intact.hfxtrack"
    runs = []
    for stream in (0, 3):
        indices = np.arange(100, 180)
        sets = [np.flatnonzero(rng.random(500) < 0.05) for _ in indices]
        weights = [rng.uniform(0.1, 1.0, len(indices)) for indices in sets]
        depth = rng.random(sum(map(len, sets))).astype(np.float32) if stream else None
        runs.append(run(HEADER, stream, indices, sets, weights, depth_m=depth))
    with TrackWriter(path, HEADER, full_precision=request.param) as writer:
        writer.append(runs)
    return path


def read_whole(path):
    """Read everything; all valid data must be writable again."""
    with TrackReader(path) as reader:
        copy = TrackWriter(
            path.with_name("copy.hfxtrack"), reader.header, full_precision=reader.full_precision
        )
        reader.summary()
        with copy:
            for item in reader.runs():
                copy.append([item])
        reader.samples_at(3.0)


def expect_input_error_or_valid(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # zipfile warns of duplicate names
        try:
            read_whole(path)
        except InputError as error:
            assert str(path) in str(error) and len(str(error)) < 500
            return False
    return True


def rebuilt(intact, **replaced):
    """Return the container with replaced entries (None: left out) and correct checksums."""
    target = io.BytesIO()
    with zipfile.ZipFile(intact) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            key = name.partition(".")[0].rpartition("/")[2]
            data = replaced.pop(key, old.read(name))
            if data is not None:
                new.writestr(name, data)
    assert not replaced
    return target.getvalue()


def entry(intact, name):
    with zipfile.ZipFile(intact) as archive:
        return archive.read(name)


fuzz = settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@fuzz
@given(data=st.data())
def test_flipped_bytes(tmp_path, intact, data):
    damaged = bytearray(intact.read_bytes())
    # The container's tables, at the end, matter most.
    offset = st.integers(0, len(damaged) - 1) | st.integers(len(damaged) - 400, len(damaged) - 1)
    for at in data.draw(st.lists(offset, min_size=1, max_size=4)):
        damaged[at] = data.draw(st.integers(0, 255))
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(damaged)
    expect_input_error_or_valid(path)


@fuzz
@given(data=st.data())
def test_flipped_bytes_within_a_chunk_of_good_checksum(tmp_path, intact, data):
    chunk = bytearray(entry(intact, "chunks/000000.bin"))
    offset = st.integers(0, len(chunk) - 1) | st.integers(0, 400)
    for at in data.draw(st.lists(offset, min_size=1, max_size=4)):
        chunk[at] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        chunk = chunk[: data.draw(st.integers(0, len(chunk)))]
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(rebuilt(intact, **{"000000": bytes(chunk)}))
    expect_input_error_or_valid(path)


@fuzz
@given(data=st.data())
def test_flipped_bytes_within_the_header_or_index(tmp_path, intact, data):
    name = data.draw(st.sampled_from(["header", "index"]))
    text = bytearray(entry(intact, f"{name}.json"))
    for at in data.draw(st.lists(st.integers(0, len(text) - 1), min_size=1, max_size=3)):
        text[at] = data.draw(st.sampled_from(b'0123456789-.e"{}[],:nt ') | st.integers(0, 255))
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(rebuilt(intact, **{name: bytes(text)}))
    expect_input_error_or_valid(path)


def test_every_truncation_is_found(tmp_path, intact):
    path = tmp_path / "damaged.hfxtrack"
    content = intact.read_bytes()
    for size in [*range(0, len(content), 97), len(content) - 1]:
        path.write_bytes(content[:size])
        assert not expect_input_error_or_valid(path)


def test_intact_file_is_valid(tmp_path, intact):
    path = tmp_path / "intact.hfxtrack"
    path.write_bytes(intact.read_bytes())
    assert expect_input_error_or_valid(path)
    assert (tmp_path / "copy.hfxtrack").read_bytes() == intact.read_bytes()


def test_damage_elsewhere_does_not_matter(tmp_path, intact):
    """Random access reads only the needed chunk."""
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(rebuilt(intact, **{"000000": b"nonsense"}))
    late = float(HEADER.time.times_s(np.array([128]))[0])
    with TrackReader(path) as reader:
        assert sum(len(item) for item in reader.runs(start_s=late)) == 2 * 52
        assert len(reader.samples_at(late)) == 2
        with pytest.raises(InputError, match="000000"):
            reader.samples_at(late - 0.1)


def header_json(intact, change):
    content = json.loads(entry(intact, "header.json"))
    change(content)
    return json.dumps(content).encode()


def change_stream(content):
    content["streams"][0]["body_id"] = "nobody"


def change_vertices(content):
    content["models"][0]["vertex_count"] = 10


def change_units(content):
    content["modalities"]["vibration"]["parameters"][0]["unit"] = "g"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(version=3), "version 3, this program reads up to version 2"),
        (lambda c: c.update(format="zip"), 'format is "zip", allowed is one of hfxtrack'),
        (lambda c: c.pop("effects"), "'effects' is missing"),
        (lambda c: c["time"].update(fps=[0, 1]), r"fps\[0\] is 0, allowed is a whole number of 1"),
        (lambda c: c["time"].update(rate_hz=[10**30, 1]), "rate_hz"),
        (lambda c: c["time"].update(frame_last=2**31 - 1), "sample_count"),
        (lambda c: c["time"].update(frame_last=0), "frame range"),
        (lambda c: c["encoding"].update(samples_per_chunk=10**6), "10000"),
        (lambda c: c["encoding"].update(weights="float16"), "float16"),
        (lambda c: c["bodies"].append(c["bodies"][0]), "same id"),
        (lambda c: c["streams"].append(c["streams"][0]), "same effect and body"),
        (lambda c: c["effects"][0].update(modality="smell"), "smell"),
        (change_stream, "nobody"),
        (change_vertices, "not in its model"),
        (change_units, "vibration"),
    ],
)
def test_a_header_that_cannot_be_is_named(tmp_path, intact, change, message):
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(rebuilt(intact, header=header_json(intact, change)))
    with pytest.raises(InputError, match=message):
        read_whole(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"[" * 100_000, "nested too deeply"),
        (b'{"a": NaN}', "NaN"),
        (b'{"a": 1e999}', "not finite"),
        (b"\xff\xfe", "."),
        (b"[]", r"the document is \[\], allowed is an object"),
        (b" " * (track_layout.MAX_JSON_BYTES + 1), "are allowed"),
        (None, "no header.json"),
    ],
)
def test_json_that_is_not_a_header(tmp_path, intact, text, message):
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(rebuilt(intact, header=text))
    with pytest.raises(InputError, match=message):
        TrackReader(path)


def test_chunks_and_index_must_agree(tmp_path, intact):
    path = tmp_path / "damaged.hfxtrack"
    path.write_bytes(rebuilt(intact, **{"000001": None}))
    with pytest.raises(InputError, match="index and the chunks differ"):
        TrackReader(path)


def test_a_small_chunk_cannot_claim_endless_contacts(tmp_path):
    """One set of a million vertices, shared by 128 samples, is 134 million contacts."""
    count = 2**20
    assert count * 128 > MAX_ENTRIES
    track_header = header(128, count, ("pressure",), HEADER.bodies[:1])
    path = tmp_path / "bomb.hfxtrack"
    with TrackWriter(path, track_header) as writer:
        writer.append([run(track_header, 0, range(128), [[1]] * 128, [[1.0]] * 128)])
    plain = entry(path, "chunks/000000.bin")
    columns = 12 + 128 * (2 + 1 + 8 + 8)
    ids = b"\0" + b"\1" * (count - 1) + bytes(3 * count)
    weights = b"\xff" * count
    bomb = plain[:columns] + struct.pack("<I", count) + ids + weights
    # The count's bytes are a column of a single number, so the planes are the number's bytes.
    path.write_bytes(rebuilt(path, **{"000000": bomb}))
    with TrackReader(path) as reader, pytest.raises(InputError, match="contacts"):
        list(reader.runs())


@pytest.mark.parametrize("content", [b"", b"PK", b"hello" * 100, b"\0" * 5000])
def test_foreign_files(tmp_path, content):
    path = tmp_path / "foreign.hfxtrack"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"foreign\.hfxtrack: not a HapticTrack"):
        TrackReader(path)


def test_a_zip_of_something_else(tmp_path):
    path = tmp_path / "foreign.hfxtrack"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(InputError, match=r"no header\.json"):
        TrackReader(path)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(InputError, match="there is no such file"):
        TrackReader(tmp_path / "none.hfxtrack")
    with pytest.raises(InputError, match="it is a folder"):
        TrackReader(tmp_path)
