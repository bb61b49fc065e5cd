# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmark tool: command line, chart, tables, history, shell."""

from __future__ import annotations

import csv
import io
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfx_blender import cli
from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.tolerance import PAPER
from hfx_blender.errors import InputError
from hfx_blender.processes import blender_session
from hfx_tools import charts
from hfx_tools.bench import economy, machine, preview_cost, volumes
from hfx_tools.bench.trade import trade_chart, trade_report


def row(setting: str, cost: float, error: float, **others: Any) -> dict[str, Any]:
    return {
        "setting": setting,
        "is_preset": setting in ("preview", "standard"),
        "on_front": True,
        "ms_per_frame": cost,
        "read_ms": cost / 2,
        "engine_ms": cost / 2,
        "render_ms": 0.0,
        "missed": 3,
        "extra": 0,
        "contacts": 200,
        "missed_cm2": 1.25,
        "extra_cm2": 0.0,
        "distance_mean_mm": 2.0,
        "distance_p95_mm": 4.0,
        "wrong_share": error,
        "amplitude_mean": error,
        "amplitude_largest": error,
        "onset_mean_ms": 100 * error,
        "onset_largest_ms": 100 * error,
        "events": 5,
        "events_missed": 1,
        "memory_mb": 12.0,
        **others,
    }


def result(*rows: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": "my scene",
        "scene": "A <hall> & more\x07",
        "frames": 24,
        "samples": 100,
        "rate_hz": 100.0,
        "bodies": 1,
        "effects": 2,
        "volumes": 1,
        "devices": ["band"],
        "contacts": 200,
        "settings": list(rows),
    }


ROWS = (row("preview", 1.0, 0.2), row("standard", 2.0, 0.05), row("3mm,5ms", 8.0, 0.05))


def test_measurements_that_are_shown_together_have_one_caption() -> None:
    here = {**machine.describe(), "date": "2026-01-02T03:04:05+00:00", "blender": None}
    with_blender = [{**here, "blender": item} for item in ("4.5.1 LTS", "5.2.0", "4.5.1 LTS")]
    later = {**here, "date": "2026-01-03T00:00:00+00:00", "load": 3.0}
    one_line = machine.as_one_line([later, here, *with_blender])
    assert one_line.startswith(f"hfx {here['hfx']}, Blender 4.5.1 LTS and 5.2.0, Python ")
    assert one_line.endswith(", 2026-01-02 and 2026-01-03")
    assert one_line.count("numpy") == one_line.count(str(here["processor"])) == 1


def test_the_front_has_no_dominated_setting() -> None:
    points = [(3.0, 0.1), (1.0, 0.5), (2.0, 0.5), (4.0, 0.2), (5.0, 0.0)]
    assert trade_chart.front(points) == [1, 0, 4]


def test_settings_within_noise_are_on_the_front() -> None:
    points = [(1.0, 0.5), (1.02, 0.5), (1.04, 0.5), (2.0, 0.1)]
    assert trade_chart.on_front(points) == [0, 1, 3]


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the matplotlib figures of the charts, filled later."""
    stored: list[Any] = []

    @contextmanager
    def chart(*arguments: Any) -> Iterator[Any]:
        with charts.chart(*arguments) as figure:
            stored.append(figure)
            yield figure

    monkeypatch.setattr(trade_chart, "chart", chart)
    return stored


def points(panel: Any) -> list[tuple[float, float]]:
    return [tuple(collection.get_offsets()[0].tolist()) for collection in panel.collections]


def test_settings_without_an_error_bound_are_crosses(figures: list[Any], tmp_path: Path) -> None:
    paper = row("paper", 0.5, 0.2, is_bounded=False)
    trade_chart.draw(result(*ROWS, paper), tmp_path / "with.svg")
    trade_chart.draw(result(*ROWS), tmp_path / "without.svg")
    for panel in figures[0].axes:
        assert points(panel)[0][0] == 0.5
        cross, *circles = (len(collection.get_paths()[0]) for collection in panel.collections)
        assert cross == 4 and all(count > 4 for count in circles)  # two strokes; arcs
    for panel in (*figures[0].axes, *figures[1].axes):
        (line,) = panel.lines
        assert line.get_xdata().tolist() == [1.0, 2.0]  # the slowest is no better than the second


def test_the_chart_has_a_point_for_each_setting_and_panel(
    figures: list[Any], tmp_path: Path
) -> None:
    table, chart = trade_report.write(result(*ROWS), tmp_path)
    assert (table.name, chart.name) == ("trade-my_scene.csv", "trade-my_scene.svg")
    skin, actuators, onsets = figures[0].axes
    assert points(skin) == [(1.0, 20.0), (2.0, 5.0), (8.0, 5.0)]  # ms, % of the samples
    assert points(actuators) == points(skin)
    assert points(onsets) == [(1.0, 20.0), (2.0, 5.0), (8.0, 5.0)]  # ms, ms
    texts = [item.text for item in ET.parse(chart).iter("{http://www.w3.org/2000/svg}text")]
    assert texts.count("preview") == texts.count("standard") == 3
    assert any("A <hall> & more\\x07" in (text or "") for text in texts)
    trade_chart.draw(result(row("exact", 1.0, 0.0)), tmp_path / "single.svg")


def test_the_tables_say_the_same() -> None:
    shown = result(*ROWS)
    text = trade_report.as_text(shown)
    assert "1.50 %" in text and "*standard" in text and "1/5" in text
    lines = trade_report.as_markdown(shown).splitlines()
    assert len(lines) == 2 + len(ROWS) and len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| **preview** \\* |")
    (first, *_) = csv.DictReader(io.StringIO(trade_report.as_csv(shown)))
    assert float(first["ms_per_frame"]) == 1.0 and first["setting"] == "preview"


def test_a_history_grows_and_is_never_damaged(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    assert [machine.append(path, {"k": k}) for k in range(3)] == [1, 2, 3]
    assert [json.loads(line)["k"] for line in path.read_text().splitlines()] == [0, 1, 2]
    for content in (b"no json\n", b"[1]\n", b"\xff\xfe"):
        path.write_bytes(content)
        with pytest.raises(InputError, match="not a history"):
            machine.append(path, {"k": 3})
        assert path.read_bytes() == content


def test_a_measurement_describes_itself() -> None:
    actual = machine.describe()
    assert actual["hfx"] and actual["numpy"] == np.__version__ and actual["processors"] >= 1
    assert json.loads(json.dumps(actual)) == actual
    assert actual["numpy"] in machine.as_line(actual)


def test_whole_numbers_judge_the_formulas(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    for name in volumes.SHAPES:
        for kind in volumes.MATRICES:
            judged = volumes.compare_formula(name, kind, 4000, rng)
            assert judged["wrong"] == 0 and judged["judged"] > 2000
    broken = type("Ball", (), {"contains": lambda self, p: (p**2).sum(axis=0) <= 1.0005})()
    broken.bounds = volumes.SHAPES["sphere"].bounds
    monkeypatch.setitem(volumes.SHAPES, "sphere", broken)
    assert volumes.compare_formula("sphere", "turned", 4000, rng)["wrong"] > 10


def test_the_winding_number_judges_meshes() -> None:
    pytest.importorskip("igl")
    (name, (vertices, triangles)), _ = volumes.bench_meshes().items()
    actual = volumes.measure_mesh(name, vertices, triangles, 2000, 1, np.random.default_rng(2))
    assert (actual["wrong"], actual["judged"]) == (0, 2000)
    assert actual["trimesh_differs"] in (None, 0)


def test_the_economy_probe_touches_nothing() -> None:
    plain = economy.evaluated_case(1, PAPER)().counters
    doubled = economy.doubled_model(load_model(economy.MODEL_ID))
    for extra in ({"idle_volumes": 7}, {"idle_bodies": 1}, {"model": doubled}):
        more = economy.evaluated_case(1, PAPER, **extra)().counters
        assert more.contacts == plain.contacts > 1000
        assert more.vertices_posed == plain.vertices_posed


@pytest.mark.parametrize(
    "arguments",
    [
        ("volumes", "demo"),
        ("economy", "--frames", "1:2"),
        ("trade", "--rounds", "0"),
        ("nothing",),
        ("trade", "demo", "--frames", "a"),
    ],
)
def test_what_makes_no_sense_is_wrong_usage(arguments: tuple[str, ...], capsys: Any) -> None:
    assert cli.run(["bench", *arguments]) == 2
    assert "hfx:" in capsys.readouterr().err


def test_volumes_are_measured_from_the_command_line(
    tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(volumes, "measure", lambda **_: _judged())
    history = tmp_path / "h.jsonl"
    assert cli.run(["bench", "volumes", "--short", "--json", "--history", str(history)]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["short"] is True and said["machine"]["hfx"] and said["volumes"]["meshes"]
    assert json.loads(history.read_text()) == said


def _judged() -> dict[str, Any]:
    mesh = {"shape": "ring", "build_ms": 1.0, "hfx_ms": 1.0, "trimesh_ms": None, "ratio": None}
    judged = {"wrong": None, "judged": 0, "unsure": 0}
    return {"meshes": [{**mesh, **judged}], "formulas": [], "band": 1e-9, "near": 0.02}


def test_the_preview_bench_times_functions_that_exist() -> None:
    blender_session.start()
    frame = preview_cost.PreviewFrame(is_on=True, is_check=False)
    frame.on_frame()  # fails if a timed function of the engine or the drawing is gone
    assert frame.seconds.own > 0.0 and frame.seconds.engine == frame.seconds.card == 0.0
