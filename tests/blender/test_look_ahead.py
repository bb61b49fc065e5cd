# SPDX-License-Identifier: GPL-3.0-or-later
"""Looking ahead for actuators that answer late: as near as matters, and each frame only once."""

from __future__ import annotations

from typing import Any

import pytest

from hfx_blender.playback.evaluation import Evaluation
from hfx_blender.playback.look_ahead import frame_ahead

LATE_MS = (20.0, 30.0, 80.0, 500.0, 3000.0)


class Ahead:
    """Notes what it is asked for."""

    reason = ""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def runs(self, frame: float) -> list[Any]:
        self.asked.append(frame)
        return [frame]


@pytest.fixture
def known() -> tuple[Evaluation, Ahead]:
    found, ahead = Evaluation(), Ahead()
    found._ahead = ahead  # type: ignore[assignment]
    return found, ahead


@pytest.mark.parametrize("fps", [24, 30, 60, 120])
def test_a_latency_is_compensated_to_within_5_ms_or_a_twentieth(scene: Any, fps: int) -> None:
    scene.render.fps, scene.frame_end = fps, 10_000
    scene.frame_set(7)
    for late_ms in (5.0, 7.0, 13.0, *LATE_MS):
        found_ms = (frame_ahead(scene, late_ms) - 7.0) / fps * 1000.0
        assert abs(found_ms - late_ms) <= max(5.0, 0.05 * late_ms) + 1e-6


@pytest.mark.parametrize(("fps", "most"), [(60, 1), (24, 3)])
def test_while_it_plays_a_frame_that_was_looked_at_is_not_evaluated_again(
    scene: Any, known: tuple[Evaluation, Ahead], fps: int, most: int
) -> None:
    scene.render.fps, scene.frame_end = fps, 10_000
    evaluation, ahead = known
    counts = []
    for frame in range(1, 400):
        scene.frame_set(frame)
        evaluation.touch()
        before = len(ahead.asked)
        for late_ms in LATE_MS:
            wanted = frame_ahead(scene, late_ms)
            assert evaluation.runs_at(wanted) == [wanted]
        counts.append(len(ahead.asked) - before)
    assert len(set(ahead.asked)) == len(ahead.asked)
    assert max(counts[4 * fps :]) <= most < len(LATE_MS)


def test_what_was_looked_at_is_forgotten_when_something_is_edited(
    known: tuple[Evaluation, Ahead],
) -> None:
    evaluation, ahead = known
    evaluation.runs_at(3.0)
    evaluation.touch()
    evaluation.runs_at(3.0)
    assert ahead.asked == [3.0]
    evaluation.edited()
    evaluation.runs_at(3.0)
    evaluation.prepare_ahead()
    evaluation._ahead = ahead  # type: ignore[assignment]
    evaluation.runs_at(3.0)
    assert ahead.asked == [3.0] * 3


def test_when_a_frames_time_is_spent_the_nearest_known_is_taken(
    known: tuple[Evaluation, Ahead], monkeypatch: pytest.MonkeyPatch
) -> None:
    evaluation, ahead = known
    for frame in (1.0, 5.0):
        evaluation.runs_at(frame)
    evaluation._spent_s = 1.0
    assert evaluation.runs_at(4.0) == [5.0] and ahead.asked == [1.0, 5.0]
    evaluation.touch()
    assert evaluation.runs_at(4.0) == [4.0]
    evaluation.edited()
    evaluation._spent_s = 1.0
    assert evaluation.runs_at(9.0) == [9.0]  # nothing is known at all
