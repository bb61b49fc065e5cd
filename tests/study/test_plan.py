# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans of studies and the trials made of them."""

from __future__ import annotations

import json
from collections import Counter
from itertools import combinations, pairwise, product
from pathlib import Path
from typing import Any

import pytest

from hfx_blender.cli import run
from hfx_tools.study.design import training_of, trials_of, williams_row
from hfx_tools.study.plan import plan_of, read_plan
from hfx_tools.study.tables import read_table

EXAMPLE = (
    '{"name": "mango96", "seed": 1, "design": "paired", "gap_ms": 400, "factors": {"duration_ms": '
    '[500, 1000], "direction": ["N", "NE", "E"]}, "compare": {"scheme": ["linear", "logarithmic", '
    '"power"]}, "orders": "both", "participants": 12}'
)
SCHEMES = ("linear", "logarithmic", "power")


def _plan(**members: Any) -> dict[str, Any]:
    return {"name": "p", "design": "rating", "scales": [{"id": "a", "text": "A?"}], **members}


def _parsed(document: dict[str, Any]) -> Any:
    return plan_of(json.dumps(document).encode(), Path("plan.json"))


def test_the_example_gives_every_cell_once_for_each_participant(tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(EXAMPLE)
    assert run(["study", "make", str(tmp_path / "plan.json"), "-o", str(tmp_path / "s")]) == 0
    pairs = [pair for pair in product(SCHEMES, SCHEMES) if pair[0] != pair[1]]
    cells = set(product(("500", "1000"), ("N", "NE", "E"), *zip(*pairs, strict=True)))
    cells = {(d, n, *pair) for d, n, pair in product(("500", "1000"), ("N", "NE", "E"), pairs)}
    orders = set()
    for number in range(1, 13):
        rows = read_table(tmp_path / "s" / f"participant-{number:02d}" / "trials.tsv")
        values = [
            (r["duration_ms"], r["direction"], r["scheme_first"], r["scheme_second"]) for r in rows
        ]
        assert len(values) == 36 and set(values) == cells
        orders.add(tuple(values))
    assert len(orders) == 12  # participants have different orders
    assert not (tmp_path / "s" / "participant-13").exists()


def test_mango96_has_96_rows_and_counterbalanced_orders() -> None:
    """2 durations, 8 directions, 3 pairs, 2 orders (Schneider et al., UIST 2015)."""
    plan = read_plan("mango96")
    for number in (1, 2, 18):
        rows = trials_of(plan, number)
        assert len(rows) == 96
        names = ("duration_ms", "direction", "scheme_first", "scheme_second")
        assert set(Counter(tuple(row[n] for n in names) for row in rows).values()) == {1}
        for pair in combinations(SCHEMES, 2):
            first = Counter(
                row["scheme_first"]
                for row in rows
                if {row["scheme_first"], row["scheme_second"]} == set(pair)
            )
            assert list(first.values()) == [16, 16]
        assert set(Counter(row["frequency_hz"] for row in rows).values()) == {24}


def test_a_balanced_order_is_within_one_and_opposite_for_the_next_participant() -> None:
    plan = _parsed(
        {
            "name": "p",
            "design": "paired",
            "orders": "balanced",
            "factors": {"place": ["a", "b", "c", "d", "e"]},
            "compare": {"scheme": ["x", "y", "z"]},
            "participants": 2,
        }
    )
    orders = []
    for number in (1, 2):
        rows = trials_of(plan, number)
        assert len(rows) == 15
        for pair in combinations("xyz", 2):
            firsts = Counter(
                row["scheme_first"]
                for row in rows
                if {row["scheme_first"], row["scheme_second"]} == set(pair)
            )
            assert sorted(firsts.values()) == [2, 3]
        orders.append({(r["place"], r["scheme_first"], r["scheme_second"]) for r in rows})
    assert orders[1] == {(place, second, first) for place, first, second in orders[0]}


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7, 12])
def test_williams_squares_balance_positions_and_successors(count: int) -> None:
    rows = [williams_row(count, k) for k in range(count * (1 + count % 2))]
    share = 1 + count % 2
    for position in range(count):
        assert set(Counter(row[position] for row in rows).values()) == {share}
    neighbours = Counter(pair for row in rows for pair in pairwise(row))
    assert len(neighbours) == count * (count - 1) and set(neighbours.values()) == {share}


def test_a_latin_sequence_puts_each_condition_once_at_each_position() -> None:
    plan = _parsed(_plan(factors={"effect": list("abcd")}, sequence="latin", participants=4))
    rows = [[row["effect"] for row in trials_of(plan, number)] for number in range(1, 5)]
    assert all(sorted(column) == list("abcd") for column in zip(*rows, strict=True))


def test_blocks_are_whole_and_their_order_is_balanced() -> None:
    factors = {"device": ["belt", "pad"], "effect": ["a", "b", "c"]}
    plan = _parsed(_plan(factors=factors, blocks_by="device", repetitions=2))
    firsts = []
    for number in (1, 2):
        devices = [row["device"] for row in trials_of(plan, number)]
        assert devices in (["belt"] * 6 + ["pad"] * 6, ["pad"] * 6 + ["belt"] * 6)
        firsts.append(devices[0])
    assert sorted(firsts) == ["belt", "pad"]


def test_the_trials_of_each_design() -> None:
    board = read_plan("board")
    rows = trials_of(board, 3)
    assert set(Counter(row["surface"] for row in rows).values()) == {4}
    assert sorted(int(row["square"]) for row in rows) == list(range(1, 17))
    textile = trials_of(read_plan("textile-pse"), 2)
    assert set(Counter((r["surface"], r["speed_mm_s"]) for r in textile).values()) == {2}
    assert Counter(row["start"] for row in textile) == {0.05: 6, 1.0: 6}
    levels = {"amplitude": [0.1, 0.2, 0.4]}
    constant = _parsed({"name": "p", "design": "2afc", "levels": levels, "repetitions": 10})
    rows = trials_of(constant, 1)
    assert set(Counter(row["amplitude"] for row in rows).values()) == {10}
    assert Counter(row["target"] for row in rows) == {"first": 15, "second": 15}
    stairs = _parsed(
        {
            "name": "p",
            "design": "staircase",
            "levels": levels,
            "trials": 9,
            "factors": {"frequency_hz": [40, 250]},
            "catch": 2,
        }
    )
    rows = trials_of(stairs, 1)
    assert Counter((row["kind"], row["staircase"]) for row in rows) == {
        ("trial", 1): 9,
        ("trial", 2): 9,
        ("catch", "n/a"): 2,
    }
    assert {row["amplitude"] for row in rows if row["kind"] == "catch"} == {0.4}


def test_training_is_apart_and_catch_trials_are_added() -> None:
    plan = _parsed(
        {
            "name": "p",
            "design": "paired",
            "compare": {"scheme": ["x", "y"]},
            "repetitions": 4,
            "training": 11,
            "catch": 3,
        }
    )
    rows = trials_of(plan, 1)
    assert Counter(row["kind"] for row in rows) == {"trial": 8, "catch": 3}
    catches = [row for row in rows if row["kind"] == "catch"]
    assert all(row["scheme_first"] == row["scheme_second"] for row in catches)
    assert [row["kind"] for row in training_of(plan, 1)] == ["training"] * 11


BAD = [
    ({"design": "abx"}, 'design is "abx", allowed is one of paired, 2afc, staircase'),
    ({"sed": 1}, "'sed' is unknown, allowed are: "),
    ({"participants": 0}, "participants is 0, allowed is a whole number from 1 to 999"),
    ({"gap_ms": "400"}, 'gap_ms is "400", allowed is a number from 0 to 10000 ms'),
    ({"factors": {"effect": []}}, "factors.effect is "),
    ({"factors": {"effect": ["a", "a"]}}, "allowed is each item once"),
    ({"factors": {"effect": [True]}}, "factors.effect[0] is true, allowed is a number, or text"),
    ({"factors": {"effect": ["a\tb"]}}, "factors.effect[0] is "),
    ({"factors": {"Effect": ["a"]}}, "allowed is lower-case letters"),
    ({"factors": {"trial": [1]}}, "allowed is a table without 'trial'"),
    ({"factors": {"duration": [1]}}, "allowed is a table without 'duration'"),
    ({"factors": {"rating_a": [1]}}, "allowed is a table without 'rating_a'"),
    (
        {"design": "paired", "compare": {"x": [1, 2]}, "factors": {"x_first": [1]}},
        "allowed is a table without 'x_first'",
    ),
    ({"factors": {"a": [1]}, "random": {"a": [1]}}, "allowed is a table without 'a'"),
    ({"blocks_by": "device"}, 'blocks_by is "device", allowed is a factor of the plan: none'),
    ({"repetitions": 1000, "factors": {"a": list(range(11))}}, "at most 10000 trials for each"),
    ({"catch": 9}, "catch is 9, allowed is a whole number of catch trials from 0 to 1"),
    ({"scales": []}, "scales is "),
    ({"scales": [{"id": "a", "text": "A"}, {"id": "a", "text": "B"}]}, "with different ids"),
    ({"stimulus": {"kind": "file"}}, 'allowed is a "path" as well'),
    ({"design": "paired", "scales": None}, "'compare' is missing"),
    ({"design": "adjustment", "adjust": {"x": [2, 1]}}, "allowed is a number above 2"),
    ({"design": "2afc", "levels": {"x": [0, 1]}, "scale": "log"}, "levels above 0"),
    ({"design": "2afc", "levels": {"x": [0, 1], "y": [0, 1]}}, "allowed is one factor with its"),
    ({"design": "identification", "identify": "x"}, 'identify is "x", allowed is a factor'),
    (
        {"design": "identification", "identify": "x", "factors": {"x": ["a"]}},
        "allowed is a list of 2 to 100 items",
    ),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=[text for _, text in BAD])
def test_a_bad_plan_is_refused_with_field_and_allowed_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, Any], message: str
) -> None:
    document = _plan(**change)
    if change.get("design", "rating") != "rating":
        del document["scales"]
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(document))
    assert run(["study", "make", str(path), "-o", str(tmp_path / "s")]) == 3
    fault = capsys.readouterr().err
    assert fault.startswith(f"hfx: {path}: ") and fault.count("\n") == 1
    assert message in fault
    assert not (tmp_path / "s").exists()


_PAIRS: dict[str, Any] = json.loads(EXAMPLE)
_TWO_INTERVALS: dict[str, Any] = {"name": "p", "design": "2afc"}
BAD_VALUES = [
    ("compare", {"scheme": ["linear", "quadratic"]}, 'compare.scheme[1] is "quadratic", ', "vbap"),
    ("compare", {"scheme": [1, 2]}, "compare.scheme[0] is 1, ", "one of "),
    ("compare", {"colour": ["red", "green"]}, "'colour' is compared, ", "direction, duration_ms"),
    ("compare", {"strength": [0.5, 2.0]}, "compare.strength[1] is 2.0, ", "a number from 0 to 1."),
    ("compare", {"device": ["back_pad", "x"]}, "compare.device[1]: ", "back_pad"),
    ("factors", {"duration_ms": [0]}, "factors.duration_ms[0] is 0, ", "from 10 to 60000 ms."),
    (
        "factors",
        {"duration_ms": [50, 1e12]},
        "duration_ms[1] is 1000000000000.0, ",
        "10 to 60000 ms",
    ),
    ("factors", {"duration_ms": ["500"]}, 'duration_ms[0] is "500", ', "a number from 10"),
    ("factors", {"direction": ["N", "NNX"]}, 'factors.direction[1] is "NNX", ', "one of N, NE, E"),
    ("factors", {"direction": [400]}, "factors.direction[0] is 400, ", "from -360 to 360"),
    ("factors", {"amplitude": [-0.1]}, "factors.amplitude[0] is -0.1, ", "from 0 to 1"),
    ("factors", {"level_db": [6]}, "factors.level_db[0] is 6, ", "from -120 to 0 dB"),
    ("factors", {"speed_mm_s": [0]}, "factors.speed_mm_s[0] is 0, ", "from 1 to 1000 mm/s"),
    ("random", {"frequency_hz": [2000]}, "random.frequency_hz[0] is 2000, ", "1 to 1000 Hz"),
    ("stimulus", {"kind": "stroke"}, "'surface' is missing", "fabric-denim"),
]


@pytest.mark.parametrize(
    ("table", "change", "fault", "allowed"), BAD_VALUES, ids=[case[2] for case in BAD_VALUES]
)
def test_a_value_for_no_device_is_refused_without_a_device(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    table: str,
    change: dict[str, Any],
    fault: str,
    allowed: str,
) -> None:
    document = _PAIRS | {table: change}
    if table == "factors":
        document[table] = {"direction": ["N"]} | change
    if table == "stimulus":
        document |= {"factors": {}, "compare": {"strength": [0.2, 0.4]}}
    _refused(tmp_path, capsys, document, fault, allowed)


@pytest.mark.parametrize(
    ("change", "fault", "allowed"),
    [
        ({"levels": {"strength": [0.5, 1.5]}}, "levels.strength[1] is 1.5, ", "from 0 to 1."),
        ({"levels": {"duration_ms": [50, 60]}}, "'reference' is missing", "from 10 to 60000 ms"),
        (
            {"levels": {"frequency_hz": [50, 60]}, "reference": 0.5},
            "reference is 0.5, ",
            "1 to 1000 Hz of frequency_hz",
        ),
        ({"levels": {"loudness": [1, 2]}}, "'loudness' is compared, ", "strength"),
    ],
)
def test_levels_and_reference_are_checked_without_a_device(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: dict[str, Any],
    fault: str,
    allowed: str,
) -> None:
    _refused(tmp_path, capsys, _TWO_INTERVALS | change, fault, allowed)


def _refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    document: dict[str, Any],
    fault: str,
    allowed: str,
) -> None:
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(document))
    assert run(["study", "make", str(path), "-o", str(tmp_path / "s")]) == 3
    line = capsys.readouterr().err
    assert line.startswith(f"hfx: {path}: ") and line.count("\n") == 1
    assert fault in line and allowed in line.split(fault)[1]
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"compare": {"scheme": ["vbap", "nearest", "log"]}},
        {"factors": {"direction": [-360, 22.5, "NW"], "duration_ms": [10, 60000]}},
        {"compare": {"strength": [0, 1], "level_db": [-120, 0]}},
        {"random": {"square": ["left", 2]}},
    ],
)
def test_values_at_the_ends_and_random_labels_are_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, Any]
) -> None:
    (tmp_path / "plan.json").write_text(json.dumps(_PAIRS | change))
    assert run(["study", "make", str(tmp_path / "plan.json"), "-o", str(tmp_path / "s")]) == 0
    assert capsys.readouterr().err == ""


def test_a_factor_without_effect_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = _PAIRS | {"factors": {"direction": ["N"], "visit": [1, 2]}}
    (tmp_path / "plan.json").write_text(json.dumps(document))
    assert run(["study", "make", str(tmp_path / "plan.json"), "-o", str(tmp_path / "s")]) == 0
    assert "no stimulus depends on factors.visit" in capsys.readouterr().err


def test_a_missing_plan_names_the_shipped_plans(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["study", "make", "mango", "-o", "s"]) == 3
    assert "shipped plans are: board, mango96, textile-pse" in capsys.readouterr().err


def test_a_folder_with_files_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert run(["study", "make", "board", "-o", str(tmp_path)]) == 3
    assert "is not empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_delete_removes_lists_and_data_of_a_participant(tmp_path: Path) -> None:
    study = tmp_path / "s"
    assert run(["study", "make", "board", "-o", str(study)]) == 0
    # BIDS refuses a table of participants, or its description, without participants.
    assert not list(study.glob("participants.*"))
    answers = []
    for number in ("02", "03"):
        folder = study / f"sub-{number}" / "beh"
        folder.mkdir(parents=True)
        answers.append(folder / f"sub-{number}_task-board_events.tsv")
        answers[-1].write_text("onset\tduration\n")
    assert run(["study", "delete", str(study), "2"]) == 0
    assert not answers[0].exists() and not (study / "participant-02").exists()
    assert answers[1].exists() and (study / "participant-01").exists()
    assert (study / "participants.tsv").read_text() == "participant_id\nsub-03\n"
    assert "participant_id" in json.loads((study / "participants.json").read_text())
    assert run(["study", "delete", str(study), "3"]) == 0
    assert not list(study.glob("participants.*"))
    assert run(["study", "delete", str(study), "02"]) == 2
    assert run(["study", "delete", str(study), "Anna"]) == 2
