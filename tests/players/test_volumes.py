# SPDX-License-Identifier: GPL-3.0-or-later
"""Several volumes of one effect act as several effects do, and levels multiply."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
from core_library import Body, Clip, Player, library
from small_clip import write_small_clip
from test_native import floats

from hfx_blender.formats.clip.container import encoded
from hfx_tools.formats import clip_rules

REST = np.tile(np.eye(4)[:3], (2, 1, 1))


def with_copies(content: bytes, effect: int, count: int) -> bytes:
    """Clip that has one volume effect ``count`` times, and no other effect."""
    sections = {name: of.copy() for name, of in clip_rules.read(content, "x").items()}
    one = sections["EFCT"][effect : effect + 1]
    filters = sections["FLTR"][int(one["first_filter"][0]) :][: int(one["filters"][0])]
    sections["EFCT"] = np.repeat(one, count)
    sections["EFCT"]["first_filter"] = len(filters) * np.arange(count)
    sections["EFCT"]["first_painted"] = 0
    sections["FLTR"], sections["PNTD"] = np.tile(filters, count), sections["PNTD"][:0]
    return encoded(sections, "x")


@pytest.mark.parametrize("effect", range(4))
@pytest.mark.parametrize("count", [1, 2, 50])
def test_volumes_of_one_effect_act_as_so_many_effects(
    effect: int, count: int, tmp_path: Path
) -> None:
    content = write_small_clip(tmp_path).read_bytes()
    one, several = (Body(Clip(with_copies(content, effect, n))) for n in (1, count))
    numbers = [0, *(one.add_volume(0) for _ in range(count - 1))]
    assert len(set(numbers)) == count
    random = np.random.default_rng(count)
    from_centre, speed = random.uniform(-1.0, 1.0, (2, count, 3))
    acts = 0
    for frame in range(12):
        for k in range(count):
            matrix = 0.6 * np.eye(4)[:3]
            matrix[:, 3] = from_centre[k] + 0.1 * frame * speed[k]
            factor = (k + frame) % 3 / 2.0
            for body, number in ((one, numbers[k]), (several, k)):
                assert body.set_volume(number, matrix) == 0
                assert body.trigger(number, factor) == 0
        for body in (one, several):
            body.set_bones(REST)
        expected = several.evaluate(0.02)
        assert one.evaluate(0.02).tolist() == expected.tolist()
        for k in range(count):
            assert one.level(numbers[k]) == several.level(k)
            assert one.weights(numbers[k]).tolist() == several.weights(k).tolist()
            acts += one.level(numbers[k]) > 0.0
    assert acts > 0


def test_a_removed_volume_is_silent_and_numbers_stay(tmp_path: Path) -> None:
    body = Body(Clip(with_copies(write_small_clip(tmp_path).read_bytes(), 1, 1)))
    first, second, third = (body.add_volume(0) for _ in range(3))
    for number in (0, first, second, third):
        body.trigger(number, 0.0)
    body.trigger(second, 1.0)
    body.set_bones(REST)
    body.evaluate(0.02)
    assert body.level(second) > 0.0 and body.level(third) == 0.0
    assert body.remove_volume(second) and not body.remove_volume(second)
    assert not body.remove_volume(0)  # the effect's own volume
    assert body.evaluate(0.02).tolist() == [0.0, 61.0]
    assert body.trigger(second, 1.0) == -6 and body.weights(second).size == 0
    assert body.trigger(third, 1.0) == 0 and body.remove_volume(third)
    assert body.trigger(first, 1.0) == 0
    assert body.add_volume(0) not in (0, first, second, third)
    assert body.add_volume(9) == body.add_volume(0, size=16) == 0xFFFFFFFF


def test_memory_in_use_takes_no_second_volume(tmp_path: Path) -> None:
    body = Body(Clip(write_small_clip(tmp_path).read_bytes()))
    number = body.add_volume(0)
    assert body.add_volume(0, in_memory_of_last=True) == 0xFFFFFFFF
    assert body.remove_volume(number)
    assert body.add_volume(0, in_memory_of_last=True) not in (0, number, 0xFFFFFFFF)
    body.evaluate(0.01)  # does not hang


def test_a_painted_area_has_no_further_volume(tmp_path: Path) -> None:
    body = Body(Clip(write_small_clip(tmp_path).read_bytes()))
    assert body.add_volume(4) == 0xFFFFFFFF


def test_an_authored_intensity_is_multiplied(tmp_path: Path) -> None:
    """A cuboid round all vertices at level 0.3 of 10 m/s^2 gives 3, at half of it 1.5."""
    sections = dict(clip_rules.read(write_small_clip(tmp_path).read_bytes(), "x"))
    effect = sections["EFCT"][:1].copy()
    effect["level"], effect["filters"], effect["falloff"] = 0.3, 0, 0
    effect["parameters"] = [[10.0, 80.0, 0.0, 0.0]]
    empty = {name: sections[name][:0] for name in ("FLTR", "PNTD")}
    body = Body(Clip(encoded({**sections, **empty, "EFCT": effect}, "x")))
    body.set_bones(REST)
    assert body.evaluate(0.02)[0] == pytest.approx(3.0)
    body.trigger(0, 0.5)
    assert body.evaluate(0.02)[0] == pytest.approx(1.5)
    body.trigger(0, 7.0)
    assert body.evaluate(0.02)[0] == pytest.approx(3.0)
    number = body.add_volume(0)
    assert body.level(number) == 0.0
    body.trigger(number, 0.5)  # 3.0 and 1.5 of one frequency add
    assert body.evaluate(0.02)[0] == pytest.approx(4.5)


def test_only_the_bytes_of_a_clip_have_to_stay(tmp_path: Path) -> None:
    clip = Clip(write_small_clip(tmp_path).read_bytes())
    player, body = Player(clip), Body(clip)
    body.set_bones(REST)
    expected = Player(clip).advance(0.25).tolist()
    ctypes.memset(clip.at, 0xA5, ctypes.sizeof(clip.at))  # as where a vector of clips has grown
    assert player.advance(0.25).tolist() == expected
    assert body.evaluate(0.02)[0] > 0.0


def test_the_engine_library_adds_and_removes_volumes(tmp_path: Path) -> None:
    core, error = library(), ctypes.c_int32()
    content = with_copies(write_small_clip(tmp_path).read_bytes(), 1, 1)
    size = ctypes.c_size_t(len(content))
    live = ctypes.c_void_p(core.hfx_live_open(content, size, 0, ctypes.byref(error)))
    assert core.hfx_live_trigger(live, 0, ctypes.c_double(0.0)) == 0
    numbers = [core.hfx_live_add_volume(live, 0) for _ in range(100)]
    assert len(set(numbers)) == 100 and min(numbers) > 0
    rest, out = floats([str(item) for item in REST.ravel()]), floats(2)
    for number in numbers:
        assert core.hfx_live_trigger(live, number, ctypes.c_double(1.0)) == 0
    core.hfx_live_set_bones(live, rest, 24)
    core.hfx_live_evaluate(live, ctypes.c_double(0.02), out, 2)
    assert out[0] == 10.0  # the motor's limit
    for number in numbers[:60]:
        assert core.hfx_live_remove_volume(live, number) == 0
        assert core.hfx_live_remove_volume(live, number) == -6
    assert core.hfx_live_add_volume(live, 5) == core.hfx_live_add_volume(None, 0) == -6
    core.hfx_live_close(live)  # with 40 added volumes
