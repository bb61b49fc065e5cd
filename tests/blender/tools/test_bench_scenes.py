# SPDX-License-Identifier: GPL-3.0-or-later
"""The trade on a real scene: no error at the exact setting, stated errors at coarser settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hfx_blender.engine.tolerance import EXACT, PAPER, STANDARD

bpy = pytest.importorskip("bpy")
scenes = pytest.importorskip("hfx_tools.bench.scenes")
trade = pytest.importorskip("hfx_tools.bench.trade.trade")


@pytest.mark.parametrize("name", ["fast", "fine"])
def test_a_scene_is_the_same_every_time(scene: Any, tmp_path: Path, name: str) -> None:
    places = []
    for k in range(2):
        scenes.build(name, tmp_path / f"{k}.blend")
        objects = [obj for obj in bpy.context.scene.objects if obj.hfx.role == "EFFECT"]
        places.append(sorted((obj.name, *obj.location, *obj.rotation_euler) for obj in objects))
        assert len(objects) == {"fast": 20, "fine": 40}[name]
    assert places[0] == places[1]


def test_errors_are_measured_against_the_exact_setting(scene: Any, tmp_path: Path) -> None:
    scenes.build("fine", tmp_path / "fine.blend")
    objects = [obj for obj in bpy.context.scene.objects if obj.hfx.role == "EFFECT"]
    for obj in sorted(objects, key=lambda obj: obj.name)[12:]:
        bpy.data.objects.remove(obj)
    bpy.context.scene.hfx.rate = 24  # a single sample
    actual = trade.measure(
        bpy.context.scene,
        tolerances=(EXACT, STANDARD, PAPER),
        frames=(40, 40),
        rounds=1,
        reference_rate_hz=None,
    )
    exact, standard, paper = actual["settings"]
    assert exact["contacts"] > 20 and actual["samples"] == 1
    for name in ("missed", "extra", "wrong_share", "amplitude_mean", "amplitude_largest"):
        assert exact[name] == 0.0, name
    assert exact["onset_mean_ms"] == 0.0 and exact["events_missed"] == 0
    assert 0.0 < standard["wrong_share"] < paper["wrong_share"]
    assert paper["missed"] > standard["missed"]
    for row in actual["settings"]:
        assert row["memory_mb"] > 0.1 and row["ms_per_frame"] <= row["ms_median"]
    assert exact["on_front"], "nothing else is as exact"
