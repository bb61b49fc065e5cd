# SPDX-License-Identifier: GPL-3.0-or-later
"""Blind comparison of two effects, and the start of a study's session."""

from __future__ import annotations

import random
import sys
from pathlib import Path
from typing import Any

import bpy
import pytest

from hfx_blender.authoring.effects import effects
from hfx_blender.commands import left_out
from hfx_blender.operators.effects.take_comparison import BlindTakes
from hfx_blender.operators.live import study_operator


@pytest.fixture
def takes(scene: Any) -> list[bpy.types.Object]:
    return [effects.add_volume(scene, "vibration", "SPHERE") for _ in range(2)]


def test_one_take_plays_at_a_time_and_mutes_come_back(takes: list[bpy.types.Object]) -> None:
    takes[1].hfx.is_muted = True
    comparison = BlindTakes(takes, random.Random(1))
    heard = []
    for _ in range(4):
        playing = [take.name for take in takes if not take.hfx.is_muted]
        assert playing == [comparison.present]
        heard.append((comparison.letter, comparison.present))
        comparison.switch()
    assert [letter for letter, _ in heard] == list("ABAB")
    assert heard[0] == heard[2] != heard[1]
    comparison.end()
    assert [take.hfx.is_muted for take in takes] == [False, True]


def test_preferences_are_counted_for_the_take_and_orders_are_drawn(
    takes: list[bpy.types.Object],
) -> None:
    comparison = BlindTakes(takes, random.Random(3))
    letters = []
    for _ in range(40):
        # A participant who always prefers the first effect, under either letter.
        if comparison.present != takes[0].name:
            comparison.switch()
        letters.append(comparison.letter)
        comparison.prefer()
    assert 10 <= letters.count("A") <= 30
    assert comparison.end() == f"{takes[0].name}: 40, {takes[1].name}: 0"


def test_an_effect_that_is_deleted_meanwhile_is_left_out(takes: list[bpy.types.Object]) -> None:
    comparison = BlindTakes(takes, random.Random(1))
    bpy.data.objects.remove(takes[0])
    comparison.switch()
    comparison.prefer()
    assert takes[1].name in comparison.end()
    assert not takes[1].hfx.is_muted


def test_it_needs_two_selected_effects(takes: list[bpy.types.Object]) -> None:
    for take in takes:
        take.select_set(True)
    assert bpy.ops.hfx.compare_takes.poll()
    takes[0].select_set(False)
    assert not bpy.ops.hfx.compare_takes.poll()


def test_run_study_needs_a_study_and_the_command(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RuntimeError, match=r"it has no plan\.json"):
        bpy.ops.hfx.run_study(directory=str(tmp_path))
    monkeypatch.setattr(left_out, "module", lambda name: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match="A session needs pip's hfx"):  # before the folder
        bpy.ops.hfx.run_study("INVOKE_DEFAULT")


def test_run_study_starts_the_command_and_reports_its_fault(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plan.json").write_text("{}")
    commands: list[Any] = []
    started = study_operator.start.start

    def start(command: list[str], **settings: Any) -> Any:
        commands.append(command)
        return started([sys.executable, *command[1:]], **settings)

    monkeypatch.setattr(study_operator.start, "start", start)
    monkeypatch.setattr(study_operator.live, "fault", "")
    assert bpy.ops.hfx.run_study(directory=str(tmp_path)) == {"FINISHED"}
    assert commands[0][1:] == ["-m", "hfx_blender", "study", "run", str(tmp_path)]
    study_operator._session[0].wait(60)
    assert study_operator._watch() is None
    assert "plan.json" in study_operator.live.fault and "'design' is missing" in (
        study_operator.live.fault
    )
