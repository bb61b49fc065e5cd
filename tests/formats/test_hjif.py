# SPDX-License-Identifier: GPL-3.0-or-later
"""HJIF: strict validation, lossless round trips, and envelopes equal to the samples."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from gltf_validator import gltf_faults
from hypothesis import given, settings
from hypothesis import strategies as st

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import (
    TrackBody,
    TrackEffect,
    TrackHeader,
    TrackModel,
    TrackReader,
    TrackWriter,
)
from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats.hjif import (
    envelopes,
    from_track,
    hjif_reader,
    hjif_rules,
    perceptions,
    to_signals,
)
from hfx_blender.formats.hjif.body_parts import BITS, described, place_mask, vertex_masks
from hfx_blender.formats.signals.signals import DEFAULT_TOLERANCE
from hfx_tools.formats import hjif_signals


def basis(*keyframes, **members):
    frames = [
        {"relative_position": t, "amplitude_modulation": a, "frequency_modulation": f}
        for t, a, f in keyframes
    ]
    return {"effect_type": "Basis", "position": 0, "keyframes": frames, **members}


def sample():
    """Return a whole document with every kind of member."""
    wave = basis((0, 0.5, 100), (400, 0.5, 200), phase=0.0, base_signal="Sine")
    channel = {
        "id": 0,
        "description": "c0",
        "gain": 1.0,
        "mixing_coefficient": 1.0,
        "body_part_mask": 1024,
        "priority": 1,
        "reference_device_id": 1,
        "vertices": [1, 2, 3],
        "body_part_target": ["Front", "Chest"],
        "actuator_resolution": {"X": 2, "Y": 2, "Z": 1},
        "actuator_target": [{"X": 1, "Y": 0, "Z": 0}],
        "frequency_sampling": 0,
        "sample_count": 0,
        "direction": {"X": 0, "Y": 0, "Z": 127},
        "bands": [
            {
                "band_type": "Curve",
                "curve_type": "Linear",
                "lower_frequency_limit": 0,
                "upper_frequency_limit": 1000,
                "effects": [basis((0, 0.0, 0), (500, 0.5, 0), (1000, 1.0, 0))],
            },
            {
                "band_type": "VectorialWave",
                "priority": 3,
                "lower_frequency_limit": 0,
                "upper_frequency_limit": 1000,
                "effects": [
                    {**wave, "position": 100},
                    {"effect_type": "Reference", "position": 600, "id": 7},
                    {"effect_type": "Composite", "position": 1500, "composition": [wave]},
                ],
            },
            {
                "band_type": "Transient",
                "lower_frequency_limit": 65,
                "upper_frequency_limit": 300,
                "effects": [basis((0, 1.0, 150), base_signal="Sine")],
            },
            {
                "band_type": "WaveletWave",
                "block_length": 64,
                "lower_frequency_limit": 65,
                "upper_frequency_limit": 300,
                "effects": [{"effect_type": "Basis", "position": 0, "wavelet_stream": "AAAA"}],
            },
        ],
    }
    device = {
        "id": 1,
        "name": "vest",
        "body_part_mask": 1024,
        "maximum_frequency": 250.0,
        "minimum_frequency": 0.0,
        "resonance_frequency": 100.0,
        "maximum_amplitude": 20.0,
        "impedance": 8.0,
        "maximum_voltage": 5.0,
        "maximum_current": 1.0,
        "maximum_displacement": 1.0,
        "weight": 0.1,
        "size": 10.0,
        "custom": -1.0,
        "type": "VCA",
    }
    library = basis((0, 1.0, 80), (500, 0.0, 80), id=7, semantic_keywords="UX/Click")
    perception = {
        "id": 0,
        "avatar_id": 2,
        "description": "chest",
        "perception_modality": "Vibrotactile",
        "priority": 2,
        "unit_exponent": -3,
        "perception_unit_exponent": 0,
        "reference_devices": [device],
        "effect_library": [library],
        "channels": [channel],
    }
    return {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": "2024-01-01T12:00:00+00:00",
        "description": "test",
        "timescale": 1000,
        "avatars": [
            {"id": 1, "lod": 0, "type": "Pressure"},
            {"id": 2, "lod": 0, "type": "Custom", "mesh": "body%20mesh.glb"},
        ],
        "perceptions": [perception],
        "syncs": [{"timestamp": 0, "timescale": 1000}],
    }


P = ("perceptions", 0)
C = (*P, "channels", 0)
D = (*P, "reference_devices", 0)
E = (*P, "effect_library", 0)


def at(document, path):
    for key in path:
        document = document[key]
    return document


def with_change(path, value):
    samples = sample()
    at(samples, path[:-1])[path[-1]] = value
    return samples


def codes(document):
    return [finding.code for finding in hjif_rules.findings(document)]


def test_the_sample_is_valid():
    assert hjif_rules.findings(sample()) == []


# One entry per semantic rule of the standard's conformance configuration.
SEMANTIC = {
    "VERSION-YEAR": (("version",), "2022"),
    "VERSION-AMENDMENT": (("version",), "2023-0"),
    "PROFILE": (("profile",), "main"),
    "LEVEL": (("level",), 3),
    "DATE": (("date",), "yesterday"),
    "TIMESCALE": (("timescale",), 48_001),
    "AVATAR-ID-DUPLICATE": (("avatars", 0, "id"), 2),
    "AVATAR-URI": (("avatars", 1, "mesh"), ""),
    "PERCEPTION-ID-DUPLICATE": (("perceptions",), [sample()["perceptions"][0]] * 2),
    "MODALITY": ((*P, "perception_modality"), "Smell"),
    "AVATAR-ID-UNKNOWN": ((*P, "avatar_id"), 9),
    "CHANNEL-COUNT": (
        (*P, "channels"),
        [{**sample()["perceptions"][0]["channels"][0], "id": k, "bands": []} for k in range(128)],
    ),
    "DEVICE-ID-DUPLICATE": ((*P, "reference_devices"), [{"id": 1, "name": "a"}] * 2),
    "DEVICE-FREQUENCY-RANGE": ((*D, "minimum_frequency"), 251.0),
    "DEVICE-RESONANCE-LOW": ((*D, "minimum_frequency"), 101.0),
    "DEVICE-RESONANCE-HIGH": ((*D, "maximum_frequency"), 99.0),
    "CHANNEL-ID-DUPLICATE": (
        (*P, "channels"),
        [sample()["perceptions"][0]["channels"][0]] * 2,
    ),
    "DEVICE-ID-UNKNOWN": ((*C, "reference_device_id"), 2),
    "RESOLUTION-NEGATIVE": ((*C, "actuator_resolution", "X"), -2),
    "ACTUATOR-TARGET": ((*C, "actuator_target", 0, "X"), 3),
    "BAND-COUNT": ((*C, "bands"), [sample()["perceptions"][0]["channels"][0]["bands"][2]] * 8),
    "DIRECTION": ((*C, "direction", "Z"), 120),
    "CURVE-TYPE": ((*C, "bands", 3, "curve_type"), "Linear"),
    "BLOCK-LENGTH": ((*C, "bands", 3, "block_length"), 65),
    "BAND-FREQUENCY": ((*C, "bands", 2, "lower_frequency_limit"), 301),
    "EFFECT-ID-DUPLICATE": (
        (*P, "effect_library"),
        [sample()["perceptions"][0]["effect_library"][0]] * 2,
    ),
    "EFFECT-ID-UNKNOWN": ((*C, "bands", 1, "effects", 1, "id"), 8),
    "EFFECT-ID-MISSING": ((*P, "effect_library"), [basis((0, 1.0, 1))]),
    "SEMANTIC-KEYWORDS": ((*E, "semantic_keywords"), "UX/Confirmation"),
    "EFFECT-POSITION": ((*C, "bands", 0, "effects"), [{"effect_type": "Basis", "keyframes": []}]),
    "EFFECT-KEYFRAMES": ((*C, "bands", 0, "effects"), [{"effect_type": "Basis", "position": 0}]),
    "EFFECT-WAVE": ((*C, "bands", 1, "effects"), [basis((0, 1.0, 150))]),
    "WAVELET-STREAM": (
        (*C, "bands", 3, "effects"),
        [{"effect_type": "Basis", "position": 0}],
    ),
    "BAND-WHOLE": ((*C, "bands", 2, "lower_frequency_limit"), 65.5),
    "WAVELET-KEYFRAMES": ((*C, "bands", 3, "effects"), [basis((0, 1.0, 150))]),
    "REFERENCE-CRASH": ((*P, "perception_modality"), "Humidity"),
    "REFERENCE-SCHEME": ((*P, "semantic_scheme"), "mine"),
    "REFERENCE-WHOLE": ((*E, "keyframes", 0, "frequency_modulation"), 80.5),
}


@pytest.mark.parametrize("code", SEMANTIC)
def test_each_semantic_rule_has_its_code(code):
    path, value = SEMANTIC[code]
    findings = hjif_rules.findings(with_change(path, value))
    assert f"HJIF-{code}" in [entry.code for entry in findings]
    is_warning = code.startswith("REFERENCE")
    severities = {entry.severity for entry in findings if entry.code == f"HJIF-{code}"}
    assert severities == {"warning" if is_warning else "error"}


# Accepted by MPEG's reference software (IOJson.cpp): a date needs four digits in a row, a URI one
# character, a target may equal the resolution, and channels count per perception.
TAKEN = {
    "HJIF-DATE": (("date",), "2024-13-01 12:00"),
    "HJIF-AVATAR-URI": (("avatars", 1, "mesh"), "body mesh.glb"),
    "HJIF-ACTUATOR-TARGET": ((*C, "actuator_target", 0, "X"), 2),
    "HJIF-UNKNOWN": ((*C, "comment"), "mine"),
}


@pytest.mark.parametrize("code", TAKEN)
def test_files_accepted_by_the_reference_software_are_valid_with_a_warning(code):
    path, value = TAKEN[code]
    document = sample()
    at(document, path[:-1])[path[-1]] = value
    findings = hjif_rules.findings(document)
    assert [(entry.code, entry.severity) for entry in findings] == [(code, "warning")]
    _, notes = hjif_reader.decode(encoded(document), "x")
    assert any(f"[{code}]" in note for note in notes)


@pytest.mark.parametrize(("part", "is_read"), [("Hand", True), ("Upper", False), ("Toe", True)])
def test_body_parts_that_the_reference_software_cannot_read_are_a_warning(part, is_read):
    """MPEG's reference software names the parts of the body Top and Down, not Upper and Lower."""
    document = sample()
    at(document, C)["body_part_target"] = ["All", part]
    assert codes(document) == ([] if is_read else ["HJIF-REFERENCE-CRASH"])


def test_channels_of_several_perceptions_are_too_many_with_a_warning():
    document = sample()
    channels = [{**at(document, C), "id": k} for k in range(100)]
    first = {**at(document, P), "channels": channels}
    document["perceptions"] = [first, {**first, "id": 1}]
    findings = [
        finding for finding in hjif_rules.findings(document) if finding.code == "HJIF-CHANNEL-COUNT"
    ]
    assert [entry.severity for entry in findings] == ["warning"]


def test_a_target_without_a_resolution_is_an_error():
    document = sample()
    del at(document, C)["actuator_resolution"]
    assert "HJIF-ACTUATOR-TARGET" in codes(document)


def test_the_profile_simple_parametric_has_rules_of_its_own():
    samples = sample()
    samples["profile"] = "Simple Parametric"
    samples["timescale"] = 48_000
    samples["perceptions"][0]["perception_modality"] = "Wind"
    assert set(codes(samples)) == {
        "HJIF-TIMESCALE",
        "HJIF-MODALITY-PROFILE",
        "HJIF-WAVELET-PROFILE",
        "HJIF-EFFECT-TYPE-PROFILE",
    }


def test_needs_of_the_reference_software_are_a_warning():
    samples = sample()
    del samples["syncs"], samples["timescale"], at(samples, C)["body_part_mask"]
    assert codes(samples) == ["HJIF-REFERENCE-MISSING"] * 3
    assert hjif_reader.decode(encoded(samples), "x")[0].get("timescale") is None


def places(value, place=()):
    """Yield the paths of all members of a document."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield (*place, key)
            yield from places(item, (*place, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*place, 0))


REQUIRED = {
    "": "version profile level date description avatars perceptions",
    "avatars": "id lod type",
    "perceptions": "id perception_modality description avatar_id effect_library channels",
    "reference_devices": "id name",
    "channels": "id description gain mixing_coefficient bands",
    "bands": "band_type lower_frequency_limit upper_frequency_limit effects",
    "effects": "effect_type",
    "effect_library": "effect_type",
    "composition": "effect_type",
    "actuator_target": "X Y Z",
    "actuator_resolution": "X Y Z",
    "direction": "X Y Z",
    "syncs": "timestamp",
}


@pytest.mark.parametrize("path", list(places(sample())), ids=lambda p: ".".join(map(str, p)))
def test_each_member_is_checked(path):
    """A member of a wrong type, a misspelt or a missing member is refused."""
    for wrong in (None, True, {"a": 1}, [[]], "\u0000?"):
        actual = with_change(path, wrong)
        original = at(sample(), path)
        if type(wrong) is type(original) and path[-1] in ("description", "name", "wavelet_stream"):
            continue
        assert any(finding.severity == "error" for finding in hjif_rules.findings(actual)), wrong
    misspelt = sample()
    parent = at(misspelt, path[:-1])
    parent[f"{path[-1]}s"] = parent[path[-1]]
    assert "HJIF-UNKNOWN" in codes(misspelt)
    without = sample()
    del at(without, path[:-1])[path[-1]]
    owner = next((key for key in reversed(path[:-1]) if isinstance(key, str)), "")
    is_required = path[-1] in REQUIRED.get(owner, "").split()
    assert ("HJIF-MISSING" in codes(without)) == is_required


@pytest.mark.parametrize(
    ("path", "lowest", "highest"),
    [
        (("avatars", 0, "id"), 1, None),
        (("avatars", 0, "lod"), 0, None),
        ((*D, "id"), 1, None),
        ((*D, "body_part_mask"), 0, 2**32 - 1),
        ((*D, "maximum_voltage"), 0.0, None),
        ((*C, "gain"), 0.0, None),
        ((*C, "body_part_mask"), 0, 2**32 - 1),
        ((*C, "direction", "X"), -127, 127),
        ((*C, "bands", 0, "upper_frequency_limit"), 0, 10_000),
        ((*C, "bands", 3, "block_length"), 16, None),
        ((*E, "position"), 0, None),
        ((*E, "phase"), 0.0, 6.28318),
        ((*E, "keyframes", 0, "relative_position"), 0, None),
        ((*E, "keyframes", 0, "amplitude_modulation"), -1.0, 1.0),
        ((*E, "keyframes", 0, "frequency_modulation"), 0, 10_000),
        (("syncs", 0, "timestamp"), 0, None),
        (("timescale",), 1, None),
    ],
)
def test_numbers_keep_their_ranges(path, lowest, highest):
    assert "HJIF-RANGE" not in codes(with_change(path, lowest))
    assert "HJIF-RANGE" in codes(with_change(path, lowest - 1))
    if highest is not None:
        assert "HJIF-RANGE" not in codes(with_change(path, highest))
        assert "HJIF-RANGE" in codes(with_change(path, highest + 1))


@pytest.mark.skipif(
    "HFX_HJIF_SCHEMAS" not in os.environ, reason="the standard's schemas are not ours"
)
def test_the_standards_schemas_agree():
    """An independent reader of the standard's schemas refuses the same documents."""
    jsonschema = pytest.importorskip("jsonschema")
    from referencing import Registry, Resource
    from referencing.jsonschema import DRAFT4

    folder = Path(os.environ["HFX_HJIF_SCHEMAS"])
    files = {path.name: json.loads(path.read_text()) for path in folder.glob("*.json")}
    registry = Registry().with_resources(
        (name, Resource(contents=entry, specification=DRAFT4)) for name, entry in files.items()
    )
    judge = jsonschema.Draft4Validator(files["MPEG_haptics.schema.json"], registry=registry)
    assert judge.is_valid(sample())
    schema_codes = {"HJIF-MISSING", "HJIF-TYPE", "HJIF-RANGE", "HJIF-CHOICE", "HJIF-COUNT"}
    schema_codes |= {"HJIF-MODALITY", "HJIF-VERSION"}
    for keys in places(sample()):
        if "composition" in keys:  # the schema does not check compositions
            continue
        for wrong in (None, True, {"a": 1}, [[]], -1, 1.5, 20_000, "?", ...):
            actual = with_change(keys, None if wrong is ... else wrong)
            if wrong is ...:
                del at(actual, keys[:-1])[keys[-1]]
            ours = not schema_codes & set(codes(actual))
            assert judge.is_valid(actual) == ours, (keys, wrong, codes(actual))


# --- round trips ---------------------------------------------------------------------------


def test_faults_are_found_among_a_thousand_unknown_members():
    actual = {**{f"more{k}": 1 for k in range(1200)}, **sample()}
    assert (
        hjif_reader.decode(encoded(actual), "x")[0] == hjif_reader.decode(encoded(sample()), "x")[0]
    )
    actual["perceptions"][0]["channels"][0]["vertices"] = "all"
    with pytest.raises(InputError, match='vertices is "all", allowed is a list'):
        hjif_reader.decode(encoded(actual), "x")


def test_a_round_trip_keeps_everything():
    document = hjif_reader.decode(encoded(sample()), "x")[0]
    assert json.loads(encoded(document)) == sample()
    assert hjif_reader.decode(encoded(document), "x")[0] == document


NAMES = st.text(max_size=20).map(lambda text: text.encode("utf-8", "replace").decode())


def record(required, **optional):
    return st.fixed_dictionaries(required, optional=optional)


KEYFRAMES = record(
    {},
    relative_position=st.integers(0, 2**31),
    amplitude_modulation=st.floats(-1.0, 1.0),
    frequency_modulation=st.integers(0, 10_000),
)
EFFECTS = record(
    {
        "effect_type": st.just("Basis"),
        "position": st.integers(0, 2**31),
        "phase": st.floats(0.0, 6.28),
        "base_signal": st.sampled_from(["Sine", "Square"]),
        "keyframes": st.lists(KEYFRAMES, max_size=5).map(
            lambda items: sorted(items, key=lambda item: item.get("relative_position", 0))
        ),
    }
)
BANDS = record(
    {
        "band_type": st.sampled_from(["Curve", "VectorialWave", "Transient"]),
        "lower_frequency_limit": st.integers(0, 500),
        "upper_frequency_limit": st.integers(500, 10_000),
        "effects": st.lists(EFFECTS, max_size=3),
    }
)
CHANNELS = record(
    {
        "id": st.just(0),
        "description": NAMES,
        "gain": st.floats(0, 1e9),
        "mixing_coefficient": st.floats(0, 1e9),
        "bands": st.lists(BANDS, max_size=3),
        "body_part_mask": st.integers(0, 2**32 - 1),
    },
    vertices=st.lists(st.integers(0, 2**31), max_size=4),
)
DOCUMENTS = st.builds(
    perceptions.document_of,
    NAMES,
    record(
        {
            "id": st.integers(0, 255),
            "avatar_id": st.just(0),
            "description": NAMES,
            "perception_modality": st.sampled_from(
                ["Pressure", "Vibrotactile", "Wind", "Temperature"]
            ),
            "channels": st.lists(CHANNELS, min_size=1, max_size=3),
            "effect_library": st.just([]),
        }
    ).map(lambda one: [one]),
    st.integers(1, 48_000),
    st.just([]),
)


@given(DOCUMENTS)
@settings(max_examples=60, deadline=None)
def test_any_document_survives(document):
    data = encoded(document)
    assert hjif_rules.validate(data, "x") == []
    assert hjif_reader.decode(data, "x")[0] == document
    with contextlib.suppress(limits.TooLargeError):  # a position may be a day away
        for envelope in to_signals.envelopes(document):
            assert np.isfinite(envelope.strength.values).all()


def test_many_channels_and_keyframes_survive():
    effect = basis(*((k, (k % 100) / 100.0, 80) for k in range(20_000)))
    effect |= {"phase": 0.0, "base_signal": "Sine"}
    wave = {"band_type": "VectorialWave", "effects": [effect]}
    wave |= {"lower_frequency_limit": 0, "upper_frequency_limit": 1000}
    channel = {"gain": 1.0, "mixing_coefficient": 1.0, "body_part_mask": 1}
    channels = [
        {"id": 0, "description": f"c{k}", **channel, "bands": [] if k else [wave]}
        for k in range(2000)
    ]
    perception = {"id": 0, "avatar_id": 0, "description": "p", "effect_library": []}
    perception |= {"perception_modality": "Vibrotactile", "channels": channels}
    document = perceptions.document_of("big", [perception], 1000, [])
    data = encoded(document)
    assert hjif_rules.validate(data, "x") == []
    assert hjif_reader.decode(data, "x")[0] == document
    one = {**document, "level": 1}
    assert "HJIF-CHANNEL-COUNT" in [
        finding.code for finding in hjif_rules.validate(encoded(one), "x")
    ]


def test_envelopes_of_references_compositions_and_ticks():
    waves = sample()  # without the curve and the wavelet, both samples of the vibration
    at(waves, (*C, "bands"))[:] = at(waves, (*C, "bands"))[1:3]
    (actual,) = to_signals.envelopes(hjif_reader.decode(encoded(waves), "x")[0])
    # A wave from 0.1 to 0.5 s; the library's from 0.6 to 1.1 s; the composition from 1.5 s on.
    assert actual.strength.at([0.05, 0.3, 0.6, 0.85, 1.2, 1.6]) == pytest.approx(
        [0.0, 0.5, 1.0, 0.5, 0.0, 0.5]
    )
    assert actual.frequency_hz.at([0.3, 0.85]) == pytest.approx([150.0, 80.0])
    assert [(t.time_s, t.amplitude, t.frequency_hz) for t in actual.transients] == [
        (0.0, 1.0, 150.0)
    ]
    assert actual.full_scale == 20.0 and actual.vertices == (1, 2, 3)


def test_effects_that_refer_in_circles_are_refused():
    samples = sample()
    library = at(samples, (*P, "effect_library"))
    library[:] = [
        {
            "effect_type": "Composite",
            "id": 7,
            "composition": [{"effect_type": "Reference", "id": 7}] * 9,
        }
    ]
    with pytest.raises(InputError, match=r"levels deep|unfolds to more"):
        hjif_signals.decode(encoded(samples), "x")


# --- from a track --------------------------------------------------------------------------


DENSE = envelopes.Dense(np.arange(3.0), np.array([0.0, 1.0, 0.0]))


def track_of(
    folder, modality, kind, values, *, fps=Fraction(24), rate_hz=None, name="Rain", strengths=None
):
    """Write a track with one effect and one level per sample, on vertices of the shipped model."""
    id = f"hfx-{'pressure' if modality == 'wind' else modality}-1"
    body = load_model(id)
    vertices = np.arange(0, len(body), 7, dtype=np.int32)[:40]
    count = len(values)
    frames = int(count * fps / (rate_hz or fps))
    time = TimeBase(fps, rate_hz or fps, 0, 0, frames - 1)
    stream = Stream("e", "b", modality, id)
    header = TrackHeader(
        time=time,
        models=(TrackModel(id, body.modality, body.content_hash, len(body)),),
        bodies=(TrackBody("b", "Zoë"),),
        effects=(
            TrackEffect(
                "e", name, modality, kind, id, painted_vertices=40 if kind == "painted" else None
            ),
        ),
        streams=(stream,),
    )
    parameters = {
        "vibration": [10.0, 80.0],
        "pressure": [5.0],
        "temperature": [14.0],
        "wind": [4.0, 0.0, -1.0, 0.0],
    }[modality]
    indices = np.flatnonzero(np.asarray(values) > 0.0)
    path = folder / "x.hfxtrack"
    weights = np.ones(40, np.float32) if strengths is None else np.float32(strengths)
    with TrackWriter(path, header, full_precision=True) as writer:
        if len(indices):
            writer.append(
                [
                    SampleRun(
                        stream=stream,
                        indices=indices,
                        times_s=time.times_s(indices),
                        levels=np.asarray(values, np.float64)[indices],
                        parameters=np.tile(parameters, (len(indices), 1)),
                        offsets=np.array([0, 40]),
                        vertices=vertices,
                        weights=weights,
                        sets=np.zeros(len(indices), np.int64),
                    )
                ]
            )
    return TrackReader(path)


BEAT = [0.0, 0.5, 1.0, 0.5, 0.0, 0.0]


@pytest.mark.parametrize("kind", ["painted", "volume"])
@pytest.mark.parametrize("modality", ["vibration", "pressure", "temperature", "wind"])
def test_the_file_holds_the_samples(tmp_path, modality, kind):
    levels = np.array(BEAT * 4)
    with track_of(tmp_path, modality, kind, levels) as track:
        written = from_track.write(track, (), tmp_path / "scene ä")
    data = (tmp_path / "scene ä.hjif").read_bytes()
    assert hjif_rules.validate(data, "x") == []
    document = hjif_reader.decode(data, "x")[0]
    (perception,) = document["perceptions"]
    assert perception["perception_modality"] == MODALITIES[modality].hjif
    assert perception["description"].startswith("Zoë")
    mesh = document["avatars"][0]["mesh"]
    assert mesh == f"scene%20%C3%A4.hfx-{'pressure' if modality == 'wind' else modality}-1.glb"
    assert gltf_faults(written.files[1]) == []
    full = {"vibration": 10.0, "pressure": 5.0, "temperature": 10.0, "wind": 4.0}[modality]
    sign = -1.0 if modality == "temperature" else 1.0  # 14 degC is ten below neutral
    times = np.arange(len(levels)) / 24.0
    vertices = set()
    for envelope in to_signals.envelopes(document):
        assert envelope.full_scale == pytest.approx(full)
        assert envelope.strength.at(times) == pytest.approx(sign * levels, abs=0.010001)
        vertices.update(envelope.vertices)
    assert len(vertices) == 40
    assert (len(perception["channels"]) == 1) == (kind == "painted")


def test_repeated_clips_are_in_the_library_once(tmp_path):
    with track_of(tmp_path, "vibration", "painted", np.array(BEAT * 20)) as track:
        document, *_ = from_track.compose(track, (), "x")
    (perception,) = document["perceptions"]
    (effect,) = perception["effect_library"]
    (channel,) = perception["channels"]
    effects = channel["bands"][0]["effects"]
    assert [entry["effect_type"] for entry in effects] == ["Reference"] * 20
    ticks = document["timescale"] // 4
    assert [entry["position"] for entry in effects] == [k * ticks for k in range(20)]
    assert [k["amplitude_modulation"] for k in effect["keyframes"]] == pytest.approx(
        [0, 1, 0], abs=0.01
    )


@pytest.mark.parametrize("modality", ["pressure", "vibration"])
@pytest.mark.parametrize("levels", [[1.0], [0.0, 1.0], [1.0] * 200])
def test_short_and_constant_scenes(tmp_path, modality, levels):
    with track_of(tmp_path, modality, "painted", levels) as track:
        document, *_ = from_track.compose(track, (), "x")
    assert hjif_rules.findings(json.loads(encoded(document))) == []
    frames = document["perceptions"][0]["channels"][0]["bands"][0]["effects"][0]["keyframes"]
    assert len(frames) >= (3 if modality == "pressure" else 2)
    assert frames[-1]["amplitude_modulation"] == pytest.approx(1.0, abs=0.01)


def _reference_channels(document):
    """Return channels as in the reference decoder: by id, over the whole file."""
    return {c["id"]: c for p in document["perceptions"] for c in p["channels"]}


def test_channels_are_numbered_over_the_whole_file():
    def perception(id):
        places = [perceptions.Place(f"{id}{k}", 1.0, 0, dense=DENSE) for k in range(3)]
        return perceptions.perception_of(id, "pressure", places, (), 1000, DEFAULT_TOLERANCE)

    document = perceptions.document_of("x", [perception(0), perception(1)], 1000)
    reference_channels = _reference_channels(json.loads(encoded(document)))
    assert [reference_channels[k]["description"] for k in range(6)] == [
        "00",
        "01",
        "02",
        "10",
        "11",
        "12",
    ]


@pytest.mark.parametrize("modality", ["vibration", "pressure"])
@pytest.mark.parametrize("seconds", [20, 150])  # at 600 ticks a second; one effect holds 109 s
def test_a_binary_form_of_16_bits_loses_no_time(tmp_path, modality, seconds):
    levels = 0.5 + 0.5 * np.sin(np.arange(100 * seconds) / 7.0)
    levels[300::500] = 1.0
    with track_of(tmp_path, modality, "painted", levels, rate_hz=Fraction(100)) as track:
        document, *_ = from_track.compose(track, (), "x")
    actual = json.loads(encoded(document))
    (channel,) = _reference_channels(actual).values()
    times, values = [], []
    for effect in channel["bands"][0]["effects"]:
        assert effect["effect_type"] == "Basis"
        for frame in effect["keyframes"]:
            ticks = effect["position"] + frame["relative_position"] % 2**16
            times.append(ticks / actual["timescale"])
            values.append(frame["amplitude_modulation"])
    assert times == sorted(times) and times[-1] >= len(levels) / 100.0
    rows = np.arange(len(levels)) / 100.0
    np.testing.assert_allclose(np.interp(rows, times, values), levels / levels.max(), atol=0.01001)


@pytest.mark.parametrize("modality", ["vibration", "pressure", "temperature", "wind"])
def test_a_player_that_scales_by_the_exponent_cuts_nothing(tmp_path, modality):
    with track_of(tmp_path, modality, "painted", [0.0, 0.4, 1.0, 0.3, 0.0]) as track:
        document, *_ = from_track.compose(track, (), "x")
    actual = json.loads(encoded(document))["perceptions"][0]
    scale = 10.0 ** actual.get("perception_unit_exponent", 0)
    frames = actual["channels"][0]["bands"][0]["effects"][0]["keyframes"]
    samples = np.clip([abs(scale * k["amplitude_modulation"]) for k in frames], 0.0, 1.0)
    assert ((samples > 0.1) & (samples < 0.9)).any() and samples.max() == pytest.approx(
        1.0, abs=0.01
    )


@pytest.mark.parametrize("modality", ["vibration", "pressure"])
@pytest.mark.parametrize("level", [1.0, 0.004])
def test_a_hold_stays_constant(tmp_path, modality, level):
    levels = np.array([0.0] * 5 + [1.0] * 50 + [0.3, 0.9] + [level] * 60 + [0.0] * 3)
    with track_of(tmp_path, modality, "painted", levels) as track:
        document, *_ = from_track.compose(track, (), "x")
    (actual,) = to_signals.envelopes(document)
    held = actual.strength.at(np.linspace(5, 54, 400) / 24.0)
    np.testing.assert_allclose(held, 1.0, atol=1e-6)
    np.testing.assert_allclose(
        actual.strength.at(np.linspace(57, 116, 400) / 24.0), level, atol=1e-6
    )


def test_weights_become_gains(tmp_path):
    weights = np.repeat([1.0, 0.5, 0.25, 0.05], 10)
    with track_of(tmp_path, "pressure", "painted", BEAT, strengths=weights) as track:
        document, *_ = from_track.compose(track, (), "x")
    gains = [channel["gain"] for channel in document["perceptions"][0]["channels"]]
    assert gains == pytest.approx([1.0, 0.5, 0.25, 0.05])


def test_a_track_without_contacts_is_refused(tmp_path):
    with track_of(tmp_path, "pressure", "painted", [0.0, 0.0]) as track:
        with pytest.raises(InputError, match="no samples on a body"):
            from_track.write(track, (), tmp_path / "y")
    assert not list(tmp_path.glob("y*"))


def test_the_wind_has_its_direction(tmp_path):
    with track_of(tmp_path, "wind", "painted", BEAT) as track:
        document, *_ = from_track.compose(track, (), "x")
    # Blender's -Y, where the body looks, is glTF's +Z.
    assert document["perceptions"][0]["channels"][0]["direction"] == {"X": 0, "Y": 0, "Z": 127}


@pytest.mark.parametrize(
    ("rates", "ticks"),
    [
        ((Fraction(24), Fraction(100)), 7800),
        ((Fraction(60), Fraction(60)), 7980),
        ((Fraction(30_000, 1001), Fraction(100)), 30_000),
        ((Fraction(24_000, 1001), Fraction(24_000, 1001)), 24_000),
        ((Fraction(120), Fraction(7919)), 7920),  # both together would need 950280
    ],
)
def test_a_frame_is_a_whole_number_of_ticks(rates, ticks):
    actual = envelopes.timescale_of(*rates)
    assert actual == ticks
    assert (actual / rates[0]).denominator == 1


# --- body parts ----------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1"])
def test_every_vertex_has_a_part_and_left_mirrors_right(id):
    body = load_model(id)
    masks = vertex_masks(body)
    assert (masks > 0).all()
    left, right = masks[body.side == 1], masks[body.side == 2]
    for bits, side in ((left, "right"), (right, "left")):
        names = {described(int(mask)) for mask in np.unique(bits)}
        assert not [name for name in names if side in name]


def test_known_places_have_their_bits():
    body = load_model("hfx-pressure-1")
    masks = vertex_masks(body)

    def bit(point):
        k = int(np.argmin(np.linalg.norm(body.vertices - np.array(point), axis=1)))
        return described(int(masks[k]))

    assert bit((0.1, 0.1, 1.35)) == "upper back"
    assert bit((-0.1, 0.1, 1.0)) == "lower back" or bit((-0.1, 0.1, 1.1)) == "lower back"
    assert bit((0.1, -0.2, 1.35)) == "left upper chest"
    assert bit((-0.1, -0.2, 1.35)) == "right upper chest"
    assert bit((0.0, -0.3, 1.15)) == "abdomen"
    assert "head" in bit((0.0, -0.3, 1.65)) and "front" in bit((0.0, -0.3, 1.65))
    assert BITS[26] == "right sole" and place_mask is not None


def test_track_data_beyond_the_document_is_reported(tmp_path):
    with track_of(tmp_path, "wind", "painted", BEAT) as track:
        header, runs = track.header, list(track.runs())
        assert from_track.write(track, (), tmp_path / "still").left_out == ()
    (run,) = runs
    run.parameters[-1, 1:4] = 1.0, 0.0, 0.0
    (tmp_path / "x.hfxtrack").unlink()
    with TrackWriter(tmp_path / "x.hfxtrack", header, full_precision=True) as writer:
        moved = run.vertices + 1
        writer.append(
            [
                replace(
                    run,
                    sets=np.array([0, 0, 1]),
                    offsets=np.array([0, 40, 80]),
                    vertices=np.concatenate([run.vertices, moved]),
                    weights=np.ones(80, "f4"),
                )
            ]
        )
    with TrackReader(tmp_path / "x.hfxtrack") as track:
        turning, changing = from_track.write(track, (), tmp_path / "turning").left_out
    assert "changing direction" in turning and turning.endswith("1 (Rain)")
    assert "first sample" in changing and changing.endswith("1 (Rain)")
