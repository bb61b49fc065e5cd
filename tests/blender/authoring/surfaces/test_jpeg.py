# SPDX-License-Identifier: GPL-3.0-or-later
"""JPEG files with a missing end."""

from __future__ import annotations

from pathlib import Path

import pytest

from hfx_blender.authoring.surfaces.image_values import is_jpeg_cut_off

# Start, a segment with a thumbnail (with start and end marks), a scan, data with a stuffed 255.
THUMBNAIL = b"\xff\xe1\0\x08\xff\xd8\xff\xda\xff\xd9"
BEGIN = b"\xff\xd8" + THUMBNAIL + b"\xff\xff\xdb\0\x03x" + b"\xff\xda\0\x02" + b"data\xff\0data"


@pytest.mark.parametrize(
    ("data", "cut_off"),
    [
        (BEGIN + b"\xff\xd9", False),
        (BEGIN + b"\xff\xd9 a film after the picture \xff\xda", False),
        (BEGIN, True),
        (BEGIN[:8], True),
        (b"\xff\xd8", True),
        (b"\x89PNG", False),
        (b"", False),
    ],
)
def test_a_jpeg_without_its_end_is_reported(tmp_path: Path, data: bytes, cut_off: bool) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(data)
    assert is_jpeg_cut_off(path) is cut_off
