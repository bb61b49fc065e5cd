# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes find what one finds, whatever becomes of them."""

from __future__ import annotations

import os
import pickle
import signal
import time
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from both_ways import by_reference, needs_library

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.evaluate import Engine
from hfx_blender.engine.native.threads import Threads
from hfx_blender.engine.parallel import evaluating
from hfx_blender.engine.parallel.evaluating import evaluated
from hfx_blender.engine.parallel.serialization import decode_object, encode_object
from hfx_blender.engine.response_filters.controls import CONTROLS, WIDTH, Filter, FilterKind
from hfx_blender.engine.scene import (
    AnimationBlock,
    BodyDescription,
    EffectBlock,
    EffectDescription,
    HapticVolume,
    PaintedArea,
    PoseBlock,
    SceneDescription,
    SkinBinding,
    TimeBase,
)
from hfx_blender.engine.tolerance import PAPER, STANDARD, Tolerance
from hfx_blender.engine.volume.analytic import Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Falloff, Shape

MODEL = load_model("hfx-temperature-1")
SAMPLES, SIZE = 72, 6

TETRAHEDRON = MeshVolume(
    np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]),
    np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32),
    "tetrahedron",
)


def _effect(name: str, area: HapticVolume | PaintedArea) -> EffectDescription:
    return EffectDescription(name, name, "temperature", MODEL.id, area)


def _scene(*filters: Filter) -> SceneDescription:
    painted = PaintedArea("anna", np.arange(5, dtype=np.int32), np.full(5, 0.5, np.float32))
    return SceneDescription(
        TimeBase(Fraction(24), Fraction(24), 0, 0, SAMPLES - 1),
        (BodyDescription("anna", "Anna", SkinBinding(MODEL.bone_names)),),
        (
            _effect("ball", HapticVolume(Falloff())),
            _effect("mesh", HapticVolume(Falloff(), filters)),
            _effect("painted", painted),
        ),
    )


def _volume(
    first: int,
    stop: int,
    shapes: tuple[Shape, ...],
    height_m: float,
    filters: tuple[Filter, ...] = (),
) -> EffectBlock:
    count = stop - first
    matrices = np.tile(np.diag([0.2, 0.2, 0.2, 1.0]), (count, 1, 1))
    matrices[:, 0, 3] = np.linspace(-0.6, 0.6, SAMPLES)[first:stop]
    matrices[:, 2, 3] = height_m
    response = np.zeros((count, len(filters), WIDTH))
    for f, each in enumerate(filters):
        defaults = [control.default for control in CONTROLS[each.kind]]
        response[:, f, : len(defaults)] = defaults
    values = np.full((count, 1), 40.0)
    return EffectBlock(np.ones(count), values, matrices, shapes, response=response)


def _block(start: int, *filters: Filter) -> AnimationBlock:
    history = min(start, 1)
    first, stop = start - history, start + SIZE
    count = stop - first
    bones = np.tile(np.eye(3, 4), (count, len(MODEL.bone_names), 1, 1))
    pose = PoseBlock(np.ones(count, bool), np.tile(np.eye(4), (count, 1, 1)), bones)
    # A mesh that stays is read once, one that changes at every block.
    mesh = (
        TETRAHEDRON
        if start < SAMPLES // 2
        else MeshVolume(TETRAHEDRON.vertices, TETRAHEDRON.triangles, f"changed {start}")
    )
    levels = np.ones(count)
    if start == 2 * SIZE:
        levels[-1] = np.nan
    return AnimationBlock(
        np.arange(first, stop),
        (
            _volume(first, stop, (Sphere(),), 1.2),
            _volume(first, stop, (mesh,), 0.8, filters),
            EffectBlock(levels, np.full((count, 1), 10.0)),
        ),
        (pose,),
        history,
    )


def _blocks(*filters: Filter) -> Iterator[AnimationBlock]:
    return (_block(start, *filters) for start in range(0, SAMPLES, SIZE))


def _plain(value: Any) -> Any:
    """Comparable form of a value: of arrays their bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return [_plain(getattr(value, each.name)) for each in fields(value)]
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def _found(
    processes: int, *filters: Filter, threads: int = 1, tolerance: Tolerance = PAPER
) -> tuple[list[Any], dict[str, object]]:
    engine = Engine(_scene(*filters), tolerance=tolerance, threads=threads)
    found = [
        (block.indices.tolist(), _plain(runs))
        for block, runs in evaluated(
            engine, _blocks(*filters), samples=SAMPLES, processes=processes, worth_s=0.0
        )
    ]
    return found, engine.counters.as_dict()


@pytest.fixture(scope="module")
def alone() -> tuple[list[Any], dict[str, object]]:
    return _found(1)


@pytest.fixture
def helpers(monkeypatch: pytest.MonkeyPatch) -> list[evaluating._Helper]:
    """The processes that help, as they are started."""
    started: list[evaluating._Helper] = []
    start = evaluating._Helper.__init__

    def noted(self: evaluating._Helper, settings: bytes) -> None:
        start(self, settings)
        started.append(self)

    monkeypatch.setattr(evaluating._Helper, "__init__", noted)
    return started


def _is_over(process: int) -> bool:
    """Test that a process ends soon."""
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def test_one_process_feels_something_all_the_time(alone: Any) -> None:
    found, counters = alone
    assert [indices[0] for indices, _ in found] == [0, *range(SIZE - 1, SAMPLES - 1, SIZE)]
    assert counters["contacts"] > SAMPLES * 5
    assert sum(counters["warnings"].values()) == 1


@pytest.mark.parametrize("processes", [2, 3])
def test_several_processes_find_and_count_the_same(
    processes: int, alone: Any, helpers: list[evaluating._Helper], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = []
    evaluate = evaluating._evaluate_here

    def counted(engine: Engine, block: AnimationBlock) -> Any:
        here.append(block)
        return evaluate(engine, block)

    monkeypatch.setattr(evaluating, "_evaluate_here", counted)
    assert _found(processes) == alone
    assert len(helpers) == processes - 1
    assert len(here) < SAMPLES // SIZE - 2  # the first two are not handed out
    assert all(_is_over(helper.pid) for helper in helpers)


@pytest.mark.parametrize("tolerance", [PAPER, STANDARD], ids=lambda each: each.name)
@pytest.mark.parametrize("threads", [2, 4])
def test_threads_find_and_count_the_same(threads: int, tolerance: Tolerance) -> None:
    ringing = Filter(FilterKind.IMPACT)
    alone = _found(1, ringing, tolerance=tolerance)
    assert _found(1, ringing, tolerance=tolerance, threads=threads) == alone


@pytest.mark.parametrize(("share", "count"), [(-1.0, 1), (1e9, 2)])
@needs_library
def test_threads_with_much_to_do_count_as_a_process(
    share: float,
    count: int,
    alone: Any,
    helpers: list[evaluating._Helper],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(evaluating, "_HELP", share)
    assert _found(3, threads=2) == alone
    assert len(helpers) == count


@needs_library
def test_two_processors_are_left_to_threads_that_have_much_to_do(
    alone: Any, helpers: list[evaluating._Helper], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluating, "_HELP", -1.0)
    assert _found(2, threads=2) == alone
    assert not helpers


def test_without_the_library_there_are_no_threads() -> None:
    with by_reference():
        assert Engine(_scene(), threads=2).threads is None
    assert Engine(_scene()).threads is None


def test_threads_tell_how_long_they_were_busy_and_pass_errors_on() -> None:
    def spin() -> str:
        end_s = time.thread_time() + 0.01
        while time.thread_time() < end_s:
            pass
        return "done"

    threads = Threads(2)
    begun = [threads.submit(spin) for _ in range(3)]
    assert [each.result() for each in begun] == ["done"] * 3
    assert threads.busy_s >= 0.03
    with pytest.raises(ZeroDivisionError):
        threads.submit(lambda: 1 // 0).result()


@needs_library
def test_with_threads_a_block_is_begun_before_the_one_before_it_is_given_on() -> None:
    """And counts only when it is given on itself."""
    read: list[int] = []

    def noted() -> Iterator[AnimationBlock]:
        for block in _blocks():
            read.append(int(block.indices[-1]))
            yield block

    engine = Engine(_scene(), tolerance=STANDARD, threads=2)
    found = evaluated(engine, noted(), samples=SAMPLES, processes=1)
    block, _ = next(found)
    assert block.indices[-1] == SIZE - 1
    assert read == [SIZE - 1, 2 * SIZE - 1]
    assert engine.counters.times_evaluated == SIZE
    found.close()
    assert engine.counters.times_evaluated == SIZE


def test_a_helper_that_is_killed_costs_nothing(
    alone: Any, helpers: list[evaluating._Helper], monkeypatch: pytest.MonkeyPatch
) -> None:
    ask, asked = evaluating._Helper.submit, []

    def killed_then_asked(self: evaluating._Helper, block: AnimationBlock) -> Any:
        answer = ask(self, block)
        asked.append(answer)
        if len(asked) == 2:
            os.kill(self.pid, signal.SIGTERM)
        return answer

    monkeypatch.setattr(evaluating._Helper, "submit", killed_then_asked)
    assert _found(2) == alone
    assert len(helpers) == 1 and len(asked) >= 2


def test_a_helper_that_cannot_be_started_is_missing_and_no_more(
    alone: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        evaluating.own_processes, "command", lambda module: [str(Path("no", "such", "python"))]
    )
    assert _found(2) == alone


def test_whoever_stops_in_between_leaves_no_process(helpers: list[evaluating._Helper]) -> None:
    steps = evaluated(
        Engine(_scene(), tolerance=PAPER), _blocks(), samples=SAMPLES, processes=2, worth_s=0.0
    )
    for _ in range(4):
        next(steps)
    (helper,) = helpers
    steps.close()
    assert _is_over(helper.pid)


def test_a_block_that_cannot_be_evaluated_fails_as_it_would_here() -> None:
    def broken(start: int) -> AnimationBlock:
        block = _block(start)
        if start < 5 * SIZE:
            return block
        return AnimationBlock(block.indices, block.effects[:1], block.poses, block.history)

    blocks = map(broken, range(0, SAMPLES, SIZE))
    steps = evaluated(
        Engine(_scene(), tolerance=PAPER), blocks, samples=SAMPLES, processes=2, worth_s=0.0
    )
    with pytest.raises(ValueError, match="zip"):
        list(steps)


def test_what_is_not_worth_it_gets_no_help(helpers: list[evaluating._Helper]) -> None:
    steps = evaluated(Engine(_scene(), tolerance=PAPER), _blocks(), samples=SAMPLES, processes=2)
    assert len(list(steps)) == SAMPLES // SIZE  # far less than two seconds of work
    assert not helpers


def test_responses_settle_in_the_order_of_time() -> None:
    """An impact goes on ringing in later blocks, whoever evaluates them."""
    filters = (Filter(FilterKind.IMPACT), Filter(FilterKind.PROXIMITY))
    (alone, counted), (helped, too) = _found(1, *filters), _found(2, *filters)
    assert helped == alone and too == counted
    assert counted["contacts"] > _found(1)[1]["contacts"]  # it rings on


def test_what_goes_on_from_sample_to_sample_gets_no_help() -> None:
    responding = _scene(Filter(FilterKind.IMPACT))
    assert evaluating._may_be_split(Engine(responding))
    assert not evaluating._may_be_split(Engine(responding, record=("positions",)))
    assert evaluating._may_be_split(Engine(_scene(), record=("positions",)))


def test_only_plain_data_is_made_of_what_is_handed_over() -> None:
    block = decode_object(encode_object(_block(8)))
    assert _plain(block.indices) == _plain(_block(8).indices)
    for value in (print, os.getpid, Path("a")):
        with pytest.raises(pickle.UnpicklingError, match="plain data"):
            decode_object(encode_object(value))
    for text in (
        b"cos\nsystem\n.",
        b"chfx_blender.engine.evaluate\nload_model\n.",
        b"chfx_blender.engine.track.writer\nPath\n.",  # it is at home elsewhere
        b"chfx_blender.engine.track.writer\nTrackWriter\n.",  # it would write
        b"chfx_blender.engine.scene\nnothing\n.",
    ):
        with pytest.raises(pickle.UnpicklingError, match="plain data"):
            decode_object(text)


def test_a_mesh_that_is_known_is_not_sent_again() -> None:
    meshes = evaluating._Meshes()
    kept, fresh = meshes.of(_block(0))
    assert not kept and list(fresh.values()) == [TETRAHEDRON]
    kept, fresh = meshes.of(_block(SIZE))
    assert len(kept) == 1 and not fresh
    kept, fresh = meshes.of(_block(SAMPLES - SIZE))
    assert not kept and [mesh.name for mesh in fresh.values()] == [f"changed {SAMPLES - SIZE}"]
    block = _block(0)
    assert b"tetrahedron" in encode_object(block)
    assert b"tetrahedron" not in encode_object(block, {TETRAHEDRON: 1})
    assert decode_object(encode_object(block, {TETRAHEDRON: 1}), {1: TETRAHEDRON}).effects[
        1
    ].shapes == (TETRAHEDRON,)
