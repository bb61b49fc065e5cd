# SPDX-License-Identifier: GPL-3.0-or-later
"""Read and export files of earlier versions with the present version.

``old_files/first_version.blend`` was saved by the first version with a command line: a
heartbeat painted on the left palm, a capsule of fire with a clip, a vibrating box.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects, model_migration
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.body.parts import PARTS, SIDES

FIRST = Path(__file__).parents[1] / "old_files" / "first_version.blend"

# Also files with one keyframed object and without the add-on; 4.2.23 opens them.
can_open = pytest.mark.skipif(
    bpy.app.version == (4, 2, 0), reason="Blender 4.2.0 crashes on actions of Blender 4.4 and later"
)


@pytest.fixture
def first(registered: Any) -> Any:
    bpy.ops.wm.open_mainfile(filepath=str(FIRST))
    return bpy.data.objects


@can_open
def test_what_the_first_version_saved_is_there(first: Any) -> None:
    fire, buzz, touch = first["Fire"].hfx, first["Buzz"].hfx, first["Touch"].hfx
    assert (fire.modality, fire.shape, fire.falloff) == ("temperature", "CAPSULE", "smooth")
    assert (fire.temperature, fire.radius, fire.height) == pytest.approx((40.0, 0.3, 1.0))
    assert (buzz.modality, buzz.shape) == ("vibration", "CUBOID")
    assert tuple(buzz.size) == pytest.approx((0.4, 0.5, 0.6))
    assert touch.kind == "PAINTED" and touch.body == first["Avatar"]
    ((_, beat),) = clips.strips_of(first["Touch"])
    assert (beat.frame_start, beat.frame_end, beat.repeat) == (10.0, 35.0, 2.0)
    assert (beat.blend_in, beat.blend_out) == (5.0, 5.0)
    ((_, clip),) = clips.strips_of(first["Fire"])
    assert (clip.frame_start, clip.frame_end, clip.blend_in) == (5.0, 30.0, 12.5)


@can_open
def test_an_area_on_an_earlier_model_is_carried_over(first: Any) -> None:
    model = load_model("hfx-pressure-1")
    assert first["Touch"].hfx.model_hash == model.content_hash
    weights = np.zeros(len(model))
    vertices, values = effects.area(first["Touch"])
    weights[vertices] = values
    palm = model.part == PARTS.index("hand_palm")
    left = palm & (model.side == SIDES.index("left"))
    assert weights[left].mean() > 0.98 and weights[~palm].max() == 0.0


@can_open
def test_it_is_exported(first: Any, tmp_path: Path) -> None:
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.hfx.rate = 12, 17, 25.0
    bpy.ops.hfx.export(filepath=str(tmp_path / "old.hfxtrack"), formats={"track"})
    report = json.loads((tmp_path / "old.report.json").read_text())
    samples = {item["effect"]: item["seconds"] for item in report["felt"]}
    assert all(samples[name] > 0.0 for name in ("Touch", "Fire", "Buzz")), samples
    # Both clips begin before frame 12 and end after frame 17.
    assert all(
        "first frame of the scene" in text or "last frame" in text for text in report["warnings"]
    )


@can_open
def test_without_scipy_the_report_says_what_is_missing(
    registered: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("scipy", "scipy.spatial"):
        monkeypatch.setitem(sys.modules, name, None)
    bpy.ops.wm.open_mainfile(filepath=str(FIRST))
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.hfx.rate = 12, 13, 25.0
    bpy.ops.hfx.export(filepath=str(tmp_path / "old.hfxtrack"), formats={"track"})
    warnings = json.loads((tmp_path / "old.report.json").read_text())["warnings"]
    (warning,) = (text for text in warnings if "scipy" in text)
    assert "'Touch'" in warning and "scipy, which this Blender lacks" in warning


def test_only_editions_that_were_are_known() -> None:
    assert len(model_migration.known_editions()) >= 4
    assert model_migration.load("hfx-pressure-1", "0" * 64) is None
    for model_id in ("hfx-pressure-1", "hfx-vibration-1", "hfx-temperature-1"):
        assert (
            f"{model_id}.{load_model(model_id).content_hash}"
            not in model_migration.known_editions()
        )
