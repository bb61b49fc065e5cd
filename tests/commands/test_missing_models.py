# SPDX-License-Identifier: GPL-3.0-or-later
"""A track whose body models are not installed: its facts are shown, and messages say what to do."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.engine.samples import SampleRun, Stream
from hfx_blender.engine.scene import TimeBase
from hfx_blender.engine.track import TrackWriter
from hfx_blender.engine.track.header import TrackBody, TrackEffect, TrackHeader, TrackModel

IDS = {"vibration": "coarse-vibration", "temperature": "coarse-temperature"}


@pytest.fixture
def track(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a track of 1 s at 10 Hz on two unknown models: a vibration is felt for 0.4 s."""
    monkeypatch.setenv("HFX_BODY_MODELS", str(tmp_path / "sets"))
    streams = tuple(Stream(f"a {kind}", "anna", kind, id) for kind, id in IDS.items())
    header = TrackHeader(
        time=TimeBase(Fraction(10), Fraction(10), 0, 0, 9),
        models=tuple(TrackModel(id, kind, "0" * 64, 50) for kind, id in IDS.items()),
        bodies=(TrackBody("anna", "Anna"),),
        effects=tuple(
            TrackEffect(s.effect_id, s.effect_id.title(), s.modality, "volume", s.model_id)
            for s in streams
        ),
        streams=streams,
    )
    indices = np.arange(2, 8)
    run = SampleRun(
        stream=streams[0],
        indices=indices,
        times_s=indices / 10.0,
        levels=np.ones(6),
        parameters=np.array([[5.0, 100.0]] * 4 + [[0.0, 100.0]] * 2),
        offsets=np.array([0, 2]),
        vertices=np.array([3, 40], np.int32),
        weights=np.ones(2, np.float32),
        sets=np.zeros(6, np.int64),
    )
    path = tmp_path / "old.hfxtrack"
    with TrackWriter(path, header) as writer:
        writer.append([run])
    return path


def test_info_shows_the_header_and_how_to_install_the_models(
    track: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["info", str(track), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [model["model"] for model in facts["models"]] == list(IDS.values())
    assert facts["felt"][0]["seconds"] == 0.4 and facts["felt"][1]["seconds"] == 0.0
    for word in (str(track), *IDS.values(), str(track.parent / "sets"), "hfx body build --install"):
        assert word in facts["not_installed"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["convert", "TRACK", "OUT.csv", "--device", "back_pad"],
        ["convert", "TRACK", "OUT.hjif"],
        ["play", "TRACK", "--device", "back_pad", "--to", "simulator"],
    ],
)
def test_commands_name_the_file_and_every_missing_model(
    track: Path, arguments: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    out = str(track.parent / "out")
    options = [word.replace("TRACK", str(track)).replace("OUT", out) for word in arguments]
    assert cli.run(options) == 3
    told = capfd.readouterr().err
    for word in (str(track), *IDS.values(), str(track.parent / "sets"), "hfx body build --install"):
        assert word in told
