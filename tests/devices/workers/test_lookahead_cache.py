# SPDX-License-Identifier: GPL-3.0-or-later
"""Input of late actuators in playback: the look-ahead, a remembered frame, or the current one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.live.playhead import Playhead, frames_ahead, parts_between
from hfx_blender.devices.workers import lookahead_cache
from hfx_blender.devices.workers.live_frame import LiveFrame
from hfx_blender.devices.workers.lookahead_cache import LookaheadCache
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.keyed_scene import KeyedBlock, KeyedScene
from hfx_blender.engine.kinematics.keyed_rig import KeyedRig
from hfx_blender.engine.scene import (
    BodyDescription,
    EffectBlock,
    EffectDescription,
    PaintedArea,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.serialization import decode_object, encode_object
from hfx_blender.engine.tolerance import STANDARD
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, FalloffKind

MODEL = load_model("hfx-vibration-1")
PATIENCE_S = 15.0
FPS = 25.0  # 40 ms are a frame


def scene(edition: int = 1) -> KeyedScene:
    """Scene with one painted effect; its bones do not matter."""
    area = PaintedArea("body", np.arange(3, dtype=np.int32), np.ones(3, np.float32))
    return KeyedScene(
        edition,
        SceneDescription(
            TimeBase(Fraction(25), Fraction(100), 1, 1, 24),
            (BodyDescription("body", "Body", SkinBinding(("Root",))),),
            (EffectDescription("rumble", "Rumble", "vibration", MODEL.id, area),),
        ),
        STANDARD,
        (),
        (None,),
        (KeyedRig((-1,), np.eye(4)[None], (True,), ("XYZ",), np.zeros(0, np.int64), {}, {}),),
    )


def block(first: int, last: int, edition: int = 1) -> KeyedBlock:
    """Frames at which it is as strong as the frame's number."""
    frames = np.arange(first, last + 1, dtype=np.float64)
    parameters = np.stack([frames, np.full(len(frames), 100.0)], axis=1)
    effect = EffectBlock(np.ones(len(frames)), parameters)
    still = np.repeat(np.eye(4)[None], len(frames), axis=0)
    return KeyedBlock(edition, frames, (effect,), (still,), (np.zeros((len(frames), 0)),))


def shown(frame: float, edition: int = 1, *, is_playing: bool = True, step: int = 1) -> LiveFrame:
    """A moment whose run is the frame's number."""
    playhead = Playhead(frame, 1, 24, FPS, is_playing, step)
    return LiveFrame(0.0, [f"shown at {frame:g}"], edition=edition, playhead=playhead)  # type: ignore[list-item]


def later(known: LookaheadCache, moment: LiveFrame) -> dict[float, Any]:
    """Later samples by latency: the strength of what was evaluated, or what was shown."""
    with known.answering(moment) as found:
        return {
            ms: runs[0] if isinstance(runs[0], str) else runs[0].parameters[0, 0]
            for ms, runs in found.items()
            if runs
        }


def until(happened: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def known() -> Iterator[LookaheadCache]:
    found = LookaheadCache((40.0, 200.0))
    yield found
    found.close()


def test_what_comes_is_evaluated_before_it_is_wanted(known: LookaheadCache) -> None:
    known.take(encode_object(scene()))
    known.take(encode_object(block(1, 24)))
    until(lambda: later(known, shown(3.0)) == {40.0: 4.0, 200.0: 8.0})
    until(lambda: later(known, shown(23.0)) == {40.0: 24.0, 200.0: 4.0})  # it begins again
    until(lambda: later(known, shown(3.0, step=-1)) == {40.0: 2.0, 200.0: 22.0})


def test_it_is_known_before_play_is_pressed(known: LookaheadCache) -> None:
    known.take(encode_object(scene()))
    known.take(encode_object(block(1, 24)))
    standing = shown(3.0, is_playing=False)
    assert later(known, standing) == {}
    until(lambda: {4000, 8000} <= set(known._known))
    assert later(known, standing) == {}  # nobody knows where one scrubs to
    assert later(known, shown(3.0)) == {40.0: 4.0, 200.0: 8.0}


def test_after_an_edit_nothing_of_before_holds(known: LookaheadCache) -> None:
    known.take(encode_object(scene()))
    known.take(encode_object(block(1, 24)))
    until(lambda: later(known, shown(3.0)))
    assert later(known, shown(3.0, edition=2)) == {}
    known.take(encode_object(scene()))  # they were on their way
    known.take(encode_object(block(1, 24)))
    until(lambda: not known._bodies)
    time.sleep(0.05)
    assert known._scene is None and not known._blocks
    later(known, shown(8.0, edition=1))
    assert later(known, shown(3.0, edition=2)) == {}
    known.take(encode_object(scene(2)))
    known.take(encode_object(block(1, 24)))
    until(lambda: known._scene is not None and not known._bodies)
    time.sleep(0.05)
    assert not known._blocks and later(known, shown(3.0, edition=2)) == {}
    changed = block(1, 24, edition=2)
    (effect,) = changed.effects
    known.take(
        encode_object(
            replace(changed, effects=(replace(effect, parameters=effect.parameters * 2),))
        )
    )
    until(lambda: later(known, shown(3.0, edition=2)) == {40.0: 8.0, 200.0: 16.0})
    assert later(known, shown(3.0, edition=1)) == {40.0: 8.0, 200.0: 16.0}  # late itself


def test_what_was_felt_is_remembered_for_the_next_time(known: LookaheadCache) -> None:
    for frame in range(1, 25):
        later(known, shown(float(frame)))
    assert later(known, shown(3.0)) == {40.0: "shown at 4", 200.0: "shown at 8"}
    assert later(known, shown(22.6)) == {40.0: "shown at 24", 200.0: "shown at 4"}  # the nearest
    assert later(known, shown(3.0, edition=2)) == {}


def test_scrubbing_is_not_remembered(known: LookaheadCache) -> None:
    for frame in range(1, 25):
        later(known, shown(float(frame), is_playing=False))
    assert later(known, shown(3.0)) == {}


def test_what_is_not_known_is_what_is_felt_now(known: LookaheadCache) -> None:
    known.take(encode_object(scene()))
    known.take(encode_object(block(1, 5)))
    until(lambda: later(known, shown(3.0)) == {40.0: 4.0})  # frame 8 was never told


def test_what_cannot_be_evaluated_is_left_out_and_tried_only_once(
    known: LookaheadCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries = []

    def broken(*_: object) -> None:
        tries.append(1)
        raise ValueError("cannot")

    monkeypatch.setattr(lookahead_cache.Engine, "evaluate", broken)
    known.take(encode_object(scene()))
    known.take(encode_object(block(1, 24)))
    known.take(b"nonsense")
    later(known, shown(3.0))
    until(lambda: len(tries) == 17)  # frames 4 to 20: half a second for both latencies
    time.sleep(0.05)
    assert later(known, shown(3.0)) == {} and len(tries) == 17


def test_what_was_edited_while_it_was_evaluated_is_not_known(
    known: LookaheadCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_done = []

    def edited_meanwhile(*_: object) -> list[Any]:
        known._later(shown(3.0, edition=2))
        is_done.append(1)
        return ["of before"]

    monkeypatch.setattr(lookahead_cache.Engine, "evaluate", edited_meanwhile)
    known.take(encode_object(scene()))
    known.take(encode_object(block(1, 24)))
    later(known, shown(3.0))
    until(lambda: is_done)
    time.sleep(0.05)
    assert "of before" not in [runs[0] for runs in known._known.values()]


def test_nothing_is_begun_while_a_moment_is_answered(known: LookaheadCache) -> None:
    later(known, shown(2.0))
    known._blocks[4000] = block(4, 4), 0
    with known.answering(shown(3.0)):
        assert known._wanted() is None
    assert known._wanted() == 4000


def test_who_is_not_needed_any_more_ends(known: LookaheadCache) -> None:
    known.take(encode_object(scene()))
    known.close()
    assert known._thread is not None
    known._thread.join(PATIENCE_S)
    assert not known._thread.is_alive()


def test_only_so_much_is_known(known: LookaheadCache, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lookahead_cache, "_MOST_KNOWN", 10)
    for frame in range(1, 25):
        later(known, shown(float(frame)))
        assert len(known._known) == len(known._order) <= 10


def test_without_late_actuators_nothing_is_kept() -> None:
    found = LookaheadCache(())
    found.take(encode_object(scene()))
    assert later(found, shown(3.0)) == {}
    assert found._thread is None and not found._known and not found._bodies


@pytest.mark.parametrize("fps", [23.976, 24.0, 30.0, 60.0, 120.0])
def test_a_latency_is_compensated_to_within_5_ms_or_a_twentieth(fps: float) -> None:
    for late_ms in (5.0, 7.0, 13.0, 20.0, 30.0, 80.0, 500.0, 3000.0):
        found_ms = frames_ahead(late_ms, fps) / fps * 1000.0
        assert abs(found_ms - late_ms) <= max(5.0, 0.05 * late_ms) + 1e-6
        (part,) = parts_between([late_ms], fps)
        reverse = parts_between([late_ms], fps, -1)[0]
        assert 0.0 <= part < 1.0 and (part + reverse) % 1.0 == pytest.approx(0.0, abs=1e-5)


def test_playback_begins_again_where_it_ends_either_way() -> None:
    def after(frame: float, step: int = 1) -> float:
        return Playhead(frame, 1, 10, 10.0, True, step).after(200.0)

    assert [after(f) for f in (1, 8, 9, 10, 30)] == [3.0, 10.0, 1.0, 2.0, 32.0]
    assert [after(f, -1) for f in (10, 3, 2, 1, -5)] == [8.0, 1.0, 10.0, 9.0, -7.0]
    assert Playhead(9.0, 1, 10, 10.0, True).next(3).frame == 2.0


MESH = MeshVolume(
    np.float64([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    np.int32([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    "a",
)


def test_plain_data_arrives_as_it_was() -> None:
    sent = (Fraction(24000, 1001), Falloff(FalloffKind.SMOOTH, 0.5), {"a": None, "b": True}, MESH)
    rate, falloff, words, mesh = decode_object(encode_object(sent))
    assert (rate, falloff, words) == sent[:3]
    assert mesh.vertices.tolist() == MESH.vertices.tolist() and mesh.name == "a"
    found = decode_object(encode_object(scene()))
    assert found.description.effects[0].area.vertices.tolist() == [0, 1, 2]
    assert found.tolerance == STANDARD and found.description.time == scene().description.time
