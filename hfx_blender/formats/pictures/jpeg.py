# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers of JPEG files (ITU-T T.81, annex B)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

_START: Final = b"\xff\xd8"
_SCAN: Final = b"\xff\xda"
_END: Final = b"\xff\xd9"


def is_cut_off(path: Path) -> bool:
    """Test for a JPEG without its end, of which readers show grey where data are missing."""
    data = path.read_bytes()
    if not data.startswith(_START):
        return False
    place = len(_START)
    # A thumbnail, which has an end of its own, stands in a segment before the first scan.
    while place < len(data) and data[place : place + 2] != _SCAN:
        is_fill = data[place : place + 2] == b"\xff\xff"
        place += 1 if is_fill else 2 + int.from_bytes(data[place + 2 : place + 4], "big")
    return data.find(_END, place) < 0
