# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Export > Haptics: the same formats and options as the command line."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hfx_scenes
import pytest
from hfx_scenes import names_in

from hfx_blender.authoring import painting
from hfx_blender.authoring.effects import effects
from hfx_blender.engine.track import TrackReader
from hfx_blender.formats.registry import EXPORTED

bpy = pytest.importorskip("bpy")


@pytest.fixture
def small(registered: Any) -> Any:
    return hfx_scenes.small_scene(3)


def test_every_format_can_be_chosen(registered: Any) -> None:
    from hfx_blender.operators.export_operator import FORMAT_ITEMS

    assert {name for name, *_ in FORMAT_ITEMS} == set(EXPORTED)
    assert len({item[-1] for item in FORMAT_ITEMS}) == len(EXPORTED)


def test_chosen_formats_and_options_are_written(small: Any, tmp_path: Path) -> None:
    small.hfx.devices.add().name = "back_pad"
    bpy.ops.hfx.export(
        filepath=str(tmp_path / "x.hfxtrack"),
        formats={"npz", "track", "jsonl"},
        record={"depth"},
        full_precision=True,
    )
    assert names_in(tmp_path) == [
        "x.back_pad.raster.npz",
        "x.hfxtrack",
        "x.report.json",
        "x.samples.jsonl",
    ]
    with TrackReader(tmp_path / "x.hfxtrack") as track:
        assert track.full_precision and track.summary()[0].channels == ("depth_m",)


def test_undo_after_an_export_keeps_the_track_of_live_devices(small: Any, tmp_path: Path) -> None:
    from hfx_blender.playback.live.live import live

    earlier, path = str(tmp_path / "a.hfxtrack"), str(tmp_path / "b.hfxtrack")
    bpy.context.preferences.edit.use_global_undo = True
    bpy.ops.hfx.export(filepath=earlier)
    bpy.ops.ed.undo_push(message="Before")
    small.frame_end = 7
    bpy.ops.ed.undo_push(message="Edit")
    bpy.ops.hfx.export(filepath=path)
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert (scene.frame_end, scene.hfx.live_track) == (3, path), "only the edit is undone"
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    assert (scene.frame_end, scene.hfx.live_track) == (7, path)
    assert str(live.tracks._path(scene)) == path
    scene.hfx.live_track = earlier  # chosen
    bpy.ops.ed.undo()
    assert bpy.context.scene.hfx.live_track == earlier


def test_what_no_device_is_there_for_is_said(small: Any, tmp_path: Path) -> None:
    path = str(tmp_path / "x.hfxtrack")
    with pytest.raises(RuntimeError, match="no devices to export: add"):
        bpy.ops.hfx.export(filepath=path, formats={"track", "ahap"})
    with pytest.raises(RuntimeError, match="at least one format"):
        bpy.ops.hfx.export(filepath=path, formats=set())
    assert names_in(tmp_path) == []
    bpy.ops.hfx.export(filepath=path)
    assert names_in(tmp_path) == ["x.hfxtrack", "x.report.json"]


def test_effects_without_an_area_are_refused_before_the_click(small: Any, tmp_path: Path) -> None:
    """Painting, an area, or an effect of another kind suffices."""
    touch = small.objects["Touch"]
    bpy.data.batch_remove([other for other in effects.effects_of(small) if other != touch])
    assert bpy.ops.hfx.export.poll()
    painting.set_weights(touch, 0.0 * painting.weights_of(touch))
    assert not bpy.ops.hfx.export.poll()
    with pytest.raises(RuntimeError, match="Paint the effect first"):
        bpy.ops.hfx.export(filepath=str(tmp_path / "x.hfxtrack"))
    bpy.context.view_layer.objects.active = touch
    bpy.ops.hfx.paint_begin()
    assert bpy.ops.hfx.export.poll()
    bpy.ops.hfx.paint_end()
    assert not bpy.ops.hfx.export.poll()
    effects.add_volume(small, "wind", "SPHERE")
    assert bpy.ops.hfx.export.poll()


def test_the_folder_is_named_in_full(
    small: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.operators import export_operator

    monkeypatch.chdir(tmp_path)
    bpy.ops.hfx.export(filepath="x.hfxtrack")
    (written,) = export_operator.last_written
    assert written.report.folder == tmp_path


def test_each_clip_by_itself(small: Any, tmp_path: Path) -> None:
    bpy.context.view_layer.objects.active = bpy.data.objects["Touch"]
    bpy.ops.hfx.add_clip(start=1.0, duration=0.04)
    bpy.ops.hfx.export(filepath=str(tmp_path / "x.hfxtrack"), per_clip=True)
    assert names_in(tmp_path) == ["x.Clip.hfxtrack", "x.report.json"]


def test_an_export_that_is_given_up_leaves_nothing_behind(small: Any, tmp_path: Path) -> None:
    """Esc leaves no file and no scratch scene, and restores the current frame."""
    from hfx_blender.export.scene_export import ExportSettings, SceneExport

    body = next(obj for obj in small.objects if obj.hfx.role == "BODY")
    body.pose.bones["head"].constraints.new("LIMIT_ROTATION")  # has to be stepped
    small.frame_end = 60
    small.frame_set(2)
    steps = SceneExport(small, ExportSettings(("track",))).steps(tmp_path / "new", "x")
    share = next(steps)
    assert 0.0 < share < 1.0 and len(bpy.data.scenes) == 2 and len(names_in(tmp_path)) == 1
    steps.close()
    assert names_in(tmp_path) == []
    assert list(bpy.data.scenes) == [small] and small.frame_current == 2


def test_steps_give_what_an_export_at_once_gives(small: Any, tmp_path: Path) -> None:
    from hfx_blender.export.scene_export import ExportSettings, SceneExport, export_scene

    small.frame_end = 40
    at_once = export_scene(small, tmp_path / "a", "x", ExportSettings(("track",)))
    steps = SceneExport(small, ExportSettings(("track",))).steps(tmp_path / "b", "x")
    shares = []
    while True:
        try:
            shares.append(next(steps))
        except StopIteration as end:
            report = end.value
            break
    assert len(shares) > 2 and shares == sorted(shares) and shares[-1] == 1.0
    assert report.as_dict()["files"] == at_once.as_dict()["files"]


def test_every_format_has_a_check_box(registered: Any) -> None:
    from hfx_blender.operators.export_operator import FORMAT_ITEMS, HFX_OT_export

    boxes = {f"formats_{name.replace('-', '_')}" for name, *_ in FORMAT_ITEMS}
    assert boxes | {"record_depth"} <= set(HFX_OT_export.__annotations__)


def test_what_is_greyed_out_has_a_reason() -> None:
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.formats.writing import why_nothing

    vest, insoles, fan = map(load_device, ("pressure_vest", "insoles", "fan_heater"))
    assert why_nothing("hjif", []) == why_nothing("csv", [vest]) == ""
    assert why_nothing("csv", []) == "Formats of devices need a device"
    assert why_nothing("wav", [vest, fan]) == "No device has vibration actuators"
    assert why_nothing("wav", [vest, insoles]) == ""


@pytest.mark.parametrize(
    ("purpose", "formats", "files"),
    [
        ("GAME", {"clip"}, ["x.hfxclip"]),
        ("PHONE", {"ahap", "he"}, ["x.phone_wide_band.phone.ahap", "x.phone_wide_band.phone.he"]),
        ("BHAPTICS", {"tact"}, ["x.bhaptics_tactsuit_x40.tact"]),
        ("HARDWARE", {"track", "csv"}, ["x.arduino_uno_pwm.csv", "x.hfxtrack"]),
        ("SOUND", {"wav"}, ["x.sound_card_8.wav", "x.sound_card_8.wav.channels.json"]),
    ],
)
def test_a_purpose_selects_formats_that_the_proposed_device_plays(
    small: Any, tmp_path: Path, purpose: str, formats: set[str], files: list[str]
) -> None:
    from hfx_blender.operators import export_operator

    chosen = type("Operator", (), {"formats": {"npz"}})()
    names = list(export_operator._PURPOSES)
    assert export_operator._purpose(chosen) == len(names), "Other"
    export_operator._choose_purpose(chosen, names.index(purpose))
    assert chosen.formats == formats
    assert export_operator._purpose(chosen) == names.index(purpose)
    export_operator._choose_purpose(chosen, len(names))
    assert chosen.formats == formats, "Other keeps the formats"
    small.hfx.devices.add().name = export_operator._PURPOSES[purpose][3]
    bpy.ops.hfx.export(filepath=str(tmp_path / "x.hfxtrack"), formats=formats)
    assert names_in(tmp_path) == sorted([*files, "x.report.json"])


def test_devices_that_are_not_ticked_write_nothing(small: Any, tmp_path: Path) -> None:
    for name in ("back_pad", "insoles"):
        small.hfx.devices.add().name = name
    small.hfx.devices["insoles"].is_exported = False
    small.hfx.devices["back_pad"].scheme = "nearest"
    bpy.ops.hfx.export(filepath=str(tmp_path / "x.hfxtrack"), formats={"csv"})
    assert names_in(tmp_path) == ["x.back_pad.csv", "x.report.json"]


def test_the_schemes_of_a_scene_are_those_of_devices() -> None:
    from typing import get_args

    from hfx_blender.engine.rendering.device_config import SchemeName
    from hfx_blender.properties.scenes import SCHEMES

    assert [name for name, *_ in SCHEMES[1:]] == list(get_args(SchemeName))


def test_a_scene_that_cannot_be_exported_is_refused_before_the_dialog(
    small: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bpy_extras.io_utils import ExportHelper

    from hfx_blender.operators.export_operator import HFX_OT_export

    monkeypatch.setattr(ExportHelper, "invoke", lambda *_: {"RUNNING_MODAL"})
    reports: list[str] = []
    # Background mode has no dialogs: the operator's method is called by itself.
    operator = SimpleNamespace(
        properties=SimpleNamespace(is_property_set=lambda _name: True),
        report=lambda _kinds, text: reports.append(text),
    )
    assert HFX_OT_export.invoke(operator, bpy.context, None) == {"RUNNING_MODAL"}
    for body in [obj for obj in bpy.data.objects if obj.hfx.role == "BODY"]:
        bpy.data.objects.remove(body)
    assert HFX_OT_export.invoke(operator, bpy.context, None) == {"CANCELLED"}
    assert "has no haptic body" in reports[0]


@pytest.mark.parametrize(
    ("devices", "formats"),
    [
        ([], {"track"}),
        (["back_pad"], {"track", "csv"}),  # .tact could hold its layout
        (["back_pad", "bhaptics_tactosy"], {"tact"}),
        (["insoles", "phone_lra"], {"ahap", "he"}),
        (["sound_card_8"], {"wav"}),
    ],
)
def test_the_first_formats_of_the_dialog_are_those_of_the_maker_of_a_device(
    small: Any, monkeypatch: pytest.MonkeyPatch, devices: list[str], formats: set[str]
) -> None:
    from bpy_extras.io_utils import ExportHelper

    from hfx_blender.operators.export_operator import HFX_OT_export

    for name in devices:
        small.hfx.devices.add().name = name
    monkeypatch.setattr(ExportHelper, "invoke", lambda *_: {"RUNNING_MODAL"})
    operator = SimpleNamespace(properties=SimpleNamespace(is_property_set=lambda _name: False))
    assert HFX_OT_export.invoke(operator, bpy.context, None) == {"RUNNING_MODAL"}
    assert operator.formats == formats


@pytest.mark.parametrize(
    ("formats", "name"),
    [
        ({"wav"}, "storm.wav"),
        ({"clip"}, "storm.hfxclip"),
        ({"track", "csv"}, "storm.hfxtrack"),
        ({"npz"}, "storm.npz"),  # not .raster.npz: a second check would repeat .raster
    ],
)
def test_the_file_name_ends_like_the_first_chosen_format(
    registered: Any, formats: set[str], name: str
) -> None:
    from bpy_extras.io_utils import ExportHelper

    from hfx_blender.operators.export_operator import HFX_OT_export

    end = HFX_OT_export.filename_ext.fget(SimpleNamespace(formats=formats))
    dialog = SimpleNamespace(check_extension=True, filename_ext=end, filepath="storm.hfxtrack")
    for _ in range(2):
        ExportHelper.check(dialog, bpy.context)
        assert dialog.filepath == name
