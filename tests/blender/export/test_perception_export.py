# SPDX-License-Identifier: GPL-3.0-or-later
"""Strength above the detection threshold in the report, ``hfx info``, the panel and exports."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from hfx_scenes import save, small_scene

from hfx_blender import cli
from hfx_blender.authoring.effects.sensation_levels import level_text
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.track import TrackReader
from hfx_blender.export.scene_export import ExportSettings, export_scene


@pytest.fixture
def scene(registered: Any) -> Iterator[Any]:
    """Add vibration of 1 m/s^2 at 100 Hz on the palms and on the torso. A palm feels 0.2 m/s^2
    (Verrillo 1963), a torso needs some 34 dB more."""
    created = small_scene(4)
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    for name, part in (("Palms", "hand_palm"), ("Back", "torso")):
        bpy.ops.hfx.add_painted(modality="vibration", name=name)
        bpy.ops.hfx.fill_part(part=part)
        bpy.data.objects[name].hfx.amplitude = 1.0
    yield created
    bpy.ops.wm.read_homefile(use_empty=True)


def notes_of(scene: Any, folder: Path) -> list[str]:
    report = export_scene(scene, folder, "x", ExportSettings(("track",), threads=1))
    return [note for note in report.notes if "detection threshold" in note]


def test_the_report_counts_and_names_effects_below_the_threshold(
    scene: Any, tmp_path: Path
) -> None:
    (note,) = notes_of(scene, tmp_path)
    assert note.endswith(": 1 (Back)")
    # 1 m/s^2 is 14 dB above the palms' 0.2; a fifth at most is 0 dB.
    bpy.data.objects["Palms"].hfx.intensity = 0.19
    (note,) = notes_of(scene, tmp_path)
    assert note.endswith(": 2 (Back, Palms)")


def test_nothing_is_said_above_the_threshold(scene: Any, tmp_path: Path) -> None:
    bpy.data.objects["Back"].hfx.amplitude = 50.0
    assert notes_of(scene, tmp_path) == []


def test_the_threshold_counts_after_equal_feel(scene: Any, tmp_path: Path) -> None:
    scene.hfx.equal_feel = True
    # 1 m/s^2 is as far below 9.82, the torso's threshold, on the palms as on the torso.
    (note,) = notes_of(scene, tmp_path)
    assert note.endswith(": 2 (Back, Palms)")
    assert level_text(bpy.data.objects["Palms"], is_equal=True) == "-20 dB SL"
    bpy.data.objects["Palms"].hfx.amplitude = bpy.data.objects["Back"].hfx.amplitude = 10.0
    assert notes_of(scene, tmp_path) == []


def test_levels_of_effects_are_those_of_their_parts(scene: Any, tmp_path: Path) -> None:
    # 20 log10(1 / 0.2010) = 13.9; torso 33.8 dB less.
    assert level_text(bpy.data.objects["Palms"]) == "14 dB SL"
    assert level_text(bpy.data.objects["Back"]) == "-20 dB SL"
    bpy.data.objects["Palms"].hfx.intensity = 0.0
    assert level_text(bpy.data.objects["Palms"]) == ""
    # 5 kPa over 1.275 kPa is 11.9 dB.
    assert level_text(bpy.data.objects["Touch"]) == "12 dB SL"


def test_info_states_levels(scene: Any, tmp_path: Path, capfd: Any) -> None:
    assert cli.run(["info", str(save(tmp_path / "x.blend")), "--json"]) == 0
    out = capfd.readouterr().out  # after lines of Blender
    (facts,) = json.loads(out[out.index("\n{") :])["scenes"]
    levels = {effect["effect"]: effect["above_threshold"] for effect in facts["effects"]}
    assert levels == {"Palms": "14 dB SL", "Back": "-20 dB SL", "Touch": "12 dB SL"}


def test_info_tells_silence_from_a_modality_without_thresholds(
    scene: Any, tmp_path: Path, capfd: Any
) -> None:
    bpy.data.objects["Palms"].hfx.intensity = 0.0
    bpy.data.objects["Touch"].hfx.modality = "wind"
    scene.hfx.equal_feel = True
    bpy.data.objects["Back"].hfx.frequency = 50.0
    assert cli.run(["info", str(save(tmp_path / "x.blend")), "--json"]) == 0
    out = capfd.readouterr().out
    (facts,) = json.loads(out[out.index("\n{") :])["scenes"]
    assert {effect["effect"]: effect["above_threshold"] for effect in facts["effects"]} == {
        "Palms": "silent (strength 0)",
        "Back": "-20 dB SL",  # without Equal Feel 12 dB more
        "Touch": "no published threshold",
    }


def values_of(scene: Any, folder: Path) -> tuple[np.ndarray, dict[str, Any]]:
    device = load_device("back_pad")
    export_scene(scene, folder, "x", ExportSettings(("csv", "track"), (device,), threads=1))
    with TrackReader(folder / "x.hfxtrack") as track:
        settings = dict(track.header.settings)
    table = np.genfromtxt(folder / "x.back_pad.csv", delimiter=",", names=True)
    name = next(name for name in table.dtype.names if "amplitude" in name)
    return np.asarray(table[name]), settings


def test_the_scene_settings_reach_track_and_devices(scene: Any, tmp_path: Path) -> None:
    bpy.data.objects["Back"].hfx.frequency = 50.0
    plain, settings = values_of(scene, tmp_path / "plain")
    assert "feel" not in settings
    scene.hfx.equal_feel = True
    equal, settings = values_of(scene, tmp_path / "equal")
    assert settings["feel"] == {"is_equal": True, "adaptation_s": 0.0, "persistence_s": 0.0}
    # On the torso at 50 Hz 22.0 dB above fingers, at 100 Hz 33.8; the palm's displacement falls
    # by 12 dB per octave, as the square of the frequency rises.
    assert plain.max() == 1.0
    assert equal == pytest.approx(plain * 10 ** ((22.0 - 33.8) / 20), rel=5e-3)
    scene.hfx.equal_feel = False
    scene.hfx.adaptation = 0.02
    adapted, _ = values_of(scene, tmp_path / "adapted")
    is_on = plain > 0.0
    # The pad's latency moves the first samples before the file.
    assert (np.diff(adapted[is_on]) < 0.0).all()
    assert 1.0 > adapted[is_on][0] > adapted[is_on][-1] > 1.0 / 1.6
