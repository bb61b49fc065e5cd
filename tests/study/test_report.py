# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of studies against closed forms and other packages, and the report of each design."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.special import expit
from study_doubles import eager, make, session_of

from hfx_blender.cli import run
from hfx_blender.errors import InputError
from hfx_tools.study import report
from hfx_tools.study.analysis import analysed
from hfx_tools.study.psychometric import PsychometricGrid, staircase
from hfx_tools.study.statistics import (
    bradley_terry,
    compared,
    holm,
    information_bits,
    mean_interval,
    share_of,
)


def test_a_share_has_wilsons_interval_and_the_exact_binomial_test() -> None:
    """Wilson 1927 for 8 of 10: (k + z^2/2 +- z sqrt(k(n-k)/n + z^2/4)) / (n + z^2)."""
    share = share_of(8, 10)
    z = 1.959963984540054
    middle, reach = 8 + z * z / 2, z * math.sqrt(8 * 2 / 10 + z * z / 4)
    assert (share.low, share.high) == pytest.approx(
        ((middle - reach) / (10 + z * z), (middle + reach) / (10 + z * z))
    )
    # Both tails of the binomial distribution: 2 (45 + 10 + 1) / 1024.
    assert share.p == pytest.approx(112 / 1024)
    assert math.isnan(share_of(0, 0).share)


def test_holm_corrects_step_by_step() -> None:
    """By hand: 0.01 x 4, 0.02 x 3, 0.03 x 2, and no value below the one before."""
    assert holm([0.03, 0.01, 0.04, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([math.nan, 0.01])[1] == 0.01


def test_bradley_terry_of_two_and_of_three() -> None:
    model = bradley_terry(np.array([[0, 30], [10, 0]]))
    assert model.strengths == pytest.approx([0.5 * math.log(3), -0.5 * math.log(3)])
    # The variance of a logit is 1/30 + 1/10; each strength is half of it.
    assert model.errors == pytest.approx([0.5 * math.sqrt(1 / 30 + 1 / 10)] * 2)
    # Frequencies that the model fits exactly: odds 1 : 2 : 4.
    model = bradley_terry(np.array([[0, 20, 12], [40, 0, 20], [48, 40, 0]]))
    assert np.diff(model.strengths) == pytest.approx([math.log(2), math.log(2)])
    assert not bradley_terry(np.array([[0, 5], [0, 0]])).is_finite


def test_bradley_terry_equals_choix() -> None:
    choix = pytest.importorskip("choix")
    rng = np.random.default_rng(3)
    for items in (3, 5, 7):
        wins = rng.integers(1, 30, (items, items))
        np.fill_diagonal(wins, 0)
        data = [(a, b) for a in range(items) for b in range(items) for _ in range(int(wins[a, b]))]
        reference = choix.opt_pairwise(items, data, alpha=0.0, method="Newton-CG", tol=1e-10)
        assert bradley_terry(wins).strengths == pytest.approx(
            reference - reference.mean(), abs=1e-6
        )


def test_friedman_and_wilcoxon_of_a_small_table() -> None:
    """Six participants rank three conditions in the same order: chi-squared is n (k - 1), W is 1;
    the exact two-sided p of six equal signs is 2 / 2^6."""
    table = np.array([[1.0, 2.0, 4.0]] * 6) + np.arange(6)[:, None] * [[0.0, 0.01, 0.02]]
    result = compared(table)
    assert result.statistic == pytest.approx(12.0) and result.w == pytest.approx(1.0)
    assert [pair.p for pair in result.pairs] == pytest.approx([2 / 64] * 3)
    assert [pair.p_holm for pair in result.pairs] == pytest.approx([6 / 64] * 3)
    assert compared(np.vstack([table, [[np.nan, 1.0, 2.0]]])).participants == 6


def test_information_and_means() -> None:
    assert information_bits(np.diag([5, 5, 5, 5])) == pytest.approx(2.0)
    assert information_bits(np.full((4, 4), 3)) == pytest.approx(0.0)
    # Student's t of 2 degrees of freedom is 4.3027 at 97.5 %.
    assert mean_interval(np.array([1.0, 2.0, 3.0])) == pytest.approx(
        (2.0, 2.0 - 4.3027 / math.sqrt(3), 2.0 + 4.3027 / math.sqrt(3)), abs=1e-4
    )


@pytest.mark.parametrize("guess", [0.5, 0.0])
def test_a_fit_recovers_the_function_of_many_answers(guess: float) -> None:
    levels = np.geomspace(0.01, 1.0, 9)
    share = expit((np.log10(levels) - math.log10(0.1)) / 0.15)
    lapse = 0.02
    chances = guess + (1.0 - guess - lapse) * share if guess else lapse / 2 + (1 - lapse) * share
    grid = PsychometricGrid(levels.tolist(), is_logarithmic=True, guess=guess)
    fit = grid.fit(np.round(chances * 2000).astype(int), np.full(9, 2000))
    assert fit.threshold == pytest.approx(0.1, rel=0.02)
    assert fit.low < 0.1 < fit.high < 1.15 * fit.low
    assert fit.spread == pytest.approx(0.15, rel=0.1)
    assert [fit.share(level) for level in levels] == pytest.approx(chances.tolist(), abs=0.02)


def test_thresholds_of_simulated_observers() -> None:
    """Fifty staircases of 40 trials; ``tests/manual/study/check_observers.py`` runs a thousand."""
    levels = np.geomspace(0.01, 1.0, 13)
    rng = np.random.default_rng(2)
    grid = PsychometricGrid(levels.tolist(), is_logarithmic=True, guess=0.5)
    factors, covered = [], 0
    for _ in range(50):
        threshold = float(rng.uniform(-1.5, -0.5))
        stairs = staircase(levels.tolist(), is_logarithmic=True, guess=0.5)
        yes, total = np.zeros(13, np.int64), np.zeros(13, np.int64)
        for _ in range(40):
            level = stairs.next_level()
            chance = 0.5 + 0.49 * expit((math.log10(levels[level]) - threshold) / 0.1)
            is_yes = bool(rng.random() < chance)
            stairs.observe(level, is_yes)
            yes[level] += is_yes
            total[level] += 1
        fit = grid.fit(yes, total)
        factors.append(fit.threshold / 10.0**threshold)
        covered += fit.low <= 10.0**threshold <= fit.high
    assert 0.85 <= np.median(factors) <= 1.15
    assert covered >= 43


def _answered(folder: Path, document: dict[str, Any], answer: Any = eager) -> Any:
    """Study with the answers of participants 01 to 03."""
    study = make(folder, {"stimulus": {"duration_ms": 50}, **document})
    for number in (1, 2, 3):
        session, _, _, answers = session_of(study, answer, f"{number:02d}")
        with answers:
            assert session.run()
    return study


DESIGNS: dict[str, dict[str, Any]] = {
    "paired": {"compare": {"strength": [0.2, 0.4, 0.6]}, "catch": 2},
    "2afc": {"levels": {"strength": [0.1, 0.2, 0.4]}, "repetitions": 3},
    "staircase": {"levels": {"strength": [0.1, 0.2, 0.4]}, "trials": 6},
    "adjustment": {"adjust": {"strength": [0.1, 0.2, 0.4]}, "factors": {"frequency_hz": [80, 99]}},
    "rating": {
        "factors": {"strength": [0.1, 0.2, 0.4]},
        "scales": [{"id": "calm", "text": "Was it <calm>?"}],
        "questionnaire": "nasa-tlx",
    },
    "identification": {"factors": {"strength": [0.1, 0.2, 0.4]}, "identify": "strength"},
}


@pytest.mark.parametrize("design", DESIGNS)
def test_the_report_of_each_design_is_one_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], design: str
) -> None:
    rng = random.Random(4)

    def guess(screen: Any) -> Any:
        count = len(screen.get("choices", ())) or screen.get("steps", 0)
        if screen["kind"] in ("choice", "scale"):
            return {"type": "answer", "value": rng.randint(1, count)}
        return eager(screen)

    document = {"name": "p", "title": "a < b", "design": design, **DESIGNS[design]}
    study = _answered(tmp_path, document, guess)
    capsys.readouterr()
    assert run(["study", "report", str(study.folder), "--json"]) == 0
    results = json.loads(capsys.readouterr().out)
    assert results["participants"] == 3 and results["design"] == design
    page = (study.folder / report.REPORT).read_text()
    assert "<h1>a &lt; b</h1>" in page and "nan" not in page.lower().replace("nano", "")
    assert "<script" not in page and "@media print" in page and "http" not in page.split("<svg")[0]
    for part in page.split("<svg")[1:]:
        ElementTree.fromstring("<svg" + part.split("</svg>")[0] + "</svg>")
    if design == "rating":
        assert "Was it &lt;calm&gt;?" in page
        assert results["nasa_tlx"]["participants"] == 3
        assert set(results["nasa_tlx"]["sums"]) == {"01", "02", "03"}
    if design == "paired":
        assert results["catch"]["total"] == 6 and results["trials"] == 18


def test_the_report_counts_preferences_by_hand(tmp_path: Path) -> None:
    """An observer who always answers "first": every alternative is preferred as often as not."""
    study = _answered(tmp_path, {"name": "p", "design": "paired", **DESIGNS["paired"]})
    results = analysed(study)
    assert results["wins"] == [[0, 3, 3], [3, 0, 3], [3, 3, 0]]
    assert results["order"]["share"] == 1.0
    assert results["bradley_terry"]["strengths"] == pytest.approx([0.0, 0.0, 0.0])
    assert results["bradley_terry"]["p"] == pytest.approx(1.0)


def test_confusions_are_counted_by_the_answer(tmp_path: Path) -> None:
    document = {"name": "p", "design": "identification", **DESIGNS["identification"]}
    results = analysed(_answered(tmp_path, document))
    assert results["confusion"] == [[3, 0, 0], [3, 0, 0], [3, 0, 0]]
    assert results["correct"]["share"] == pytest.approx(1 / 3)
    assert results["information_bits"] == pytest.approx(0.0)


def test_a_study_without_answers_and_a_changed_answer_are_refused(tmp_path: Path) -> None:
    study = make(tmp_path, {"name": "p", "design": "paired", **DESIGNS["paired"]})
    with pytest.raises(InputError, match="has no answers"):
        analysed(study)
    study = _answered(tmp_path / "b", {"name": "p", "design": "paired", **DESIGNS["paired"]})
    path = study.data_file("02")
    path.write_text(path.read_text().replace("\tfirst\t", "\tboth\t"))
    with pytest.raises(InputError, match="response is 'both', allowed is one of first, second"):
        analysed(study)
