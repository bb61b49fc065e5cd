# SPDX-License-Identifier: GPL-3.0-or-later
"""A second reader, written from docs/track-format.md in plain Python, agrees with the package."""

import io
import json
import struct
import zipfile

import numpy as np
import pytest
from track_synthetic import body_points, header, run, walking_contact

from hfx_blender.engine.track import TrackReader, TrackWriter


def planes(data, count, width):
    part = data.read(count * width)
    return [
        sum(part[plane * count + k] << 8 * plane for plane in range(width)) for k in range(count)
    ]


def summed(data, count, width):
    total, values = 0, []
    for change in planes(data, count, width):
        total = (total + change) % 256**width
        values.append(total)
    return values


def per_vertex(data, sets, width):
    last, values = {}, []
    changes = iter(planes(data, sum(map(len, sets)), width))
    for members in sets:
        values.append([])
        for vertex in members:
            last[vertex] = (last.get(vertex, 0) + next(changes)) % 256**width
            values[-1].append(last[vertex])
    return values


def floats(bits, width):
    kind = "<d" if width == 8 else "<f"
    return [struct.unpack(kind, item.to_bytes(width, "little"))[0] for item in bits]


def toggled(counts, gaps):
    sets, members = [], set()
    for count in counts:
        vertex = 0
        for _ in range(count):
            vertex += next(gaps)
            members = members ^ {vertex}
        sets.append(sorted(members))
    return sets


def twin(path):
    """Return (stream, sample index) -> level, parameters, vertices, weights, channels."""
    archive = zipfile.ZipFile(path)
    head = json.loads(archive.read("header.json"))
    index = json.loads(archive.read("index.json"))
    modality = {effect["id"]: effect["modality"] for effect in head["effects"]}
    columns = [
        len(head["modalities"][modality[stream["effect_id"]]]["parameters"])
        for stream in head["streams"]
    ]
    wide = head["encoding"]["weights"] == "float32"
    samples_by_key = {}
    for chunk in index["chunks"]:
        data = io.BytesIO(archive.read(f"chunks/{chunk:06d}.bin"))
        start = chunk * head["encoding"]["samples_per_chunk"]
        while section := data.read(12):
            stream, n, flags = struct.unpack("<III", section)
            steps = summed(data, n, 2)
            is_new = planes(data, n, 1)
            levels = floats(summed(data, n, 8), 8)
            parameters = [floats(summed(data, n, 8), 8) for _ in range(columns[stream])]
            counts = planes(data, sum(is_new), 4)
            sets = toggled(counts, iter(planes(data, sum(counts), 4)))
            weights = per_vertex(data, sets, 4 if wide else 1)
            channels = [
                per_vertex(data, sets, 4)
                for bit, count in ((0, 3), (1, 3), (2, 1))
                if flags >> bit & 1
                for _ in range(count)
            ]
            at = -1
            for k in range(n):
                at += is_new[k]
                samples_by_key[stream, start + steps[k]] = (
                    levels[k],
                    [column[k] for column in parameters],
                    sets[at],
                    floats(weights[at], 4) if wide else [weight / 255 for weight in weights[at]],
                    [floats(channel[at], 4) for channel in channels],
                )
    return samples_by_key


@pytest.mark.parametrize("full_precision", [False, True])
def test_the_twin_reads_the_same(tmp_path, full_precision):
    points = body_points(0.06)
    track_header = header(200, len(points), ("vibration", "wind"), header().bodies[:1])
    rng = np.random.default_rng(3)
    contacts = [walking_contact(points, k, True, 0.06) for k in range(200)]
    total = sum(len(vertices) for vertices, _ in contacts)
    painted = np.array([3, 4, 90])
    runs = [
        run(
            track_header,
            0,
            range(200),
            *zip(*contacts, strict=True),
            levels=rng.uniform(0.1, 1, 200),
            parameters=rng.normal(size=(200, 2)),
            positions=rng.normal(size=(total, 3)).astype(np.float32),
            depth_m=rng.random(total).astype(np.float32),
        ),
        run(
            track_header,
            1,
            range(20, 160, 3),
            [painted] * 47,
            [[0.2, 0.4, 1.0]] * 47,
            parameters=rng.normal(size=(47, 4)),
        ),
    ]
    path = tmp_path / "a.hfxtrack"
    with TrackWriter(path, track_header, full_precision=full_precision) as writer:
        writer.append(runs)
    expected = twin(path)
    with TrackReader(path) as reader:
        streams = list(reader.header.streams)
        count = 0
        for item in reader.runs():
            for index, sample in zip(item.indices.tolist(), item, strict=True):
                level, parameters, vertices, weights, channels = expected[
                    streams.index(item.stream), index
                ]
                assert sample.level == level and sample.parameters.tolist() == parameters
                assert sample.vertices.tolist() == vertices
                assert sample.weights.tolist() == np.float32(weights).tolist()
                if sample.positions is not None:
                    actual = [*sample.positions.T.tolist(), sample.depth_m.tolist()]
                    assert actual == channels and sample.velocities is None
                count += 1
    assert count == len(expected) == 247
