# SPDX-License-Identifier: GPL-3.0-or-later
"""Safety bench: distinguishes silence from never having played, and detects a leaking limiter."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender.devices.host.guard import Guard
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_tools.bench.safety import safety, safety_stops, safety_values
from hfx_tools.bench.safety.safety_stops import Log, NotPlayedError, NotSilentError, gaps_of


def loud(time_s: float) -> dict[str, Any]:
    return {"time_s": time_s, "values": [10.0, 100.0]}


def quiet(time_s: float) -> dict[str, Any]:
    return {"time_s": time_s, "values": [0.0, 100.0]}


def stop(time_s: float) -> dict[str, Any]:
    return {"time_s": time_s, "stop": True}


def log_of(folder: Path, *rows: dict[str, Any]) -> Log:
    path = folder / "log"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return Log(path)


def test_silence_is_counted_from_the_fault_to_the_first_stop(tmp_path: Path) -> None:
    log = log_of(tmp_path, loud(1.0), loud(2.0), stop(2.5), stop(2.6))
    assert log.silence_after(2.1) == pytest.approx(0.4)


def test_a_stop_that_something_loud_follows_is_none(tmp_path: Path) -> None:
    rows = [loud(1.0), stop(2.0), loud(2.1)]
    assert log_of(tmp_path, *rows).silence_after(1.5) is None
    assert log_of(tmp_path, *rows, stop(3.0)).silence_after(1.5) == pytest.approx(1.5)


def test_imperceptible_values_are_no_stop(tmp_path: Path) -> None:
    assert log_of(tmp_path, loud(1.0), quiet(2.0)).silence_after(1.5) is None


@pytest.mark.parametrize("rows", [[], [quiet(1.0)], [loud(0.5), stop(1.0)]])
def test_a_device_that_did_not_play_at_the_fault_says_nothing(
    tmp_path: Path, rows: list[dict[str, Any]]
) -> None:
    with pytest.raises(NotPlayedError):
        log_of(tmp_path, *rows, stop(2.0)).silence_after(1.5)


def test_an_incomplete_line_is_left_out(tmp_path: Path) -> None:
    log = log_of(tmp_path, loud(1.0))
    path = tmp_path / "log"
    path.write_text(path.read_text() + '{"time_s": 2.0, "st')
    assert len(log.read()) == 1
    path.write_text(path.read_text() + 'op": true}\n')
    assert log.silence_after(1.5) == 0.5


class Scripted(safety_stops.Rounds):
    """Simulated measurement rounds."""

    def __init__(self, *answers: float | type[Exception]) -> None:
        self._answers = list(answers)
        self.recovered = 0

    def round(self) -> float:
        answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        if isinstance(answer, float):
            return answer
        raise answer

    def recover(self) -> None:
        self.recovered += 1


def run(kind: Scripted, rounds: int) -> safety_stops.Trials:
    return safety_stops.rounds_of("operator stops", lambda: kind, rounds, lambda share: None)


def test_rounds_without_play_are_repeated_and_rounds_without_silence_are_not() -> None:
    kind = Scripted(0.1, NotPlayedError, 0.2, NotSilentError, 0.3)
    completed = run(kind, 4)
    assert completed.times_s == [0.1, 0.2, 0.3]
    assert (completed.never_silent, completed.not_played, kind.recovered) == (1, 1, 2)
    row = safety.result_row("operator stops", completed)
    assert row["trials"] == 4
    assert not safety.is_within(row)
    assert "1 never silent, 1 repeated" in safety.as_text({"operator stops": row})


def test_a_device_that_hardly_ever_plays_ends_the_measurement() -> None:
    with pytest.raises(InputError, match="does not play"):
        run(Scripted(NotPlayedError), 3)


def test_a_stop_between_values_is_no_gap() -> None:
    gaps = gaps_of([loud(1.0), loud(1.25), stop(1.5), stop(1.5), quiet(2.0), quiet(2.5)])
    assert gaps.times_s == [0.25, 0.5]
    assert gaps.not_played == 1


@pytest.mark.parametrize(
    ("changes", "is_right"),
    [
        ({}, True),
        ({"max_ms": 51.0}, False),
        ({"p99_ms": 26.0}, False),
        ({"never_silent": 1}, False),
        ({"max_ms": None, "p99_ms": None}, False),
    ],
)
def test_a_figure_over_its_limit_is_reported(changes: dict[str, Any], is_right: bool) -> None:
    row = {"trials": 9, "median_ms": 1.0, "p99_ms": 20.0, "max_ms": 40.0, "limit_ms": 50.0}
    row |= {"p99_limit_ms": 25.0, "never_silent": 0, "repeated": 0, **changes}
    assert safety.is_within(row) is is_right
    assert ("over" in safety.as_text({"gap": row})) is not is_right


def test_a_table_is_made_of_records_of_some_rows_idle_and_busy() -> None:
    row = {"trials": 1000, "median_ms": 1.0, "p99_ms": 20.0, "max_ms": 40.0, "limit_ms": 50.0}
    row |= {"never_silent": 0, "repeated": 0, "load": 0.5, "busy": False}
    busy = {**row, "max_ms": 49.04, "load": 4.25, "busy": True, "never_silent": 2}
    leak = {"trials": 7, "what": "values", "faults": 0, "load": 1.0, "busy": False}
    records = [{"safety": {"operator stops": {**row, "max_ms": 1.0}, "limiter": leak}}]
    records += [{"safety": {"operator stops": row}}, {"safety": {"operator stops": busy}}]
    assert safety.as_markdown(records).splitlines()[2:] == [
        "| operator stops | idle, load 0.5 | 1,000 | 1.0 ms | 20.0 ms | 40.0 ms | 50 ms |",
        "| operator stops | busy, load 4.2 | 1,000 | 1.0 ms | 20.0 ms | 49.0 ms, 2 never silent"
        " | 50 ms |",
        "| limiter | idle, load 1.0 | 7 | | | 0 values | 0 |",
    ]


def test_every_row_has_a_measurement() -> None:
    second = {"gap beside hostile scripts", "limiter", "opened files"}
    assert set(safety.ROWS) == set(safety.KINDS) | second


def test_rounds_are_shared_by_those_that_work_at_a_time(tmp_path: Path) -> None:
    completed = safety_stops.run("x", lambda folder: Scripted(0.1), 3, tmp_path, 7)
    assert completed.count == 9 and completed.times_s == [0.1] * 9
    with pytest.raises(InputError, match="does not play"):
        second = tmp_path / "other"
        second.mkdir()
        safety_stops.run("x", lambda folder: Scripted(NotPlayedError), 2, second, 7)


def test_nothing_gets_through_the_limiter() -> None:
    actual = safety_values.limiter(200_000)
    assert actual["trials"] >= 200_000
    assert actual["faults"] == 0


@pytest.mark.parametrize(
    "leak",
    [
        lambda given: np.where(np.arange(len(given)) == 7, np.nan, given),
        lambda given: given * 1.5 + 1.0,
    ],
)
def test_a_limiter_that_leaks_is_found(monkeypatch: pytest.MonkeyPatch, leak: Any) -> None:
    limited = Guard.limited
    monkeypatch.setattr(Guard, "limited", lambda self, *rest: leak(limited(self, *rest)))
    assert safety_values.limiter(10_000)["faults"] > 0


def test_a_limiter_that_rises_too_fast_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    limited = Guard.limited
    monkeypatch.setattr(Guard, "limited", lambda self, wanted, s: limited(self, wanted, 2.0 * s))
    assert safety_values.limiter(10_000)["faults"] > 0


def test_no_code_of_an_opened_linked_or_appended_file_runs(tmp_path: Path) -> None:
    pytest.importorskip("bpy")
    assert safety_values.opened_files(tmp_path, 6)["faults"] == 0


def test_a_row_is_measured_with_user_data_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(resources.USER_DATA_VARIABLE, "as before")
    row = safety.measure(short=True, only=("limiter",))["limiter"]
    assert row["faults"] == 0 and safety.is_within(row)
    assert os.environ[resources.USER_DATA_VARIABLE] == "as before"
