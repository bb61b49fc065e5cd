# SPDX-License-Identifier: GPL-3.0-or-later
"""Point clouds: round trips in all encodings of PLY, and refusal in one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hfx_blender.errors import InputError
from hfx_blender.formats.pictures import point_cloud

POINTS = np.array([[0.0, 0.0, 0.5], [1.0, 0.0, 0.25], [0.0, 2.0, 0.0], [1.0, 2.0, -1.5]])


def ply(kind: str, count: int = len(POINTS), extra: str = "") -> bytes:
    head = (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {count}\n"
        f"property float x\nproperty double y\n{extra}property float z\n"
        "element face 0\nproperty list uchar int vertex_indices\nend_header\n"
    )
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(kind)
    if order is None:
        middle = "7 " if extra else ""
        body = "".join(f"{x} {y} {middle}{z}\n" for x, y, z in POINTS).encode()
    else:
        columns = [("x", f"{order}f4"), ("y", f"{order}f8")]
        columns += [("c", "u1")] if extra else []
        table = np.zeros(len(POINTS), np.dtype([*columns, ("z", f"{order}f4")]))
        for k, axis in enumerate("xyz"):
            table[axis] = POINTS[:, k]
        body = table.tobytes()
    return head.encode() + body


@pytest.mark.parametrize("extra", ["", "property uchar c\n"])
@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_every_kind_of_ply(tmp_path: Path, kind: str, extra: str) -> None:
    path = tmp_path / "p.ply"
    path.write_bytes(ply(kind, extra=extra))
    assert np.array_equal(point_cloud.read(path), POINTS)


@pytest.mark.parametrize("mark", [" ", ",", "; ", "\t"])
def test_lines_of_points(tmp_path: Path, mark: str) -> None:
    path = tmp_path / "p.xyz"
    rows = [mark.join(map(str, [*point, 255])) for point in POINTS]
    path.write_text("# x y z colour\n" + "\n".join(rows))
    assert np.array_equal(point_cloud.read(path), POINTS)


def test_missing_measurements_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "p.xyz"
    path.write_text("nan nan nan\n0 0 0\n1 0 0\n0 1 0\n0 1 inf\n")
    assert len(point_cloud.read(path)) == 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (ply("ascii", 9), "ends early"),
        (ply("binary_little_endian", 9), "ends early"),
        (ply("binary_middle_endian"), "header"),
        (ply("ascii", -1), "header"),
        (ply("ascii", 10**12), "header"),
        (ply("ascii").replace(b"float x", b"float16 x"), "header"),
        (ply("ascii").replace(b"float x", b"float a"), "no x, y and z"),
        (ply("ascii").replace(b"0.25", b"high"), "no three numbers"),
        (ply("ascii").replace(b"double y", b"double x"), "header"),
        (b"ply\nend_header\n", "header"),
        (b"plyplyply", "no PLY"),
        (b"", "no PLY"),
    ],
)
def test_a_broken_ply_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "p.ply"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        point_cloud.read(path)


@given(st.binary(max_size=400), st.integers(0, 400))
def test_any_bytes_are_points_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, offset: int
) -> None:
    whole = ply("binary_little_endian")
    for name, content in (("p.ply", whole[:offset] + noise), ("p.xyz", noise)):
        path = tmp_path_factory.getbasetemp() / name
        path.write_bytes(content)
        try:
            points = point_cloud.read(path)
        except InputError as error:
            assert name in str(error)
        else:
            assert points.shape[1] == 3 and np.isfinite(points).all()
