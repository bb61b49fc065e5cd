# SPDX-License-Identifier: GPL-3.0-or-later
"""HMPG: bits packed by hand, steps of numbers, round trips, damaged streams, commands.

Widths and order of the fields are those of MPEG's reference software (HapticReferenceSoftware,
``IOStream.cpp`` and ``IOBinaryFields.h``), written down here once more.
"""

from __future__ import annotations

import copy
import json
import random
from fractions import Fraction

import numpy as np
import pytest
from format_cases import raster_for
from test_hjif import at, basis, sample, track_of
from test_hjif_foreign import RATE, channel_with, coded

from hfx_blender import cli
from hfx_blender.devices.configuration import load_device
from hfx_blender.errors import InputError
from hfx_blender.files import limits
from hfx_blender.files.strict_json import encoded as as_json
from hfx_blender.formats import writing
from hfx_blender.formats.hjif import hjif_reader, hjif_rules, to_signals
from hfx_blender.formats.hjif.semantics import SEMANTICS
from hfx_tools.commands.conversion import convert
from hfx_tools.formats import hjif_signals
from hfx_tools.formats.facts import facts_of
from hfx_tools.formats.hmpg import bits, syntax
from hfx_tools.formats.hmpg.hmpg_files import validate
from hfx_tools.formats.hmpg.hmpg_reader import decode, document_of
from hfx_tools.formats.hmpg.hmpg_writer import encoded
from hfx_tools.formats.validation import fault_of

# --- a stream by hand -----------------------------------------------------------------------


def packed(*fields):
    """Bytes of (bits, number) or texts, highest bit first; a text has a byte for its length."""
    digits = ""
    for field in fields:
        if isinstance(field, str):
            content = field.encode()
            digits += "".join(f"{byte:08b}" for byte in (len(content), *content))
        else:
            width, number = field
            digits += f"{number:0{width}b}"
            assert len(f"{number:0{width}b}") == width
    digits += "0" * (-len(digits) % 8)
    return bytes(int(digits[k : k + 8], 2) for k in range(0, len(digits), 8))


def packet(kind, *fields):
    payload = packed(*fields)
    return packed((6, kind), (17, len(payload)), (1, 0)) + payload


def unit(kind, duration, *packets, sync=0):
    payload = b"".join(packets)
    head = packed((6, kind), (2, sync), (4, 0), (24, duration), (32, len(payload)), (4, 0))
    return head + payload


def wave_document():
    """Return a document of one wave at 0.2 s, at 1000 ticks a second."""
    wave = basis((0, 0.0, 100), (40, 1.0, 200), (300, -1.0, 200), phase=0.0, base_signal="Square")
    band = {"band_type": "VectorialWave", "lower_frequency_limit": 0, "upper_frequency_limit": 1000}
    document = channel_with({**band, "effects": [{**wave, "position": 200}]}, modality="Wind")
    document["perceptions"][0] |= {"unit_exponent": -3, "perception_unit_exponent": 0}
    return {**document, "syncs": [{"timestamp": 0, "timescale": 1000}]}


GAIN = round(10_001 / 20_000 * (2**32 - 1))  # 1 within -10,000 to 10,000
MIXING = round(1 / 10_000 * (2**32 - 1))


def wave_stream():
    """Return the same wave, packed by hand. Units of 128 ticks: the first is silent, the wave
    begins at tick 72 of the second, and ends 116 ticks into the fourth, 184 - 368 = -184."""
    heads = [
        packet(11, (32, 0), (32, 1000), (24, 128), (24, 0), (1, 0)),
        packet(1, "2023", "Main", (8, 1), "2026-11-23 00:12:16", "", (8, 1), (8, 0)),
        packet(
            *(2, (8, 0), (8, 0), "", (8, 8), (8, 0), (16, 0), (1, 0)),
            *((8, 253), (8, 0), (8, 0), (16, 1)),  # exponents -3 and 0
        ),
        packet(
            *(3, (16, 0), (8, 0), (8, 0), "c", (8, 255), (32, GAIN), (32, MIXING)),
            *((8, 1), (32, 0), (32, 0), (16, 0), (8, 1)),
        ),
        packet(4, (8, 0), (8, 0), (16, 0), (8, 0), (3, 2), (16, 0), (16, 1000), (16, 1)),
    ]
    band = ((8, 0), (16, 0), (8, 0), (16, 1), (16, 0), (2, 0))
    wave = ((16, 0), (4, 1))  # phase 0, square
    begin = ((2, 3), (8, 127), (16, 0), (16, 100), (2, 3), (8, 255), (16, 40), (16, 200))
    end = ((2, 3), (8, 0), (16, 300), (16, 200))
    first = packet(5, (1, 0), *band, (25, 72), (1, 0), (16, 2), *wave, *begin)
    last = packet(5, (1, 1), *band, (25, 2**25 - 184), (1, 0), (16, 1), *wave, *end)
    return b"".join(
        (
            unit(0, 0, *heads),
            unit(3, 128),
            unit(1, 128, first),
            unit(3, 128, sync=1),
            unit(1, 128, last, sync=1),
        )
    )


def test_the_writer_makes_the_bits_packed_by_hand():
    made = encoded(wave_document(), "x")
    assert made.content == wave_stream()
    assert made.left_out == ()


def test_the_reader_reads_the_bits_packed_by_hand():
    document, notes = document_of(wave_stream(), "x")
    assert (document, notes) == (wave_document() | {"syncs": document["syncs"]}, ())
    assert document["syncs"] == [{"timestamp": 0, "timescale": 1000}]


def test_amplitudes_are_steps_of_255():
    # MPEG's decoder: code / 255 * 2 - 1. Its encoder cuts down: 0 becomes 127.
    for code in (0, 1, 126, 128, 200, 255):
        assert bits.amplitude_of(code) == pytest.approx(code / 255 * 2 - 1, abs=1e-6)
    assert bits.amplitude_of(127) == 0.0
    assert [bits.amplitude_code(value) for value in (-1.0, 0.0, 1.0, 7.0)] == [0, 127, 255, 255]
    for value in np.linspace(-1.0, 1.0, 4001):
        assert abs(bits.amplitude_of(bits.amplitude_code(value)) - value) <= 1.5 / 255 + 1e-6
    # Files of MPEG's decoder hold these numbers, as they passed through HMPG.
    assert bits.amplitude_of(bits.amplitude_code(0.3019608)) == pytest.approx(0.3019608, abs=1e-6)


def test_numbers_of_32_bits_are_equal_steps():
    # -10,000 to 10,000 in 2^32 - 1 steps; the values of MPEG's own test.
    for value in (32.0, 0.0, -6345.365, 1.65436789):
        writer = bits.BitWriter("x")
        writer.put_number(32, value, -syntax.MOST, syntax.MOST, "")
        code = int.from_bytes(writer.content())
        assert code == round(Fraction(value + 10_000.0) / 20_000 * (2**32 - 1))
        read = bits.BitReader(writer.content(), "x").number(32, -syntax.MOST, syntax.MOST)
        assert read == pytest.approx(value, abs=1e-5)
    # MPEG's encoder cuts a mixing coefficient of 1 down to 429,496 steps, read as 0.9999983.
    content = packed((32, 429_496))
    assert bits.BitReader(content, "x").number(32, 0.0, syntax.MOST) == 1.0


def test_numbers_of_the_choices():
    # Perception.h, CurveType.h, BodyPartTarget.h, EffectSemantic.h
    modalities = {"Other": 0, "Temperature": 5, "Vibrotactile": 6, "Wind": 8, "Force": 9}
    modalities |= {"Friction": 12, "Electrotactile": 13}
    assert {name: syntax.MODALITIES.index(name) for name in modalities} == modalities
    assert set(syntax.MODALITIES) <= set(hjif_rules.MODALITIES)
    assert [syntax.CURVE_TYPES.index(name) for name in ("Cubic", "Akima", "BSpline")] == [1, 3, 5]
    parts = {0: "Unknown", 15: "Back", 24: "Leg", 37: "Foot", 59: "Pinky-Toe", 255: "Plus"}
    assert {number: syntax.BODY_PARTS[number] for number in parts} == parts
    assert set(syntax.BODY_PARTS.values()) == set(hjif_rules.BODY_PART_TARGETS)
    words = {1: "UX/Click", 265: "Avatar/Footstep", 784: "WeaponCombat/Blast"}
    words |= {
        1036: "Ambient/Thunderbolt",
        1545: "Vehicle/AirFriction",
        1798: "Music/BrassInstrument",
    }
    assert {number: syntax.KEYWORDS[number] for number in words} == words
    assert set(syntax.KEYWORDS.values()) == SEMANTICS


# --- round trips ----------------------------------------------------------------------------


def as_stored(document):
    """Return a copy of a HJIF document without content that HMPG lacks, and with compositions
    replaced by their parts."""
    document = copy.deepcopy(document)
    for perception in document["perceptions"]:
        for device in perception.get("reference_devices", ()):
            device.pop("type", None)
        for effect in perception["effect_library"]:
            effect |= {"phase": 0.0, "base_signal": "Sine"}  # always there
        for channel in perception["channels"]:
            del channel["body_part_mask"]
            channel.pop("frequency_sampling")
            channel.pop("sample_count")
            curve, wave, *_ = channel["bands"]
            for frame in curve["effects"][0]["keyframes"]:
                del frame["frequency_modulation"]
            composite = wave["effects"].pop()
            wave["effects"].append({**composite["composition"][0], "position": 1500})
    return document


def close(found, expected):
    """Compare within the steps of HMPG: 1.5/255 of amplitudes, else 1e-4."""
    if isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for key, value in expected.items():
            if key == "amplitude_modulation":
                assert abs(found[key] - value) <= 1.5 / 255 + 1e-6
            else:
                close(found[key], value)
    elif isinstance(expected, list):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            close(one, other)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, abs=1e-4)
    else:
        assert found == expected


def test_every_kind_of_member_survives():
    document = sample()
    made = encoded(document, "x")
    found, notes = decode(made.content, "x")
    close(found, as_stored(document))
    assert ["body_part_mask" in note for note in notes] == [True]  # a channel with actuators
    assert set(made.left_out) == {
        "1 body part masks beside actuator_resolution",
        "1 actuator types of reference devices",
    }
    assert all(finding.severity == "warning" for finding in hjif_rules.findings(found))
    # What was stored once is stored again without any change.
    again = encoded(found, "x")
    assert decode(again.content, "x")[0] == found
    assert again.content == encoded(decode(again.content, "x")[0], "x").content


def test_effects_longer_than_a_unit_and_late_ones():
    # 60 s at 1000 ticks: 469 units; positions far beyond 16 bits.
    frames = [(t, (t % 500) / 500.0, 80 + t % 100) for t in range(0, 60_000, 37)]
    wave = {**basis(*frames, phase=1.0, base_signal="Sine"), "position": 5_000_000}
    band = {"band_type": "VectorialWave", "lower_frequency_limit": 0, "upper_frequency_limit": 1000}
    other = {**basis((0, 0.5, 60), phase=0.0, base_signal="Sine"), "position": 5_000_010}
    document = channel_with({**band, "effects": [wave, other]}, modality="Vibrotactile")
    found, _ = decode(encoded(document, "x").content, "x")
    (stored,) = at(found, ("perceptions", 0, "channels", 0, "bands"))
    first, second = stored["effects"]
    assert first["position"] == 5_000_000
    assert [frame["relative_position"] for frame in first["keyframes"]] == [t for t, _, _ in frames]
    assert [frame["frequency_modulation"] for frame in first["keyframes"]] == [
        hz for _, _, hz in frames
    ]
    assert second["position"] == 5_000_010


def test_wavelets_keep_their_bits_and_their_times():
    tone = 0.6 * np.sin(2 * np.pi * 150 * np.arange(2048) / RATE)
    band = coded(tone)
    band["effects"][1]["position"] = 3 * 128  # two blocks of silence before
    document = channel_with(band)
    found, _ = decode(encoded(document, "x").content, "x")
    (stored,) = at(found, ("perceptions", 0, "channels", 0, "bands"))
    assert [effect["position"] for effect in stored["effects"]] == [0, 128, 256, 384]
    (before,), _ = hjif_signals.decode(as_json(document), "x")
    (after,), _ = hjif_signals.decode(as_json(found), "x")
    np.testing.assert_allclose(after.amplitude.values, before.amplitude.values, atol=1e-9)


def test_blocks_of_wavelets_have_two_forms():
    # 1024 samples at 8000 Hz are 128 of 1000 ticks a second: 2^10 = 16 * 2^6.
    assert syntax.block_ticks(128, 8000, 1000) == syntax.block_ticks(6, 8000, 1000) == 128
    assert syntax.block_code(128, 8000, 1000) == 128
    assert syntax.block_code(1024, 8000, 8000) == 6


def test_more_bands_than_numbers():
    channel = channel_with(
        {
            "band_type": "Transient",
            "lower_frequency_limit": 0,
            "upper_frequency_limit": 300,
            "effects": [basis((0, 1.0, 150), base_signal="Sine")],
        }
    )["perceptions"][0]["channels"][0]
    document = sample()
    document["perceptions"][0]["channels"] = [
        {**copy.deepcopy(channel), "id": k, "description": f"c{k}"} for k in range(300)
    ]
    made = encoded(document, "x")
    assert "300 bands" in made.notes[1]
    channels = decode(made.content, "x")[0]["perceptions"][0]["channels"]
    assert [each["description"] for each in channels] == [f"c{k}" for k in range(300)]
    assert all(len(each["bands"][0]["effects"]) == 1 for each in channels)


def test_equal_ids_of_channels_in_two_perceptions_are_noted():
    document = sample()
    assert not any("same id" in note for note in encoded(document, "x").notes)
    document["perceptions"].append({**copy.deepcopy(document["perceptions"][0]), "id": 1})
    assert any("same id" in note for note in encoded(document, "x").notes)


def test_ids_of_0_stay_apart_from_ids_of_1():
    document = sample()
    perception = document["perceptions"][0]
    device = {"name": "pad"}
    perception["reference_devices"] = [{**device, "id": k} for k in range(3)]
    document["avatars"] = [{"id": k, "lod": 0, "type": "Pressure"} for k in range(3)]
    read, _ = hjif_reader.decode(as_json(document), "x.hjif")
    found, _ = decode(encoded(read, "x").content, "x")
    assert [each["id"] for each in found["perceptions"][0]["reference_devices"]] == [0, 1, 2]
    assert [each["id"] for each in found["avatars"]] == [0, 1, 2]


@pytest.mark.parametrize(
    "path, value, message",
    [
        (("perceptions", 0, "id"), 256, r"perceptions\[0\].id is 256, HMPG holds 0 to 255"),
        (("perceptions", 0, "perception_modality"), "Humidity", "is Humidity, HMPG holds Other"),
        (("perceptions", 0, "channels", 0, "gain"), 10_001.0, "gain is 10001, HMPG holds -10000"),
        (
            ("perceptions", 0, "channels", 0, "bands", 0, "effects", 0, "keyframes", 1),
            {"relative_position": 65_536, "amplitude_modulation": 0.0},
            "relative_position is 65536, HMPG holds 0 to 65535",
        ),
        (("perceptions", 0, "channels", 0, "vertices"), [1] * 40_000, "40000 vertices. takes"),
        (("perceptions", 0, "channels", 0, "bands", 3, "block_length"), 1 << 20, "block_length"),
        (("avatars", 1, "mesh"), "x" * 256, "has 256 bytes, HMPG holds 255"),
    ],
)
def test_content_beyond_the_fields_is_refused(path, value, message):
    document = sample()
    at(document, path[:-1])[path[-1]] = value
    with pytest.raises(InputError, match=rf"^x: .*{message}"):
        encoded(document, "x")


def test_losses_are_told():
    document = sample()
    document["description"] = "ü" * 200
    document["syncs"].append({"timestamp": 500, "timescale": 1000})
    texture = copy.deepcopy(document["perceptions"][0])
    texture |= {"id": 1, "perception_modality": "Vibrotactile Texture"}
    document["perceptions"].append(texture)
    band = document["perceptions"][0]["channels"][0]["bands"][0]
    reference = {"effect_type": "Reference", "id": 0, "semantic_keywords": "UX/Click"}
    band["effects"].append(reference | {"position": 9})
    made = encoded(document, "x")
    assert "1 perceptions over space (Vibrotactile Texture)" in made.left_out
    assert "1 semantic keywords of references" in made.left_out
    assert "1 synchronization points after the start" in made.left_out
    assert "1 ends of texts longer than 255 bytes (description)" in made.left_out
    found, _ = decode(made.content, "x")
    assert found["description"] == "ü" * 127
    assert len(found["perceptions"]) == 1


def test_each_lost_keyword_is_counted_once():
    """In effects over many units, in the library, and in compositions."""
    document = sample()
    perception = document["perceptions"][0]
    keyword = {"semantic_keywords": "Zwurbel"}
    frames = [(t, 0.5, 100) for t in range(0, 4000, 100)]  # 4 s, units of 128 ms
    wave = {**basis(*frames, phase=0.0, base_signal="Sine"), "position": 0, **keyword}
    composite = {"effect_type": "Composite", "position": 0, "composition": [wave]}
    bands = [band for channel in perception["channels"] for band in channel["bands"]]
    target = next(band for band in bands if band["band_type"] == "VectorialWave")
    target["effects"] += [wave, {**composite, "semantic_keywords": "UX/Click"}]
    perception["effect_library"].append({**wave, "id": 77})
    left_out = encoded(document, "x").left_out
    # Three unknown keywords: an effect of a band, a part of a composition, one in the library.
    assert "3 semantic keywords outside of the standard's list" in left_out
    assert "1 semantic keywords of compositions" in left_out


def test_unknown_numbers_of_keywords_are_counted_once():
    document = wave_document()
    (band,) = at(document, ("perceptions", 0, "channels", 0, "bands"))
    band["effects"][0]["semantic_keywords"] = syntax.KEYWORDS[1]
    library = {**basis((0, 1.0, 150)), "id": 7, "position": 0, "semantic_keywords": "UX/Click"}
    document["perceptions"][0]["effect_library"] = [library]
    content = encoded(document, "x").content
    # Repeated metadata, where a player may join.
    size = 9 + int.from_bytes(content[4:9]) // 16 % (1 << 32)
    repeated = content + content[:size]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(syntax, "KEYWORDS", {})
        _, notes = document_of(repeated, "x")
    assert notes == ("2 semantic keywords of no known number were not read",)


# --- damaged streams ------------------------------------------------------------------------


def test_every_part_of_a_stream_is_refused_or_read():
    whole = encoded(sample(), "x").content
    for length in range(len(whole)):
        try:
            decode(whole[:length], "x")
        except InputError as error:
            assert str(error).startswith("x: ")
    with pytest.raises(InputError, match="holds no haptic experience"):
        decode(b"", "x")


def test_effects_missing_after_a_cut_between_units_are_counted():
    whole = encoded(sample(), "x").content
    # The initialization unit alone: 9 bytes, then as many as bits 36 to 68 state.
    length = int.from_bytes(whole[:9]) >> 4 & 0xFFFFFFFF
    _, notes = document_of(whole[: 9 + length], "x")
    bands = [b for c in sample()["perceptions"][0]["channels"] for b in c["bands"]]
    count = sum(len(band["effects"]) for band in bands)
    assert notes == (f"{count} effects that bands announce are not in the stream",)
    assert document_of(whole, "x")[1] == ()


def test_changed_bytes_are_refused_or_read():
    rng = random.Random(7)
    whole = encoded(sample(), "x").content
    for _ in range(1000):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        for read in (decode, validate):
            try:
                read(bytes(damaged), "x")
            except InputError as error:
                assert str(error).startswith("x: ")
    for size in (1, 8, 9, 100, 1000):
        for _ in range(200):
            with pytest.raises(InputError):
                decode(rng.randbytes(size), "x")


def test_a_stream_of_too_many_keyframes_is_refused():
    with limits.raised(1e-4), pytest.raises(limits.TooLargeError, match="its packets hold"):
        frames = [(t, 0.5, 100) for t in range(300)]
        wave = basis(*frames, phase=0.0, base_signal="Sine")
        document = wave_document()
        at(document, ("perceptions", 0, "channels", 0, "bands", 0))["effects"] = [wave]
        decode(encoded(document, "x").content, "x")


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda s: b"\x04" + s[1:], "does not begin with an initialization unit"),
        (lambda s: s + b"\x24" + s[1:9], "has the type 9, HMPG has 0 to 3"),
        (lambda s: s[:-1], "is cut off: 1 bytes are missing"),
        (lambda s: s + unit(1, 128, packet(5, (33, 7 << 24))), "of the perception 7"),
        (lambda s: s + unit(1, 128, packed((6, 5), (17, 9), (1, 0))), "longer than its unit"),
        (lambda s: s + unit(0, 0, packet(11, (64, 0))), "has 0 ticks a second"),
    ],
)
def test_damage_is_named(change, message):
    with pytest.raises(InputError, match=rf"^x: .*{message}"):
        decode(change(wave_stream()), "x")


def test_unknown_packets_and_checksums_are_passed_over():
    further = unit(1, 0, packet(8, (16, 1)), packet(40, (8, 1)))
    document, notes = document_of(wave_stream() + further, "x")
    assert document["perceptions"] == document_of(wave_stream(), "x")[0]["perceptions"]
    assert notes == (
        "1 checksums were not compared",
        "1 packets of the unknown type 40 were passed over",
    )
    assert [finding.code for finding in validate(wave_stream() + further, "x")][:2] == [
        "HMPG-UNREAD",
        "HMPG-UNREAD",
    ]


def test_texts_that_are_no_utf_8_are_counted():
    # "c" is the description of the channel, 0xE9 an "é" of Latin-1.
    stream = wave_stream().replace(packed("c"), b"\x01\xe9")
    document, notes = document_of(stream, "x")
    assert document["perceptions"][0]["channels"][0]["description"] == "\ufffd"
    assert notes == ("1 texts are not UTF-8: other bytes became U+FFFD",)


def test_repeated_metadata_changes_nothing():
    # Streams repeat it where a player may join.
    whole = wave_stream()
    size = 9 + int.from_bytes(whole[4:9]) // 16 % (1 << 32)
    again = whole + whole[:size]
    found, expected = document_of(again, "x")[0], document_of(whole, "x")[0]
    assert found["perceptions"] == expected["perceptions"]
    assert len(found["syncs"]) == 2


# --- files ----------------------------------------------------------------------------------


def run(capsys, *arguments):
    code = cli.run([str(argument) for argument in arguments])
    output = capsys.readouterr()
    return code, output.out, output.err


def test_hjif_to_hmpg_and_back(tmp_path, capsys):
    (tmp_path / "x.hjif").write_bytes(as_json(sample()))
    code, out, err = run(capsys, "convert", tmp_path / "x.hjif", tmp_path / "y.hmpg")
    assert code == 0 and "amplitudes in 8 bits" in out and "actuator types" in err
    assert fault_of(tmp_path / "y.hmpg") == ""  # apart from its mesh, which is not there
    assert run(capsys, "convert", tmp_path / "y.hmpg", tmp_path / "z.hjif")[0] == 0
    close(json.loads((tmp_path / "z.hjif").read_bytes()), as_stored(sample()))
    assert fault_of(tmp_path / "z.hjif") == ""
    code, out, _ = run(capsys, "info", tmp_path / "y.hmpg")
    assert code == 0 and "MPEG HMPG" in out and "chest" in out
    # A file that is a quarter of the text, or less.
    sizes = [(tmp_path / name).stat().st_size for name in ("y.hmpg", "z.hjif")]
    assert sizes[0] * 4 < sizes[1]


def test_negative_gains_are_noted(tmp_path, capsys):
    document = sample()
    channels = document["perceptions"][0]["channels"]
    channels[0]["gain"] = -2.5
    (tmp_path / "x.hjif").write_bytes(as_json(document))
    note = "gains below 0, read as 0, so that their channels are silent: 1"
    for name in ("y.ahap", "y.hmpg", "y.hjif"):
        code, out, err = run(capsys, "convert", tmp_path / "x.hjif", tmp_path / name)
        assert code == 0 and note in out + err
    channels[0]["gain"] = 0.0
    (tmp_path / "x.hjif").write_bytes(as_json(document))
    assert "gains below" not in "".join(
        map(str, run(capsys, "convert", tmp_path / "x.hjif", tmp_path / "y.ahap"))
    )


def test_notes_of_conversions_are_stated_once_with_the_codes_of_validation(tmp_path, capsys):
    document = sample()
    document["date"] = "2026-11-29"
    (tmp_path / "x.hjif").write_bytes(as_json(document))
    assert run(capsys, "convert", tmp_path / "x.hjif", tmp_path / "y.hmpg")[0] == 0
    for name in ("z.ahap", "z.hjif"):
        code, out, err = run(capsys, "convert", tmp_path / "y.hmpg", tmp_path / name)
        assert code == 0 and (out + err).count("[HMPG-DATE]") == 1 and "HJIF-" not in out + err
    assert "HMPG-DATE" in "".join(map(str, run(capsys, "validate", tmp_path / "y.hmpg")))


@pytest.mark.parametrize("suffix", [".ahap", ".haptic", ".he", ".openxr.json"])
def test_vibration_goes_on_to_other_formats(tmp_path, suffix):
    (tmp_path / "x.hjif").write_bytes(as_json(sample()))
    convert(tmp_path / "x.hjif", tmp_path / "y.hmpg")
    assert convert(tmp_path / "y.hmpg", tmp_path / f"z{suffix}").files


def test_vibration_of_other_formats(tmp_path):
    (tmp_path / "x.hjif").write_bytes(as_json(sample()))
    convert(tmp_path / "x.hjif", tmp_path / "x.haptic")
    written = convert(tmp_path / "x.haptic", tmp_path / "y.hmpg")
    assert [path.name for path in written.files] == ["y.hmpg"]
    assert not (tmp_path / "y.hjif").exists()


def test_a_device_s_output(tmp_path):
    device = load_device("forearm_band_left")
    writing.write("npz", raster_for(device), device, tmp_path / "x")
    for name in ("y.hmpg", "y.hjif"):
        convert(tmp_path / "x.raster.npz", tmp_path / name, device=device.id)
    found, _ = decode((tmp_path / "y.hmpg").read_bytes(), "y")
    expected = hjif_reader.decode((tmp_path / "y.hjif").read_bytes(), "y")[0]
    for one, other in zip(found["perceptions"], expected["perceptions"], strict=True):
        assert len(one["channels"]) == len(other["channels"])
    pairs = zip(to_signals.envelopes(found), to_signals.envelopes(expected), strict=True)
    for one, other in pairs:
        times = np.union1d(one.strength.times_s, other.strength.times_s)
        worst = np.abs(one.strength.at(times) - other.strength.at(times)).max()
        assert worst <= 1.5 / 255 + 1e-6


def test_a_track(tmp_path):
    levels = np.array([0.0, 0.5, 1.0, 0.5, 0.0, 0.0] * 4)
    with track_of(tmp_path, "pressure", "painted", levels) as track:
        path = track.path
    written = convert(path, tmp_path / "y.hmpg")
    mesh = next(path for path in written.files if path.suffix == ".glb")
    assert b'"mimeType":"haptics/hmpg","uri":"y.hmpg"' in mesh.read_bytes()
    document, _ = decode((tmp_path / "y.hmpg").read_bytes(), "y")
    assert document["avatars"][0]["mesh"] == mesh.name
    assert facts_of(tmp_path / "y.hmpg")["valid"] == "yes"
