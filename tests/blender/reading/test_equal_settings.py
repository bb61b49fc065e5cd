# SPDX-License-Identifier: GPL-3.0-or-later
"""Values derived once for all volumes with equal stored settings are right for each volume."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from test_hostile_values import put, stored

from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.reading.description.equal_settings import EqualSettings
from hfx_blender.reading.description.visibility import stored_of
from hfx_blender.reading.scene_reader import SceneReader
from hfx_blender.reading.stepped import stepping

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

FAR = (20.0, 0.0, 1.2)


@pytest.fixture
def ball(scene: Any) -> Any:
    scene.frame_start, scene.frame_end = 1, 6
    oracle.add_avatar()
    return oracle.add_volume("Ball", "pressure", "SPHERE", FAR, radius=0.2)


def _copy(obj: Any, name: str) -> Any:
    """Linked copy of an effect with the same settings and an id of its own."""
    copy = obj.copy()
    copy.name, copy.hfx.uid = name, f"id of {name}"
    copy.location.x += 1.0
    bpy.context.scene.collection.objects.link(copy)
    return copy


def _groups(*objects: Any) -> EqualSettings:
    return EqualSettings({obj: stored_of(obj) for obj in objects})


def _keyed(obj: Any) -> None:
    oracle.key(obj, "hfx.intensity", [(1, 1.0), (6, 0.0)])


@pytest.mark.parametrize(
    "change",
    [
        lambda obj: put(stored(obj), "radius", 0.25),
        lambda obj: put(stored(obj), "radius", "0.2"),
        lambda obj: put(stored(obj), "radius", [0.2]),
        lambda obj: put(stored(obj), "radius", math.nan),
        lambda obj: put(stored(obj), "uid", 3),
        lambda obj: setattr(obj.hfx, "is_muted", True),
        lambda obj: obj.hfx.response.add(),
        lambda obj: obj.__setitem__("hfx_weights", [1.0]),
        _keyed,
    ],
    ids=["number", "text", "array", "nan", "uid", "mute", "filter", "weights", "keyed"],
)
def test_another_value_is_another_group(ball: Any, change: Callable[[Any], object]) -> None:
    same, other = _copy(ball, "Same"), _copy(ball, "Other")
    assert len(_groups(ball, same, other).distinct([ball, same, other])) == 1, "only the id differs"
    change(other)
    groups = _groups(ball, same, other)
    assert groups.group_of(ball) == groups.group_of(same) != groups.group_of(other)


def test_a_number_is_another_value_than_a_flag(ball: Any) -> None:
    """1, 1.0 and True are equal in Python, but not allowed for the same properties."""
    copies = [_copy(ball, f"Copy {k}") for k in range(3)]
    for copy, value in zip(copies, (1, 1.0, True), strict=True):
        put(stored(copy), "is_solo", value)
    groups = _groups(*copies)
    assert groups.group_of(copies[0]) != groups.group_of(copies[1])


def test_equal_nan_and_filters_are_one_group(ball: Any) -> None:
    ball.hfx.response.add().kind = "sine"
    put(stored(ball), "radius", math.nan)
    copies = [_copy(ball, "Copy 1"), _copy(ball, "Copy 2")]
    assert len(_groups(ball, *copies).distinct([ball, *copies])) == 1


def test_an_empty_array_and_a_data_block_are_alone(ball: Any) -> None:
    """An empty array does not tell the type of its elements, and names of data-blocks repeat."""
    for name, value in (("size", []), ("body", bpy.data.objects["Avatar"])):
        put(stored(ball), name, value)
        copy = _copy(ball, "Copy")
        assert len(_groups(ball, copy).distinct([ball, copy])) == 2, name
        del stored(ball)[name]
        bpy.data.objects.remove(copy)


def test_shared_work_is_done_once_for_a_group(ball: Any) -> None:
    copy, other = _copy(ball, "Copy"), _copy(ball, "Other")
    other.hfx.radius = 0.5
    asked = []

    def work(obj: Any, flag: bool = False) -> float:
        asked.append((obj.name, flag))
        return float(obj.hfx.radius)

    shared = _groups(ball, copy, other).shared(work)
    assert [shared(obj) for obj in (ball, copy, other, copy)] == pytest.approx([0.2, 0.2, 0.5, 0.2])
    assert asked == [("Ball", False), ("Other", False)]
    shared(copy, True)
    assert asked[2:] == [("Copy", True)]


def _crowd(ball: Any) -> None:
    """Add three copies of a volume with each of the changes below: far, muted, keyed ..."""
    scene = bpy.context.scene
    top = oracle.empty(scene, "Top")
    top.location.z = 0.5
    changes: dict[str, Callable[[Any], object]] = {
        "Far": lambda obj: None,
        "Near": lambda obj: setattr(obj, "location", (0.0, 0.0, 1.2)),
        "Muted": lambda obj: setattr(obj.hfx, "is_muted", True),
        "Weak": lambda obj: setattr(obj.hfx, "pressure", 0.0),
        "Silent": lambda obj: setattr(obj.hfx, "intensity", 0.0),
        "Negative": lambda obj: put(stored(obj), "radius", -1.0),
        "Text": lambda obj: None,  # see below
        "Endless": lambda obj: put(stored(obj), "size", [math.nan] * 3),
        "Unknown": lambda obj: put(stored(obj), "shape", 99),
        "Keyed": _keyed,
        "Child": lambda obj: setattr(obj, "parent", top),
        "Filter": lambda obj: obj.hfx.response.add(),
        "Mesh": lambda obj: setattr(obj.hfx, "shape", "MESH"),
        "Stiff": lambda obj: setattr(obj.hfx, "stiffness", 200.0),
        "Hidden": lambda obj: setattr(obj, "hide_viewport", True),
    }
    for name, change in changes.items():
        for k in range(3):
            change(_copy(ball, f"{name} {k}"))


@pytest.mark.parametrize("is_solo", [False, True])
def test_groups_change_no_file(
    ball: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_solo: bool
) -> None:
    """Tracks and reports are those of a reading of each volume by itself."""
    _crowd(ball)
    for k in range(2 * is_solo):
        bpy.data.objects[f"Near {k}"].hfx.is_solo = True

    def files(name: str) -> list[bytes]:
        for k in range(3):  # Blender drops a value of another type with the first reading
            put(stored(bpy.data.objects[f"Text {k}"]), "stiffness", "much")
        report = export_scene(bpy.context.scene, tmp_path / name, "x", ExportSettings())
        assert len(report.effects) == 46
        for fault in ("hfx.radius is -1", "hfx.stiffness is the text"):
            assert sum(fault in text for text in report.warnings) == 3
        return [path.read_bytes() for path in sorted((tmp_path / name).iterdir())]

    grouped = files("grouped")
    monkeypatch.setattr(EqualSettings, "group_of", lambda self, obj: obj)
    monkeypatch.setattr(EqualSettings, "shared", lambda self, work: work)
    alone = files("alone")
    assert grouped == alone
    reports = [json.loads(content) for content in grouped if content.startswith(b"{")]
    assert [len(report["effects"]) for report in reports] == [46]


def test_each_corrected_value_of_a_group_has_a_warning(ball: Any) -> None:
    for k in range(3):
        put(stored(_copy(ball, f"Low {k}")), "radius", -1.0)
    warnings = SceneReader(bpy.context.scene).description.warnings
    named = [text for text in warnings if "hfx.radius is -1" in text]
    assert [text.split("'")[1] for text in named] == ["Low 0", "Low 1", "Low 2"]


def test_a_file_without_drivers_runs_no_code(ball: Any) -> None:
    """References are followed only if some data-block of any kind has a driver."""
    assert not stepping.runs_code([ball])
    material = bpy.data.materials.new("Look")
    material.driver_add("roughness").driver.expression = "sin(bpy.context.scene.frame_current)"
    assert not stepping.runs_code([ball]), "no part of the motion"
    ball.data.shape_keys or ball.shape_key_add(name="Basis")
    key = ball.shape_key_add(name="Up")
    key.driver_add("value").driver.expression = "bpy.context.scene.frame_current * 0.1"
    assert stepping.runs_code([ball])
