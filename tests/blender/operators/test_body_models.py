# SPDX-License-Identifier: GPL-3.0-or-later
"""Choice of an installed set of body models for the bodies of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import body_sets
import bpy
import numpy as np
import oracle
import pytest
from own_avatar import opened

from hfx_blender.authoring import painting
from hfx_blender.authoring.effects import effect_exchange, effects
from hfx_blender.avatars import stored_fits
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.body import model
from hfx_blender.engine.body.parts import PARTS
from hfx_blender.engine.rendering.device_config import VertexPlace, VertexSet
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.live_scene import signature_of
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.ui.panels import body_panel
from hfx_tools.formats import facts
from hfx_tools.track_rendering import render_devices

IDS = ("hfx-pressure-1-quadric", "hfx-vibration-1-quadric")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: Any) -> Iterator[Path]:
    """Folder of user sets with the set "coarse"; temperature is not in the set."""
    monkeypatch.setenv("HFX_BODY_MODELS", str(tmp_path / "sets"))
    assert body_sets.coarse_set(tmp_path / "sets" / "coarse") == IDS
    yield tmp_path / "sets"
    model.load_model.cache_clear()


def drawn_menus() -> list[str]:
    """Texts of the menus in the panel of the active body."""
    layout = MagicMock()
    body_panel.HFX_PT_body.draw(SimpleNamespace(layout=layout), bpy.context)
    return [call.kwargs.get("text", "") for call in layout.operator_menu_enum.call_args_list]


def nearest_in_part(source: Any, target: Any) -> np.ndarray:
    """Nearest vertex of ``target`` on the part for each vertex of ``source``, by trying all."""
    owners = np.zeros(len(source), np.int64)
    for part in np.unique(source.part):
        there = np.flatnonzero(target.part == part)
        for vertex in np.flatnonzero(source.part == part):
            away = np.linalg.norm(target.vertices[there] - source.vertices[vertex], axis=1)
            owners[vertex] = there[away.argmin()]
    return owners


def test_a_painted_area_moves_to_the_nearest_cells_in_one_undo_step(installed: Path) -> None:
    rig = oracle.add_avatar()
    touch = oracle.add_painted("Touch", "pressure", rig)
    fine, coarse = model.load_model("hfx-pressure-1"), model.load_model(IDS[0])
    owners = nearest_in_part(fine, coarse)
    counts = np.bincount(owners, minlength=len(coarse))
    cell = int(np.flatnonzero(counts > 8)[0])  # a cell of nine or more fine vertices, all painted
    painted = np.flatnonzero(owners == cell)
    effects.set_area(touch, painted.tolist(), [0.75] * len(painted))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.hfx.use_models(models="coarse") == {"FINISHED"}
    bpy.ops.ed.undo_push(message="models")
    weights = painting.weights_of(touch)
    assert touch.hfx.model_id == IDS[0] and touch.hfx.model_hash == coarse.content_hash
    assert weights[cell] == pytest.approx(0.75)
    # Cells with several fine vertices take their own vertices only.
    others = np.flatnonzero((counts > 1) & (np.arange(len(coarse)) != cell))
    assert not weights[others].any()
    bpy.ops.ed.undo()
    touch, rig = (
        bpy.data.objects["Touch"],
        next(o for o in bpy.data.objects if o.hfx.role == "BODY"),
    )
    assert touch.hfx.model_id == "hfx-pressure-1" and rig.hfx.body_models == ""
    assert effects.area(touch)[0] == painted.tolist()


def test_effects_tracks_and_files_carry_the_ids_of_the_set(installed: Path, tmp_path: Path) -> None:
    rig = oracle.add_avatar()
    oracle.add_painted("Touch", "vibration", rig, part="hand_palm")
    oracle.add_painted("Warm", "temperature", rig, part="head")
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.2), radius=0.3)
    scene = bpy.context.scene
    scene.frame_end = 5
    bpy.context.view_layer.objects.active = rig
    before = export_scene(scene, tmp_path / "before", "x", ExportSettings())
    bpy.ops.hfx.use_models(models="coarse")
    settings = ExportSettings(("track", "jsonl", "glb", "hjif", "clip"))
    report = export_scene(scene, tmp_path / "coarse", "x", settings)
    track = TrackReader(next(path for path in report.files if path.suffix == ".hfxtrack"))
    by_name = {effect.name: effect.model_id for effect in track.header.effects}
    assert by_name == {"Touch": IDS[1], "Warm": "hfx-temperature-1", "Ball": IDS[0]}
    clip = next(path for path in report.files if path.suffix == ".hfxclip")
    assert set(facts.clip_facts(clip)["models"]) == set(by_name.values())
    hashes = {used.id: used.content_hash for used in track.header.models}
    assert hashes == {id: model.load_model(id).content_hash for id in by_name.values()}
    # A ball feels the coarse vertices inside it: points in a sphere, by arithmetic.
    coarse = model.load_model(IDS[0])
    inside = np.linalg.norm(coarse.vertices - (0.0, 0.0, 1.2), axis=1) < 0.3 - 0.02
    evaluated = oracle.evaluate(scene)
    sample = evaluated.of("Ball", 0)
    assert sample is not None and set(np.flatnonzero(inside)) <= set(sample.vertices.tolist())
    assert sample.vertices.max() < len(coarse)
    # The default set again: the untouched volume is exported as before.
    bpy.ops.hfx.use_models(models="DEFAULT")
    after = export_scene(scene, tmp_path / "after", "x", ExportSettings())
    ids = [[e.model_id for e in TrackReader(r.files[0]).header.effects] for r in (before, after)]
    assert ids[0] == ids[1]


def test_bodies_of_different_sets_are_refused_with_the_cure(installed: Path) -> None:
    first = oracle.add_avatar()
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.2))
    bpy.context.view_layer.objects.active = first
    bpy.ops.hfx.use_models(models="coarse")
    second = oracle.add_avatar()
    with pytest.raises(InputError, match=r"different sets of body models.*panel Haptic Body"):
        SceneReader(bpy.context.scene)
    bpy.context.view_layer.objects.active = second
    bpy.ops.hfx.use_models(models="coarse")
    assert {e.model_id for e in SceneReader(bpy.context.scene).description.effects} == {IDS[0]}


def test_a_missing_set_is_named_and_shown(installed: Path) -> None:
    rig = oracle.add_avatar()
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.2))
    bpy.context.view_layer.objects.active = rig
    assert "Body Models: Default" in drawn_menus()
    bpy.ops.hfx.use_models(models="coarse")
    assert "Body Models: coarse" in drawn_menus()
    (installed / "coarse").rename(installed.parent / "elsewhere")
    model.load_model.cache_clear()
    assert f"Body Models: {' '.join(IDS)}" in drawn_menus()
    with pytest.raises(InputError, match=f"'{IDS[0]}' is unknown"):
        oracle.evaluate(bpy.context.scene)
    bpy.ops.hfx.use_models(models="DEFAULT")
    assert not [text for text in drawn_menus() if "Body Models" in text]
    assert SceneReader(bpy.context.scene).description.effects[0].model_id == "hfx-pressure-1"


def test_an_area_on_the_other_model_stays_and_is_named(
    installed: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rig = oracle.add_avatar()
    touch = oracle.add_painted("Touch", "pressure", rig, part="head")
    touch.hfx.model_hash = "0" * 64  # painted on an unknown edition
    bpy.context.view_layer.objects.active = rig
    before = effects.area(touch)
    bpy.ops.hfx.use_models(models="coarse")
    assert "Areas that stay on the earlier models: Touch" in capfd.readouterr().out
    assert effects.area(touch) == before and touch.hfx.model_id == "hfx-pressure-1"


def test_an_own_avatar_is_fitted_to_the_set_and_keeps_the_shipped_fit(installed: Path) -> None:
    rig, _ = opened(is_fitted=True)
    bpy.context.view_layer.objects.active = rig
    shipped = stored_fits.fitted_model(rig, "hfx-pressure-1")
    bpy.ops.hfx.use_models(models="coarse")
    fitted = stored_fits.fitted_model(rig, IDS[0])
    assert shipped is not None and fitted is not None
    again = stored_fits.fitted_model(rig, "hfx-pressure-1")
    assert again is not None and np.array_equal(again.vertices, shipped.vertices)
    # The coarse vertices are fine ones, so they lie where the fine model's fit has them.
    fine, coarse = model.load_model("hfx-pressure-1"), model.load_model(IDS[0])
    rows = [int(np.flatnonzero((fine.vertices == v).all(axis=1))[0]) for v in coarse.vertices]
    away = np.linalg.norm(fitted.vertices - shipped.vertices[rows], axis=1)
    assert np.quantile(away, 0.95) < 0.01 * np.ptp(shipped.vertices)


def test_a_saved_effect_of_the_shipped_model_moves_to_the_set(installed: Path) -> None:
    rig = oracle.add_avatar()
    touch = oracle.add_painted("Touch", "pressure", rig, part="torso")
    saved = effect_exchange.sensation_of(bpy.context.scene, [touch], "Saved")
    bpy.context.view_layer.objects.active = rig
    bpy.ops.hfx.use_models(models="coarse")
    (placed,) = effect_exchange.place_sensation(bpy.context.scene, saved, body=rig, frame=1.0)
    # A whole part stays a whole part on any model.
    coarse = model.load_model(IDS[0])
    assert placed.hfx.model_id == IDS[0]
    assert effects.area(placed)[0] == np.flatnonzero(coarse.part == PARTS.index("torso")).tolist()


def test_the_open_scene_is_described_again_with_the_set(installed: Path) -> None:
    rig = oracle.add_avatar()
    oracle.add_volume("Ball", "pressure", "SPHERE", (0.0, 0.0, 1.2))
    bpy.context.view_layer.objects.active = rig
    before = signature_of(bpy.context.scene)
    bpy.ops.hfx.use_models(models="coarse")
    assert signature_of(bpy.context.scene) != before


def test_devices_and_clips_play_by_place_and_name_actuators_of_other_vertices(
    installed: Path, tmp_path: Path
) -> None:
    rig = oracle.add_avatar()
    buzz = oracle.add_painted("Buzz", "vibration", rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.hfx.use_models(models="coarse")
    buzz.hfx.intensity = 1.0
    bpy.context.scene.frame_end = 3
    by_place = load_device("waist_belt")
    shipped = model.load_model("hfx-vibration-1")
    named = VertexPlace((VertexSet(shipped.id, shipped.content_hash, (5,)),))
    first = replace(by_place.actuators[0], place=named)
    by_name = replace(by_place, id="named", actuators=(first,))
    settings = ExportSettings(("track", "csv", "clip"), (by_place, by_name))
    report = export_scene(bpy.context.scene, tmp_path, "x", settings)
    lost = [w for w in report.notes if f"without a vertex on the body model '{IDS[1]}'" in w]
    assert len(lost) == 1 and "device 'named'" in lost[0] and first.id in lost[0]
    with TrackReader(next(p for p in report.files if p.suffix == ".hfxtrack")) as track:
        rasters = {device.id: raster for device, raster in render_devices(track, [by_place])}
    assert (rasters[by_place.id].values.max(axis=0) > 0.0).sum() >= len(by_place.actuators)
