# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked clips and painted areas at another angle and height, and effects of another clip."""

from __future__ import annotations

import ctypes
import sys

import numpy as np
import pytest
from core_library import ROOT, Body, Clip, Player, library

sys.path.insert(0, str(ROOT / "tests" / "manual" / "players"))
from hand_clips import avatar_clip, library_clip, ring

from hfx_blender.engine.body.model import load_model
from hfx_blender.formats.clip.container import encoded, records
from hfx_tools.formats import clip_rules

FOLDER = ROOT / "players" / "conformance"


def test_the_clips_of_hand_calculated_calls_are_those_that_are_made() -> None:
    for name, content in (("avatar", avatar_clip()), ("library", library_clip())):
        assert (FOLDER / "behaviour" / f"{name}.hfxclip").read_bytes() == content


@pytest.mark.parametrize("name", ["suit", "vest", "belt", "many", "peltier", "demo_garage"])
def test_a_full_turn_changes_no_value(name: str) -> None:
    """Real devices have no even rings: a turn of next to nothing finds each actuator itself."""
    content = (FOLDER / f"{name}.hfxclip").read_bytes()
    clip, strengths = Clip(content), clip_rules.read(content, "x")["ACTR"]["first_column"]
    plain, turned = Player(clip), Player(clip)
    turned.place(360.0 + 1e-7, 1e-9, 1.0 + 1e-9)
    acts = 0.0
    for _ in range(25):
        expected = plain.advance(0.04)
        actual = turned.advance(0.04)[strengths]
        assert actual == pytest.approx(expected[strengths], rel=1e-4, abs=1e-4)
        acts += np.abs(expected).sum()
    assert acts > 0.0


@pytest.mark.parametrize("actuator", range(16))
def test_a_vest_turned_by_half_plays_its_front_on_its_back(actuator: int) -> None:
    """Actuators are 4 rows of 4 in front, then 4 of 4 behind, seen from outside from the left and
    from the left again: one in front is felt behind, in its row, most on the other side."""
    sections = dict(clip_rules.read((FOLDER / "vest.hfxclip").read_bytes(), "x"))
    at = sections["ACTR"].copy()
    at["rows"], at["first_row"], at["first_value"] = 1, np.arange(32), np.arange(32)
    numbers = np.zeros(32, np.uint16)
    numbers[actuator] = 65535
    clip = Clip(
        encoded({**sections, "ACTR": at, "ROWS": np.zeros(32, np.uint32), "VALU": numbers}, "x")
    )
    player = Player(clip)
    full = player.advance(0.01)[actuator]
    player.place(180.0, 0.0, 1.0)
    front, back = player.advance(0.01).reshape(2, 4, 4) / full
    row, column = divmod(actuator, 4)
    assert front.max() < 0.35  # uneven angles: a share stays on the flank
    assert not np.delete(back, row, axis=0).any()
    assert int(np.argmax(back[row])) == 3 - column and back[row].max() > 0.5


def test_a_painted_area_on_the_chest_turns_to_the_back() -> None:
    """A dot of the real model, in front at a height of 1.25 m, turned by 180 degrees."""
    model = load_model("hfx-pressure-1")
    places = model.vertices.astype(np.float64)
    is_torso = (np.abs(places[:, 0]) < 0.16) & (places[:, 2] > 1.0) & (places[:, 2] < 1.5)
    torso = np.flatnonzero(is_torso)
    sections = dict(clip_rules.read(library_clip(), "x"))
    middle = np.array([0.0, -0.15, 1.25])
    dot = np.flatnonzero(np.linalg.norm(places[torso] - middle, axis=1) < 0.04)
    effect = sections["EFCT"][:1].copy()
    effect["first_painted"], effect["painted"], effect["level"] = 0, len(dot), 1.0
    one_bone = {
        "BODY": [(0, 0, 1, 0, 1, 0)],
        "MODL": [(effect["model"][0], 0, 0, 0, len(torso), 0)],
    }
    changed = {name: records(name, rows) for name, rows in one_bone.items()}
    changed["VERT"] = records("VERT", [(places[v], v, k, 1) for k, v in enumerate(torso)])
    changed["WGHT"] = records("WGHT", [(0, 65535)] * len(torso))
    changed["PNTD"] = records("PNTD", [(k, 1.0) for k in dot])
    clip = Clip(encoded({**sections, **changed, "EFCT": effect}, "x"))
    assert clip.error == 0 and len(dot) > 20
    body = Body(clip)

    def centre() -> np.ndarray:
        weights = body.weights(0)
        assert weights.any()
        return np.average(places[torso], axis=0, weights=weights)

    assert centre() == pytest.approx(places[torso][dot].mean(axis=0))
    for turn, expected in ((180.0, [0.0, 0.06, 1.25]), (90.0, [0.14, -0.04, 1.25])):
        assert body.place(0, turn, 0.0, 1.0) == 0
        assert centre() == pytest.approx(expected, abs=0.035)
    assert body.place(0, 0.0, -0.1, 1.0) == 0
    assert centre() == pytest.approx([0.0, -0.15, 1.15], abs=0.02)
    assert body.place(0, 0.0, 0.0, 0.5) == 0
    half = body.weights(0) > 0.0
    assert np.ptp(places[torso][half, 2]) < 0.6 * np.ptp(places[torso][dot, 2])
    assert body.place(0, 0.0, 0.0, 1.0) == 0
    assert body.weights(0).tolist() == np.isin(np.arange(len(torso)), dot).astype(float).tolist()


def test_a_library_of_a_coarser_model_covers_the_skin_between() -> None:
    """The body has 64 vertices, 0.0196 m apart, the library each fourth: weights reach up to the
    next vertex of the library, by less than 6 % of the body's size."""
    avatar = dict(clip_rules.read(avatar_clip(), "x"))
    places = ring(64, 1.0)
    avatar["VERT"] = records("VERT", [(at, k, k, 1) for k, at in enumerate(places)])
    avatar["WGHT"] = records("WGHT", [(0, 65535)] * 64)
    avatar["MODL"] = records("MODL", [(int(avatar["MODL"]["id"][0]), 0, 0, 0, 64, 0)])
    clip = Clip(encoded(avatar, "x"))
    coarse = Clip(library_clip(4 * np.arange(16), level=1))
    body = Body(clip, 0, coarse)
    assert body.error == 0
    weights = body.weights(0)
    assert weights[[0, 1, 63]].tolist() == [1.0] * 3
    assert not weights[3:62].any()  # 2 and 62 are as near to the next vertex
    fine = Body(clip, 0, Clip(library_clip(np.arange(64))))
    assert fine.weights(0).tolist() == [1.0] + [0.0] * 63


def test_a_body_of_its_own_effects_feels_as_before_and_both_clips_may_move() -> None:
    content = (FOLDER / "spatial" / "walk.hfxclip").read_bytes()
    clip, same = Clip(content), Clip(content)  # at another place: a library of the same content
    own, foreign = Body(clip), Body(clip, 0, same)
    ctypes.memset(same.at, 0xA5, ctypes.sizeof(same.at))
    count = int(library().hfx_clip_bones(clip.at, 0))
    rest = np.tile(np.eye(4)[:3], (count, 1, 1))
    acts = 0.0
    for _ in range(3):
        for body in (own, foreign):
            body.set_bones(rest)
        expected = own.evaluate(0.02)
        assert foreign.evaluate(0.02).tolist() == expected.tolist()
        acts += sum(own.level(k) for k in range(8))
    assert acts > 0.0


def test_only_painted_areas_are_placed() -> None:
    clip = Clip(library_clip())
    body = Body(Clip(avatar_clip()), 0, clip)
    assert [body.place(k, 10.0, 0.0, 1.0) for k in range(5)] == [0, -6, 0, 0, -6]
    assert Body(Clip(avatar_clip()), 3, clip).error == -6


def test_the_engine_library_opens_effects_of_another_clip() -> None:
    core, error = library(), ctypes.c_int32()
    avatar, effects = avatar_clip(), library_clip()
    sizes = [ctypes.c_size_t(len(content)) for content in (avatar, effects)]
    live = ctypes.c_void_p(
        core.hfx_live_open_effects(avatar, sizes[0], 0, effects, sizes[1], ctypes.byref(error))
    )
    rest = (ctypes.c_float * 12)(*np.eye(4)[:3].ravel())
    out = (ctypes.c_float * 16)()
    assert core.hfx_live_set_bones(live, rest, 12) == 0
    assert core.hfx_live_trigger(live, 0, ctypes.c_double(1.0)) == 0
    place = [ctypes.c_double(number) for number in (45.0, 0.0, 1.0)]
    assert core.hfx_live_place(live, 0, *place) == 0
    assert core.hfx_live_place(live, 1, *place) == core.hfx_live_place(None, 0, *place) == -6
    assert core.hfx_live_evaluate(live, ctypes.c_double(0.02), out, 16) == 0
    assert list(out)[:3] == [0.0, 5.0, 0.0]
    core.hfx_live_close(live)
    for broken in (effects[:-1], b"no clip"):
        size = ctypes.c_size_t(len(broken))
        opened = core.hfx_live_open_effects(avatar, sizes[0], 0, broken, size, ctypes.byref(error))
        assert opened is None and error.value < 0
