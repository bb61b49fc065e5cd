# SPDX-License-Identifier: GPL-3.0-or-later
"""Optional fields of samples: motion, depth, surface, impacts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from ..active_rows import posed_rows
from ..arrays import F32, F64, I32, I64
from ..contact.contact_query import ContactDetails, Contacts
from ..samples import Impact
from ..scene import EffectBlock, PoseBlock, TimeBase
from ..skin.posing import PosableModel
from ..volume.nearest_surface import boundary_normals, nearest_surface
from ..volume.shape import Shape

ON_DEMAND: Final = frozenset({"positions", "velocities", "depth"})
"""Optional fields stored in tracks."""

ON_DEMAND_HERE: Final = frozenset({"surface", "impact"})
"""Optional fields not stored in tracks."""


def motion(
    model: PosableModel,
    pose: PoseBlock,
    rows: I64,
    vertices: list[I32],
    indices: I64,
    step_s: float,
    *,
    with_velocities: bool,
) -> tuple[F32, F32]:
    """World positions and velocities (total, 3) of the vertices of each row, concatenated.

    Velocities are central differences of the neighbouring samples; one-sided where a neighbour is
    missing in the block or without pose; 0 without neighbours, or without ``with_velocities``.
    """
    is_posed = np.zeros(len(indices), np.bool_)
    is_posed[posed_rows(pose)] = True
    # follows[k]: row k is one sample after row k - 1; False at both ends.
    follows = np.zeros(len(indices) + 1, np.bool_)
    follows[1:-1] = is_posed[1:] & is_posed[:-1] & (np.diff(indices) == 1)

    def places(row: int, ids: I32) -> F64:
        return model.points(ids, pose, row, pose.to_world[row])

    positions, velocities = [], []
    for row, ids in zip(rows.tolist(), vertices, strict=True):
        here = places(row, ids)
        positions.append(here.T)
        before, after = row - int(follows[row]), row + int(follows[row + 1])
        if not with_velocities or before == after:
            velocities.append(np.zeros_like(here.T))
            continue
        displacement = (places(after, ids) if after > row else here) - (
            places(before, ids) if before < row else here
        )
        velocities.append(displacement.T / (step_s * (after - before)))
    return np.concatenate(positions).astype(np.float32), np.concatenate(velocities).astype(
        np.float32
    )


def _by_row(
    animated: EffectBlock, hits: Contacts
) -> Iterator[tuple[slice, Shape, F64, ContactDetails]]:
    """Yield (slice of the contacts, shape, matrix (4, 4), details of all contacts) for each row
    with contacts."""
    assert animated.matrices is not None and hits.details is not None
    for k, row in enumerate(hits.rows):
        part = slice(int(hits.offsets[k]), int(hits.offsets[k + 1]))
        shape_id = 0 if animated.shape_index is None else int(animated.shape_index[row])
        yield part, animated.shapes[shape_id], animated.matrices[row], hits.details


def depths(animated: EffectBlock, hits: Contacts) -> F32:
    """Distance (total,) of each contact's position from the volume's boundary, metres, float32."""
    depths = np.zeros(len(hits.vertices), np.float32)
    for part, shape, matrix, details in _by_row(animated, hits):
        depths[part] = shape.depth_m(details.places[:, part], matrix)
    return depths


def surface(animated: EffectBlock, hits: Contacts) -> tuple[F32, F32]:
    """Nearest boundary points and outward normals (total, 3 each) of the contacts, world space,
    metres."""
    places = np.zeros((len(hits.vertices), 3), np.float32)
    normals = np.zeros_like(places)
    for part, shape, matrix, details in _by_row(animated, hits):
        boundary_points, normal = nearest_surface(shape, details.places[:, part], matrix)
        places[part], normals[part] = boundary_points.T, normal.T
    return places, normals


def impact(animated: EffectBlock, hits: Contacts, indices: I64, time: TimeBase) -> Impact:
    """Times (seconds), approach speeds (m/s, at least 0) and normals of contacts begun since the
    previous sample; NaN for earlier contacts. ``indices`` are the block's sample indices."""
    count = len(hits.vertices)
    times, speeds = np.full(count, np.nan), np.full(count, np.nan, np.float32)
    normals = np.full((count, 3), np.nan, np.float32)
    rate = float(time.rate_hz)
    ends = time.times_s(indices[hits.rows])
    for end, (part, shape, matrix, details) in zip(ends, _by_row(animated, hits), strict=True):
        begun = np.flatnonzero(~np.isnan(details.since[part])) + part.start
        if len(begun):
            normal = boundary_normals(shape, details.entries[:, begun], matrix)
            velocity = matrix[:3, :3] @ details.ways[:, begun]
            # ``since`` is the time within the last interval (0..1) at which the contact began.
            times[begun] = end + (details.since[begun] - 1.0) / rate
            speeds[begun] = np.maximum(-np.einsum("in,in->n", velocity, normal) * rate, 0.0)
            normals[begun] = normal.T
    return Impact(times, speeds, normals)
