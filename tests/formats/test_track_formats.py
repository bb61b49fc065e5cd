# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON Lines of samples and GLB meshes, held against independent readers."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from test_hjif import BEAT, track_of

from hfx_blender.engine.body.model import load_model
from hfx_blender.formats import glb, jsonl_samples
from hfx_blender.formats.checking import encoded

SCHEMA = Path(__file__).resolve().parents[2] / "docs" / "formats" / "samples.schema.json"


@pytest.mark.parametrize("modality", ["vibration", "pressure", "temperature", "wind"])
def test_samples_are_those_of_the_track(tmp_path, modality):
    jsonschema = pytest.importorskip("jsonschema")
    path = tmp_path / "x.samples.jsonl"
    with track_of(tmp_path, modality, "volume", BEAT) as track:
        jsonl_samples.write(track, path)
        runs = list(track.runs())
    assert jsonl_samples.validate(path.read_bytes(), "x") == []
    judge = jsonschema.Draft7Validator(json.loads(SCHEMA.read_text()))
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    assert not [error for line in lines for error in judge.iter_errors(line)]
    assert lines == list(jsonl_samples.read(path))
    header, *rest = lines
    assert header["bodies"] == [{"id": "b", "name": "Zoë"}]
    sets = [line for line in rest if line["type"] == "set"]
    samples = [line for line in rest if line["type"] == "sample"]
    assert len(sets) == 1 and sets[0]["vertices"] == runs[0].vertices.tolist()
    assert [line["level"] for line in samples] == runs[0].levels.tolist()
    assert [line["t"] for line in samples] == pytest.approx(runs[0].times_s.tolist())


@pytest.mark.parametrize(
    ("line", "change", "code"),
    [
        (0, {"format": "other"}, "JSONL-CHOICE"),
        (0, {"type": "sample"}, "JSONL-LINE"),
        (0, {"type": []}, "JSONL-LINE"),
        (0, {"more": 1}, "JSONL-UNKNOWN"),
        (1, {"weights": [1.0]}, "JSONL-SET-SIZE"),
        (1, {"vertices": [7, 7], "weights": [1, 1]}, "JSONL-SET-ORDER"),
        (1, {"vertices": [2**30], "weights": [1]}, "JSONL-SET-VERTEX"),
        (2, {"set": 4}, "JSONL-SAMPLE-SET"),
        (2, {"effect": "other"}, "JSONL-SAMPLE-ID"),
        (2, {"parameters": {}}, "JSONL-SAMPLE-PARAMETERS"),
        (2, {"t": 99}, "JSONL-ORDER"),
        (2, {"level": 2}, "JSONL-RANGE"),
    ],
)
def test_a_broken_rule_is_found_by_its_code(tmp_path, line, change, code):
    path = tmp_path / "x.samples.jsonl"
    with track_of(tmp_path, "pressure", "volume", BEAT) as track:
        jsonl_samples.write(track, path)
    lines = [json.loads(each) for each in path.read_text(encoding="utf-8").splitlines()]
    lines[line] = {**lines[line], **change}
    found = jsonl_samples.validate(b"".join(encoded(each) for each in lines), "x")
    assert code in [each.code for each in found]


def test_more_broken_lines_than_are_told_do_no_harm(tmp_path):
    path = tmp_path / "x.samples.jsonl"
    with track_of(tmp_path, "pressure", "volume", BEAT) as track:
        jsonl_samples.write(track, path)
    broken = b'{"type":"set"}\n{"type":"sample","effect":[]}\n' * 400
    found = jsonl_samples.validate(path.read_bytes() + broken, "x")
    assert len(found) >= 1000 and {each.severity for each in found} == {"error"}


@pytest.mark.parametrize("id", ["hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1"])
def test_a_model_is_the_same_mesh_in_gltfs_space(tmp_path, id):
    trimesh = pytest.importorskip("trimesh")
    model = load_model(id)
    path = tmp_path / "x.glb"
    glb.write_model(model, path)
    data = path.read_bytes()
    assert glb.validate(data, "x") == []
    loaded = trimesh.load(io.BytesIO(data), file_type="glb", process=False)
    (mesh,) = loaded.geometry.values()
    x, y, z = model.vertices.T
    np.testing.assert_allclose(mesh.vertices, np.column_stack([x, z, -y]), atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, model.triangles)
    # It stands upright and looks along +Z: turned, not mirrored.
    assert mesh.bounds[1][1] > 1.6 and mesh.volume > 0.0


@pytest.mark.parametrize("place", [4, 8, 12, 16])
def test_a_broken_container_is_found(tmp_path, place):
    path = tmp_path / "x.glb"
    glb.write_model(load_model("hfx-temperature-1"), path)
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, place, 77)
    assert glb.validate(bytes(data), "x")


@pytest.mark.parametrize(
    ("kind", "index", "member", "value", "code"),
    [
        ("accessors", 0, "count", 10**9, "GLB-ACCESSOR"),
        ("accessors", 0, "bufferView", 99, "GLB-REFERENCE"),
        ("accessors", 0, "type", "VEC9", "GLB-ACCESSOR"),
        ("accessors", 2, "count", 10**9, "GLB-ACCESSOR"),
        ("accessors", 0, "count", 3, "GLB-INDEX"),
        ("accessors", 0, "sparse", {"count": 1}, "GLB-ACCESSOR"),
        ("accessors", 0, "byteOffset", -4, "GLB-ACCESSOR"),
        ("bufferViews", 0, "byteStride", 0, "GLB-VIEW"),
        ("bufferViews", 0, "byteStride", 240, "GLB-ACCESSOR"),
        ("bufferViews", 0, "byteLength", 10**9, "GLB-VIEW"),
        ("bufferViews", 0, "buffer", -1, "GLB-REFERENCE"),
        ("buffers", 0, "byteLength", 3, "GLB-BUFFER"),
        ("nodes", 0, "mesh", True, "GLB-REFERENCE"),
        ("nodes", 1, "children", [0], "GLB-NODE-TREE"),
        ("nodes", 0, "children", [0], "GLB-NODE-TREE"),
        ("scenes", 0, "nodes", [9], "GLB-REFERENCE"),
        ("animations", 0, "samplers", [{"input": 0, "output": 99}], "GLB-REFERENCE"),
        ("animations", 0, "channels", [{"target": {"node": -1}}], "GLB-REFERENCE"),
        ("meshes", 0, "primitives", [{"attributes": {}, "indices": 99}], "GLB-REFERENCE"),
    ],
)
def test_a_broken_reference_is_found(kind, index, member, value, code):
    document = glb.Document()
    glb.add_model(document, load_model("hfx-temperature-1"))
    for node in ({"mesh": 0}, {}, {"children": [0]}):
        document.append("nodes", node)
    document.append("scenes", {"nodes": [1]})
    document.append("animations", {})
    assert glb.validate(document.encoded(), "x") == []
    document.json[kind][index] = {**document.json[kind][index], member: value}
    text = json.dumps(document.json).encode()
    text += b" " * (-len(text) % 4)
    binary = bytes(document._bytes) + bytes(-len(document._bytes) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    data = struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
    assert code in [each.code for each in glb.validate(data, "x")]
