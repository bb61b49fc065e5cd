# SPDX-License-Identifier: GPL-3.0-or-later
"""Several threads give the results of one; scenes and blocks as bytes for other processes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from both_ways import by_reference, needs_library

from hfx_blender.engine import evaluate
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.contact import contacts, narrow_phase
from hfx_blender.engine.evaluate import Engine
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
    for f, item in enumerate(filters):
        defaults = [control.default for control in CONTROLS[item.kind]]
        response[:, f, : len(defaults)] = defaults
    values = np.full((count, 1), 40.0)
    return EffectBlock(np.ones(count), values, matrices, shapes, response=response)


def _block(start: int, *filters: Filter) -> AnimationBlock:
    history = min(start, 1)
    first, stop = start - history, start + SIZE
    count = stop - first
    bones = np.tile(np.eye(3, 4), (count, len(MODEL.bone_names), 1, 1))
    pose = PoseBlock(np.ones(count, bool), np.tile(np.eye(4), (count, 1, 1)), bones)
    # A constant mesh is read once, a changing mesh at every block.
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
    """Return a comparable form of a value, with bytes for arrays."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return [_plain(getattr(value, field.name)) for field in fields(value)]
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _found(
    threads: int, *filters: Filter, tolerance: Tolerance = PAPER
) -> tuple[list[Any], dict[str, Any]]:
    engine = Engine(_scene(*filters), tolerance=tolerance, threads=threads)
    evaluated = engine.evaluated(_blocks(*filters))
    actual = [(block.indices.tolist(), _plain([*runs])) for block, runs in evaluated]
    return actual, engine.counters.as_dict()


def test_contacts_exist_at_all_times() -> None:
    actual, counters = _found(1)
    assert [indices[0] for indices, _ in actual] == [0, *range(SIZE - 1, SAMPLES - 1, SIZE)]
    assert counters["contacts"] > SAMPLES * 5
    assert sum(counters["warnings"].values()) == 1


@pytest.mark.parametrize("tolerance", [PAPER, STANDARD], ids=lambda each: each.name)
@pytest.mark.parametrize("threads", [2, 4])
def test_threads_find_and_count_the_same(threads: int, tolerance: Tolerance) -> None:
    """Impacts ring on in later blocks, for any thread of the contact search."""
    ringing = Filter(FilterKind.IMPACT), Filter(FilterKind.PROXIMITY)
    alone = _found(1, *ringing, tolerance=tolerance)
    assert _found(threads, *ringing, tolerance=tolerance) == alone
    assert alone[1]["contacts"] > _found(1, tolerance=tolerance)[1]["contacts"]


def test_without_the_library_there_are_no_threads() -> None:
    with by_reference():
        assert not Engine(_scene(), threads=2).has_threads
    assert not Engine(_scene()).has_threads


@needs_library
def test_with_threads_blocks_start_before_the_last_is_passed_on() -> None:
    """Warnings count only when the block itself is passed on."""
    read: list[int] = []

    def noted() -> Iterator[AnimationBlock]:
        for block in _blocks():
            read.append(int(block.indices[-1]))
            yield block

    engine = Engine(_scene(), tolerance=STANDARD, threads=2)
    actual = engine.evaluated(noted())
    block, _ = next(actual)
    assert block.indices[-1] == SIZE - 1
    assert read == [SIZE - 1, 2 * SIZE - 1]
    assert engine.counters.times_evaluated == SIZE
    actual.close()
    assert engine.counters.times_evaluated == SIZE


@needs_library
def test_only_some_effects_of_a_crowd_are_in_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each effect in work holds dense weights; two thousand took 3 GB."""
    ringing = Filter(FilterKind.IMPACT), Filter(FilterKind.PROXIMITY)
    expected, answered = _found(2), _found(2, *ringing, tolerance=STANDARD)
    monkeypatch.setattr(evaluate, "_MOST_BEGUN", 1, raising=False)
    assert _found(2, *ringing, tolerance=STANDARD) == answered
    begun, real, most = [0], contacts.begin, [0]

    def counted(query: Any) -> Any:
        finish = real(query)
        begun[0] += 1
        most[0] = max(most[0], begun[0])

        def finished() -> Any:
            begun[0] -= 1
            return finish()

        return finished

    monkeypatch.setattr(contacts, "begin", counted)
    assert _found(2) == expected
    assert most == [2] and begun == [0]


@pytest.mark.parametrize("threads", [1, 2])
def test_a_failing_block_raises_at_its_own_turn(threads: int) -> None:
    def broken(start: int) -> AnimationBlock:
        block = _block(start)
        if start < 5 * SIZE:
            return block
        return AnimationBlock(block.indices, block.effects[:1], block.poses, block.history)

    engine = Engine(_scene(), tolerance=PAPER, threads=threads)
    with pytest.raises(ValueError, match="zip"):
        list(engine.evaluated(map(broken, range(0, SAMPLES, SIZE))))


@needs_library
def test_an_error_in_a_thread_is_raised_where_its_block_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_arguments: Any) -> int:
        raise ZeroDivisionError

    monkeypatch.setattr(narrow_phase.NarrowPhaseCall, "run", fails)
    with pytest.raises(ZeroDivisionError):
        list(Engine(_scene(), tolerance=PAPER, threads=2).evaluated(_blocks()))
