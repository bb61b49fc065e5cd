# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of the supported Blenders: rows from the output of pytest, written into two pages."""

from __future__ import annotations

from pathlib import Path

import pytest

from release import blender_range
from release.blender_range import Result, Suite, Version

OLD = Version("4.2.0", "3.11", "1.24.3", "1.15.3")
NEW = Version("4.10.1", "3.11", "1.26.4", "1.17.1")
PAGE = "Before\n<!-- blender range -->\n{}<!-- end -->\nAfter\n"
HEAD = "| Blender | Python, NumPy, SciPy | demo | tests inside Blender |\n|---|---|---|---|\n"
ROW = "| 4.5.15 | 3.11, 1.26.4, 1.17.1 | 8 files, equal | 7 passed |\n"


def test_counts_and_reasons_are_read_from_the_output() -> None:
    output = (
        "..s.F\n"
        "SKIPPED [4] tests/blender/a.py:38: no sound: none\n"
        "SKIPPED [1] tests/blender/b.py:3: no sound: none\n"
        "FAILED tests/blender/c.py::test_in - assert 3 passed in 5\n"
        "1 failed, 1234 passed, 5 skipped in 12.34s (0:00:12)\n"
    )
    suite = blender_range.suite_of(output)
    assert suite == Suite({"failed": 1, "passed": 1234, "skipped": 5}, {"no sound: none": 5})
    assert str(suite) == "1 failed, 1,234 passed, 5 skipped" and not suite.is_good
    assert blender_range.suite_of("2 passed in 0.1s\n").is_good
    assert blender_range.suite_of("2 passed, 1 skipped, 3 warnings in 0.1s\n").is_good


@pytest.mark.parametrize(
    "output",
    [
        "",
        "Fatal Python error: Segmentation fault\n",
        "no tests ran in 0.01s\n",
        "3 passed, 1 error in 1s\n",
        "1 failed, 3 passed, 2 warnings in 1s\n",
        "3 skipped in 1s\n",
    ],
)
def test_a_run_that_ended_early_or_without_a_passed_test_is_not_good(output: str) -> None:
    assert not blender_range.suite_of(output).is_good


def test_rows_of_tested_versions_are_replaced_and_sorted_by_number(tmp_path: Path) -> None:
    pages = tmp_path / "README.md", tmp_path / "docs" / "install.md"
    pages[1].parent.mkdir()
    pages[0].write_text(PAGE.format(HEAD + "| 4.2.0 | old |\n" + ROW), encoding="utf-8")
    pages[1].write_text(PAGE.format(""), encoding="utf-8")
    suite = Suite({"passed": 3, "skipped": 2}, {"no sound": 2})
    results = {
        NEW: Result("differs: ['a.csv']", False, None),
        OLD: Result("8 files, equal", True, suite),
    }
    blender_range.write_tables(results, tmp_path)
    assert pages[0].read_text(encoding="utf-8") == PAGE.format(
        HEAD
        + "| 4.2.0 | 3.11, 1.24.3, 1.15.3 | 8 files, equal | 3 passed, 2 skipped |\n"
        + ROW
        + "| 4.10.1 | 3.11, 1.26.4, 1.17.1 | differs: ['a.csv'] | - |\n"
    )
    assert pages[1].read_text(encoding="utf-8") == PAGE.format(
        "| Blender | skipped tests: reason |\n|---|---|\n| 4.2.0 | 2: no sound |\n"
    )
