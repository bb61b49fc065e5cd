# SPDX-License-Identifier: GPL-3.0-or-later
"""Effects of a deleted body act on no body until the user assigns a new body."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest

from hfx_blender import cli
from hfx_blender.authoring.effects import effects
from hfx_blender.avatars import bodies

bpy = pytest.importorskip("bpy")


@pytest.fixture
def anna(registered: Any) -> Any:
    """The body of the painted effect 'Touch'; 'Ball' is a volume, and 'Ben' another body."""
    scene = hfx_scenes.small_scene()
    body = effects.bodies_of(scene)[0]
    body.name = "Anna"
    bodies.add_avatar(bpy.context, "Ben")
    bpy.context.view_layer.update()
    return body


def _bodies_felt(tmp_path: Path) -> tuple[set[tuple[str, str]], list[str]]:
    """Effect and body of each line in the report of an export; the export's warnings."""
    path, out = hfx_scenes.save(tmp_path / "scene.blend"), tmp_path / "out"
    assert cli.run(["export", str(path), "-o", str(out)]) == 0
    report = json.loads((out / "scene.report.json").read_text())
    return {(item["effect"], item["body"]) for item in report["felt"]}, report["warnings"]


def test_an_effect_of_a_deleted_body_is_not_felt_and_said(
    anna: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ("Touch", "Anna") in _bodies_felt(tmp_path)[0]
    bpy.data.objects.remove(bpy.data.objects["Anna"])
    samples, warnings = _bodies_felt(tmp_path)
    assert samples == {("Ball", "Ben")}
    reason = "belongs to body 'Anna', which is not in the scene"
    (warning,) = warnings
    assert warning.startswith(f"effect 'Touch' {reason}: it was left out") and "Move to" in warning
    assert f"Touch was not felt: it {reason}" in capsys.readouterr().out
    words = ["export", str(tmp_path / "scene.blend"), "-o", str(tmp_path / "strict"), "--strict"]
    assert cli.run(words) == 3
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    touch = bpy.data.objects["Touch"]
    assert effects.effects_without_body(bpy.context.scene) == [touch]
    bpy.ops.hfx.move_to_body(which="GONE", body="Ben")
    assert _bodies_felt(tmp_path) == ({("Touch", "Ben"), ("Ball", "Ben")}, [])


def test_the_only_effect_of_a_deleted_body_is_an_error(
    anna: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("Anna", "Ball"):
        bpy.data.objects.remove(bpy.data.objects[name])
    path = hfx_scenes.save(tmp_path / "scene.blend")
    assert cli.run(["export", str(path), "-o", str(tmp_path / "out")]) == 3
    assert "Effect 'Touch' belongs to body 'Anna'" in capsys.readouterr().err


def test_several_effects_of_one_deleted_body_are_one_warning(anna: Any, tmp_path: Path) -> None:
    for k in range(8):
        effects.duplicate(bpy.data.objects["Touch"]).name = f"Copy {k}"
    bpy.data.objects["Copy 7"].hfx.is_muted = True  # a muted effect needs no warning
    bpy.data.objects.remove(anna)
    samples, (warning,) = _bodies_felt(tmp_path)
    assert samples == {("Ball", "Ben")}
    assert warning.startswith("8 effects were left out, as each belongs to body 'Anna'")
    assert all(f"'Copy {k}'" in warning for k in range(7)) and "Copy 7" not in warning


@pytest.mark.parametrize("change", ["never had one", "cleared by hand"])
def test_an_effect_that_has_no_body_is_felt_on_the_only_one(
    anna: Any, tmp_path: Path, change: str
) -> None:
    bpy.data.objects["Touch"].hfx.body = None
    if change == "never had one":  # state in old files
        for name in ("body", "body_name"):
            bpy.data.objects["Touch"].hfx.property_unset(name)
    bpy.data.objects.remove(anna)
    assert ("Touch", "Ben") in _bodies_felt(tmp_path)[0]


def test_a_file_that_stored_no_names_gets_them_when_it_is_opened(
    anna: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touch = bpy.data.objects["Touch"]
    with monkeypatch.context() as patch:
        patch.setattr(effects, "store_body_names", lambda found: None)
        touch.hfx.property_unset("body_name")
        path = hfx_scenes.save(tmp_path / "old.blend")
    bpy.ops.wm.open_mainfile(filepath=str(path))
    bpy.data.objects.remove(bpy.data.objects["Anna"])
    touch = bpy.data.objects["Touch"]
    assert effects.body_in(bpy.context.scene, touch) is None
    assert "'Anna'" in effects.missing_body_reason(touch)


def test_undo_brings_the_body_back(anna: Any) -> None:
    bpy.ops.ed.undo_push(message="before")
    bpy.data.objects.remove(anna)
    bpy.ops.ed.undo_push(message="after")
    touch = bpy.data.objects["Touch"]
    assert effects.effects_without_body(bpy.context.scene) == [touch]
    bpy.ops.ed.undo()
    assert effects.effects_without_body(bpy.context.scene) == []
    assert bpy.data.objects["Touch"].hfx.body == bpy.data.objects["Anna"]


def test_the_same_avatar_made_a_body_again_takes_its_effects(anna: Any) -> None:
    for name in ("Anna", "Ben"):
        bpy.data.objects.remove(bpy.data.objects[name])
    again, _ = bodies.add_avatar(bpy.context, "Anna")
    touch = bpy.data.objects["Touch"]
    assert effects.body_in(bpy.context.scene, touch) is None, "nobody has said so"
    bpy.ops.hfx.mark_body()
    assert touch.hfx.body == again and touch.hfx.body_name == "Anna"


def test_an_appended_effect_is_not_felt_on_a_stranger(anna: Any, tmp_path: Path) -> None:
    path = hfx_scenes.save(tmp_path / "theirs.blend")
    bpy.data.objects.remove(anna)
    bodiless = hfx_scenes.save(tmp_path / "bodiless.blend")
    for source in (path, bodiless):
        bpy.ops.wm.read_homefile(use_empty=True)
        bodies.add_avatar(bpy.context, "Mine")
        with bpy.data.libraries.load(str(source)) as (_, expected):
            expected.objects = ["Touch"]
        bpy.context.scene.collection.objects.link(expected.objects[0])
        assert effects.effects_without_body(bpy.context.scene) == expected.objects[:]
        assert "'Anna'" in effects.missing_body_reason(expected.objects[0])


def test_an_effect_of_a_deleted_copy_names_no_other_body(anna: Any) -> None:
    bpy.ops.scene.new(type="FULL_COPY")
    (touch,) = (e for e in effects.effects_of(bpy.context.scene) if e.name == "Touch.001")
    assert touch.hfx.body.name == "Anna.001"
    bpy.data.objects.remove(touch.hfx.body)
    assert effects.missing_body_reason(touch) == "belongs to a body that was deleted"
    assert effects.effects_without_body(bpy.context.scene) == [touch]


def test_a_new_avatar_names_the_effects_that_it_takes(
    anna: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("Anna", "Ben"):
        bpy.data.objects.remove(bpy.data.objects[name])
    bpy.ops.hfx.add_avatar()
    assert "feels the effects of deleted bodies: Touch" in capfd.readouterr().out


def test_all_orphaned_effects_are_named(
    anna: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects.duplicate(bpy.data.objects["Touch"]).name = "Second"
    for name in ("Anna", "Ball"):
        bpy.data.objects.remove(bpy.data.objects[name])
    path = hfx_scenes.save(tmp_path / "scene.blend")
    assert cli.run(["export", str(path), "-o", str(tmp_path / "out")]) == 3
    message = capsys.readouterr().err
    assert "'Touch' belongs to body 'Anna'" in message
    assert "'Second' belongs to body 'Anna'" in message
