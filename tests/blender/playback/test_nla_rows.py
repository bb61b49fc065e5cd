# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks of the rows of an NLA Editor."""

from __future__ import annotations

import pytest

from hfx_blender.playback.timeline import nla_rows


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
