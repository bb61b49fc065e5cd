# SPDX-License-Identifier: GPL-3.0-or-later
"""Sliding a skin point by hand: path, keyframes, Auto Keying, handles."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mathutils import Vector

from hfx_blender.authoring.paths import paths, spot_placing
from hfx_blender.blender import compat
from hfx_blender.engine.areas.spot import lengths_along, places_on
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.operators.paths import path_overlay
from hfx_blender.operators.paths.spot_handles import HFX_OT_resize_spot, HFX_OT_slide_spot
from hfx_blender.reading.live_scene import LiveScene
from hfx_blender.ui import gizmos

LEFT, RIGHT, LOW = (0.09, 0.076, 1.35), (-0.09, 0.076, 1.35), (0.0, 0.04, 1.15)
ON_SKIN_M = 0.012  # largest distance of the positions below from the skin


@pytest.fixture
def spot(scene: Any) -> Any:
    scene.render.fps = 25
    scene.frame_start, scene.frame_end = 0, 40
    scene.frame_set(0)
    bpy.ops.hfx.add_avatar()
    bpy.ops.hfx.add_spot(modality="vibration", name="Point")
    edit = bpy.context.preferences.edit
    only_animated = edit.use_keyframe_insert_available  # on by default from 5.0
    edit.use_keyframe_insert_available = False
    yield bpy.context.object
    edit.use_keyframe_insert_available = only_animated
    bpy.context.tool_settings.use_keyframe_insert_auto = False


def slide(frame: int, place: Any, **options: Any) -> None:
    bpy.context.scene.frame_set(frame)
    bpy.ops.hfx.slide_spot(place=place, **options)


def felt(frame: int) -> np.ndarray:
    bpy.context.scene.frame_set(frame)
    (run,) = LiveScene(bpy.context.scene, bpy.context.view_layer, STANDARD).runs()
    return run.focus[0, :3]


def auto_key(mode: str = "ADD_REPLACE_KEYS") -> None:
    bpy.context.tool_settings.use_keyframe_insert_auto = True
    bpy.context.tool_settings.auto_keying_mode = mode


def keys(spot: Any) -> list[int]:
    curve = paths.motion_of(spot)
    return [] if curve is None else [round(key.co[0]) for key in curve.keyframe_points]


def test_a_resting_point_is_felt_where_it_is_slid_to_and_one_undo_takes_it_back(spot: Any) -> None:
    bpy.ops.ed.undo_push(message="before")
    before = paths.path_of(spot)
    bpy.ops.hfx.slide_spot("EXEC_DEFAULT", True, place=LEFT)
    assert felt(0) == pytest.approx(LEFT, abs=ON_SKIN_M)
    assert spot.location[:] == pytest.approx(LEFT, abs=ON_SKIN_M), "the object goes along"
    assert keys(spot) == [] and len(paths.path_of(spot)) == 1
    bpy.ops.ed.undo()
    assert paths.path_of(bpy.data.objects["Point"]) == pytest.approx(before)


def test_with_auto_keying_it_moves_on_the_skin_from_key_to_key(spot: Any) -> None:
    auto_key()
    slide(0, LEFT)
    slide(20, RIGHT)
    assert felt(10)[0] == pytest.approx(0.0, abs=0.01), "half way at half time"
    slide(40, LOW)
    assert keys(spot) == [0, 20, 40]
    for frame, position in ((0, LEFT), (20, RIGHT), (40, LOW)):
        assert felt(frame) == pytest.approx(position, abs=ON_SKIN_M), frame
    path = paths.path_of(spot)
    assert paths.skin().on_skin(path) == pytest.approx(path, abs=1e-6), "all of it on the skin"


def test_a_key_between_keys_and_on_a_key_moves_only_the_ways_beside_it(spot: Any) -> None:
    auto_key()
    for frame, position in ((0, LEFT), (10, RIGHT), (20, LEFT), (30, LOW)):
        slide(frame, position)
    early = [felt(frame) for frame in (0, 3, 6, 9)]
    slide(25, RIGHT)
    assert keys(spot) == [0, 10, 20, 25, 30]
    assert felt(25) == pytest.approx(RIGHT, abs=ON_SKIN_M)
    slide(20, LOW)
    assert keys(spot) == [0, 10, 20, 25, 30]
    assert felt(20) == pytest.approx(LOW, abs=ON_SKIN_M)
    for frame, position in ((0, LEFT), (10, RIGHT), (25, RIGHT), (30, LOW)):
        assert felt(frame) == pytest.approx(position, abs=ON_SKIN_M), frame
    for frame, position in zip((0, 3, 6, 9), early, strict=True):
        assert felt(frame) == pytest.approx(position, abs=2e-3), "as it went before, but for ease"


def test_a_drawn_curve_stays_a_curve_where_no_key_is_moved(spot: Any) -> None:
    """To and fro over a drawn path: a new key at the end changes only the last segment."""
    bpy.ops.hfx.path_from_library(name="circle_chest")
    bpy.context.scene.frame_set(0)
    bpy.ops.hfx.move_along_path(seconds=0.4, repeats=3, to_and_fro=True, interpolation="BEZIER")
    before = [felt(frame) for frame in range(20)]
    auto_key()
    slide(30, LOW)
    assert felt(30) == pytest.approx(LOW, abs=ON_SKIN_M)
    for frame, position in enumerate(before):
        assert felt(frame) == pytest.approx(position, abs=2e-3), frame


def test_without_auto_keying_a_moving_point_is_loose_until_the_frame_changes(spot: Any) -> None:
    auto_key()
    slide(0, LEFT)
    slide(20, RIGHT)
    bpy.context.tool_settings.use_keyframe_insert_auto = False
    length, half_way = paths.length_m(spot), felt(10)
    slide(10, LOW)
    (run,) = LiveScene(bpy.context.scene, bpy.context.view_layer, STANDARD).runs()
    assert run.focus[0, :3] == pytest.approx(LOW, abs=ON_SKIN_M), "felt where it was dragged"
    assert paths.length_m(spot) == pytest.approx(length), "its path is as it was"
    path, ring = path_overlay.lines_of(spot, bpy.context.evaluated_depsgraph_get(), 1.0)
    assert path[-1] == pytest.approx(RIGHT, abs=0.02), "and is drawn so"
    assert ring.mean(axis=0) == pytest.approx(LOW, abs=0.02)
    recipe = paths.recipe_of(bpy.context.scene, spot, "x")
    assert recipe.motion[-1][1] == pytest.approx(1.0, abs=1e-5), "and saved so"
    assert felt(20) == pytest.approx(RIGHT, abs=ON_SKIN_M)
    assert felt(10) == pytest.approx(half_way, abs=1e-4)
    slide(10, LEFT)  # again, now from a path with a loose end
    slide(10, LOW)
    bpy.ops.hfx.key_spot()
    assert keys(spot) == [0, 10, 20]
    assert felt(10) == pytest.approx(LOW, abs=ON_SKIN_M)
    assert felt(0) == pytest.approx(LEFT, abs=ON_SKIN_M)
    assert paths.OWN not in spot


def test_reversing_and_mirroring_leave_no_loose_end(spot: Any) -> None:
    auto_key()
    slide(0, LEFT)
    slide(20, RIGHT)
    bpy.context.tool_settings.use_keyframe_insert_auto = False
    slide(10, LOW)
    bpy.ops.hfx.reverse_path()
    assert felt(0) == pytest.approx(RIGHT, abs=ON_SKIN_M)
    slide(10, LOW)
    bpy.ops.hfx.mirror_path()
    assert felt(0) == pytest.approx(LEFT, abs=ON_SKIN_M)
    assert felt(20) == pytest.approx(RIGHT, abs=ON_SKIN_M)


def test_auto_keying_that_only_replaces_adds_no_key(spot: Any) -> None:
    auto_key("REPLACE_KEYS")
    slide(0, LEFT)
    assert keys(spot) == []
    auto_key()
    slide(0, LEFT)
    slide(20, RIGHT)
    auto_key("REPLACE_KEYS")
    slide(10, LOW)
    assert keys(spot) == [0, 20]
    slide(20, LOW)
    assert keys(spot) == [0, 20] and felt(20) == pytest.approx(LOW, abs=ON_SKIN_M)


def test_auto_keying_of_what_is_animated_only_needs_a_first_key(spot: Any) -> None:
    bpy.context.preferences.edit.use_keyframe_insert_available = True
    auto_key()
    slide(0, LEFT)
    assert keys(spot) == [], "it rests: it is moved"
    bpy.ops.hfx.key_spot()
    slide(20, RIGHT)
    assert keys(spot) == [0, 20]
    assert felt(0) == pytest.approx(LEFT, abs=ON_SKIN_M)


def test_the_first_key_after_sliding_along_a_path_keeps_the_path(spot: Any) -> None:
    bpy.ops.hfx.path_from_library(name="across_back")
    path = paths.path_of(spot)
    slide(0, path[len(path) // 4], along_path=True)
    bpy.ops.hfx.key_spot()
    auto_key()
    slide(20, path[3 * len(path) // 4] + [0.0, 0.0, 0.004], along_path=True)
    assert paths.path_of(spot) == pytest.approx(path)
    values = [key.co[1] for key in paths.motion_of(spot).keyframe_points]
    assert values == pytest.approx([0.25, 0.75], abs=0.02)


@pytest.mark.parametrize("kind", ["straight", "curve", "traced"])
def test_a_path_without_keys_leads_through_where_its_point_is_slid_to(spot: Any, kind: str) -> None:
    knots = np.array([LEFT, (0.0, 0.05, 1.35), RIGHT])
    if kind == "traced":
        knots = places_on(knots, np.linspace(0.0, 1.0, 60))
    paths.draw(spot, knots, kind=kind)
    spot.hfx.path_position = 0.5
    slide(0, LOW)
    assert felt(0) == pytest.approx(LOW, abs=ON_SKIN_M)
    path = paths.path_of(spot)
    assert path[0] == pytest.approx(LEFT, abs=ON_SKIN_M)
    assert path[-1] == pytest.approx(RIGHT, abs=ON_SKIN_M)
    assert paths.skin().on_skin(path) == pytest.approx(path, abs=1e-6)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.01, "and nowhere jumps"


def test_what_rules_the_position_otherwise_is_told(spot: Any) -> None:
    driver = spot.driver_add(paths.POSITION).driver
    driver.expression = "0.5"
    before = list(spot[paths.PATH])
    for operator in (bpy.ops.hfx.slide_spot, bpy.ops.hfx.key_spot):
        with pytest.raises(RuntimeError, match="position of 'Point' is driven"):
            operator()
    spot.driver_remove(paths.POSITION)
    auto_key()
    slide(0, LEFT)
    slide(20, RIGHT)
    data = spot.animation_data
    track = data.nla_tracks.new()
    track.strips.new("Gesture", 1, data.action).name = "Gesture"  # 4.4.0 ignores new()'s
    data.action = None
    with pytest.raises(RuntimeError, match="NLA strip 'Gesture'"):
        bpy.ops.hfx.slide_spot(place=LEFT)
    assert len(spot[paths.PATH]) > len(before)


def test_a_place_that_is_not_on_the_body_changes_nothing(spot: Any) -> None:
    before = list(spot[paths.PATH])
    for position in ((0.0, 3.0, 1.0), (np.nan, 0.0, 1.0)):
        with pytest.raises(RuntimeError, match=r"[Pp]lace"):
            bpy.ops.hfx.slide_spot(place=position)
    assert list(spot[paths.PATH]) == before


def test_the_radius_is_set_and_keyed(spot: Any) -> None:
    bpy.ops.hfx.resize_spot(radius=0.06)
    assert spot.hfx.radius == pytest.approx(0.06) and spot.animation_data is None
    auto_key()
    bpy.context.scene.frame_set(10)
    bpy.ops.hfx.resize_spot(radius=0.02)
    curve = compat.fcurve_of(spot, "hfx.radius")
    assert [key.co[:] for key in curve.keyframe_points] == [(10.0, pytest.approx(0.02))]
    bpy.ops.hfx.resize_spot(radius=-1.0)
    assert spot.hfx.radius == 0.0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=1, max_size=8),
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6),
    st.data(),
)
def test_whatever_key_is_moved_every_other_stays_where_it_was(
    points: Any, shares: Any, data: Any
) -> None:
    path, old = np.array(points), np.array(shares)
    new = data.draw(st.booleans())
    at = data.draw(st.integers(0, len(old) if new else len(old) - 1))
    position = np.array([2.0, 0.5, 0.25])
    created, where = spot_placing.rerouted(
        path, old, at, position, lambda a, b: np.stack([a, (a + b) / 2, b]), new=new
    )
    assert len(where) == len(old) + new
    assert (np.diff(where) >= 0.0).all() and np.isfinite(created).all()
    actual = places_on(created, where)
    assert actual[at] == pytest.approx(position, abs=1e-9)
    others = np.delete(np.arange(len(where)), at)
    stored = old if new else np.delete(old, at)
    assert actual[others] == pytest.approx(places_on(path, stored), abs=1e-6)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=1, max_size=8),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_a_part_of_a_path_is_as_long_as_its_shares_say(points: Any, a: float, b: float) -> None:
    path = np.array(points)
    part = spot_placing.between(path, a, b)
    ends = places_on(path, np.array([a, b]))
    assert part[[0, -1]] == pytest.approx(ends, abs=1e-9)
    whole = lengths_along(path)[-1]
    assert lengths_along(part)[-1] == pytest.approx(abs(b - a) * whole, abs=1e-6)


# The mouse, without a window


class _Slide:
    """The operator's methods on a plain object, because a modal operator needs a window."""

    def __init__(self, operator: type, effect: Any) -> None:
        self.release_confirm, self.along_path = True, False
        self.place, self.radius = (0.0, 0.0, 0.0), 0.0
        self.reports: list[str] = []
        self.executed = False
        for kind in reversed(operator.__mro__[:-3]):
            for name, value in vars(kind).items():
                if callable(value) and name not in ("execute", "report"):
                    setattr(self, name, value.__get__(self))
        self._end = lambda _context: None
        self._tell = lambda _context: None

    def execute(self, _context: Any) -> set[str]:
        self.executed = True
        return {"FINISHED"}


@pytest.fixture
def mouse(spot: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """``mouse(operator, kind, x, ...)``: x metres to the left on the back, 1000 pixels a metre."""
    look = SimpleNamespace(
        region_2d_to_origin_3d=lambda _r, _v, at: Vector((at[0] / 1000.0, 3.0, at[1] / 1000.0)),
        region_2d_to_vector_3d=lambda *_: Vector((0.0, -1.0, 0.0)),
        location_3d_to_region_2d=lambda _r, _v, place: Vector((place[0], place[2])) * 1000.0,
    )
    from hfx_blender.operators import framing
    from hfx_blender.operators.paths import spot_handles

    for module in (framing, spot_handles):
        monkeypatch.setattr(module, "view3d_utils", look)
    region = SimpleNamespace(type="WINDOW", x=0, y=0, width=100, height=100, data=None)
    context = SimpleNamespace(
        object=spot,
        scene=bpy.context.scene,
        selected_objects=[spot],
        tool_settings=bpy.context.tool_settings,
        preferences=bpy.context.preferences,
        area=SimpleNamespace(type="VIEW_3D", tag_redraw=lambda: None, regions=[region]),
        window=SimpleNamespace(cursor_modal_set=lambda _: None),
        window_manager=SimpleNamespace(modal_handler_add=lambda _: None),
        evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
    )

    def send(held: Any, kind: str, x: float = 0.0, z: float = 1.25, **more: Any) -> set[str]:
        event = SimpleNamespace(
            **{"type": kind, "value": "ANY", "shift": False, **more},
            mouse_x=1000.0 * x,
            mouse_y=1000.0 * z,
        )
        return (
            held.modal(context, event)
            if more.get("value") != "BEGIN"
            else held.invoke(context, event)
        )

    return send


def test_dragging_shows_it_at_once_and_letting_go_confirms(spot: Any, mouse: Any) -> None:
    held = _Slide(HFX_OT_slide_spot, spot)
    before = list(spot[paths.PATH])
    assert mouse(held, "LEFTMOUSE", 0.002, value="BEGIN") == {"RUNNING_MODAL"}
    mouse(held, "MOUSEMOVE", 0.062)
    assert spot[paths.PATH][0] == pytest.approx(0.06, abs=2e-3), "the distance to the mouse stays"
    assert felt(0)[0] == pytest.approx(0.06, abs=2e-3)
    mouse(held, "MOUSEMOVE", 0.072, shift=True)
    assert spot[paths.PATH][0] == pytest.approx(0.061, abs=2e-3), "a tenth with Shift"
    assert mouse(held, "LEFTMOUSE", 0.072, value="RELEASE") == {"FINISHED"}
    assert held.executed and held.place[0] == pytest.approx(0.061, abs=2e-3)
    assert list(spot[paths.PATH]) == before, "the operator itself makes the change, once"


def test_escape_takes_back_all(spot: Any, mouse: Any) -> None:
    held = _Slide(HFX_OT_slide_spot, spot)
    before = list(spot[paths.PATH]), tuple(spot.location), spot.hfx.path_position
    mouse(held, "G", value="BEGIN")
    mouse(held, "MOUSEMOVE", 0.06)
    assert mouse(held, "ESC", 0.06, value="PRESS") == {"CANCELLED"}
    assert (list(spot[paths.PATH]), tuple(spot.location), spot.hfx.path_position) == before
    assert not held.executed


def test_beside_the_body_it_stays_on_its_outline(spot: Any, mouse: Any) -> None:
    held = _Slide(HFX_OT_slide_spot, spot)
    mouse(held, "G", value="BEGIN")
    mouse(held, "MOUSEMOVE", 0.5, z=1.25)
    position = np.array(held.place)
    assert paths.skin().on_skin(position[None])[0] == pytest.approx(position, abs=1e-5)
    assert 0.1 < position[0] < 0.5, "to the side that the mouse went to"


def test_g_again_keeps_it_on_its_path(spot: Any, mouse: Any) -> None:
    paths.draw(spot, np.array([RIGHT, LEFT]))
    path = list(spot[paths.PATH])
    held = _Slide(HFX_OT_slide_spot, spot)
    mouse(held, "G", x=-0.09, z=1.35, value="BEGIN")
    mouse(held, "MOUSEMOVE", 0.0, z=1.30)
    assert len(spot[paths.PATH]) == 3
    mouse(held, "G", value="PRESS")
    assert list(spot[paths.PATH]) == path
    assert spot.hfx.path_position == pytest.approx(0.5, abs=0.03)
    path_overlay.show_pending(None, np.zeros((0, 3)))


def test_the_ring_sizes_the_disc_by_the_distance_from_its_middle(spot: Any, mouse: Any) -> None:
    held = _Slide(HFX_OT_resize_spot, spot)
    mouse(held, "LEFTMOUSE", 0.03, value="BEGIN")
    mouse(held, "MOUSEMOVE", 0.06)
    assert spot.hfx.radius == pytest.approx(0.06, rel=0.02)
    assert mouse(held, "ESC", value="PRESS") == {"CANCELLED"}
    assert spot.hfx.radius == pytest.approx(0.03)


def test_with_something_else_selected_the_keys_are_blenders(spot: Any, mouse: Any) -> None:
    held = _Slide(HFX_OT_slide_spot, spot)
    spot.select_set(False)
    assert mouse(held, "G", value="BEGIN") == {"PASS_THROUGH"}
    assert mouse(held, "LEFTMOUSE", value="BEGIN") == {"RUNNING_MODAL"}, "a handle is for the point"


def test_the_handles_stand_on_the_posed_body(spot: Any) -> None:
    slide(0, LEFT)
    body = spot.hfx.body
    body.location = (1.0, 2.0, 0.0)
    body.rotation_euler.z = np.pi
    bpy.context.view_layer.update()
    matrix = gizmos.placed_on_body(bpy.context, spot)
    assert matrix.translation[:] == pytest.approx((1.0 - 0.09, 2.0 - 0.076, 1.35), abs=ON_SKIN_M)
    assert matrix.col[2].y < -0.8, "its axis is the skin's normal: the back looks to -Y now"
    spot.hfx.body = None
    assert gizmos.placed_on_body(bpy.context, spot) is None
