# SPDX-License-Identifier: GPL-3.0-or-later
"""The bone table: detected bones are shown, corrected, saved, loaded and used by the next fit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.errors import InputError

bpy = pytest.importorskip("bpy")
from own_avatar import mark, opened, own_avatar  # noqa: E402

from hfx_blender.authoring.effects import effects  # noqa: E402
from hfx_blender.avatars import bone_table, stored_fits  # noqa: E402


@pytest.fixture
def anna(scene: Any) -> tuple[Any, Any]:
    return opened(is_fitted=True)


def table(rig: Any) -> dict[str, tuple[str, str, str]]:
    return {row.name: (row.bone, row.found, row.follows) for row in rig.hfx.bone_map}


def rename(rig: Any, prefix: str) -> None:
    for number, bone in enumerate(rig.data.bones):
        bone.name = f"{prefix}{number}"


def unrecognisable(rig: Any) -> dict[str, str]:
    """Remove hierarchy and meaning from bone names; return the new name of each bone."""
    names = {bone.name: f"b{number}" for number, bone in enumerate(rig.data.bones)}
    rename(rig, "b")
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in rig.data.edit_bones:
        bone.use_connect = False
        bone.parent = None
    bpy.ops.object.mode_set(mode="OBJECT")
    return names


def test_a_fit_fills_the_table(anna: tuple[Any, Any]) -> None:
    rows = table(anna[0])
    assert len(rows) == 163
    assert rows["upperarm01.L"] == ("mixamorig:LeftArm", "mixamorig:LeftArm", "")
    assert rows["jaw"] == ("", "", "mixamorig:Head")
    assert anna[0].hfx.bone_map_convention == "mixamo"
    assert not bone_table.is_corrected(anna[0])


def test_find_bones_shows_them_before_there_is_a_body(scene: Any) -> None:
    rig, _ = opened()
    bpy.ops.hfx.find_bones()
    assert rig.hfx.role == "NONE" and not stored_fits.is_fitted(rig)
    assert table(rig)["head"][0] == "mixamorig:Head"


def test_what_a_joint_follows_is_told_at_once(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    rows = rig.hfx.bone_map
    rows["finger2-1.L"].bone = ""
    rows["finger2-2.L"].bone = ""
    assert table(rig)["finger2-1.L"] == (
        "",
        "mixamorig:LeftHandIndex1",
        "mixamorig:LeftHand",
    )
    assert table(rig)["finger2-2.L"][2] == "mixamorig:LeftHand"
    rows["finger2-1.L"].bone = "mixamorig:LeftHandIndex1"
    assert table(rig)["finger2-2.L"][2] == "mixamorig:LeftHandIndex1"


def test_a_correction_is_used_by_the_next_fit_and_stays(
    anna: tuple[Any, Any], tmp_path: Path
) -> None:
    rig, skin = anna
    for side in ("Left", "Right"):
        for canonical, bone in (("upperarm01", "Arm"), ("lowerarm01", "ForeArm")):
            second = "R" if side == "Left" else "L"
            rig.hfx.bone_map[f"{canonical}.{second}"].bone = f"mixamorig:{side}{bone}"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "anna.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "anna.blend"))
    rig, skin = bpy.data.objects["Anna"], bpy.data.objects["Anna Skin"]
    bpy.context.view_layer.objects.active = rig
    bpy.ops.hfx.fit_body()
    warnings = stored_fits.messages_of(rig, "warnings")
    assert any("arm" in warning for warning in warnings), warnings
    assert table(rig)["upperarm01.L"][:2] == ("mixamorig:RightArm", "mixamorig:LeftArm")
    mark(rig, skin)  # "Add Haptic Body" keeps the table as well
    assert bone_table.is_corrected(rig)
    bpy.ops.hfx.reset_bones()
    bpy.ops.hfx.fit_body()
    assert not bone_table.is_corrected(rig)
    assert not any("upper arm" in warning for warning in stored_fits.messages_of(rig, "warnings"))


def test_fitting_again_keeps_the_id_and_what_is_painted(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    uid = rig.hfx.uid
    bpy.ops.hfx.add_painted(modality="pressure", name="Touch")
    effect = bpy.context.object
    bpy.ops.hfx.fill_part(part="fingers")
    painted = effects.area(effect)
    before = stored_fits.fitted_model(rig, "hfx-pressure-1").weights.values
    bpy.context.view_layer.objects.active = rig
    rig.hfx.bone_map["toe2-1.L"].bone = ""
    bpy.ops.hfx.fit_body()
    assert rig.hfx.uid == uid and effect.hfx.body == rig and len(painted[0]) > 100
    assert effects.area(effect) == painted
    assert len(before) == len(stored_fits.fitted_model(rig, "hfx-pressure-1").weights.values)


def test_bones_that_nothing_recognises_can_be_assigned_by_hand(anna: tuple[Any, Any]) -> None:
    rig, skin = anna
    actual = {name: bone for name, (bone, _, _) in table(rig).items() if bone}
    rig.hfx.bone_map.clear()
    rig.hfx.bone_map_convention = ""
    now = unrecognisable(rig)
    with pytest.raises(RuntimeError, match="Assign the bones by hand"):
        mark(rig, skin)
    assert not rig.hfx.bone_map
    bpy.ops.hfx.find_bones()  # reports a warning, and gives an empty table
    assert len(rig.hfx.bone_map) == 163 and not any(row.bone for row in rig.hfx.bone_map)
    for name, bone in actual.items():
        rig.hfx.bone_map[name].bone = now[bone]
    mark(rig, skin)
    assert rig.hfx.bone_map_convention == bone_table.BY_HAND
    quality = stored_fits.quality_of(rig)[0]
    assert quality.sides > 0.95 and not quality.whole_faults
    assert not any(part.faults for part in quality.parts)


def test_find_keeps_corrections_and_sees_new_bones(anna: tuple[Any, Any]) -> None:
    rig, _ = anna
    rig.hfx.bone_map["neck01"].bone = "mixamorig:Spine2"
    rig.data.bones["mixamorig:LeftHand"].name = "mixamorig:LeftHandNew"
    bpy.ops.hfx.find_bones()
    assert table(rig)["neck01"][0] == "mixamorig:Spine2"
    assert table(rig)["wrist.L"][1] != "mixamorig:LeftHand"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        ({"wrist.L": "mixamorig:Paw"}, "no bone of that name"),
        ({"wrist.L": "mixamorig:LeftArm"}, "given for 2 joints"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(
    anna: tuple[Any, Any], spoil: dict[str, str], message: str
) -> None:
    rig, _ = anna
    before = stored_fits.fitted_model(rig, "hfx-pressure-1").vertices
    for name, bone in spoil.items():
        rig.hfx.bone_map[name].bone = bone
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.hfx.fit_body()
    assert (stored_fits.fitted_model(rig, "hfx-pressure-1").vertices == before).all()
    assert rig.hfx.bone_map["wrist.L"].bone == spoil["wrist.L"]


def test_a_saved_mapping_fits_another_avatar_of_the_same_rig(
    anna: tuple[Any, Any], tmp_path: Path
) -> None:
    rig, _ = anna
    rig.hfx.bone_map["toe2-1.R"].bone = ""
    path = tmp_path / "rig.json"
    bpy.ops.hfx.save_bones(filepath=str(path))
    saved = {name: bone for name, (bone, _, _) in table(rig).items()}
    second, skin = own_avatar(bpy.context.scene)
    assert second != rig
    bpy.context.view_layer.objects.active = second
    bpy.ops.hfx.load_bones(filepath=str(path))
    assert {name: bone for name, (bone, _, _) in table(second).items()} == saved
    mark(second, skin)
    assert {name: bone for name, (bone, _, _) in table(second).items()} == saved


def test_a_mapping_is_saved_without_a_table_and_with_an_ending(scene: Any, tmp_path: Path) -> None:
    opened()
    bpy.ops.hfx.save_bones(filepath=str(tmp_path / "rig"))
    assert json.loads((tmp_path / "rig.json").read_text())["bones"]["head"] == "mixamorig:Head"


def test_bones_that_an_avatar_lacks_are_left_open(anna: tuple[Any, Any], tmp_path: Path) -> None:
    rig, _ = anna
    path = tmp_path / "rig.json"
    bone_table.save(rig, path)
    rig.data.bones["mixamorig:LeftHandPinky3"].name = "stump"
    (warning,) = bone_table.load(rig, path)
    assert "lacks 1 of" in warning and "mixamorig:LeftHandPinky3" in warning
    assert table(rig)["finger5-3.L"][0] == ""


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a bone mapping"),
        (b"\xff\xfe\x00", "not a JSON text"),
        (b"[" * 100_000, "not a"),
        (b'{"format": "something"}', "its format is 'something'"),
        (b'{"format": "hfx bone mapping", "version": 99}', "newer than 1"),
        (b'{"format": "hfx bone mapping", "version": 1, "bones": 3}', "not a bone mapping"),
        (None, "there is no such file"),
    ],
)
def test_a_bad_file_is_told_and_the_table_stays(
    anna: tuple[Any, Any], tmp_path: Path, content: bytes | None, message: str
) -> None:
    rig, _ = anna
    path = tmp_path / "bad.json"
    if content is not None:
        path.write_bytes(content)
    before = table(rig)
    with pytest.raises(RuntimeError, match=message) as caught:
        bpy.ops.hfx.load_bones(filepath=str(path))
    assert "bad.json" in str(caught.value)
    assert table(rig) == before


def test_a_mapping_of_another_kind_of_rig_is_refused(anna: tuple[Any, Any], tmp_path: Path) -> None:
    rig, _ = anna
    path = tmp_path / "rig.json"
    bone_table.save(rig, path)
    rename(rig, "x")
    before = table(rig)
    with pytest.raises(InputError, match="none of which 'Anna' has"):
        bone_table.load(rig, path)
    assert table(rig) == before


@pytest.mark.parametrize(
    ("operator", "words"),
    [
        ("find_bones", "Select an armature"),
        ("reset_bones", "Select an armature"),
        ("save_bones", "Select an armature"),
        ("load_bones", "Select an armature"),
        ("fit_body", "Select a haptic body"),
        ("show_model", "Select a haptic body"),
    ],
)
def test_an_operator_says_what_it_needs(scene: Any, operator: str, words: str) -> None:
    with pytest.raises(RuntimeError, match=words):
        getattr(bpy.ops.hfx, operator)()
