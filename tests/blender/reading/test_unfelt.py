# SPDX-License-Identifier: GPL-3.0-or-later
"""An export reports the contact times of each effect, or the reason for none; with warnings."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import hfx_scenes
import pytest

from hfx_blender import cli
from hfx_blender.authoring import clips
from hfx_blender.authoring.effects import effects
from hfx_blender.blender import compat
from hfx_blender.engine.counters import Counters
from hfx_blender.export.report import ExportReport, describe, felt_lines, unfelt_lines
from hfx_blender.reading.description.missed_effects import flattened_warning
from hfx_blender.text import MOST_LINES

bpy = pytest.importorskip("bpy")
oracle = pytest.importorskip("oracle")

FPS, LAST = 25, 49
"""Frames 0 to 49: two seconds. The rate is that of the frames."""


@pytest.fixture
def touch(registered: Any) -> Any:
    """A painted effect, and a volume 'Ball' in contact all the time."""
    scene = hfx_scenes.small_scene(LAST)
    scene.hfx.rate = FPS
    return scene.objects["Touch"]


@pytest.fixture
def told(tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Function exporting the open scene: the report, plus ``strict``: exit code of ``--strict``."""

    def export(*words: str) -> dict[str, Any]:
        path, out = hfx_scenes.save(tmp_path / "scene.blend"), tmp_path / "out"
        assert cli.run(["export", str(path), "-o", str(out), *words]) == 0
        report: dict[str, Any] = json.loads((out / "scene.report.json").read_text())
        report["strict"] = cli.run(
            ["export", str(path), "-o", str(tmp_path / "strict"), "--strict", *words]
        )
        return report

    return export


def _line(report: dict[str, Any], effect: str = "Touch") -> dict[str, Any]:
    (actual,) = (item for item in report["effects"] if item["effect"] == effect)
    return actual


def _clip(effect: Any, start_s: float, end_s: float, name: str = "Clip") -> Any:
    return clips.add_clip(effect, start_s * FPS, end_s * FPS, name=name)


# Clips: seconds of the clip, location of the clip, seconds with contact


@pytest.mark.parametrize(
    ("start", "end", "where", "felt"),
    [
        (3.0, 4.0, "lies after the last frame of the scene (2.00 s)", None),
        (2.0, 3.0, "lies after the last frame of the scene (2.00 s)", None),
        (-2.0, -1.0, "lies before the first frame of the scene", None),
        (1.0, 3.0, "goes on after the last frame of the scene (2.00 s)", (1.0, 1.96)),
        (-1.0, 1.0, "goes on before the first frame of the scene", (0.0, 1.0)),
        (1.01, 1.02, "lies between two samples", None),
    ],
)
def test_a_clip_outside_the_scene_is_a_warning(
    touch: Any, told: Any, start: float, end: float, where: str, felt: tuple[float, float] | None
) -> None:
    _clip(touch, start, end, "Beat")
    report = told()
    (warning,) = report["warnings"]
    assert warning.startswith(f"clip 'Beat' of 'Touch' ({start:.2f} to {end:.2f} s) {where}")
    assert report["strict"] == 3
    line = _line(report)
    assert line["felt"] == (felt is not None)
    if felt is not None:
        assert (line["from_s"], line["to_s"]) == pytest.approx(felt)
    else:
        assert line["reason"] == (
            "has no clip that reaches a sample"
            if "between" in where
            else "has no clip within the frames of the scene"
        )
        assert line["expected"] is False, "a warning names its clip"
        assert [item["effect"] for item in report["felt"]] == ["Ball"]
    assert _line(report, "Ball")["felt"]


def test_a_short_clip_beside_a_long_one(touch: Any, told: Any) -> None:
    _clip(touch, 0.0, 0.5, "long")
    _clip(touch, 1.01, 1.02, "short")
    report = told()
    (warning,) = report["warnings"]
    assert "'short'" in warning and "'long'" not in warning
    assert _line(report)["to_s"] == pytest.approx(0.48)


@pytest.mark.parametrize(
    ("first", "start", "end", "times"),
    [
        # Samples are at multiples of 0.04 s.
        (10, 30.05, 30.1, "0.802 to 0.804"),  # frames 20.05 and 20.1 of 25 a second
        (0, 20.0125, 20.5, "0.8005 to 0.8200"),  # after the sample at 0.80 s
        (0, 25.25, 25.5, "1.01 to 1.02"),
    ],
)
def test_a_short_clip_shows_both_times(
    touch: Any, told: Any, first: int, start: float, end: float, times: str
) -> None:
    bpy.context.scene.frame_start = first
    clips.add_clip(touch, start, end, name="Tick")
    (warning,) = told()["warnings"]
    assert warning.startswith(f"clip 'Tick' of 'Touch' ({times} s) lies between two samples")


def test_many_clips_are_one_warning(touch: Any, told: Any) -> None:
    for k in range(20):
        _clip(touch, 10.0 + k, 10.5 + k, f"Late {k}")
    (warning,) = told()["warnings"]
    assert warning.startswith("20 clips lie after") and "and 14 more" in warning


def _key(effect: Any, name: str, *keys: tuple[float, float]) -> None:
    for frame, value in keys:
        setattr(effect.hfx, name, value)
        effect.keyframe_insert(f"hfx.{name}", frame=frame)


@pytest.mark.parametrize(
    ("modality", "name", "nothing", "strong"),
    [
        ("vibration", "amplitude", 0.0, 5.0),
        ("pressure", "pressure", 0.0, 5.0),
        ("wind", "wind_speed", 0.0, 5.0),
        ("wind", "intensity", 0.0, 1.0),
        ("temperature", "temperature", 24.0, 40.0),
    ],
)
def test_strength_outside_of_the_exported_frames_is_expected(
    touch: Any, told: Any, modality: str, name: str, nothing: float, strong: float
) -> None:
    effect = _volume(modality)
    _key(effect, name, (0, nothing), (30, nothing), (31, strong))
    report = told("--frames", "0:12")
    line = _line(report, "Still")
    assert (line["felt"], line["expected"]) == (False, True)
    assert (report["warnings"], report["strict"]) == ([], 0)
    assert line["reason"] == "can be felt only outside of the exported frames"


def _move_in(effect: Any) -> None:
    for frame, x in ((0, 5.0), (30, 5.0), (31, 0.0)):
        effect.location.x = x
        effect.keyframe_insert("location", frame=frame)


def _show_later(effect: Any) -> None:
    _drive(effect, "hide_viewport", "frame<30")


@pytest.mark.parametrize(
    ("modality", "change", "reason"),
    [
        ("temperature", ("temperature", "max(24,frame)"), "has the neutral temperature, 24 °C"),
        ("vibration", ("amplitude", "max(0,frame-30)"), "has amplitude 0"),
        ("wind", ("intensity", "max(0,frame-30)"), "is never on"),
        ("pressure", _move_in, "touches no body"),
        ("pressure", _show_later, "is never on"),
    ],
)
def test_silence_judged_by_samples_names_the_exported_frames(
    touch: Any, told: Any, modality: str, change: Any, reason: str
) -> None:
    effect = _volume(modality)
    if callable(change):
        change(effect)
    else:
        _drive(effect, f"hfx.{change[0]}", change[1])
    report = told("--frames", "0:12")
    line = _line(report, "Still")
    assert (line["reason"], line["expected"]) == (f"{reason} in the exported frames", True)
    assert (report["warnings"], report["strict"]) == ([], 0)
    assert _line(told(), "Still")["felt"]


def test_more_frames_than_the_scene_has_leave_nothing_out(touch: Any, told: Any) -> None:
    _volume("pressure").location.x = 5.0
    report = told("--frames", "0:80")
    assert _line(report, "Still")["reason"] == "touches no body" and report["strict"] == 3


def test_effects_without_a_clip_are_not_felt_in_files_of_clips(touch: Any, told: Any) -> None:
    _clip(touch, 0.2, 1.0)
    _mute(_volume("pressure"))
    report = told("--per-clip", "-f", "track")
    (warning,) = report["warnings"]
    assert warning.endswith("left out with --per-clip: 1 (Ball)") and report["strict"] == 3
    line = _line(report, "Ball")
    assert line["reason"] == "has no clip, and only clips are exported" and not line["expected"]
    assert _line(report, "Still")["reason"] == "is muted" and _line(report)["felt"]
    assert [item["effect"] for item in report["felt"]] == ["Touch"]
    # No device loses or cuts what is not exported: back_pad has vibration motors only.
    bpy.data.objects["Ball"].hfx.modality = "temperature"
    report = told("--per-clip", "--device", "back_pad")
    assert [item["effect"] for item in report["unrendered"]] == ["Touch"]
    assert not [note for note in report["notes"] if "'Ball'" in note]


def test_a_file_of_a_muted_clip_is_said_to_be_silent(touch: Any, told: Any) -> None:
    _clip(touch, 0.2, 0.4, "Muted").mute = True
    _clip(touch, 0.8, 1.2, "Loud")
    report = told("--per-clip", "-f", "track")
    assert report["notes"] == ["clip 'Muted' has no samples, so its files are silent"]


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("amplitude", ((0, 0.0), (30, 0.0))),
        ("amplitude", ((0, 0.0), (LAST + 1, 0.0), (LAST + 2, 5.0))),  # after the last frame
        ("intensity", ((0, 0.0), (30, 0.0))),
        ("activation", ((0, 0.0), (30, 0.0))),
        ("temperature", ((0, 24.0), (30, 24.0))),
    ],
)
def test_an_effect_without_strength_in_the_scene_is_a_warning_for_a_part(
    touch: Any, told: Any, name: str, keys: tuple[tuple[float, float], ...]
) -> None:
    _key(_volume("temperature" if name == "temperature" else "vibration"), name, *keys)
    report = told("--frames", "0:12")
    (warning,) = report["warnings"]
    assert warning.startswith("effect 'Still' ") and report["strict"] == 3
    assert not _line(report, "Still")["expected"]


@pytest.mark.parametrize(
    ("start", "end", "where"),
    [
        (3.0, 4.0, "after the last frame of the scene (2.00 s)"),
        (-2.0, -1.0, "before the first frame of the scene"),
        (1.01, 1.02, "between two samples"),
    ],
)
def test_a_clip_outside_the_scene_is_a_warning_for_a_part(
    touch: Any, told: Any, start: float, end: float, where: str
) -> None:
    _clip(touch, start, end)
    report = told("--frames", "0:12")
    (warning,) = report["warnings"]
    assert f"lies {where}" in warning and report["strict"] == 3


@pytest.mark.parametrize("span", [(1.0, 3.0), (1.0, 1.5), (-1.0, 0.5)])
def test_a_clip_of_the_scene_is_none_for_a_part(
    touch: Any, told: Any, span: tuple[float, float]
) -> None:
    _clip(touch, *span)
    report = told("--frames", "15:22")
    assert (report["warnings"], report["strict"]) == ([], 0)
    assert _line(report)["expected"]


@pytest.mark.parametrize("end", [2.0, 1.5])
def test_a_clip_within_the_scene_is_none(touch: Any, told: Any, end: float) -> None:
    """The last frame lasts until 2 s."""
    _clip(touch, 0.0, end)
    report = told()
    assert report["warnings"] == [] and report["strict"] == 0


def test_some_frames_are_no_loss(touch: Any, told: Any) -> None:
    _clip(touch, 1.0, 1.5)
    report = told("--frames", "0:9")
    assert report["warnings"] == [] and report["strict"] == 0
    expected = {"felt": False, "reason": "is not on at any exported time", "expected": True}
    assert _line(report) == {"effect": "Touch", "modality": "pressure", **expected}


# Marks and fixes of the panel


@pytest.mark.parametrize(
    ("start", "end", "where"),
    [(3.0, 4.5, "after"), (1.0, 2.5, "beyond"), (0.0, 2.0, None), (-1.0, 0.5, "early")],
)
def test_extend_the_scene(
    touch: Any, told: Any, start: float, end: float, where: str | None
) -> None:
    scene = bpy.context.scene
    bpy.context.view_layer.objects.active = touch
    strip = _clip(touch, start, end)
    assert clips.outside_scene(scene, strip) == where
    if where is None or start < 0.0:  # nothing to mend, or no scene begins before frame 0
        assert bool(clips.extend_scene(scene, [touch])) == (where is not None)
        assert (scene.frame_start, scene.frame_end) == (0, LAST)
        return
    assert bpy.ops.hfx.extend_scene() == {"FINISHED"}
    assert scene.frame_start == 0 and scene.frame_end >= end * FPS - 1
    report = told()
    assert report["warnings"] == [] and report["strict"] == 0
    line = _line(report)
    assert (line["from_s"], line["to_s"]) == pytest.approx((start, end), abs=1 / FPS)


def test_a_scene_that_begins_later_is_extended_to_both_sides(touch: Any) -> None:
    scene = bpy.context.scene
    scene.frame_start = 20
    _clip(touch, 0.4, 3.0)
    bpy.context.view_layer.objects.active = bpy.data.objects["Ball"]
    bpy.ops.hfx.extend_scene(which="ALL")
    assert (scene.frame_start, scene.frame_end) == (10, 75)


def test_a_clip_before_frame_0_is_named_and_moves_no_start(touch: Any) -> None:
    scene = bpy.context.scene
    scene.frame_start, last = 1, scene.frame_end
    _clip(touch, -0.8, -0.32).name = "Before"  # frames -20 to -8
    with pytest.raises(RuntimeError, match="Move the clip: 'Before' of 'Touch'"):
        bpy.ops.hfx.extend_scene(which="ALL")
    assert (scene.frame_start, scene.frame_end) == (1, last)
    _clip(touch, 3.0, 4.5).name = "After"  # frames 75 to 112.5
    assert clips.extend_scene(scene, [touch]) == ["'Before' of 'Touch'"]
    assert (scene.frame_start, scene.frame_end) == (1, 113)


def test_a_muted_clip_is_not_marked(touch: Any) -> None:
    strip = _clip(touch, 3.0, 4.0)
    strip.mute = True
    assert clips.outside_scene(bpy.context.scene, strip) is None


# Effects


def _mute(effect: Any) -> None:
    effect.hfx.is_muted = True


def _play_another_alone(effect: Any) -> None:
    bpy.data.objects["Ball"].hfx.is_solo = True


def _play_four_others_alone(effect: Any) -> None:
    for k in range(3):
        _volume("vibration").name = f"S{k}"
        bpy.data.objects[f"S{k}"].hfx.is_solo = True
    _play_another_alone(effect)


def _mute_beside_solo(effect: Any) -> None:
    _mute(effect)
    _play_another_alone(effect)


def _mute_its_clip(effect: Any) -> None:
    _clip(effect, 0.0, 1.0).mute = True


def _play_another_track_alone(effect: Any) -> None:
    _clip(effect, 0.0, 1.0)
    effect.animation_data.nla_tracks.new().is_solo = True


def _turn_the_nla_off(effect: Any) -> None:
    _clip(effect, 0.0, 1.0)
    effect.animation_data.use_nla = False


def _drain(effect: Any) -> None:
    effect.hfx.intensity = 0.0


def _drain_over_time(effect: Any) -> None:
    for frame in (0, 20):
        effect.hfx.pressure = 0.0
        effect.keyframe_insert("hfx.pressure", frame=frame)


def _no_pressure(effect: Any) -> None:
    effect.hfx.pressure = 0.0


def _hide(effect: Any) -> None:
    effect.hide_viewport = True


@pytest.mark.parametrize(
    ("change", "reason", "is_expected"),
    [
        (_mute, "is muted", True),
        (_play_another_alone, "is silent because others are solo: 'Ball'", True),
        (
            _play_four_others_alone,
            "is silent because others are solo: 'Ball', 'S0', 'S1' and 1 more",
            True,
        ),
        (_mute_beside_solo, "is muted", True),
        (_mute_its_clip, "has clips, all of them muted", True),
        (
            _play_another_track_alone,
            "has clips, none of them on the NLA track that is solo",
            True,
        ),
        (_turn_the_nla_off, "has clips, but its NLA is turned off", True),
        (_drain, "has intensity 0", False),
        (_no_pressure, "has pressure 0", False),
        (_drain_over_time, "has pressure 0", False),
        (_hide, "is disabled in viewports or excluded from the view layer", False),
    ],
)
def test_an_effect_that_is_not_felt(
    touch: Any, told: Any, change: Callable[[Any], None], reason: str, is_expected: bool
) -> None:
    change(touch)
    report = told()
    line = _line(report)
    assert (line["felt"], line["reason"], line["expected"]) == (False, reason, is_expected)
    assert len(report["warnings"]) == (0 if is_expected else 1)
    assert all(reason in text and "'Touch'" in text for text in report["warnings"])
    assert report["strict"] == (0 if is_expected else 3)


@pytest.mark.parametrize(("reference", "neutral"), [("AMBIENT", 24.0), ("CONTACT", 33.0)])
def test_a_neutral_temperature(touch: Any, told: Any, reference: str, neutral: float) -> None:
    """24 °C of air and 33 °C of an object are neutral: no warmth, no cooling."""
    effect = effects.add_volume(bpy.context.scene, "temperature", "SPHERE", "Warm")
    effect.location.z, effect.hfx.radius = 1.1, 0.3
    effect.hfx.temperature_reference, effect.hfx.temperature = reference, neutral
    report = told()
    assert [f"{neutral:g} °C" in text for text in report["warnings"]] == [True]
    bpy.data.objects["Warm"].hfx.temperature = neutral + 2.0
    assert told()["warnings"] == []


def test_a_volume_that_touches_nobody(
    touch: Any, told: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    bpy.data.objects["Ball"].location.x = 9.0
    report = told()
    assert _line(report, "Ball")["reason"] == "touches no body"
    assert report["warnings"] == ["effect 'Ball' touches no body: it is not felt"]
    assert report["strict"] == 3
    assert "  Ball (vibration) was not felt: it touches no body" in capsys.readouterr().out
    # Contact is possible at frames outside of the range.
    assert told("--frames", "0:9")["warnings"] == []


def test_felt_in_one_part_only_is_felt(touch: Any, tmp_path: Path) -> None:
    ball = bpy.data.objects["Ball"]
    for frame, x in ((0, 9.0), (30, 9.0), (31, 0.0)):
        ball.location.x = x
        ball.keyframe_insert("location", frame=frame)
    path = hfx_scenes.save(tmp_path / "parts.blend")
    for words in (["--split", "10"], []):
        out = tmp_path / f"out{len(words)}"
        assert cli.run(["export", str(path), "-o", str(out), *words, "--strict"]) == 0
    one, whole = (json.loads((tmp_path / f"out{k}/parts.report.json").read_text()) for k in (2, 0))
    assert one["effects"] == whole["effects"] and _line(one, "Ball")["felt"]


# Facts of the samples


def _volume(modality: str) -> Any:
    """A volume 'Still', inside the body all the time."""
    effect = effects.add_volume(bpy.context.scene, modality, "SPHERE", "Still")
    effect.location.z, effect.hfx.radius = 1.1, 0.3
    return effect


def _drive(effect: Any, name: str, expression: str) -> None:
    driver = effect.driver_add(name).driver
    driver.type, driver.expression = "SCRIPTED", expression


@pytest.mark.parametrize(
    ("modality", "name", "expression", "reason"),
    [
        ("painted", "pressure", "0*frame", "has pressure 0"),
        ("pressure", "pressure", "0*frame", "has pressure 0"),
        ("vibration", "amplitude", "0*frame", "has amplitude 0"),
        ("wind", "wind_speed", "min(frame, 0)", "has wind speed 0"),
        ("temperature", "temperature", "24", "has the neutral temperature, 24 °C"),
    ],
)
def test_driven_to_nothing(
    touch: Any,
    told: Any,
    modality: str,
    name: str,
    expression: str,
    reason: str,
) -> None:
    effect = touch if modality == "painted" else _volume(modality)
    _drive(effect, f"hfx.{name}", expression)
    title, report = effect.name, told()
    line = _line(report, title)
    assert (line["felt"], line["reason"], line["expected"]) == (False, reason, False)
    assert report["warnings"] == [f"effect '{title}' {reason}: it is not felt"]
    assert report["strict"] == 3
    (samples,) = (item for item in report["felt"] if item["effect"] == title)
    assert (samples["seconds"], samples["first_s"], samples["last_s"]) == (0.0, None, None)


def test_a_single_key_of_the_neutral_temperature(touch: Any, told: Any) -> None:
    effect = _volume("temperature")
    effect.hfx.temperature = 24.0
    effect.keyframe_insert("hfx.temperature", frame=1)
    report = told()
    assert _line(report, "Still")["reason"] == "has the neutral temperature, 24 °C"
    assert report["strict"] == 3


def test_a_failing_driver_of_an_amplitude(touch: Any, told: Any) -> None:
    _drive(_volume("vibration"), "hfx.amplitude", "sqrt(-1 - frame)")
    report = told()
    line = _line(report, "Still")
    assert not line["felt"] and report["strict"] == 3
    assert line["reason"] == "has a driver that cannot be evaluated, that of 'hfx.amplitude'"


@pytest.mark.parametrize("path", ["hfx.activation", "hfx.intensity"])
def test_a_driver_that_divides_by_zero_is_the_reason(touch: Any, told: Any, path: str) -> None:
    _drive(touch, path, "1/0")
    report = told()
    line = _line(report)
    assert line["reason"] == f"has a driver that cannot be evaluated, that of '{path}'"
    assert (line["expected"], report["strict"], len(report["warnings"])) == (False, 3, 1)


def test_a_scale_of_zero_is_the_reason(touch: Any, told: Any) -> None:
    bpy.data.objects["Ball"].scale = (0.0, 0.0, 0.0)
    report = told()
    assert _line(report, "Ball")["reason"].startswith("is flattened")
    assert report["strict"] == 3


def test_flattened_volumes_have_one_warning_with_their_number(touch: Any, told: Any) -> None:
    ball = bpy.data.objects["Ball"]
    ball.scale = (1.0, 0.0, 1.0)
    for k in range(14):
        copy = ball.copy()
        copy.name = f"Flat {k:02}"
        bpy.context.scene.collection.objects.link(copy)
    report = told()
    (warning,) = [text for text in report["warnings"] if "is flattened" in text]
    assert warning.startswith("each of 15 effects is flattened, infinite or not a number: it is")
    assert ": Ball, Flat 00, " in warning and warning.endswith("and 3 more")
    for name in ("Ball", "Flat 00", "Flat 13"):
        assert _line(report, name)["reason"].startswith("is flattened")


def test_flattened_volumes_are_counted_together() -> None:
    """3 samples of one volume and 4 of another, in parts of a recording, are 7."""
    engine, parts = Counters(), (Counters(flattened={"It's": 1}), Counters(flattened={"B": 4}))
    engine.flattened["It's"] = 2
    before = engine.copy()
    for part in parts:
        engine.add(part)
    assert engine.since(before).flattened == {"It's": 1, "B": 4}
    words = "is flattened, infinite or not a number: it is not felt (7 times)"
    assert flattened_warning(engine.flattened) == (f"each of 2 effects {words}: It's, B",)
    assert flattened_warning({}) == ()


def test_an_effect_without_an_area_is_named_once(
    touch: Any, told: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    effects.set_area(touch, [], [])
    report = told()
    assert _line(report)["reason"] == "is painted nowhere. Paint it, or delete it"
    assert "Touch was not felt: it is painted nowhere" in capsys.readouterr().out


@pytest.mark.parametrize("words", [(), ("--split", "10")])
def test_felt_until_its_strength_ends(touch: Any, told: Any, words: tuple[str, ...]) -> None:
    """5 kPa up to frame 19, 0 from frame 20 on: 20 samples of 0.04 s."""
    for frame, pressure in ((0, 5.0), (19, 5.0), (20, 0.0)):
        touch.hfx.pressure = pressure
        touch.keyframe_insert("hfx.pressure", frame=frame)
    report = told(*words)
    line = _line(report)
    assert (line["from_s"], line["to_s"]) == pytest.approx((0.0, 19 / FPS))
    (samples,) = (item for item in report["felt"] if item["effect"] == "Touch")
    assert (samples["seconds"], samples["last_s"]) == pytest.approx((20 / FPS, 19 / FPS))
    assert report["warnings"] == [] and report["strict"] == 0


def _fail_intensity(effect: Any) -> None:
    _drive(effect, "hfx.intensity", "1/0")


def _drive_intensity(effect: Any) -> None:
    _drive(effect, "hfx.intensity", "0*frame")


def _drive_hidden(effect: Any) -> None:
    _drive(effect, "hide_viewport", "frame < 500")


def _without_influence(effect: Any) -> None:
    strip = _clip(effect, 0.2, 1.0)
    strip.use_animated_influence = True
    strip.influence = 0.0


def _begin_after_the_last_sample(effect: Any) -> None:
    _clip(effect, 1.99, 3.0)


@pytest.mark.parametrize(
    "change",
    [
        _fail_intensity,
        _drive_intensity,
        _drive_hidden,
        _without_influence,
        _begin_after_the_last_sample,
    ],
)
def test_a_volume_that_is_never_on(touch: Any, told: Any, change: Callable[[Any], None]) -> None:
    change(_volume("pressure"))
    report = told()
    fails = change is _fail_intensity
    reason = "has a driver that cannot be evaluated, that of 'hfx.intensity'"
    assert _line(report, "Still")["reason"] == (reason if fails else "is never on")
    assert report["strict"] == 3


@pytest.mark.parametrize(
    ("level", "reason"),
    [("0.5", "touches no body"), ("0*frame", "is never on"), ("frame>30", "touches no body")],
)
def test_a_stepped_volume_far_from_all_skin(touch: Any, told: Any, level: str, reason: str) -> None:
    """Only location and activation are read; twice, as parts are merged."""
    effect = _volume("pressure")
    effect.hfx.shape, effect.location.x = "CUBOID", 5.0
    _drive(effect, "hfx.intensity", level)
    for words in ([], ["--split", "10"]):
        report = told(*words)
        assert _line(report, "Still")["reason"] == reason and report["strict"] == 3
        assert report["reading"]["far"] == {"Still": LAST + 1}


def test_a_place_that_is_no_number(touch: Any, told: Any) -> None:
    effect = _volume("pressure")
    effect.keyframe_insert("location", index=0, frame=1)
    (curve,) = compat.fcurves(effect)
    curve.keyframe_points[0].co.y = float("nan")
    reason = "has a place that is no number wherever it would be on"
    assert _line(told(), "Still")["reason"] == reason
    effect = bpy.data.objects["Still"]
    effect.driver_add("scale", 1).driver.expression = "1"  # Blender has to evaluate the driver
    assert _line(told(), "Still")["reason"] == reason


def test_an_intensity_that_is_no_number(touch: Any, told: Any) -> None:
    effect = _volume("pressure")
    effect.keyframe_insert("hfx.intensity", frame=1)
    (curve,) = compat.fcurves(effect)
    curve.keyframe_points[0].co.y = float("nan")
    report = told()
    assert "touch" not in _line(report, "Still")["reason"] and report["strict"] == 3


def test_a_contact_response_that_gives_nothing(touch: Any, told: Any) -> None:
    """No impact: ball and body stand still. Elsewhere, no body is in reach."""
    effect = _volume("vibration")
    bpy.context.view_layer.objects.active = effect
    bpy.ops.hfx.add_response_filter(kind="impact")
    report = told()
    reason = "touches a body, but its contact response gives nothing"
    assert _line(report, "Still")["reason"] == reason and report["strict"] == 3
    bpy.data.objects["Still"].location.x = 5.0
    assert _line(told(), "Still")["reason"] == "touches no body"


# Bodies


def test_a_body_shown_as_an_instance_beside_an_own_one(touch: Any, told: Any) -> None:
    scene = bpy.context.scene
    collection = bpy.data.collections.new("Crowd")
    twin = bpy.data.objects["Avatar"].copy()
    twin.name = "Twin"
    collection.objects.link(twin)
    instancer = bpy.data.objects.new("Instance", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    scene.collection.objects.link(instancer)
    report = told()
    (warning,) = report["warnings"]
    assert "body 'Twin'" in warning and "by 'Instance'" in warning and report["strict"] == 3
    bpy.data.objects["Instance"].hide_viewport = True
    assert told()["warnings"] == []


# Many


def _report(count: int, is_felt: bool) -> ExportReport:
    names = [f"E{k}" for k in range(count)]
    samples = {"modality": "wind", "body": "A", "seconds": 1.0, "first_s": 0.0, "last_s": 0.9}
    return ExportReport(
        scene="Scene",
        folder=Path(),
        files=(),
        felt=tuple({"effect": name, **samples, "mean_vertices": 3.0} for name in names),
        unrendered=(),
        warnings=(),
        effects=tuple(
            {"effect": name, "modality": "wind", "felt": is_felt, "reason": "is muted"}
            for name in names
        ),
    )


def test_two_thousand_effects_stay_readable() -> None:
    lines = felt_lines(_report(2000, True))
    assert len(lines) == MOST_LINES + 1 and lines[-1] == f"... and {2000 - MOST_LINES} more"
    (line,) = unfelt_lines(_report(2000, False))
    assert line.startswith("2000 effects were not felt: each is muted: E0 (wind)")
    assert line.endswith("E11 (wind) and 1988 more") and felt_lines(_report(2000, False)) == ()


@pytest.mark.parametrize("reason", ["disabled", "of intensity 0", "touching no body", "off"])
def test_many_effects_of_a_reason_are_one_warning_of_twelve_names(
    touch: Any, told: Any, reason: str
) -> None:
    for _ in range(20):
        still = oracle.add_volume("Still", "pressure", "SPHERE", (0.0, 0.0, 50.0))
        still.hide_viewport = reason == "disabled"
        still.hfx.intensity = float(reason != "of intensity 0")
        if reason == "off":
            still.hfx.activation = 0.0
            oracle.key(still, "hfx.activation", [(1, 0.0), (500, 0.0)])
    report = told()
    (warning,) = report["warnings"]
    assert "20" in warning and warning.count("Still") == 12 and "and 8 more" in warning
    assert sum(line["effect"].startswith("Still") for line in report["effects"]) == 20


@pytest.mark.parametrize("count", [12, 300])
def test_the_last_lines_are_those_of_effects(tmp_path: Path, count: int) -> None:
    files = [tmp_path / f"scene.{k}.he" for k in range(count - 1)]
    files.append(tmp_path / "scene.report.json")
    for path in files:
        path.write_bytes(bytes(1000))
    report = replace(
        _report(40, False), files=tuple(files), folder=tmp_path, notes=("n",), warnings=("w",)
    )
    first, *lines = describe(report).splitlines()
    *written, warning, note, unfelt = lines
    assert (first, note, warning) == ("Scene 'Scene'", "  note: n", "  warning: w")
    assert all(f"E{k} (wind)" in unfelt for k in range(12)) and unfelt.endswith("and 28 more")
    if count == 12:
        assert [line.split()[1] for line in written] == [str(path) for path in files]
    else:
        listed = f"listed in {tmp_path / 'scene.report.json'}"
        assert written == [f"  wrote 300 files (300.0 kB) to {tmp_path}, {listed}"]


def test_info_of_a_track_counts_what_has_a_strength(
    touch: Any, told: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pressure is 0 in the first of two seconds."""
    for frame, pressure in ((0, 0.0), (24, 0.0), (25, 5.0)):
        touch.hfx.pressure = pressure
        touch.keyframe_insert("hfx.pressure", frame=frame)
    for curve in compat.fcurves(touch):
        for key in curve.keyframe_points:
            key.interpolation = "CONSTANT"
    told()
    capsys.readouterr()
    assert cli.run(["info", str(tmp_path / "out" / "scene.hfxtrack"), "--json"]) == 0
    (samples,) = (
        item for item in json.loads(capsys.readouterr().out)["felt"] if item["effect"] == "Touch"
    )
    assert (samples["seconds"], samples["first_s"]) == pytest.approx((1.0, 1.0))


class _Layout:
    """Layout recording drawn items in order."""

    def __init__(self) -> None:
        self.drawn: list[str] = []

    def label(self, text: str, icon: str, translate: bool = True) -> None:
        self.drawn.append(f"{icon} {text}")

    def operator(self, name: str, **_options: str) -> Any:
        self.drawn.append(name)
        return type("Settings", (), {})()

    def separator(self) -> None:
        pass

    def split(self, factor: float) -> _Layout:
        assert 0.0 < factor < 1.0
        return self


def test_the_popup_counts_the_clips_of_an_effect(touch: Any, tmp_path: Path) -> None:
    from hfx_blender.operators import export_operator

    _clip(bpy.data.objects["Ball"], 0.0, 4.0, "One")
    _clip(bpy.data.objects["Ball"], 8.0, 10.0, "Two")
    bpy.ops.hfx.export(filepath=str(tmp_path / "scene.hfxtrack"), formats={"track"})
    layout = _Layout()
    export_operator.draw_written(type("Menu", (), {"layout": layout})(), bpy.context)
    (line,) = [text for text in layout.drawn if text.startswith("CHECKMARK Ball")]
    assert line.endswith(", in 2 clips")


def test_the_popup_lists_warnings_first(touch: Any, tmp_path: Path) -> None:
    from hfx_blender.operators import export_operator

    _clip(touch, 3.0, 4.0, "Beat")
    bpy.ops.hfx.export(filepath=str(tmp_path / "scene.hfxtrack"), formats={"track"})
    layout = _Layout()
    export_operator.draw_written(type("Menu", (), {"layout": layout})(), bpy.context)
    lines = [line for line in layout.drawn if not line.startswith("BLANK1")]
    assert [line[:30] for line in lines] == [
        "EXPORT Haptic Export",
        "ERROR Clip 'Beat' of 'Touch' (",
        "hfx.extend_scene",
        "X Touch: not felt, as it has n",
        "CHECKMARK Ball: felt from 0.00",
        "FILE_TICK Wrote scene.hfxtrack",
        "wm.path_open",
        "hfx.show_report",
    ]
    (written,) = export_operator.last_written
    assert written.warned == ", 1 warning"
    bpy.ops.hfx.show_report()
    text = bpy.data.texts["Haptic Export Report"].as_string()
    assert "Touch (pressure) was not felt: it has no clip within the frames" in text


def test_the_message_of_an_export_belongs_to_its_file(touch: Any, tmp_path: Path) -> None:
    from hfx_blender.operators import export_operator

    bpy.ops.hfx.export(filepath=str(tmp_path / "scene.hfxtrack"), formats={"track"})
    assert len(export_operator.last_written) == 1
    bpy.ops.wm.read_homefile(use_empty=True)
    assert not export_operator.last_written
    with pytest.raises(RuntimeError, match="Export first"):
        bpy.ops.hfx.show_report()
