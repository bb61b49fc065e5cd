# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes: speed of queries to a mesh, and exactness of the inside test of every shape.

Speed is compared with ``trimesh`` and its embree rays, exactness with libigl's winding number
and, for the shapes with a formula, with whole-number arithmetic. A comparison with a missing
package is left out and mentioned.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from hfx_blender.engine.arrays import F64, I32, I64
from hfx_blender.engine.native.library import loaded
from hfx_blender.engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from hfx_blender.engine.volume.mesh import MeshVolume
from hfx_blender.engine.volume.shape import Shape, inverse_placement

BAND: Final = 1e-9
"""Points nearer to the boundary than this share of the shape's size are not compared."""

NEAR: Final = 0.02  # of the extent: "near the surface"

_UNIT: Final = 64  # denominator of the matrices' entries
_GRID: Final = 4096  # denominator of the points' coordinates

MATRICES: Final[dict[str, tuple[tuple[int, int, int], ...]]] = {
    "turned": ((10, 15, 30), (15, -30, 10), (30, 10, -15)),
    "mirrored": ((-30, 0, 0), (0, 20, 0), (0, 0, 25)),
    "sheared": ((30, 20, -10), (0, 30, 25), (0, 0, 30)),
    "40 to 1": ((1, 0, 0), (0, 40, 0), (0, 0, 1)),
}
SHAPES: Final[dict[str, Shape]] = {
    "cuboid": Cuboid(),
    "sphere": Sphere(),
    "cylinder": Cylinder(),
    "capsule": Capsule(0.75),
}


def measure(
    *,
    short: bool = False,
    rounds: int = 7,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Any]:
    """Measure speed and exactness; plain data.

    ``short``: 50,000 instead of a million points for each shape.
    """
    count = 50_000 if short else 1_000_000
    rng = np.random.default_rng(1)
    meshes = bench_meshes()
    steps = len(meshes) + len(SHAPES) * len(MATRICES)
    mesh_rows: list[dict[str, Any]] = []
    for name, (vertices, triangles) in meshes.items():
        mesh_rows.append(
            {"shape": name, **measure_mesh(name, vertices, triangles, count, rounds, rng)}
        )
        progress(len(mesh_rows) / steps)
    formula_rows: list[dict[str, Any]] = []
    for shape in SHAPES:
        for matrix in MATRICES:
            comparison = compare_formula(shape, matrix, count, rng)
            formula_rows.append({"shape": shape, "matrix": matrix, **comparison})
            progress((len(mesh_rows) + len(formula_rows)) / steps)
    return {"meshes": mesh_rows, "formulas": formula_rows, "band": BAND, "near": NEAR}


def as_text(result: dict[str, Any]) -> str:
    """Format a result of :func:`measure` for a terminal."""
    lines = [
        f"Mesh volumes, 10,000 points within {result['near']:.0%} of the surface, best of several:",
        f"  {'mesh':24} {'made':>9} {'hfx':>10} {'trimesh':>10} {'ratio':>7}   against the "
        "exact winding number",
    ]
    for row in result["meshes"]:
        trimesh_ms, ratio = row["trimesh_ms"], row["ratio"]
        lines.append(
            f"  {row['shape']:24} {row['build_ms']:6.0f} ms {row['hfx_ms']:7.2f} ms "
            + (f"{trimesh_ms:7.2f} ms {ratio:6.1f}x" if trimesh_ms else f"{'-':>10} {'-':>7}")
            + f"   {_verdict(row)}"
        )
    if not result["meshes"][0]["trimesh_ms"]:
        lines.append("  (trimesh's fast rays, the package 'embreex', are not installed)")
    timed_rows = [row for row in result["meshes"] if "depth_ms" in row]  # not in older histories
    if timed_rows:
        lines.append(
            "The same points: how deep, a bound of the distance, when inside on a way of "
            f"{result['near']:.0%}:"
        )
    lines += [
        f"  {row['shape']:24} {row['depth_ms']:6.2f} ms {row['clearance_ms']:7.2f} ms "
        f"{row['passage_ms']:7.2f} ms"
        for row in timed_rows
    ]
    lines.append("Shapes with a formula, against arithmetic in whole numbers:")
    lines += [
        f"  {row['shape']:10} {row['matrix']:10} {_verdict(row)}" for row in result["formulas"]
    ]
    return "\n".join(lines)


def _verdict(row: dict[str, Any]) -> str:
    if row["wrong"] is None:
        return "not judged (libigl is not installed)"
    return f"{row['wrong']} of {row['judged']} points wrong ({row['unsure']} on the boundary)"


# Meshes


def bench_meshes() -> dict[str, tuple[F64, I32]]:
    """Vertices and triangles of the measured meshes, by name."""
    import trimesh

    torus = trimesh.creation.torus(1.0, 0.3, major_sections=150, minor_sections=90)
    ball = trimesh.creation.icosphere(5)
    x, y, z = ball.vertices.T
    radius = 1.0 + 0.45 * np.sin(7 * x) * np.cos(6 * y) + 0.3 * np.sin(9 * z)
    return {
        f"torus, {len(torus.faces)} faces": (
            np.array(torus.vertices, np.float64),
            np.array(torus.faces, np.int32),
        ),
        f"dented, {len(ball.faces)} faces": (
            np.array(ball.vertices * radius[:, None], np.float64),
            np.array(ball.faces, np.int32),
        ),
    }


def measure_mesh(
    name: str, vertices: F64, triangles: I32, count: int, rounds: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Time the inside test and trimesh's, and count wrong answers by the winding number."""
    start = time.perf_counter()
    volume = MeshVolume(vertices, triangles, name)
    points = _near_surface(vertices, triangles, 10_000, rng)
    columns = np.ascontiguousarray(points.T)
    volume.contains(columns)  # the first query builds the voxels
    build_s = time.perf_counter() - start
    trimesh_mesh = _trimesh_mesh(vertices, triangles)
    hfx_s, trimesh_s, differ = [], [], None
    for k in range(rounds + 1):
        inside, seconds = _time_call(lambda: volume.contains(columns))
        if k:
            hfx_s.append(seconds)
        if trimesh_mesh is None:
            continue
        trimesh_inside, seconds = _time_call(lambda: trimesh_mesh.contains(points))
        differ = int(np.count_nonzero(inside != trimesh_inside))
        if k:
            trimesh_s.append(seconds)
    return {
        "build_ms": 1e3 * build_s,
        # The minimum of each: other load on the machine only adds.
        "hfx_ms": 1e3 * min(hfx_s),
        "trimesh_ms": 1e3 * min(trimesh_s) if trimesh_s else None,
        "ratio": min(trimesh_s) / min(hfx_s) if trimesh_s else None,
        "trimesh_differs": differ,
        **_time_queries(volume, columns, rounds, rng),
        **_compare_winding(volume, vertices, triangles, count, rng),
    }


def _time_queries(
    volume: MeshVolume, points: F64, rounds: int, rng: np.random.Generator
) -> dict[str, float]:
    """Milliseconds of depth, clearance and passage queries with a built tree, minimum of rounds."""
    reach = NEAR * float(np.ptp(points, axis=1).max())
    ends = points + reach * rng.uniform(-1.0, 1.0, points.shape)
    questions: dict[str, Callable[[], Any]] = {
        "depth_ms": lambda: volume.depth_m(points, np.eye(4)),
        "clearance_ms": lambda: clearances(volume, points),
        "passage_ms": lambda: passages(volume, points, ends),
    }
    milliseconds = {}
    for name, question in questions.items():
        question()
        milliseconds[name] = 1e3 * min(_time_call(question)[1] for _ in range(rounds))
    return milliseconds


def clearances(volume: MeshVolume, points: F64) -> F64:
    """Signed lower bounds of the distance to the boundary of points (3, N), shape space, (N,).

    Positive outside, negative inside; all points nearer than the absolute value are on the same
    side. 0 where no bound is known without a search, NaN for NaN. Needs the compiled library.
    """
    bounds = np.empty(points.shape[1])
    loaded().hfx_mesh_clearances(volume.compiled(), points, points.shape[1], bounds)
    return bounds


def passages(volume: MeshVolume, starts: F64, ends: F64) -> tuple[F64, F64]:
    """First and last time at which points in straight, even motion are inside, (N,) each.

    Time is 0 at ``starts`` (3, N) and 1 at ``ends``; infinity and -infinity for a point that is
    never inside. A point may leave the mesh in between. Needs the compiled library.
    """
    first, last = np.empty((2, starts.shape[1]))
    loaded().hfx_mesh_passages(volume.compiled(), starts, ends, len(first), first, last)
    return first, last


def _time_call(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


def _trimesh_mesh(vertices: F64, triangles: I32) -> Any:
    """Trimesh mesh with embree rays; None without the package embreex."""
    import trimesh

    if not trimesh.ray.has_embree:
        return None
    return trimesh.Trimesh(vertices, triangles, process=False)


def _near_surface(vertices: F64, triangles: I32, count: int, rng: np.random.Generator) -> F64:
    """Random points along the normals of random triangles, (count, 3)."""
    corners = vertices[triangles[rng.integers(len(triangles), size=count)]]
    shares = rng.dirichlet(np.ones(3), count)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    reach = NEAR * float(np.ptp(vertices, axis=0).max())
    away = rng.uniform(-reach, reach, (count, 1)) * normals / np.where(lengths > 0, lengths, 1.0)
    return np.einsum("nk,nki->ni", shares, corners) + away


def _compare_winding(
    volume: MeshVolume, vertices: F64, triangles: I32, count: int, rng: np.random.Generator
) -> dict[str, int | None]:
    try:
        import igl
    except ImportError:
        return {"wrong": None, "judged": 0, "unsure": 0}
    faces = triangles.astype(np.int64)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    wrong = judged = unsure = 0
    for first in range(0, count, 50_000):
        size = min(50_000, count - first)
        points = np.concatenate(
            [
                _near_surface(vertices, triangles, size // 2, rng),
                rng.uniform(low, high, (size - size // 2, 3)),
            ]
        )
        winding = igl.fast_winding_number(vertices, faces, points)
        inside = volume.contains(np.ascontiguousarray(points.T))
        # The fast number is approximate: the exact number is computed in doubt.
        plain = np.abs(np.abs(winding) - np.rint(np.abs(winding))) < 0.1
        plain &= (np.rint(np.abs(winding)) > 0) == inside
        doubtful = np.flatnonzero(~plain)
        differs = np.zeros(size, np.bool_)
        if len(doubtful):
            exact = np.abs(igl.winding_number(vertices, faces, points[doubtful])) > 0.5
            differs[doubtful] = exact != inside[doubtful]
        squared = igl.point_mesh_squared_distance(points[differs], vertices, faces)[0]
        on_boundary = int(np.count_nonzero(squared <= (BAND * np.ptp(vertices)) ** 2))
        unsure += on_boundary
        wrong += int(np.count_nonzero(differs)) - on_boundary
        judged += size - on_boundary
    return {"wrong": wrong, "judged": judged, "unsure": unsure}


# Shapes with a formula


def compare_formula(name: str, kind: str, count: int, rng: np.random.Generator) -> dict[str, int]:
    """Compare a shape's inside test with whole-number arithmetic, on rational points; counts."""
    whole = np.array(MATRICES[kind], np.int64)
    offset = np.array([17, -5, 40], np.int64)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = whole / _UNIT, offset / _UNIT
    shape = SHAPES[name]
    points = _lattice_points(shape, matrix, count, rng)

    adjugate = np.rint(np.linalg.inv(whole.astype(float)) * np.linalg.det(whole)).astype(np.int64)
    bottom = round(np.linalg.det(whole)) * _UNIT
    # points are q / 4096 and offsets b / 64: L^-1 (p - t) = adj (q - 64 b) / (64 det).
    top = np.abs(adjugate @ (points - (_GRID // _UNIT) * offset[:, None]))
    distance, size = _whole_distance(name, top, abs(bottom))

    (inverse,), _ = inverse_placement(matrix[None])
    world = points / _GRID
    inside = shape.contains(inverse[:3, :3] @ world + inverse[:3, 3:])
    sure = np.abs(distance) > BAND * size
    wrong = int(np.count_nonzero(inside[sure] != (distance[sure] < 0)))
    judged = int(np.count_nonzero(sure))
    return {"wrong": wrong, "judged": judged, "unsure": count - judged}


def _whole_distance(name: str, top: I64, bottom: int) -> tuple[I64, float]:
    """Signed whole-number distance to the boundary, negative inside, and the shape's size in it.

    Distance and size share one scale, linear or squared by shape.
    """
    x, y, z = top
    if name == "cuboid":
        return np.max(top, axis=0) - bottom, float(bottom)
    square = bottom * bottom
    if name == "sphere":
        return x * x + y * y + z * z - square, float(square)
    if name == "cylinder":
        return np.maximum(x * x + y * y, z * z) - square, float(square)
    beyond = np.maximum(4 * z - 3 * bottom, 0)  # half the segment is 3/4 of the radius
    return 16 * (x * x + y * y) + beyond * beyond - 16 * square, 16.0 * square


def _lattice_points(shape: Shape, matrix: F64, count: int, rng: np.random.Generator) -> I64:
    """Points (3, count) in 1/4096 m: half within 1.1 x the box, half at the boundary."""
    low, high = shape.bounds
    local = rng.uniform(1.1 * low[:, None], 1.1 * high[:, None], (3, count))
    near = local[:, : count // 2]
    inner, outer = np.zeros(near.shape[1]), np.full(near.shape[1], 4.0)
    for _ in range(40):  # along the ray from the centre
        middle = 0.5 * (inner + outer)
        inside = shape.contains(near * middle)
        inner, outer = np.where(inside, middle, inner), np.where(inside, outer, middle)
    local[:, : count // 2] = near * inner * rng.uniform(0.999, 1.001, near.shape[1])
    world = matrix[:3, :3] @ local + matrix[:3, 3:]
    return np.rint(world * _GRID).astype(np.int64)
