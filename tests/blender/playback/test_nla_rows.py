# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks of the rows of an NLA Editor."""

from __future__ import annotations

import pytest

from hfx_blender.playback.timeline import nla_rows

BLOCKS = [(name, [number]) for number, name in enumerate("ABCD")]  # a track each
SAME = [0, 1, 2, 3]  # clips at the same times
Fitting = list[list[int] | None]


@pytest.mark.parametrize(
    ("fitting", "folded", "expected"),
    [
        ([], "", []),
        ([[], SAME, [], SAME, [], SAME], "", [None, 0, None, 1, None, 2]),  # the last is cut off
        ([None, None, None, SAME, [], SAME], "", [None, 0, None, 1, None, 2]),  # scrolled
        ([None, None, SAME, [], SAME], "A", [None, None, 1, None, 2]),  # A was seen folded
        ([[], [], SAME, [], SAME, [], SAME], "", [None, None, 1, None, 2, None, 3]),  # A is folded
        ([[], SAME, [], SAME], "A", [None, 0, None, 1]),  # A is open again
        ([[], [0], [0], [], [1]], "", None),  # a strip of another owner at the same times
    ],
)
def test_tracks_follow_the_order_of_the_objects(
    fitting: Fitting, folded: str, expected: list[int | None] | None
) -> None:
    assert nla_rows.arranged_tracks(fitting, BLOCKS, set(folded), set()) == expected


def test_a_fold_is_remembered_and_an_action_has_a_row() -> None:
    folded: set[str] = set()
    blocks = [("A", [0]), ("B", [nla_rows.ANY, 1])]
    tracks = nla_rows.arranged_tracks([[], [], [0], [0, 1]], blocks, folded, set())
    assert tracks == [None, None, None, 1] and folded == {"A"}


def test_a_track_without_strips_in_view_has_an_empty_row() -> None:
    fitting: Fitting = [[], [], [], [1], []]
    assert nla_rows.arranged_tracks(fitting, BLOCKS[:2], set(), {0}) == [None, 0, None, 1, None]


@pytest.mark.parametrize(
    ("fitting", "expected"),
    [
        ([], []),
        ([[0, 1, 2]] * 3, [0, 1, 2]),  # all in view
        ([[0, 1, 2]] * 2, [None, None]),  # one is folded
        ([[0, 2], [1], [0, 2]], [0, 1, 2]),  # known by the row between
        ([[0], [0]], [None, None]),  # a strip of another object at the same times
        ([[0, 1], [2], [3, 4]], [None, 2, None]),
    ],
)
def test_a_row_has_a_track_only_if_no_other_is_possible(
    fitting: list[list[int]], expected: list[int | None]
) -> None:
    assert nla_rows.certain_tracks(fitting) == expected


def test_names_have_the_order_of_blender() -> None:
    """As BLI_strcasecmp_natural compares: by value of numbers, "." first, shorter names first."""
    names = ["Rain", "Rain.001", "rain 2", "Rain 10", "Rain1", "RainA", "rainb"]
    assert sorted(reversed(names), key=nla_rows.natural_key) == names
