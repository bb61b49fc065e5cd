# SPDX-License-Identifier: GPL-3.0-or-later
"""Clip format after the format's page, damaged clips, and conversion of tracks to clips."""

from __future__ import annotations

import ctypes
import json
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from check_frames import Counts, play
from clip_cases import SPECS, case_of
from core_library import ROOT, Clip, Player, library
from damage import damaged

from hfx_blender.cli import run
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.errors import InputError
from hfx_blender.formats.clip.container import with_checksum
from hfx_tools.formats import clip_rules

TEXT = b"\0touch\0m\0Hz\0amplitude_m_s2\0frequency_hz\0part\0"
TOUCH, M, HZ, AMPLITUDE, FREQUENCY, PART = (
    TEXT.index(b"\0" + item + b"\0") + 1
    for item in (b"touch", b"m", b"Hz", b"amplitude_m_s2", b"frequency_hz", b"part")
)
NUMBERS = (0, 0, 13107, 65535, 32768, 0)
"""Strength and frequency of three rows: 0 of 10, 2 of 10, 5 of 10."""


def by_hand(**changed: bytes) -> bytes:
    """Return a clip of one actuator, byte by byte after the page: ten rows in one second."""
    sections = {
        "TEXT": TEXT,
        "TIME": struct.pack("<ddII", 10.0, 0.0, 10, 0),
        "DEVC": struct.pack("<8I", TOUCH, TOUCH, 0, 0, 1, 0, 2, 250),
        "ACTR": struct.pack("<12I", TOUCH, 0, 0, 2, 0, 3, 0, 1, 1, 0, 0, 0)
        + struct.pack("<9fI", 0.5, 0.0, 1.0, 0.1, 20.0, 10.0, np.inf, np.inf, 1.0, 0),
        "COLM": struct.pack("<4I3d", AMPLITUDE, M, 0, 0, 0.0, 10.0, 0.0)
        + struct.pack("<4I3d", FREQUENCY, HZ, 0, 0, 60.0, 160.0, 60.0),
        "ROWS": struct.pack("<3I", 0, 3, 4),
        "VALU": struct.pack("<6H", *NUMBERS),
        "CLIP": struct.pack("<2I2d", PART, 1, 0.3, 0.5),
        **changed,
    }
    table, body, at = b"", b"", 24 + 16 * len(sections)
    for name, content in sections.items():
        gap = -at % 8
        table += name.encode() + struct.pack("<3I", at + gap, len(content), 0)
        body += bytes(gap) + content
        at += gap + len(content)
    rest = struct.pack("<I", len(sections)) + table + body
    head = struct.pack("<8sIII", b"HFXCLIP\n", 1, at, zlib.crc32(rest))
    return head + rest


def test_a_clip_made_by_hand_is_read_and_played() -> None:
    sections = clip_rules.read(by_hand(), "x")
    rows, values = clip_rules.values_of(sections, 0)
    assert rows.tolist() == [0, 3, 4]
    assert values == pytest.approx(np.array([[0, 60], [2, 160], [5.0000763, 60]]), abs=1e-6)
    player = Player(Clip(by_hand()))
    frames = [player.advance(value).tolist() for value in (0.0, 0.2, 0.1, 0.1, 0.4, 0.1, 0.1)]
    # Row 3 is felt from 0.3 s on, row 4 to the end: 1.0 s, when all has been felt.
    expected = [[0, 60], [0, 60], [2, 160], [5, 60], [5, 60], [5, 60], [0, 60]]
    assert np.array(frames) == pytest.approx(np.array(expected), abs=1e-3)
    assert not player.is_playing


def test_a_long_frame_gives_the_strongest_row_with_its_frequency() -> None:
    values = struct.pack("<6H", 65535, 65535, 13107, 0, 0, 0)  # 10 at 160 Hz, then less
    player = Player(Clip(by_hand(VALU=values)))
    assert player.advance(0.35).tolist() == pytest.approx([10, 160])
    player.seek(0.3)
    assert player.advance(0.25).tolist() == pytest.approx([2, 60], abs=1e-3)


def test_a_part_loops_and_a_loop_takes_end_and_beginning_into_one_frame() -> None:
    player = Player(Clip(by_hand()))
    assert player.named("nothing") == -7 and not player.is_playing
    assert player.named("part") == 0  # 0.3 s to 0.5 s: row 3 with 2, row 4 with 5
    actual = [player.advance(value)[0] for value in (0.05, 0.1, 0.06, 0.05, 0.1)]
    # At 0.35, 0.45, 0.31 (again, past the end: row 4 was felt), 0.36 and 0.46 s.
    assert actual == pytest.approx([2, 5, 2, 2, 5], abs=1e-3)


def test_texts_are_utf_8() -> None:
    assert Clip(by_hand(TEXT=TEXT + "é \uffff 触覚 \U0010ffff".encode() + b"\0")).error == 0
    # A slash in two bytes, a surrogate, above 10FFFF, cut off, an orphan continuation byte.
    for text in (b"\xc0\xaf", b"-\xed\xa0\x80", b"\xf4\x90\x80\x80", b"a\xe2\x82", b"\x80"):
        content = by_hand(TEXT=TEXT + text + b"\0")
        assert Clip(content).error == -5
        with pytest.raises(InputError, match=f"TEXT' byte {len(TEXT)}|byte {len(TEXT) + 1}"):
            clip_rules.read(content, "x")


def test_gain_parameter_and_silence() -> None:
    player = Player(Clip(by_hand()))
    player.seek(0.4)
    player.gain(0.5)
    assert player.parameter("frequency_hz", 1.5) == 0
    assert player.parameter("pressure_kpa", 1.5) == -7
    assert player.advance(0.0).tolist() == pytest.approx([2.5, 90], abs=1e-3)
    player.gain(5.0)
    assert player.advance(0.0)[0] == 10.0  # the column's limit
    player.gain(float("nan"))
    assert player.advance(0.0)[0] == 0.0
    assert player.silence().tolist() == [0, 60] and player.advance(1.0).tolist() == [0, 60]
    player.pause(0)
    assert player.position_s == pytest.approx(0.4)


def test_numbers_that_a_script_may_give_end_no_loop() -> None:
    player = Player(Clip(by_hand(CLIP=struct.pack("<2I2d", PART, 1, 0.1, 0.8))))
    for seconds in (1e17, 1e30, float("inf"), float("nan"), -1.0):
        assert player.named("part") == 0
        player.advance(seconds)
        before = player.position_s
        player.advance(0.01)
        assert 0.1 <= before <= 0.8 and player.position_s != before


def test_a_player_never_started_is_silent() -> None:
    core = library()
    zeros, out = (ctypes.c_uint64 * 64)(), (ctypes.c_float * 4)(1, 1, 1, 1)
    core.hfx_player_advance(zeros, ctypes.c_double(0.1), out)
    core.hfx_player_seek(zeros, ctypes.c_double(0.1))
    core.hfx_player_silence(zeros, out)
    core.hfx_body_set_bones(zeros, out)
    core.hfx_body_evaluate(zeros, ctypes.c_double(0.1), out)
    assert core.hfx_player_set_parameter(zeros, b"frequency_hz", ctypes.c_double(1.0)) == -7
    assert core.hfx_body_trigger(zeros, 0, ctypes.c_double(1.0)) == -6
    assert list(out) == [1, 1, 1, 1]  # there are no columns
    # A clip refused for the rate has a duration of 0.
    broken = Clip(by_hand(**HOSTILE["TIME.rate_hz"]))
    assert broken.error < 0 and core.hfx_clip_seconds(broken.at) == 0.0
    assert not Player(broken).is_playing


HOSTILE = {
    "TIME.rate_hz": {"TIME": struct.pack("<ddII", np.nan, 0.0, 10, 0)},
    "TIME.rows": {"TIME": struct.pack("<ddII", 10.0, 0.0, 0, 0)},
    "DEVC[0].id": {"DEVC": struct.pack("<8I", 900, 1, 0, 0, 1, 0, 2, 250)},
    "DEVC.actuators": {"DEVC": struct.pack("<8I", TOUCH, TOUCH, 0, 0, 2**31, 0, 2, 250)},
    "ROWS[1]": {"ROWS": struct.pack("<3I", 0, 0, 4)},
    "ROWS[2]": {"ROWS": struct.pack("<3I", 0, 3, 10)},
    "VALU": {"VALU": struct.pack("<5H", *NUMBERS[:5])},
    "CLIP[0].end_s": {"CLIP": struct.pack("<2I2d", PART, 0, 0.0, 1.5)},
    "COLM[0].neutral": {
        "COLM": struct.pack("<4I3d", AMPLITUDE, M, 0, 0, 0.0, 10.0, 11.0)
        + struct.pack("<4I3d", FREQUENCY, HZ, 0, 0, 60.0, 160.0, 60.0)
    },
    "COLM[0].parameter": {
        "COLM": struct.pack("<4I3d", PART, M, 0, 0, 0.0, 10.0, 0.0)
        + struct.pack("<4I3d", FREQUENCY, HZ, 0, 0, 60.0, 160.0, 60.0)
    },
}


@pytest.mark.parametrize("field", HOSTILE)
def test_a_hostile_clip_is_refused_with_its_field(
    field: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = by_hand(**HOSTILE[field])
    assert Clip(content).error == -5
    path = tmp_path / "x.hfxclip"
    path.write_bytes(content)
    assert run(["info", str(path)]) == 3
    errors = capsys.readouterr().err
    assert field in errors and str(path) in errors
    assert run(["validate", str(path)]) == 3


def test_reserved_words_are_zero_and_names_of_sections_are_not_repeated(tmp_path: Path) -> None:
    """Reserved words, at the page's offsets: a player may ignore values, a validator may not."""
    good = (ROOT / "players/conformance/everything.hfxclip").read_bytes()
    count = struct.unpack_from("<I", good, 20)[0]
    table = {good[24 + 16 * k :][:4]: 24 + 16 * k for k in range(count)}
    first = {name: struct.unpack_from("<I", good, at + 4)[0] for name, at in table.items()}
    path = tmp_path / "x.hfxclip"
    for at in (table[b"ACTR"] + 12, first[b"ACTR"] + 84):
        path.write_bytes(with_checksum(good[:at] + struct.pack("<I", 7) + good[at + 4 :]))
        assert run(["validate", str(path)]) == 3
    again = with_checksum(good[: table[b"VALU"]] + b"ROWS" + good[table[b"VALU"] + 4 :])
    with pytest.raises(InputError, match="occurs twice"):
        clip_rules.read(again, "x")


def test_incomplete_clips_and_other_versions_are_refused() -> None:
    good = by_hand()
    newer = with_checksum(good[:8] + struct.pack("<I", 2) + good[12:])
    flipped = good[:-1] + bytes([good[-1] ^ 1])
    for content, error, word in (
        (b"", -2, "no game clip"),
        (good[:20], -1, "cut off"),
        (good[:-8], -1, "size"),
        (newer, -3, "'version' is 2"),
        (flipped, -4, "checksum"),
    ):
        assert Clip(content).error == error
        with pytest.raises(InputError, match=word):
            clip_rules.read(content, "x")


def test_valid_clips_play_and_invalid_clips_are_not_opened() -> None:
    source = (ROOT / "players/conformance/everything.hfxclip").read_bytes()
    changed = damaged(source, np.random.default_rng(3))
    opened = 0
    for _ in range(250):
        content = next(changed)
        clip = Clip(content)
        try:
            is_valid = not clip_rules.validate(content, "x")
        except InputError:
            is_valid = False
        if is_valid:
            assert clip.error == 0
        if clip.error == 0:
            opened += 1
            player = Player(clip)
            assert all(np.isfinite(player.advance(step)).all() for step in (0.0, 0.01, 5.0, 1e300))
    assert 10 < opened < 240


def test_no_peak_is_lost_at_random_frame_rates(tmp_path: Path) -> None:
    counts, random = Counts(), np.random.default_rng(7)
    names = {"touch", "everything", "film"}
    for case in [case_of(spec, tmp_path) for spec in SPECS if spec.name in names]:
        for _ in range(4):
            play(case, random, counts)
    assert counts.peaks > 1000
    assert (counts.lost, counts.wrong) == (0, 0)


def test_convert_and_info_agree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case_of(next(spec for spec in SPECS if spec.name == "touch"), tmp_path)
    path = tmp_path / "made.hfxclip"
    command = [
        "convert",
        str(tmp_path / "touch.hfxtrack"),
        str(path),
        "--device",
        "oculus_touch",
    ]
    assert run(command) == 0
    capsys.readouterr()
    assert run(["info", str(path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["rows"], document["rate_hz"], document["seconds"]) == (240, 100.0, 2.4)
    assert [name["device"] for name in document["devices"]] == ["oculus_touch"]
    sections = clip_rules.read(path.read_bytes(), "made")
    assert sections["ACTR"]["latency_ms"].tolist() == [20.0, 20.0]
    assert sections["DEVC"]["dead_man_ms"].tolist() == [250]
    human = [bytes(sections["TEXT"])[k:].split(b"\0")[0] for k in sections["ACTR"]["human"]]
    assert human == [b"leftHand", b"rightHand"]
    assert run(["convert", str(tmp_path / "touch.hfxtrack"), str(path)]) == 2  # no device
    assert run(["convert", str(path), str(tmp_path / "x.csv")]) == 2
    assert "game clip cannot be converted" in capsys.readouterr().err


DEVICE = {
    "schema": "hfx-device",
    "version": 1,
    "id": "touch",
    "name": "Touch",
    "description": "One motor.",
    "actuator_types": {
        "motor": {
            "modality": "vibration",
            "latency_ms": 20,
            "parameters": {
                "amplitude_m_s2": {"unit": "m/s^2", "minimum": 0, "maximum": 4},
                "frequency_hz": {"unit": "Hz", "minimum": 60, "maximum": 160},
            },
        }
    },
    "actuators": [
        {
            "id": "touch",
            "type": "motor",
            "place": {
                "placement": {"parts": ["torso"], "centre_m": [0, -0.1, 1.2], "radius_m": 0.1}
            },
        }
    ],
}


def test_a_clip_is_played_by_the_output_process_with_its_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip, device, log = (tmp_path / item for item in ("x.hfxclip", "touch.json", "log.jsonl"))
    clip.write_bytes(by_hand(TIME=struct.pack("<ddII", 20.0, 7.0, 10, 0)))
    device.write_text(json.dumps(DEVICE))
    start = ["play", str(clip), "--device", str(device), "--to", "simulator", "--path", str(log)]
    assert run(start) == 0
    rows = [json.loads(line) for line in log.read_text().splitlines()]
    sent = [(row["time_s"] - rows[0]["time_s"], *row["values"]) for row in rows if "values" in row]
    loud = [message for message in sent if message[1] > 0.0]
    # 2 at 160 Hz from 0.15 s on, 5 at 60 Hz from 0.2 to 0.5 s, where this motor's limit is 4. Late
    # on a busy machine, never early; the 20 ms of latency are in the rows already.
    assert loud[0][0] > 0.14 and loud[0][2] == 160.0 and loud[0][1] <= 2.001
    assert max(block[1] for block in loud) == 4.0 and loud[-1][2] == 60.0
    assert sent[-1][1] == 0.0 and "stop" in rows[-1]
    capsys.readouterr()
    before = log.read_bytes()
    start[start.index("simulator")] = "log"
    assert run(start) == 3 and log.read_bytes() == before  # an output that cannot be written
    assert f"{log} exists already" in capsys.readouterr().err
    device.write_text(json.dumps({**DEVICE, "id": "belt"}))
    assert run(start) == 3
    assert f"{clip}: it has no values for 'belt'; it has those of: 'touch' on" in (
        capsys.readouterr().err
    )
    device.write_text(json.dumps(DEVICE).replace('"id": "touch", "type"', '"id": "finger", "type"'))
    assert run(start) == 3
    assert "touch amplitude_m_s2 where its configuration has finger" in capsys.readouterr().err


def test_players_list_the_modalities_in_the_order_of_the_engine() -> None:
    players = Path(__file__).resolve().parents[2] / "players"
    lists = {
        "core/hfx_player.h": r"enum hfx_modality \{(.*?)\}",
        "godot/addons/hfx/haptic_clip.gd": r"const MODALITIES.*?\[(.*?)\]",
        "unity/Runtime/HapticClip.cs": r"enum Modality \{(.*?)\}",
        "web/src/clip.js": r"const MODALITIES = \[(.*?)\]",
        "web/index.d.ts": r"type Modality = (.*?);",
    }
    for name, pattern in lists.items():
        match = re.search(pattern, (players / name).read_text("utf-8"), re.DOTALL)
        assert match is not None, name
        names = re.findall(r"\w+", match[1].lower().replace("hfx_", ""))
        assert names == list(MODALITIES), name
