# SPDX-License-Identifier: GPL-3.0-or-later
"""Points on the skin: operators, paths, motion, files, export, viewport drawing."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Vector

from hfx_blender.authoring.effects import effect_exchange, effect_file
from hfx_blender.authoring.paths import path_file, paths, skin_picking
from hfx_blender.devices.configuration import load_device
from hfx_blender.engine.rendering.moment import MomentRenderer
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.export.scene_export import ExportSettings, export_scene
from hfx_blender.operators.paths import path_overlay
from hfx_blender.reading.live_scene import LiveScene

BACK = (0.09, 0.076, 1.35)


@pytest.fixture
def body(scene: Any) -> Any:
    scene.render.fps = 25
    scene.frame_start, scene.frame_end = 0, 24
    scene.frame_set(0)
    bpy.ops.hfx.add_avatar()
    return bpy.context.object


@pytest.fixture
def spot(body: Any) -> Any:
    bpy.ops.hfx.add_spot(modality="vibration", name="Point")
    return bpy.context.object


def _stroke(*places: Any, times: Any = None) -> list[dict[str, Any]]:
    times = times or [0.0] * len(places)
    return [
        {"name": "", "place": tuple(p), "time": float(t)}
        for p, t in zip(places, times, strict=True)
    ]


def _runs() -> list[Any]:
    return LiveScene(bpy.context.scene, bpy.context.view_layer, STANDARD).runs()


def test_a_new_point_is_felt_at_once_where_it_was_put(spot: Any) -> None:
    (run,) = _runs()
    assert run.focus[0, :3] == pytest.approx((0.0, 0.047, 1.25), abs=0.005)
    assert run.focus[0, 3] == pytest.approx(0.015)  # half of 3 cm: the falloff is smooth
    assert 2 < len(run.vertices) < 40 and run.weights.max() > 0.5


def test_a_point_needs_a_body_and_a_place_on_it(scene: Any) -> None:
    assert not bpy.ops.hfx.add_spot.poll() and not bpy.ops.hfx.draw_path.poll()
    bpy.ops.hfx.add_avatar()
    before = len(bpy.data.objects)
    with pytest.raises(RuntimeError, match=r"0\.\d+ m from the skin"):
        bpy.ops.hfx.add_spot(place=(0.0, 1.0, 1.0))
    assert len(bpy.data.objects) == before
    assert not bpy.ops.hfx.draw_path.poll() and not bpy.ops.hfx.mirror_path.poll()


def test_wind_has_no_point(body: Any) -> None:
    with pytest.raises(InputError, match="Wind"):
        paths.add_spot(bpy.context.scene, "wind", body)


def test_a_straight_path_is_the_shortest_way(spot: Any) -> None:
    bpy.ops.hfx.draw_path(mode="STRAIGHT", stroke=_stroke((-0.09, 0.076, 1.35), BACK))
    path = paths.path_of(spot)
    straight = np.linalg.norm(path[-1] - path[0])
    assert straight == pytest.approx(0.18, abs=0.005)
    assert straight < paths.length_m(spot) < 1.15 * straight  # over the hollow of the spine
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.01
    assert np.abs(path[:, 2] - 1.35).max() < 0.02


def test_a_curve_is_smooth_and_goes_through_its_places(spot: Any) -> None:
    places = [(-0.09, 0.076, 1.3), (0.0, 0.05, 1.38), (0.09, 0.076, 1.3), (0.0, 0.05, 1.2)]
    bpy.ops.hfx.draw_path(mode="CURVE", closed=True, stroke=_stroke(*places))
    path = paths.path_of(spot)
    for knot in paths.knots_of(spot):
        assert np.linalg.norm(path - knot, axis=1).min() < 0.003
    assert np.linalg.norm(path[0] - path[-1]) < 1e-6
    steps = np.diff(path, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((steps[1:] * steps[:-1]).sum(axis=1), -1.0, 1.0)))
    assert np.percentile(turns, 95) < 25.0
    bpy.ops.hfx.draw_path(mode="STRAIGHT", closed=True, stroke=_stroke(*places))
    assert paths.length_m(spot) < np.linalg.norm(np.diff(path, axis=0), axis=1).sum()


def test_recording_keeps_place_and_speed(spot: Any) -> None:
    """Slow over the first half of the way, fast over the rest, then a rest."""
    x = [-0.08, -0.04, 0.0, 0.08, 0.08]
    times = [0.0, 0.4, 0.8, 1.2, 1.6]
    bpy.context.scene.frame_set(5)
    bpy.ops.hfx.draw_path(
        mode="RECORD", stroke=_stroke(*[(item, 0.06, 1.25) for item in x], times=times)
    )
    curve = paths.motion_of(spot)
    assert [key.co[0] for key in curve.keyframe_points] == pytest.approx([5, 15, 25, 35, 45])
    shares = [key.co[1] for key in curve.keyframe_points]
    assert shares == pytest.approx([0.0, 0.25, 0.5, 1.0, 1.0], abs=0.03)
    for frame, position in zip((5, 15, 25, 35, 45), x, strict=True):
        bpy.context.scene.frame_set(frame)
        (run,) = _runs()
        assert run.focus[0, 0] == pytest.approx(position, abs=0.004)


def test_a_point_is_placed_by_one_click_and_taken_back_by_one_undo(spot: Any) -> None:
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.hfx.draw_path(mode="STRAIGHT", stroke=_stroke((-0.05, 0.06, 1.3), BACK))
    bpy.ops.hfx.draw_path(mode="PLACE", stroke=_stroke(BACK))
    assert len(paths.path_of(spot)) == 1 and paths.length_m(spot) == 0.0
    assert spot.location[:] == pytest.approx(BACK, abs=0.01)
    with pytest.raises(RuntimeError, match="no place was given"):
        bpy.ops.hfx.draw_path(mode="STRAIGHT")


def test_a_path_is_reversed_and_mirrored(spot: Any) -> None:
    bpy.ops.hfx.draw_path(stroke=_stroke((0.02, 0.05, 1.3), BACK))
    before = paths.path_of(spot)
    bpy.ops.hfx.reverse_path()
    assert paths.path_of(spot) == pytest.approx(before[::-1])
    bpy.ops.hfx.move_along_path(seconds=1.0)
    bpy.ops.hfx.mirror_path(copy=True)
    second = bpy.context.object
    assert second != spot and second.hfx.uid != spot.hfx.uid
    assert paths.path_of(second) == pytest.approx(before[::-1] * [-1, 1, 1])
    assert paths.path_of(spot) == pytest.approx(before[::-1])
    assert paths.motion_of(second) is not None
    one, two = _runs()
    assert one.focus[0, 0] == pytest.approx(-two.focus[0, 0], abs=1e-6)
    assert len(one.vertices) == len(two.vertices)


def test_motion_goes_to_and_fro(spot: Any) -> None:
    bpy.ops.hfx.path_from_library(name="across_back")
    bpy.ops.hfx.move_along_path(seconds=0.4, repeats=2, to_and_fro=True, interpolation="BEZIER")
    curve = paths.motion_of(spot)
    assert [key.co[:] for key in curve.keyframe_points] == [(0, 0), (10, 1), (20, 0)]
    bpy.ops.hfx.move_along_path(seconds=0.4, repeats=2)
    frames = [key.co[0] for key in curve.keyframe_points]
    values = [key.co[1] for key in curve.keyframe_points]
    assert values == [0, 1, 0, 1] and 9 < frames[1] < frames[2] == 10


def test_every_path_of_the_library_lies_on_the_skin() -> None:
    assert len(path_file.library()) >= 8
    for name in path_file.library():
        recipe = path_file.load_library(name)
        places = np.array(recipe.points_m)
        assert paths.skin().on_skin(places) == pytest.approx(places, abs=0.002)
        assert recipe.description and recipe.name


def test_a_path_is_saved_and_loaded_with_its_motion(spot: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.draw_path(mode="CURVE", stroke=_stroke((-0.05, 0.06, 1.3), (0, 0.05, 1.2), BACK))
    bpy.context.scene.frame_set(10)
    bpy.ops.hfx.move_along_path(seconds=2.0)
    before = paths.path_of(spot)
    file = tmp_path / "mine.hfxpath"
    bpy.ops.hfx.save_path(filepath=str(file))
    assert path_file.load(file).motion == ((0.0, 0.0), (2.0, 1.0))
    bpy.ops.hfx.draw_path(mode="PLACE", stroke=_stroke(BACK))
    bpy.context.scene.frame_set(100)
    bpy.ops.hfx.load_path(filepath=str(file))
    assert paths.path_of(spot) == pytest.approx(before, abs=1e-4)
    keys = [key.co[:] for key in paths.motion_of(spot).keyframe_points]
    assert keys == [(100, 0), (150, 1)]


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda d: d.update(schema="x"), "schema"),
        (lambda d: d.update(version=2), "version"),
        (lambda d: d.update(kind="wild"), "kind"),
        (lambda d: d["points_m"].clear(), "points_m"),
        (lambda d: d["points_m"][0].append(1.0), "points_m"),
        (lambda d: d.update(points_m=[[0, 0, 1e9]]), "points_m"),
        (lambda d: d.update(motion=[[1.0, 0.0], [0.5, 1.0]]), "motion"),
        (lambda d: d.update(motion=[[0.0, 1.5]]), "motion"),
        (lambda d: d.update(code="import os"), "code"),
    ],
)
def test_faults_of_a_path_file_name_their_place(tmp_path: Path, change: Any, place: str) -> None:
    content = json.loads(path_file.library()["across_back"].read_text())
    change(content)
    file = tmp_path / "bad.hfxpath"
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match=place):
        path_file.load(file)


def test_points_are_saved_with_effects(spot: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.path_from_library(name="along_spine")
    spot.hfx.radius, spot.hfx.falloff = 0.05, "linear"
    bpy.context.scene.frame_set(10)
    bpy.ops.hfx.move_along_path(seconds=1.0)
    file = tmp_path / "s.hfxeffect"
    bpy.ops.hfx.save_effects(filepath=str(file))
    sensation = effect_file.load(file)
    effect_file.save(sensation, tmp_path / "again.hfxeffect")
    assert effect_file.load(tmp_path / "again.hfxeffect") == sensation
    (created,) = effect_exchange.place_sensation(
        bpy.context.scene, sensation, body=spot.hfx.body, frame=50.0
    )
    assert created.hfx.kind == "SPOT" and created.hfx.radius == pytest.approx(0.05)
    assert (created.hfx.falloff, created.hfx.falloff_share) == ("linear", 1.0)
    # A new path across a flat back: a route slightly to the side is equally short.
    assert paths.path_of(created) == pytest.approx(paths.path_of(spot), abs=2e-3)
    assert paths.length_m(created) == pytest.approx(paths.length_m(spot), rel=1e-3)
    assert [k.co[:] for k in paths.motion_of(created).keyframe_points] == [(50, 0), (75, 1)]


def test_the_export_is_continuous_and_the_preview_shows_the_same(spot: Any, tmp_path: Path) -> None:
    """A second across the back at 100 Hz: 2.7 mm a sample; the pad's steepest slope is known."""
    bpy.ops.hfx.path_from_library(name="across_back")
    bpy.ops.hfx.move_along_path(seconds=1.0)
    spot.hfx.amplitude, spot.hfx.frequency = 5.0, 200.0
    device = load_device("mango_pad")
    export_scene(
        bpy.context.scene, tmp_path, "a", ExportSettings(devices=(device,), full_precision=True)
    )
    with TrackReader(tmp_path / "a.hfxtrack") as track:
        runs = list(track.runs())
    focus = np.concatenate([run.focus for run in runs])
    assert len(focus) == 100
    # Even speed along the path: equal steps, without a jump between neighbouring samples.
    steps = np.linalg.norm(np.diff(focus[:, :3], axis=0), axis=1)
    assert steps == pytest.approx(paths.length_m(spot) / 100, rel=0.05)
    live = LiveScene(bpy.context.scene, bpy.context.view_layer, STANDARD)
    moment = MomentRenderer(live.description, device)
    played = []
    for frame in range(25):
        bpy.context.scene.frame_set(frame)
        now = live.runs()
        assert now[0].focus[0] == pytest.approx(focus[4 * frame], abs=1e-4)
        played.append(moment.values(now)[::2])
    steepest = 5.0 / np.log(2.0) * 4 * 0.0028 / 0.055
    assert np.abs(np.diff(played, axis=0)).max() <= 1.01 * steepest


def test_a_driven_or_eased_point_is_read_by_stepping_too(spot: Any, tmp_path: Path) -> None:
    bpy.ops.hfx.path_from_library(name="along_spine")
    bpy.ops.hfx.move_along_path(seconds=1.0, interpolation="BOUNCE")
    driver = spot.driver_add("hfx.radius").driver
    driver.expression = "0.02 + 0.001 * frame"
    report = export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())
    assert "drivers" in report.engine["stepping"]
    with TrackReader(tmp_path / "a.hfxtrack") as track:
        focus = np.concatenate([run.focus for run in track.runs()])
    assert focus[0, 3] == pytest.approx(0.01) and focus[96, 3] == pytest.approx(0.022, abs=1e-4)
    assert focus[:, 2].max() - focus[:, 2].min() > 0.4


def test_a_point_that_is_nowhere_is_told(spot: Any, tmp_path: Path) -> None:
    del spot[paths.PATH]
    with pytest.raises(InputError, match="'Point' is nowhere on the skin"):
        export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())
    spot[paths.PATH] = [0.0, 1.0]
    with pytest.raises(InputError, match="not a list of places"):
        export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())
    spot[paths.PATH] = "code"
    with pytest.raises(InputError, match="not a list of places"):
        export_scene(bpy.context.scene, tmp_path, "a", ExportSettings())


def test_what_is_drawn_lies_on_the_posed_body(spot: Any) -> None:
    body = spot.hfx.body
    bpy.ops.hfx.path_from_library(name="up_left_arm")
    bpy.ops.hfx.move_along_path(seconds=1.0)
    bpy.context.scene.frame_set(25)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    at_rest, ring = path_overlay.lines_of(spot, depsgraph, 1.0)
    from_point = np.linalg.norm(ring - at_rest[-1], axis=1)
    assert from_point == pytest.approx(0.03, abs=0.012)
    body.location = (1.0, 2.0, 0.0)
    bone = next(b for b in body.pose.bones if "upperarm01.L" in b.name or b.name == "upperarm01.L")
    bone.rotation_mode = "XYZ"
    bone.rotation_euler = (0.0, 0.0, 0.8)
    bpy.context.view_layer.update()
    moved, _ = path_overlay.lines_of(spot, bpy.context.evaluated_depsgraph_get(), 1.0)
    assert moved[-1] - at_rest[-1] == pytest.approx((1.0, 2.0, 0.0), abs=0.1)
    assert np.linalg.norm(moved[0] - at_rest[0] - (1, 2, 0)) > 0.1
    lengths = [np.linalg.norm(np.diff(item, axis=0), axis=1).sum() for item in (moved, at_rest)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.1)


def test_a_ray_finds_the_place_on_a_moved_body(body: Any) -> None:
    depsgraph = bpy.context.evaluated_depsgraph_get()
    hit = skin_picking.Picker(body, depsgraph).hit(Vector((0.05, 3, 1.2)), Vector((0, -1, 0)))
    body.location, body.rotation_euler = (4.0, 0.0, 0.0), (0.0, 0.0, np.pi)
    bpy.context.view_layer.update()
    picker = skin_picking.Picker(body, bpy.context.evaluated_depsgraph_get())
    again = picker.hit(Vector((3.95, -3, 1.2)), Vector((0, 1, 0)))
    assert again == pytest.approx(hit, abs=1e-5)
    assert picker.hit(Vector((0.05, 3, 1.2)), Vector((0, -1, 0))) is None
    assert picker.nearest(Vector((4, 0, 5)), 0.1) is None


class _Drawing:
    """The operator without a window: stored state, and stand-ins for Blender's calls."""

    def __init__(self, mode: str, body: Any) -> None:
        from hfx_blender.operators.paths.path_drawing import HFX_OT_draw_path

        self.mode, self.stroke, self.finished = mode, _Stroke(), False
        self._is_held, self._began_s, self._timer = False, 0.0, None
        self._picker = skin_picking.Picker(body, bpy.context.evaluated_depsgraph_get())
        for name in ("modal", "_held", "_over_region", "_add", "_show"):
            setattr(self, name, getattr(HFX_OT_draw_path, name).__get__(self))

    def _end(self, _context: Any) -> None:
        pass

    def _finish(self, _context: Any) -> set[str]:
        self.finished = True
        return {"FINISHED"}


class _Stroke(list):
    def add(self) -> Any:
        self.append(SimpleNamespace(place=None, time=None))
        return self[-1]

    def remove(self, index: int) -> None:
        del self[index]


def _mouse(
    monkeypatch: pytest.MonkeyPatch,
    drawing: _Drawing,
    kind: str,
    x: float,
    value: str = "ANY",
    at: tuple[int, int] = (60, 60),
) -> set[str]:
    """An event over the back at height 1.25 m, x metres to the left of the middle."""
    from hfx_blender.operators import framing

    view = SimpleNamespace(
        region_2d_to_origin_3d=lambda *_: Vector((x, 3.0, 1.25)),
        region_2d_to_vector_3d=lambda *_: Vector((0.0, -1.0, 0.0)),
    )
    monkeypatch.setattr(framing, "view3d_utils", view)
    window = SimpleNamespace(type="WINDOW", x=10, y=10, width=100, height=100, data=None)
    panel = SimpleNamespace(type="UI", x=80, y=10, width=30, height=100)  # lies on the view
    context = SimpleNamespace(
        region=panel,  # started from a button in a panel
        area=SimpleNamespace(tag_redraw=lambda: None, regions=[panel, window]),
        object=bpy.context.object,
    )
    event = SimpleNamespace(type=kind, value=value, mouse_x=at[0], mouse_y=at[1])
    return drawing.modal(context, event)


def test_recording_by_hand_keeps_the_last_place_beside_the_body(
    spot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawing = _Drawing("RECORD", spot.hfx.body)
    assert _mouse(monkeypatch, drawing, "MOUSEMOVE", -0.05) == {"PASS_THROUGH"}
    _mouse(monkeypatch, drawing, "LEFTMOUSE", -0.05, "PRESS")
    for x in (-0.02, 0.03, 2.0):
        _mouse(monkeypatch, drawing, "MOUSEMOVE", x)
    _mouse(monkeypatch, drawing, "TIMER", 0.06)
    assert not drawing.finished
    assert _mouse(monkeypatch, drawing, "LEFTMOUSE", 0.07, "RELEASE") == {"FINISHED"}
    actual = [item.place[0] for item in drawing.stroke]
    assert actual == pytest.approx([-0.05, -0.02, 0.03, 0.03, 0.06, 0.07], abs=1e-5)
    times = [item.time for item in drawing.stroke]
    assert times == sorted(times) and times[0] < 0.05
    assert drawing.finished


def test_places_are_clicked_taken_back_and_finished(
    spot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawing = _Drawing("STRAIGHT", spot.hfx.body)
    for x in (-0.05, 2.0, 0.0, 0.05):  # the click at 2.0 misses the body
        assert _mouse(monkeypatch, drawing, "LEFTMOUSE", x, "PRESS") == {"RUNNING_MODAL"}
    assert len(drawing.stroke) == 3
    _mouse(monkeypatch, drawing, "BACK_SPACE", 0.0, "PRESS")
    assert _mouse(monkeypatch, drawing, "MIDDLEMOUSE", 0.0, "PRESS") == {"PASS_THROUGH"}
    assert _mouse(monkeypatch, drawing, "RET", 0.0, "PRESS") == {"FINISHED"}
    assert [item.place[0] for item in drawing.stroke] == pytest.approx([-0.05, 0.0], abs=1e-5)
    _, clicked, path = path_overlay.pending_clicks
    assert len(clicked) == 2 and len(path) > 10  # the path drawn so far lies on the skin
    path_overlay.show_pending(None, np.zeros((0, 3)))
    assert _mouse(monkeypatch, _Drawing("CURVE", spot.hfx.body), "ESC", 0.0) == {"CANCELLED"}


def test_a_package_that_is_not_there_is_told_and_is_no_traceback(
    body: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.authoring.paths import paths

    def missing() -> Any:
        raise ModuleNotFoundError("No module named 'scipy'", name="scipy.spatial")

    monkeypatch.setattr(paths, "skin", missing)
    before = len(bpy.data.objects)
    with pytest.raises(RuntimeError, match="Python package scipy") as caught:
        bpy.ops.hfx.add_spot(modality="vibration", name="Point")
    assert "Traceback" not in str(caught.value)
    assert len(bpy.data.objects) == before


def test_a_package_that_is_not_there_ends_a_drawing_with_a_report(
    spot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfx_blender.authoring.paths import paths

    def missing() -> Any:
        raise ModuleNotFoundError("No module named 'scipy'", name="scipy.sparse.csgraph")

    drawing = _Drawing("STRAIGHT", spot.hfx.body)
    ends: list[str] = []
    drawing.cancel = lambda _context: ends.append("cancel")
    drawing.report = lambda kinds, text: ends.append(f"{kinds} {text}")
    assert _mouse(monkeypatch, drawing, "LEFTMOUSE", 0.0, "PRESS") == {"RUNNING_MODAL"}
    monkeypatch.setattr(paths, "skin", missing)
    assert _mouse(monkeypatch, drawing, "LEFTMOUSE", 0.05, "PRESS") == {"CANCELLED"}
    assert ends[0] == "cancel" and "{'ERROR'} This needs the Python package scipy" in ends[1]
    assert len(ends) == 2
    monkeypatch.setattr(paths, "skin", lambda: 1 / 0)  # a defect is not hidden
    with pytest.raises(ZeroDivisionError):
        _mouse(monkeypatch, drawing, "LEFTMOUSE", 0.1, "PRESS")


def test_a_click_on_a_panel_over_the_view_is_for_the_panel(
    spot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawing = _Drawing("STRAIGHT", spot.hfx.body)
    for at, taken in (((95, 60), False), ((5, 60), False), ((60, 60), True)):
        answer = _mouse(monkeypatch, drawing, "LEFTMOUSE", 0.05, "PRESS", at)
        assert answer == ({"RUNNING_MODAL"} if taken else {"PASS_THROUGH"}), at
    assert len(drawing.stroke) == 1


def test_a_long_path_is_read_again(tmp_path: Path) -> None:
    """40,000 points are 2 MB of text; 100,001 are refused before writing."""
    points = tuple((k / 1e5, 0.123456789, 1.0) for k in range(40_000))
    recipe = path_file.PathRecipe("Long", points, kind="traced")
    file = tmp_path / "long.hfxpath"
    path_file.save(recipe, file)
    assert path_file.load(file).points_m == points and file.stat().st_size > 1 << 20
    with pytest.raises(InputError, match="allowed is a list of 1 to 100000 items"):
        path_file.save(path_file.PathRecipe("Longer", ((0.0, 0.0, 1.0),) * 100_001), file)
    assert path_file.load(file).points_m == points
