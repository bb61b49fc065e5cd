# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx validate``: rules between a file and its name, its meshes, or the sound beside it."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_hjif import basis, sample

from hfx_blender.files import kinds
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats.device_files import openxr
from hfx_blender.formats.files import format_of
from hfx_blender.formats.glb.glb import Document
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import csv_reader, glb_rules, jsonl_rules
from hfx_tools.formats.facts import facts_of
from hfx_tools.formats.hmpg import hmpg_writer
from hfx_tools.formats.validation import fault_of, validate


def codes(path: Path, severity: str = "error") -> list[str]:
    return [finding.code for finding in validate(path)[1] if finding.severity == severity]


def triangle() -> Document:
    """Document of a mesh of three vertices, with an animation of two times."""
    document = Document()
    places = document.accessor(np.eye(3), is_vertex=True)
    corners = document.accessor(np.array([0, 1, 2]), is_index=True)
    primitive = {"attributes": {"POSITION": places}, "indices": corners}
    document.append("meshes", {"primitives": [primitive]})
    document.append("nodes", {"mesh": 0})
    times = document.accessor(np.array([0.0, 1.0]))
    moves = document.accessor(np.zeros((2, 3)))
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    sampler = {"input": times, "output": moves}
    document.append("animations", {"samplers": [sampler], "channels": [channel]})
    return document


def scene_with(folder: Path, vertices: list[int], suffix: str = ".hjif") -> Path:
    """File of a scene whose channel has vertices of an avatar with the mesh ``body.glb``."""
    document = sample()
    document["avatars"] = [{"id": 1, "lod": 0, "type": "Custom", "mesh": "body.glb"}]
    for perception in document["perceptions"]:
        perception["avatar_id"] = 1
        for channel in perception["channels"]:
            channel.pop("vertices", None)
    document["perceptions"][0]["channels"][0]["vertices"] = vertices
    path = folder / f"scene{suffix}"
    binary = suffix == ".hmpg"
    path.write_bytes(hmpg_writer.encoded(document, "x").content if binary else encoded(document))
    return path


@pytest.mark.parametrize("suffix", [".hjif", ".hmpg"])
def test_a_scene_needs_its_meshes(tmp_path: Path, suffix: str) -> None:
    prefix = suffix[1:].upper()
    path = scene_with(tmp_path, [0, 2], suffix)
    assert codes(path) == [f"{prefix}-MESH"] and fault_of(path) == ""
    (tmp_path / "body.glb").write_bytes(triangle().encoded())
    assert codes(path) == []
    (tmp_path / "body.glb").write_bytes(triangle().encoded()[:-4])
    assert codes(path) == [f"{prefix}-MESH"]
    (tmp_path / "body.glb").write_bytes(triangle().encoded())
    (finding,) = [x for x in validate(scene_with(tmp_path, [1, 3], suffix))[1] if "VERT" in x.code]
    assert finding.place == "perceptions[0].channels[0].vertices[1]"
    assert finding.message == "is 3, allowed is 0 to 2, the vertices of 'body.glb'"


def test_meshes_that_no_channel_needs_are_a_warning(tmp_path: Path) -> None:
    path = scene_with(tmp_path, [])
    assert codes(path) == [] and "HJIF-MESH" in codes(path, "warning")
    assert codes(scene_with(tmp_path, [-1])) == ["HJIF-VERTEX", "HJIF-MESH"]


@pytest.mark.parametrize("uri", ["https://example.org/body.glb", "/body.glb", "", "//host/b.glb"])
def test_meshes_elsewhere_are_not_looked_for(tmp_path: Path, uri: str) -> None:
    path = scene_with(tmp_path, [7])
    document = json.loads(path.read_bytes())
    document["avatars"][0]["mesh"] = uri
    path.write_bytes(encoded(document))
    assert not {"HJIF-MESH", "HJIF-VERTEX"} & {*codes(path), *codes(path, "warning")}


@pytest.mark.parametrize(
    ("band", "at", "is_valid"),
    [
        ("VectorialWave", (0, 500, 300), False),
        ("Curve", (0, 500, 300), False),
        ("Curve", (0, 300, 300), True),
        ("Transient", (0, 500, 300), True),
    ],
)
def test_keyframes_are_in_order(tmp_path: Path, band: str, at: Any, is_valid: bool) -> None:
    document = sample()
    effect = basis(*((time, 0.5, 100) for time in at), phase=0.0, base_signal="Sine")
    limits = {"lower_frequency_limit": 0, "upper_frequency_limit": 1000}
    channel = document["perceptions"][0]["channels"][0]
    channel["bands"] = [{"band_type": band, **limits, "effects": [effect]}]
    path = tmp_path / "x.hjif"
    path.write_bytes(encoded(document))
    expected = [] if is_valid else ["HJIF-KEYFRAME-ORDER"]
    assert [code for code in codes(path) if "MESH" not in code] == expected


def test_amplitudes_and_frequencies_are_in_order_each(tmp_path: Path) -> None:
    """MPEG's encoder puts a frequency behind a later amplitude."""
    document = sample()
    keyframes = [
        {"relative_position": 0, "amplitude_modulation": 0.5, "frequency_modulation": 80},
        {"relative_position": 500, "amplitude_modulation": 0.5},
        {"relative_position": 300, "frequency_modulation": 90},
    ]
    document["perceptions"][0]["effect_library"][0]["keyframes"] = keyframes
    path = tmp_path / "x.hjif"
    path.write_bytes(encoded(document))
    assert "HJIF-KEYFRAME-ORDER" not in codes(path)


def pattern(version: int) -> dict[str, Any]:
    event = {
        "Type": "transient",
        "RelativeTime": 0,
        "Index": 0,
        "Parameters": {"Intensity": 50, "Frequency": 50},
    }
    entries = [{"Event": event}]
    kinds = {
        1: {"Metadata": {"Version": 1}, "Pattern": entries},
        2: {"Metadata": {"Version": 2}, "PatternList": [{"AbsoluteTime": 0, "Pattern": entries}]},
    }
    return kinds[version]


def openharmony() -> dict[str, Any]:
    parameters = {"Intensity": 50, "Frequency": 50}
    event = {"Type": "transient", "StartTime": 0, "Parameters": parameters}
    return {
        "MetaData": {"Version": 1.0, "ChannelNumber": 1},
        "Channels": [{"Parameters": {"Index": 0}, "Pattern": [{"Event": event}]}],
    }


@pytest.mark.parametrize(
    ("name", "document", "is_valid"),
    [
        ("x.openharmony.json", openharmony(), True),
        ("x.json", openharmony(), True),
        ("x.openxr.json", openharmony(), False),
        ("x.he", openharmony(), False),
        ("x.v1.he", pattern(1), True),
        ("x.he", pattern(1), True),
        ("x.he", pattern(2), True),
        ("x.he.json", pattern(2), True),
        ("x.v1.he", pattern(2), False),
        ("x.openharmony.json", pattern(2), False),
        ("x.openxr.json", pattern(1), False),
    ],
)
def test_the_content_is_of_the_format_in_the_name(
    tmp_path: Path, name: str, document: Any, is_valid: bool
) -> None:
    path = tmp_path / name
    path.write_bytes(encoded(document))
    assert facts_of(path)["valid"].partition(",")[0] == ("yes" if is_valid else "no")
    assert [code.partition("-")[2] for code in codes(path)] == ([] if is_valid else ["NAME"])


def test_spaces_count_among_the_bytes_of_openharmony(tmp_path: Path) -> None:
    path = tmp_path / "x.openharmony.json"
    content = encoded(openharmony())
    path.write_bytes(content + b" " * ((64 << 10) - len(content)))
    assert codes(path) == []
    path.write_bytes(path.read_bytes() + b" ")
    assert codes(path) == ["HE-BYTES"]


def wave(channels: int, rate_hz: int) -> bytes:
    """WAV of a silent sample (Microsoft, 1994)."""
    data = bytes(2 * channels)
    head = struct.pack("<HHIIHH", 1, channels, rate_hz, 2 * channels * rate_hz, 2 * channels, 16)
    chunks = b"fmt " + struct.pack("<I", len(head)) + head
    chunks += b"data" + struct.pack("<I", len(data)) + data
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks


def test_a_sound_and_its_list_have_the_same_channels(tmp_path: Path) -> None:
    sound, beside = tmp_path / "x.wav", tmp_path / "x.wav.channels.json"
    document = {
        "format": "hfx-sound-channels",
        "version": 1,
        "rate_hz": 48000,
        "start_s": 0.0,
        "layout": "stereo",
        "gain": 1.0,
        "channels": [{"channel": k, "azimuth_deg": 0.0, "elevation_deg": 0.0} for k in range(2)],
    }
    beside.write_bytes(encoded(document))
    assert codes(beside, "warning") == ["CHANNELS-SOUND"]
    for channels, rate_hz, expected in ((2, 48000, 0), (1, 48000, 1), (2, 44100, 1)):
        sound.write_bytes(wave(channels, rate_hz))
        assert codes(sound) == ["WAV-LIST"] * expected
        assert codes(beside) == ["CHANNELS-LIST"] * expected


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a.amplitude_m_s2 [m/s^2],a.amplitude_m_s2 [m/s^2]\n0,1,1\n", "'a.amplitude_m_s2' twice"),
        ("a.amplitude_m_s2 [m/s^2]\n0,1\n1,-3\n", "is -3 in row 2, allowed is 0 or more"),
        ("a.amplitude_m_s2 [kPa]\n0,1\n", "unit 'kPa', allowed is 'm/s^2'"),
        ("a.temperature_c [degC]\n0,-3\n", ""),
        ("a.speed [%]\n0,-3\n", ""),
    ],
)
def test_a_table_of_values_that_no_device_plays(text: str, said: str) -> None:
    findings = csv_reader.validate(f"time_s,{text}".encode(), "x.csv")
    assert len(findings) == bool(said) and all(said in each.message for each in findings)


HEADER: dict[str, Any] = {
    "type": "header",
    "format": "hfx-samples",
    "version": 1,
    "rate_hz": 10.0,
    "duration_s": 1.0,
    "models": [{"id": "m", "modality": "vibration", "hash": "0", "vertex_count": 3}],
    "bodies": [{"id": "b", "name": "Anna"}],
    "effects": [
        {
            "id": "e",
            "name": "Buzz",
            "modality": "vibration",
            "kind": "painted",
            "model": "m",
            "is_contact": True,
        }
    ],
}
SET = {"type": "set", "set": 0, "vertices": [0, 2], "weights": [1.0, 0.5]}
SAMPLE = {
    "type": "sample",
    "t": 0.0,
    "effect": "e",
    "body": "b",
    "set": 0,
    "level": 1.0,
    "parameters": {"amplitude_m_s2": 5.0, "frequency_hz": 100.0},
}


@pytest.mark.parametrize(
    ("header", "of_sample", "code"),
    [
        ({}, {}, ""),
        ({"models": HEADER["models"] * 2}, {}, "ID-DUPLICATE"),
        ({"effects": HEADER["effects"] * 2}, {}, "ID-DUPLICATE"),
        ({"effects": [HEADER["effects"][0] | {"model": "other"}]}, {}, "MODEL"),
        ({"effects": [HEADER["effects"][0] | {"kind": "actuators"}]}, {}, "KIND"),
        ({}, {"spot": {"centre_m": [0, 0, 0], "radius_m": 0.1}}, "KIND"),
        ({}, {"actuators": [1.0]}, "SAMPLE-ACTUATORS"),
        ({}, {"parameters": {"amplitude_m_s2": -5.0, "frequency_hz": 100.0}}, "SAMPLE-RANGE"),
    ],
)
def test_lines_fit_the_header(header: Any, of_sample: Any, code: str) -> None:
    lines = (HEADER | header, SET, SAMPLE | of_sample)
    findings = jsonl_rules.validate(b"".join(map(encoded, lines)), "x")
    # A header with a fault makes samples wrong, too: the first fault is the cause.
    assert [finding.code for finding in findings][:1] == ([f"JSONL-{code}"] if code else [])


def test_frames_of_openxr_do_not_overlap() -> None:
    def frame(start: int, kind: str) -> dict[str, Any]:
        points = [{"time": 0, "value": 0.0}, {"time": 1000, "value": 1.0}]
        return {"start": start, "streamFrameType": kind, "amplitudePoints": points}

    def found(second: int) -> list[str]:
        frames = [frame(0, "FIRST_FRAME"), frame(second, "LAST_FRAME")]
        document = {
            "format": openxr.FORMAT,
            "version": 1,
            "minFrequencyHz": 50,
            "maxFrequencyHz": 200,
            "channels": [{"actuator": "a", "frames": frames}],
        }
        return [finding.code for finding in openxr.validate(encoded(document), "x")]

    assert found(1000) == [] and found(1500) == [] and found(500) == ["OPENXR-ORDER"]


def _longer(document: Document) -> None:
    document.json["accessors"][0]["count"] = 1000


def _no_node(document: Document) -> None:
    document.json["nodes"][0]["mesh"] = 4


def _no_vertex(document: Document) -> None:
    corners = document.accessor(np.array([0, 1, 3]), is_index=True)
    document.json["meshes"][0]["primitives"][0]["indices"] = corners


def _back_in_time(document: Document) -> None:
    document.json["animations"][0]["samplers"][0]["input"] = document.accessor(np.array([1.0, 0.0]))


def _volume(document: Document) -> None:
    document.json["nodes"][0]["extras"] = {"hfx_effect": "e", "modality": "smell"}


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (_longer, "GLB-ACCESSOR"),
        (_no_node, "GLB-REFERENCE"),
        (_no_vertex, "GLB-INDEX"),
        (_back_in_time, "GLB-TIME-ORDER"),
        (_volume, "GLB-CHOICE"),
    ],
)
def test_members_of_a_mesh_file_fit_each_other(damage: Any, code: str) -> None:
    document = triangle()
    assert glb_rules.validate(document.encoded(), "x") == []
    damage(document)
    assert code in [finding.code for finding in glb_rules.validate(document.encoded(), "x")]


def test_a_file_named_by_a_mesh_file_is_looked_for(tmp_path: Path) -> None:
    document = triangle()
    media = {"media": [{"alternatives": [{"uri": "x.hjif", "mimeType": "haptics/hjif"}]}]}
    document.json |= {"extensions": {"MPEG_media": media}, "extensionsUsed": ["MPEG_media"]}
    path = tmp_path / "x.glb"
    path.write_bytes(document.encoded())
    assert codes(path, "warning") == ["GLB-MEDIA"]
    (tmp_path / "x.hjif").write_bytes(b"")
    assert codes(path, "warning") == []


def test_a_mesh_file_of_70_mib_is_read_beside_others(tmp_path: Path) -> None:
    document = triangle()
    document.accessor(np.zeros((70 << 20) // 4))
    path = tmp_path / "x.glb"
    path.write_bytes(document.encoded())
    assert path.stat().st_size > 70 << 20
    assert codes(path, "error") + codes(path, "warning") == []


def test_an_unknown_file_is_told_all_known_suffixes(tmp_path: Path) -> None:
    path = tmp_path / "x.foo"
    path.write_bytes(b"x")
    with pytest.raises(Exception, match=r"which is no known format") as caught:
        format_of(path)
    for suffix in (".hfxeffect", ".hfxpath", ".report.json", ".hjif", *kinds.OWN_KINDS):
        assert f" {suffix}" in str(caught.value)


def test_a_converted_scene_has_its_meshes(tmp_path: Path) -> None:
    source, folder = scene_with(tmp_path, [0, 2]), tmp_path / "other"
    (tmp_path / "body.glb").write_bytes(triangle().encoded())
    folder.mkdir()
    written = convert(source, folder / "x.hmpg")
    assert {path.name for path in written.files} == {"x.hmpg", "body.glb"}
    assert codes(folder / "x.hmpg") == []
    (folder / "body.glb").write_bytes(b"of another program")
    assert [path.name for path in convert(source, folder / "x.hmpg").files] == ["x.hmpg"]
    assert (folder / "body.glb").read_bytes() == b"of another program"
