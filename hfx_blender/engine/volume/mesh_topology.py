# SPDX-License-Identifier: GPL-3.0-or-later
"""Repair of triangle meshes into closed, consistently oriented surfaces, and their decimation.

A sound mesh is recognised with numpy alone. trimesh finds connected parts of a faulty mesh;
trimesh's own ``repair`` needs networkx, which the extension does not bundle.

fast-simplification collapses edges by quadrics (Garland and Heckbert, SIGGRAPH 1997) and bounds no
distance. The distances between both surfaces are therefore measured, and results beyond the bound
are discarded.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ..arrays import F64, I32, I64, Bool
from .mesh_distance import TriangleTree

LARGEST_HOLES: Final = 0.25
"""Largest area of all caps as a share of the mesh's: 0.2 for a box without its lid, far more for a
bowl. Beyond this limit a mesh is rather a sheet, which has no inside."""

_SHARE: Final = 4  # factor of face counts between steps
_STEPS: Final = 3
_LEAST_GAIN: Final = 0.5  # largest share of faces that a useful step leaves
_SPARSE: Final = 8  # one of so many vertices is measured after each step
_AGGRESSIVENESS: Final = 3.0  # the default of 7 has six times as large errors
_FINE: Final = 16.0  # largest mean edge length in bounds with any hope of a gain


def merged(vertices: F64, triangles: npt.NDArray[np.integer[Any]]) -> tuple[F64, I32]:
    """Merge coincident vertices; drop unused vertices and degenerate triangles. Vertices are sorted
    in the result (by z, then y, then x); triangles keep their order."""
    used, corners = _used(triangles, len(vertices))
    vertices = vertices[used]
    # Equal vertices become adjacent in sorted order and get the same group.
    order = np.lexsort(vertices.T)
    new = np.ones(len(vertices), np.bool_)
    new[1:] = np.any(vertices[order[1:]] != vertices[order[:-1]], axis=1)
    group = np.zeros(len(vertices), np.int64)
    group[order] = np.cumsum(new) - 1
    corners = group[corners]
    # Merging may collapse triangles, and leave vertices unused.
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    used, corners = _used(corners, int(np.count_nonzero(new)))
    return vertices[order][new][used], corners.astype(np.int32)


def _used(numbers: npt.NDArray[np.integer[Any]], count: int) -> tuple[I64, I64]:
    """Sorted unique ids below ``count``, and the index of each entry of ``numbers`` among them."""
    occurs = np.zeros(count, np.bool_)
    occurs[numbers] = True
    # A running count of used ids is the position of each id.
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[numbers]


def closed_surface(vertices: F64, triangles: I32, name: str) -> tuple[F64, I32, str]:
    """Flip wrongly oriented triangles and close small holes.

    A cap is the cone from a hole's rim to the mean of its corners. Over a rim of any shape it makes
    each edge used equally often in both directions. Returns the vertices, then the apexes of caps;
    the triangles, some flipped, then the caps; and the repairs for the user, with counts, or "".
    Raises InputError for holes that are too large, without a consistent orientation, or without
    trimesh.
    """
    try:
        return _mended(vertices, triangles, name)
    except ImportError as error:
        raise InputError(
            f"'{name}' has holes or flipped normals, and {error.name}, which repairs them, is not "
            f"installed; fill the holes and recalculate the normals."
        ) from error


def _mended(vertices: F64, triangles: I32, name: str) -> tuple[F64, I32, str]:
    """Result of :func:`closed_surface`; raises ImportError without trimesh for a faulty mesh."""
    edge, uses, up = _edges(triangles)
    is_open = uses % 2 == 1
    notes: list[str] = []
    # Edges of holes are unbalanced in any orientation, and are left to the caps.
    if _balance(edge, up)[~is_open].any():
        turned = _turns(triangles)
        triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
        edge, uses, up = _edges(triangles)
        number = int(np.count_nonzero(turned))
        faces = (
            "1 face with a flipped normal"
            if number == 1
            else f"{number} faces with flipped normals"
        )
        notes += [f"'{name}' has {faces}: recalculated for the volume"] * (number > 0)
    # Flipping keeps the number of uses of an edge, so ``is_open`` still holds.
    if is_open.any():
        vertices, triangles, note = _with_caps(vertices, triangles, edge, uses, name)
        notes.append(note)
        edge, uses, up = _edges(triangles)
    if _balance(edge, up).any():
        raise InputError(
            f"'{name}' has faces whose normals cannot be made to agree, so its inside is not "
            f"defined; recalculate its normals or remove its inner faces."
        )
    return vertices, triangles, "; ".join(notes)


def is_closed(triangles: I32) -> bool:
    """Test that each edge is used equally often in both directions."""
    edge, _, up = _edges(triangles)
    return not _balance(edge, up).any()


def _edges(triangles: I32) -> tuple[I64, I64, Bool]:
    """Undirected edges of triangles (F, 3); corner ``k`` starts an edge of triangle ``k // 3``.
    Returns the edge (3 F,) of each corner, the number of corners of each edge (edges,), and a mask
    (3 F,) of edges to the higher vertex id."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    up = starts < ends
    # One integer per undirected edge: unique() of integers is faster than of rows.
    keys = np.minimum(starts, ends).astype(np.int64) * (triangles.max() + 1) + np.maximum(
        starts, ends
    )
    _, edge, uses = np.unique(keys, return_inverse=True, return_counts=True)
    return edge.ravel(), uses, up


def _balance(edge: I64, up: Bool) -> F64:
    """Uses upwards (in vertex ids) minus downwards of each edge, (edges,); 0: balanced."""
    return np.bincount(edge, np.where(up, 1.0, -1.0)).astype(np.float64)


def _with_caps(
    vertices: F64, triangles: I32, edge: I64, uses: I64, name: str
) -> tuple[F64, I32, str]:
    """Close holes: vertices with apexes, triangles with caps, and a note. ``edge`` and ``uses`` are
    of :func:`_edges`. Raises InputError for caps above a quarter of the area."""
    from trimesh.graph import connected_component_labels

    # Opposite uses of an edge cancel; uncancelled edges form closed loops, the rims.
    rim = _rim_edges(edge, triangles, uses)
    count = len(vertices)
    labels = connected_component_labels(rim, count)[rim[:, 0]]
    holes, hole = np.unique(labels, return_inverse=True)
    sizes = np.bincount(hole)
    middles = np.stack(
        [np.bincount(hole, vertices[rim[:, 0], k]) / sizes for k in range(3)], axis=1
    )
    caps = np.stack([rim[:, 1], rim[:, 0], count + hole], axis=1).astype(np.int32)
    with_middles = np.concatenate([vertices, middles])
    open_edges = int(np.count_nonzero(uses % 2))
    if _area(with_middles, caps) > LARGEST_HOLES * _area(vertices, triangles):
        raise InputError(
            f"'{name}' is not closed: {open_edges} of its {len(uses)} edges lack a face on one "
            f"side; fill the holes or merge the vertices there."
        )
    filled = "1 hole was" if len(holes) == 1 else f"{len(holes)} holes were"
    note = f"'{name}' is open at {open_edges} edges: {filled} filled for the volume"
    return with_middles, np.concatenate([triangles, caps]), note


def _rim_edges(edge: I64, triangles: I32, uses: I64) -> I64:
    """Directed edges (n, 2) of hole rims, in the direction of the surplus use. Only edges with an
    odd number of uses; repeated for each surplus use."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    balance = _balance(edge, starts < ends)
    firsts = np.zeros(len(uses), np.int64)
    firsts[edge] = np.arange(len(edge))
    is_unbalanced = (uses % 2 == 1) & (balance != 0)
    edges = np.repeat(np.arange(len(uses)), np.where(is_unbalanced, np.abs(balance), 0).astype(int))
    start, end = starts[firsts[edges]], ends[firsts[edges]]
    low, high = np.minimum(start, end), np.maximum(start, end)
    upwards = balance[edges] > 0
    return np.stack([np.where(upwards, low, high), np.where(upwards, high, low)], axis=1).astype(
        np.int64
    )


def _area(vertices: F64, triangles: I32) -> float:
    """Sum of the triangles' areas, relative to the square of the mesh's extent."""
    from trimesh.triangles import area

    size = np.abs(vertices - vertices[0]).max() or 1.0  # areas of tiny meshes would underflow
    return float(area(vertices[triangles] / size).sum())


def winding_groups(triangles: npt.NDArray[np.integer[Any]]) -> npt.NDArray[np.integer[Any]]:
    """Connected component, (2, F), of each triangle as it is, and flipped.

    Links of the graph join neighbours, across edges of exactly two triangles, that use this edge in
    opposite directions. The two components of an orientable piece are its two consistent windings;
    components are numbered in the order of their first triangle, unflipped first.
    """
    from trimesh.graph import connected_component_labels, face_adjacency

    count = len(triangles)
    pairs, shared = face_adjacency(triangles, return_edges=True)
    corners = triangles[pairs]  # (n, 2, 3)
    ahead = (corners == shared[:, None, :1]) & (np.roll(corners, -1, axis=2) == shared[:, None, 1:])
    # Two triangles are consistent if they use the shared edge in opposite directions.
    differ = count * (ahead[:, 0].any(axis=1) == ahead[:, 1].any(axis=1))
    first_face, second_face = pairs.T
    links = np.stack(
        [first_face, second_face + differ, first_face + count, second_face + count - differ]
    ).reshape(2, 2, -1)
    labels = connected_component_labels(links.swapaxes(1, 2).reshape(-1, 2), 2 * count)
    return np.asarray(labels).reshape(2, count)


def _turns(triangles: I32) -> Bool:
    """Mask of triangles to flip so that neighbours agree, the fewest in each connected piece; of
    equally many those that leave the first triangle of the piece as it is."""
    as_is, turned = winding_groups(triangles)
    count = len(triangles)
    votes = np.bincount(as_is, minlength=2 * count)
    more = votes[turned] - votes[as_is]
    first = np.full(2 * count, count)
    np.minimum.at(first, as_is, np.arange(count))
    return (more > 0) | ((more == 0) & (first[turned] < first[as_is]))


def decimated(
    vertices: F64, triangles: I32, bound: float, to_surface: Callable[[F64], F64]
) -> tuple[F64, I32] | None:
    """Decimate a closed mesh, both surfaces at most ``bound`` apart; None without much gain.

    Measured at all vertices of the mesh, and at the vertices and face centres of the result. The
    result, vertices (v, 3) and triangles (f, 3), is closed; its volume differs by at most the
    mesh's area times the bound. ``to_surface`` gives distances (N,) of points (3, N) to the mesh.
    Raises ImportError without fast-simplification or trimesh.
    """
    import fast_simplification
    from trimesh.triangles import area

    corners = vertices[triangles]
    size, total = float(np.ptp(vertices, axis=0).max()), float(area(corners).sum())
    if not 0.0 < np.sqrt(total / len(triangles)) <= _FINE * bound:
        return None
    middle = vertices.mean(axis=0)
    points, faces = (vertices - middle) / size, triangles  # thresholds suit size 1
    candidates: list[tuple[F64, I32]] = []
    for _ in range(_STEPS):
        before = len(faces)
        points, faces = fast_simplification.simplify(
            points, faces, target_count=before // _SHARE, agg=_AGGRESSIVENESS
        )
        if not 4 <= len(faces) <= _LEAST_GAIN * before:
            break
        step = points * size + middle, faces.astype(np.int32)
        if _farthest(vertices[::_SPARSE], *step) > bound:
            break
        candidates.append(step)
    # The coarsest step first; the full measurement is dear.
    while candidates:
        step = candidates.pop()
        if _is_within(vertices, triangles, *step, bound, to_surface):
            return step
    return None


def _is_within(
    vertices: F64,
    triangles: I32,
    points: F64,
    faces: I32,
    bound: float,
    to_surface: Callable[[F64], F64],
) -> bool:
    """Test a decimated mesh (points, faces): closed, within ``bound`` both ways and in volume. The
    volume may differ by the area times ``bound``."""
    from trimesh.triangles import area, mass_properties

    if not is_closed(faces) or _farthest(vertices, points, faces) > bound:
        return False
    corners = (vertices - vertices[0])[triangles]
    volume, new_volume = (
        mass_properties(part, skip_inertia=True).volume
        for part in (corners, (points - vertices[0])[faces])
    )
    # A lost part, such as a thin fin, may be near the surface and still change the volume.
    if abs(volume - new_volume) > bound * area(corners).sum():
        return False
    places = np.concatenate([points[np.unique(faces)], points[faces].mean(axis=1)])
    return bool(to_surface(np.ascontiguousarray(places.T)).max() <= bound)


def _farthest(places: F64, points: F64, faces: I32) -> float:
    """Largest distance of ``places`` (n, 3) to the surface of the mesh (points, faces)."""
    tree = TriangleTree(points[faces] - points[0])
    return float(tree.distances(np.ascontiguousarray((places - points[0]).T)).max())
