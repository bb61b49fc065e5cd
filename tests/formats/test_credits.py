# SPDX-License-Identifier: GPL-3.0-or-later
"""Author, project and tags survive conversions, or a note names the loss."""

from __future__ import annotations

import json

import pytest
from test_hjif_foreign import channel_with

from hfx_blender import cli
from hfx_blender.files.strict_json import encoded
from hfx_tools.commands.conversion import convert

METADATA = {
    "editor": "Studio",
    "author": "Ada",
    "source": "boom.wav",
    "project": "Caves",
    "tags": ["rock", "frequency-range-hz:50-200", "large"],
    "description": "boom",
}
POINTS = [{"time": 0.0, "amplitude": 0.2}, {"time": 1.0, "amplitude": 0.8}]
HAPTIC = {
    "version": {"major": 1, "minor": 0, "patch": 0},
    "metadata": METADATA,
    "signals": {"continuous": {"envelopes": {"amplitude": POINTS}}},
}
EVENT = {"Time": 0.0, "EventType": "HapticContinuous", "EventDuration": 1.0}
AHAP = {
    "Version": 1.0,
    "Metadata": {"Project": "Caves", "Created": "5 May 2023", "Description": "boom", "Team": "A"},
    "Pattern": [{"Event": EVENT}],
}
HE = {
    "Metadata": {"Version": 1, "Created": "2023-05-05", "Description": "boom"},
    "Pattern": [
        {
            "Event": {
                "Type": "transient",
                "RelativeTime": 0,
                "Parameters": {"Intensity": 90, "Frequency": 50},
            }
        }
    ],
}
WAVE = {
    "effect_type": "Basis",
    "position": 0,
    "phase": 0.0,
    "base_signal": "Sine",
    "keyframes": [
        {"relative_position": t, "amplitude_modulation": 0.5, "frequency_modulation": 100}
        for t in (0, 400)
    ],
}
BAND = {"band_type": "VectorialWave", "lower_frequency_limit": 0, "upper_frequency_limit": 1000}
HJIF = {
    **channel_with({**BAND, "effects": [WAVE]}),
    "description": "a boom in a cave",
    "date": "2023-05-05T12:00:00+02:00",
}
MODE = {
    "mode": "DOT_MODE",
    "dotMode": {
        "feedback": [
            {
                "startTime": 0,
                "endTime": 100,
                "playbackType": "NONE",
                "pointList": [{"index": 0, "intensity": 0.5}],
            }
        ]
    },
    "pathMode": {"feedback": []},
}
TACT = {
    "intervalMillis": 20,
    "size": 20,
    "durationMillis": 100,
    "project": {
        "name": "Caves",
        "description": "a boom",
        "layout": {
            "type": "Vest",
            "name": "Tactot",
            "layouts": {"VestBack": [{"index": 0, "x": 0.0, "y": 0.0}]},
        },
        "tracks": [{"effects": [{"startTime": 0, "offsetTime": 100, "modes": {"VestBack": MODE}}]}],
    },
}


def converted(document, source, target, folder, **options):
    """Return the written document and the note about unsupported metadata, or None."""
    path = folder / source
    path.write_bytes(encoded(document))
    written = convert(path, folder / target, **options)
    lost = [note for note in written.notes if "has no place for" in note]
    assert len(lost) <= 1
    is_text = written.files[0].suffix not in (".csv", ".wav")
    return is_text and json.loads(written.files[0].read_bytes()), "".join(lost)


def test_haptic_keeps_all_of_its_own(tmp_path):
    actual, lost = converted(HAPTIC, "a.haptic", "b.haptic", tmp_path)
    metadata = {key: actual["metadata"][key] for key in ("author", "source", "project")}
    assert metadata == {"author": "Ada", "source": "boom.wav", "project": "Caves"} and not lost
    assert actual["metadata"]["tags"] == ["rock", "large", "frequency-range-hz:50-200"]


def test_ahap_keeps_project_date_and_unknown_metadata(tmp_path):
    actual, lost = converted(HAPTIC, "a.haptic", "b.ahap", tmp_path)
    assert actual["Metadata"]["Project"] == "Caves"
    assert lost == (
        "Apple AHAP has no place for author 'Ada', source 'boom.wav', tags 'rock, large'"
    )
    actual, lost = converted(AHAP, "c.ahap", "d.ahap", tmp_path)
    assert actual["Metadata"]["Created"] == "5 May 2023" and actual["Metadata"]["Team"] == "A"
    assert not lost
    _, lost = converted(AHAP, "c.ahap", "d.haptic", tmp_path)
    assert lost == "Meta .haptic has no place for created '5 May 2023', Team 'A'"


def test_he_holds_the_date(tmp_path):
    actual, lost = converted(HE, "a.he", "b.he", tmp_path)
    assert actual["Metadata"]["Created"] == "2023-05-05" and not lost
    actual, lost = converted(HE, "a.he", "b.openharmony.json", tmp_path)
    assert actual["MetaData"]["Create"] == "2023-05-05" and not lost
    _, lost = converted(HAPTIC, "a.haptic", "b.he", tmp_path)
    assert "author 'Ada', project 'Caves', source 'boom.wav', tags 'rock, large'" in lost


def test_hjif_holds_its_description_and_date(tmp_path):
    actual, lost = converted(HJIF, "a.hjif", "b.hjif", tmp_path)
    assert (actual["description"], actual["date"]) == (HJIF["description"], HJIF["date"])
    assert not lost
    _, lost = converted({**HJIF, "date": "in May 2023"}, "a.hjif", "b.hjif", tmp_path)
    assert lost == "MPEG HJIF has no place for created 'in May 2023'"
    _, lost = converted(HJIF, "a.hjif", "b.haptic", tmp_path)
    assert "description 'a boom in a cave'" in lost and "created '2023-05-05" in lost


def test_tact_has_a_project(tmp_path):
    actual, lost = converted(TACT, "a.tact", "b.haptic", tmp_path)
    assert actual["metadata"]["project"] == "Caves" and "description 'a boom'" in lost


@pytest.mark.parametrize("target", ["b.openxr.json", "b.csv", "b.wav", "b.tact"])
def test_formats_without_a_place_tell_all(target, tmp_path):
    options = {} if "openxr" in target else {"device": "back_pad"}
    _, lost = converted(HAPTIC, "a.haptic", target, tmp_path, **options)
    assert "author 'Ada', project 'Caves', source 'boom.wav', tags 'rock, large'" in lost


def test_our_own_statements_are_none(tmp_path):
    converted({**HAPTIC, "metadata": {}}, "a.haptic", "b.ahap", tmp_path)
    for target in ("c.haptic", "c.he", "c.openxr.json", "c.hjif"):
        written = convert(tmp_path / "b.ahap", tmp_path / target)
        assert not any("has no place for" in note for note in written.notes)
    assert not any(
        "has no place for" in note
        for note in convert(tmp_path / "c.hjif", tmp_path / "d.haptic").notes
    )


def test_info_shows_them(tmp_path, capsys):
    path = tmp_path / "a.haptic"
    path.write_bytes(encoded(HAPTIC))
    assert cli.run(["info", str(path), "--json"]) == 0
    actual = json.loads(capsys.readouterr().out)
    assert actual["metadata"] == {
        "author": "Ada",
        "project": "Caves",
        "source": "boom.wav",
        "tags": "rock, large",
    }


# Metadata of another type than text, or with characters outside the target format.
@pytest.mark.parametrize("value", [None, 3, ["a"], {"b": 1}, "\x00", "a" * 10_000])
def test_any_statement_is_read(value, tmp_path):
    document = {**AHAP, "Metadata": dict.fromkeys(("Project", "Created", "Team", "tags"), value)}
    converted(document, "a.ahap", "b.haptic", tmp_path)
