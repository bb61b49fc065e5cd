# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers of JPEG files (ITU-T T.81, annex B)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

_START: Final = b"\xff\xd8"
_SCAN: Final = b"\xff\xda"
_END: Final = b"\xff\xd9"


def is_cut_off(path: Path) -> bool:
    """Test for a JPEG without end marker after the first scan; False for files of another kind.

    Readers show the missing part grey. Raises OSError for an unreadable file.
    """
    data = path.read_bytes()
    if not data.startswith(_START):
        return False
    offset = len(_START)
    # Segments before the first scan are skipped: an embedded thumbnail has its own end marker.
    while offset < len(data) and data[offset : offset + 2] != _SCAN:
        is_fill = data[offset : offset + 2] == b"\xff\xff"
        offset += 1 if is_fill else 2 + int.from_bytes(data[offset + 2 : offset + 4], "big")
    return data.find(_END, offset) < 0
